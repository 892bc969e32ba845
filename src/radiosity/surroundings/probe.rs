//! A few rays from every side: how much of a cluster's light meets the cluster itself, and from which sides rays leave the scene.

use super::side_rays::{ESCAPED, SideHit, SideRays};
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers, point_on};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{DarkSideHit, Element, Elements, Shape, Side};
use crate::radiosity::rgb::mean;
use crate::ray::Packet;
use crate::visibility::Exact;

/// Results of the rays.
pub struct Surroundings {
    /// By cluster: fraction of the light of its sides that meets its own sides, in `[0, 1]`.
    pub enclosed: Vec<f32>,
    /// By cluster: the same fraction of the light that its sides emit; 0 without emitters.
    pub enclosed_emission: Vec<f32>,
    /// By side: whether none of its rays left the scene.
    pub closed: Vec<bool>,
    /// By side: fraction of its rays that left the scene, in `[0, 1]`.
    pub escaped: Vec<f32>,
    /// By side: probability that one of two rays leaves the scene and the other does not, in `[0, 1]`. It is small within rooms and on
    /// the outsides of rooms, and not in the open.
    pub differ: Vec<f32>,
    /// Length of rays, more than the scene's diagonal; scene units.
    pub length: f32,
    /// Rays that met faces on a side without an element, in the order of the sides that they started from.
    pub entered: Vec<DarkSideHit>,
}

impl Surroundings {
    /// Of elements whose surroundings nobody asks for: none is closed, and nothing escapes.
    pub fn unknown(elements: &Elements, length: f32) -> Surroundings {
        let (sides, clusters) = (elements.sides.len(), elements.clusters.len());
        Surroundings {
            enclosed: vec![0.0; clusters],
            enclosed_emission: vec![0.0; clusters],
            closed: vec![false; sides],
            escaped: vec![0.0; sides],
            differ: vec![0.0; sides],
            length,
            entered: Vec::new(),
        }
    }
}

/// Smallest number of rays of a side. Without a local pass 1 or 8 instead change irradiance by 0.02 % or 0.19 %
/// (`constants.py solve`).
const MIN_RAYS: f64 = 2.0;
/// Largest number of rays of a side: a share that they measure has a standard error of at most 1 / (2 · 16) = 3 %.
const MAX_RAYS: f64 = 256.0;
/// Rays that all sides share by area: limit the time to 100,000 rays and [`MIN_RAYS`] per side. Without a local pass a
/// third or three times as many change irradiance by 0.31 % or 0.17 % (`constants.py solve`).
const SHARED_RAYS: f64 = 1e5;
/// Rays that emitting sides share by power besides: a tenth of [`SHARED_RAYS`].
const EMITTED_RAYS: f64 = 1e4;
/// Smallest number of rays, of a side or of all sides of its cluster, that must stay in the scene for a closed side: if a tenth
/// of a side's rays leave the scene, none of 24 rays does so with a probability of 0.9²⁴ = 8 %.
const MIN_CLOSED_RAYS: u32 = 24;
/// Sides that are traced after the deadline, evenly spread, and fraction of the area of all sides from which a side is always traced:
/// at most 2¹⁷ of two rays each and the shared rays take some 0.1 s.
const LATE_SIDES: usize = 1 << 16;
/// Rays of a leaf whose row sum is short: a standard error of at most 1 / (2 √64) = 0.0625.
const SHORT_ROW_RAYS: usize = 64;

/// Sides between two reports of progress: with [`MAX_RAYS`] rays each they take 0.1 s by the figure at [`LATE_SIDES`], and the bar of the
/// command is drawn every 0.2 s.
const SIDES_PER_REPORT: usize = 1 << 10;

/// Traces the rays of all sides; after the deadline, only those of a part of the sides. `length` exceeds the diagonal of the scene.
pub fn probe(
    elements: &Elements,
    exact: &Exact,
    length: f32,
    seed: u64,
    deadline: &Deadline,
) -> Surroundings {
    let sides = elements.sides.len();
    let step = sides.div_ceil(LATE_SIDES).max(1);
    let large = elements.area / LATE_SIDES as f64;
    let power = elements.sides.iter().map(|side| power_of(elements, side)).sum::<f64>();
    deadline.stage("surroundings of surfaces", sides);
    let tracer = SideRays { elements, exact, length };
    let found: Vec<(Vec<ProbeRay>, Vec<DarkSideHit>)> =
        parallel::map_with(parallel::at_least(64, 0..sides), Vec::new, |packets: &mut Vec<Packet>, s| {
            if s % SIDES_PER_REPORT == 0 {
                deadline.advance(SIDES_PER_REPORT.min(sides - s));
            }
            let small = elements.elements[elements.sides[s].element as usize].area < large;
            match s % step > 0 && small && deadline.late() {
                true => (Vec::new(), Vec::new()),
                false => rays_of_side(&tracer, seed, power, s, packets),
            }
        });
    let entered = found.iter().flat_map(|f| &f.1).copied().collect();
    let found: Vec<&Vec<ProbeRay>> = found.iter().map(|f| &f.0).collect();
    // For each cluster, the area and the emitted power that rays represent: of rays that meet the cluster, and of all traced rays.
    let mut enclosed = vec![[0.0; 2]; elements.clusters.len()];
    let mut traced = enclosed.clone();
    // By leaf cluster: rays, and rays that left the scene.
    let mut rays_of_leaf = vec![(0u32, 0u32); elements.clusters.len()];
    for (s, rays) in found.iter().enumerate() {
        let leaf = elements.elements[elements.sides[s].element as usize].parent as usize;
        let exitance = mean(elements.sides[s].exitance);
        for &ProbeRay { area, met } in *rays {
            let counts = [area, area * exitance];
            add(&mut traced[leaf], counts);
            rays_of_leaf[leaf].0 += 1;
            rays_of_leaf[leaf].1 += u32::from(met == ESCAPED);
            if met < sides as u32 {
                add(&mut enclosed[smallest_holding(elements, leaf, met)], counts);
            }
        }
    }
    for c in (1..enclosed.len()).rev() {
        let (parent, own) = (elements.elements[c].parent as usize, [enclosed[c], traced[c]]);
        add(&mut enclosed[parent], own[0]);
        add(&mut traced[parent], own[1]);
    }
    let closed = found
        .iter()
        .enumerate()
        .map(|(s, rays)| {
            let leaf = elements.elements[elements.sides[s].element as usize].parent as usize;
            let own = rays.iter().all(|ray| ray.met != ESCAPED);
            let (all, escaped) = rays_of_leaf[leaf];
            own && (rays.len() as u32 >= MIN_CLOSED_RAYS || (escaped == 0 && all >= MIN_CLOSED_RAYS))
        })
        .collect();
    let counts: Vec<[usize; 2]> =
        found.iter().map(|rays| [rays.iter().filter(|ray| ray.met == ESCAPED).count(), rays.len()]).collect();
    let escaped = counts.iter().map(|[gone, all]| *gone as f32 / (*all).max(1) as f32).collect();
    // Of all pairs of rays; a side without rays is not known to lie inside or outside.
    let differ = |&[gone, all]: &[usize; 2]| match all {
        0 => 1.0,
        _ => (2 * gone * (all - gone)) as f32 / (all * (all - 1)).max(1) as f32,
    };
    let differ = counts.iter().map(differ).collect();
    let part = |of: f64, all: f64| if all > 0.0 { (of / all).min(1.0) as f32 } else { 0.0 };
    let parts = |k: usize| enclosed.iter().zip(&traced).map(|(of, all)| part(of[k], all[k])).collect();
    Surroundings { enclosed: parts(0), enclosed_emission: parts(1), closed, escaped, differ, length, entered }
}

fn add(sums: &mut [f64; 2], counts: [f64; 2]) {
    sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
}

/// Power that a side emits, W.
fn power_of(elements: &Elements, side: &Side) -> f64 {
    elements.elements[side.element as usize].area * mean(side.exitance)
}

/// For each of some surfaces the fraction of its light that meets sides with elements, by a few rays.
pub fn received_shares(
    elements: &Elements,
    exact: &Exact,
    length: f32,
    seed: u64,
    surfaces: &[u32],
) -> Vec<f64> {
    let tracer = SideRays { elements, exact, length };
    let of = |packets: &mut Vec<Packet>, e: &u32| {
        let element = &elements.elements[*e as usize];
        let (mut met, seed) = (0, mix(!seed ^ element.ids[0]));
        rays(&tracer, element, SHORT_ROW_RAYS, seed, packets, |found| {
            met += usize::from(found.side < ESCAPED)
        });
        met as f64 / SHORT_ROW_RAYS as f64
    };
    parallel::map_with(parallel::at_least(16, surfaces), Vec::new, of)
}

/// One ray of a side.
struct ProbeRay {
    /// The part of the side's area that the ray represents, scene units squared.
    area: f64,
    /// The side that it meets, [`ESCAPED`], or [`Elements::NONE`] for a side without an element.
    met: u32,
}

/// The smallest cluster at or above `leaf` that holds a side.
fn smallest_holding(elements: &Elements, leaf: usize, side: u32) -> usize {
    let mut c = leaf;
    loop {
        let [from, to] = elements.clusters[c].sides;
        if (from..to).contains(&side) || c == 0 {
            return c;
        }
        c = elements.elements[c].parent as usize;
    }
}

/// The rays of a side, and those of them that met a side without an element. All sides together emit `power`.
fn rays_of_side(
    tracer: &SideRays,
    seed: u64,
    power: f64,
    s: usize,
    packets: &mut Vec<Packet>,
) -> (Vec<ProbeRay>, Vec<DarkSideHit>) {
    let elements = tracer.elements;
    let side = &elements.sides[s];
    let element = &elements.elements[side.element as usize];
    let emits = side.exitance.iter().any(|&m| m > 0.0);
    let of_emitters = if emits { EMITTED_RAYS * power_of(elements, side) / power } else { 0.0 };
    let count = MIN_RAYS + SHARED_RAYS * element.area / elements.area + of_emitters;
    let count = count.min(MAX_RAYS) as usize;
    let mut entered = Vec::new();
    let mut found = Vec::with_capacity(count);
    let seed = seed ^ (s as u64) << 20;
    rays(tracer, element, count, seed, packets, |SideHit { side, triangle, from, .. }| {
        found.push(ProbeRay { area: element.area / count as f64, met: side });
        if side == Elements::NONE {
            entered.push(DarkSideHit { triangle, from, emits });
        }
    });
    (found, entered)
}

/// Traces `count` cosine-weighted rays from a surface, and calls `each` with the hit of each ray.
fn rays(
    tracer: &SideRays,
    element: &Element,
    count: usize,
    seed: u64,
    packets: &mut Vec<Packet>,
    each: impl FnMut(SideHit),
) {
    let Shape::Surface { side, corners } = &element.shape else { return };
    let Side { normal, end, .. } = tracer.elements.sides[*side as usize];
    let rays = (0..count).map(|i| {
        let [u, v, p, q] = numbers(seed, i as u64);
        let at = point_on(corners, u, (i as f32 + v) / count as f32);
        ((at, normal, end), cosine_direction(normal, p, q))
    });
    tracer.trace(rays, packets, each);
}
