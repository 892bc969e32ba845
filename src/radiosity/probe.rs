//! A few rays from every side: how much of what a cluster sends out meets itself, and which sides see out of the scene.

use super::Solver;
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::radiosity::elements::{Element, Elements, Entered, Shape};
use crate::radiosity::links::{cosine_direction, mix, numbers, point_on};
use crate::ray::{EndRule, LANES, Packet};
use glam::Vec3;
use rayon::prelude::*;

/// What the rays found.
pub struct Probe {
    /// By cluster: part of what its sides send out that meets its own sides, in `[0, 1]`.
    pub enclosed: Vec<f32>,
    /// By side: none of its rays left the scene.
    pub closed: Vec<bool>,
    /// How far rays go, scene units: more than the scene's diagonal.
    pub length: f32,
    /// Rays that met faces on a side that has no element, in the order of their sides.
    pub entered: Vec<Entered>,
}

/// Most rays of a side; sides of a whole scene share about [`SHARED`] more of them by area.
const MOST: f64 = 256.0;
const SHARED: f64 = 1e5;
const LEAST: f64 = 2.0;
/// Rays that a cluster's closed sides must have together before a side's own few count.
const SURE: u32 = 24;

/// Rays leave so many roundings above their surface, and meet all from there on: walls that it ends at, too.
pub(super) const OFF: f32 = 5.0;

/// Traces the rays. `length` exceeds the scene's diagonal.
pub fn probe(
    elements: &Elements,
    traced: &CommittedScene,
    traversal: Traversal,
    ends: EndRule,
    length: f32,
    seed: u64,
) -> Probe {
    let sides = elements.sides.len();
    let found: Vec<(Rays, Vec<Entered>)> = (0..sides)
        .into_par_iter()
        .with_min_len(64)
        .map_init(Vec::new, |packets: &mut Vec<Packet>, s| {
            from_side(elements, (traced, traversal), ends, length, seed, s, packets)
        })
        .collect();
    let entered = found.iter().flat_map(|f| &f.1).copied().collect();
    let found: Vec<&Rays> = found.iter().map(|f| &f.0).collect();
    let mut meets = vec![0.0; elements.clusters.len()];
    let mut rays_of_leaf = vec![(0u32, 0u32); elements.clusters.len()];
    for (s, rays) in found.iter().enumerate() {
        let leaf = elements.elements[elements.sides[s].element as usize].parent as usize;
        for &(power, met) in *rays {
            rays_of_leaf[leaf].0 += 1;
            rays_of_leaf[leaf].1 += u32::from(met == ESCAPED);
            if met < sides as u32 {
                meets[holding(elements, leaf, met)] += power;
            }
        }
    }
    let mut enclosed = meets;
    for c in (1..enclosed.len()).rev() {
        enclosed[elements.elements[c].parent as usize] += enclosed[c];
    }
    let closed = found
        .iter()
        .enumerate()
        .map(|(s, rays)| {
            let leaf = elements.elements[elements.sides[s].element as usize].parent as usize;
            let own = rays.iter().all(|&(_, met)| met != ESCAPED);
            let (all, escaped) = rays_of_leaf[leaf];
            own && (rays.len() as u32 >= SURE || (escaped == 0 && all >= SURE))
        })
        .collect();
    let enclosed = enclosed
        .iter()
        .zip(&elements.elements)
        .map(|(power, e)| if e.area > 0.0 { (power / e.area).min(1.0) as f32 } else { 0.0 })
        .collect();
    Probe { enclosed, closed, length, entered }
}

/// What each ray of a side carries, and the side that it meets.
type Rays = Vec<(f64, u32)>;

/// Stands for a ray that left the scene.
const ESCAPED: u32 = u32::MAX - 1;

/// The smallest cluster above `leaf` that holds a side.
fn holding(elements: &Elements, leaf: usize, side: u32) -> usize {
    let mut c = leaf;
    loop {
        let [from, to] = elements.clusters[c].sides;
        if (from..to).contains(&side) || c == 0 {
            return c;
        }
        c = elements.elements[c].parent as usize;
    }
}

/// What each ray of a side carries and meets: a side, [`ESCAPED`], or [`Elements::NONE`] for the dark side of a face; and
/// those rays.
fn from_side(
    elements: &Elements,
    (traced, traversal): (&CommittedScene, Traversal),
    ends: EndRule,
    length: f32,
    seed: u64,
    s: usize,
    packets: &mut Vec<Packet>,
) -> (Rays, Vec<Entered>) {
    let side = &elements.sides[s];
    let element = &elements.elements[side.element as usize];
    let count = (LEAST + SHARED * element.area / elements.area).min(MOST) as usize;
    let mut entered = Vec::new();
    let emits = side.exitance.iter().any(|&m| m > 0.0);
    let mut rays = Vec::with_capacity(count);
    let seed = seed ^ (s as u64) << 20;
    look(
        elements,
        (traced, traversal),
        ends,
        length,
        (element, count, seed),
        packets,
        |met, triangle, from| {
            rays.push((element.area / count as f64, met));
            if met == Elements::NONE {
                entered.push(Entered { triangle, from, emits });
            }
        },
    );
    (rays, entered)
}

/// Tells of each of `count` rays from a surface what side it meets, [`ESCAPED`] or [`Elements::NONE`], on what face, and where
/// it comes from.
fn look(
    elements: &Elements,
    (traced, traversal): (&CommittedScene, Traversal),
    ends: EndRule,
    length: f32,
    (element, count, seed): (&Element, usize, u64),
    packets: &mut Vec<Packet>,
    mut tell: impl FnMut(u32, u32, Vec3),
) {
    let Shape::Surface { side, corners } = &element.shape else { return };
    let normal = elements.sides[*side as usize].normal;
    packets.clear();
    for i in 0..count {
        if i % LANES == 0 {
            packets.push(Packet::EMPTY);
        }
        let [u, v, p, q] = numbers(seed, i as u64);
        let from = point_on(corners, u, (i as f32 + v) / count as f32) + OFF * ends.slack() * normal;
        let to = from + length * cosine_direction(normal, p, q);
        let packet = packets.last_mut().expect("just pushed");
        packet.set(i % LANES, from, to, ends);
        packet.near[i % LANES] = 0.0;
    }
    let mut hits = vec![Hits::NONE; packets.len()];
    traced.first_hits(traversal, packets, &mut hits);
    for i in 0..count {
        let packet = &packets[i / LANES];
        let from = packet.point(i % LANES, 0.0);
        let triangle = hits[i / LANES].triangle[i % LANES];
        let met = match triangle {
            Hits::NOTHING => ESCAPED,
            t => elements.met(t, packet.point(i % LANES, 1.0) - from),
        };
        tell(met, triangle, from);
    }
}

/// Rays of a leaf whose row is short.
const DOUBTED: usize = 64;

impl Solver {
    /// Part of what each of some surfaces sends out that meets a side light can reach, by a few rays of their own.
    pub(super) fn received(&self, surfaces: &[u32]) -> Vec<f64> {
        let exact = self.sight.exact();
        let of = |packets: &mut Vec<Packet>, e: &u32| {
            let element = &self.elements.elements[*e as usize];
            let (mut met, rays) = (0, (element, DOUBTED, mix(!self.seed ^ element.ids[0])));
            let traced = (&exact.scene, exact.traversal);
            look(&self.elements, traced, self.ends, self.probe.length, rays, packets, |side, _, _| {
                met += usize::from(side < ESCAPED);
            });
            met as f64 / DOUBTED as f64
        };
        surfaces.par_iter().with_min_len(16).map_init(Vec::new, of).collect()
    }
}
