//! Sides that no light reaches: the insides of boxes that stand on a floor, the rooms behind a closed door.
//!
//! An element of a floor under the edge of such a box is lit as a whole and would send light into the box; in closed rooms row
//! normalisation would even amplify that light. Sides that paths from all emitters never hit get no elements.

use super::side_rays::{SideHit, SideRays, SurfacePoint};
use crate::math::on_plane;
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers, point_on};
use crate::radiosity::elements::emitters::{EmitterFace, Emitters};
use crate::radiosity::elements::{Elements, Side};
use crate::ray::LANES;
use crate::scene::Scene;
use crate::visibility::Exact;
use serde::Serialize;

/// Packets of sixteen paths from all emitters: with [`BOUNCES`] at most 65,536 hits, so that [`MIN_EXPECTED_HITS`] are
/// expected on 1/2,048 of the area.
const PATH_PACKETS: usize = 1 << 9;
/// Bounces of each path: up to eight surfaces on the way from an emitter to a room behind several doors.
const BOUNCES: usize = 8;
/// Smallest number of hits in uniform light for which a side without any hit counts as unlit: a side that receives a tenth
/// of uniform light is missed by all paths with a probability of exp(−3.2) = 4 %.
const MIN_EXPECTED_HITS: f64 = 32.0;
/// Sides with less than this fraction of the hits in uniform light are dim: they lie in a room that little light enters, and some sides of
/// that room may be missed by chance. A side of 32 expected hits has fewer than 4 with a probability of 1e-10 in uniform light.
const MAX_DIM_HITS: f64 = 0.1;
/// Packets of sixteen rays from each side that may be unlit, which search for dim sides: one that covers a twentieth of
/// the hemisphere is found with a probability of 1 − 0.95⁶⁴ = 0.96.
const PACKETS_PER_SIDE: usize = 4;

/// Sides of surfaces without light, which have no elements. Scenes with clusters have none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Unlit {
    /// Number of unlit sides.
    pub sides: usize,
    /// Number of all sides.
    pub of: usize,
    /// Their fraction of the area of all sides, in `[0, 1]`.
    pub area: f64,
}

/// Traces paths from surface to surface.
struct Paths<'a> {
    scene: &'a Scene,
    rays: SideRays<'a>,
}

impl Paths<'_> {
    /// The sides that one cosine-weighted ray from each of sixteen points meets, and the points met.
    fn step(
        &self,
        points: &[Option<SurfacePoint>; LANES],
        seed: u64,
    ) -> [Option<(u32, SurfacePoint)>; LANES] {
        let known = (0..LANES).filter_map(|lane| Some((lane, points[lane]?)));
        let rays = known.clone().map(|(lane, point)| {
            let [u, v, ..] = numbers(seed, lane as u64);
            (point, cosine_direction(point.1, u, v))
        });
        let mut next = [None; LANES];
        let mut lanes = known.map(|(lane, _)| lane);
        self.rays.trace(rays, &mut Vec::new(), |SideHit { side, triangle, at, .. }| {
            let lane = lanes.next().unwrap_or_default();
            next[lane] = self.rays.elements.sides.get(side as usize).map(|&Side { normal, end, .. }| {
                (side, (on_plane(self.scene.corners(triangle), at), normal, end))
            });
        });
        next
    }

    /// Number of hits of each side by paths from all emitters.
    fn hits_by_side(&self, emitters: &[&Vec<EmitterFace>], seed: u64) -> Vec<u32> {
        let met: Vec<Vec<u32>> = parallel::map(0..PATH_PACKETS, |k| {
            let seed = mix(seed ^ mix(k as u64));
            let faces = emitters[k % emitters.len()];
            let mut points: [Option<SurfacePoint>; LANES] = std::array::from_fn(|lane| {
                let [u, v, face, _] = numbers(seed, lane as u64);
                let face = &faces[(face * faces.len() as f32) as usize % faces.len()];
                Some((point_on(&face.corners, u, v), face.normal, face.end))
            });
            let mut met = Vec::new();
            for bounce in 1..=BOUNCES {
                let next = self.step(&points, mix(seed ^ bounce as u64));
                met.extend(next.iter().flatten().map(|(side, _)| *side));
                points = next.map(|hit| hit.map(|(_, point)| point));
            }
            met
        });
        let mut counts = vec![0u32; self.rays.elements.sides.len()];
        met.iter().flatten().for_each(|&side| counts[side as usize] += 1);
        counts
    }

    /// The sides that rays from a side meet.
    fn around(&self, side: usize, seed: u64) -> Vec<usize> {
        let elements = self.rays.elements;
        let Side { normal, end, .. } = elements.sides[side];
        let corners = elements.corners(&elements.sides[side]);
        let mut seen = Vec::new();
        for k in 0..PACKETS_PER_SIDE {
            let points = std::array::from_fn(|lane| {
                let [u, v, ..] = numbers(mix(!seed ^ side as u64), (k * LANES + lane) as u64);
                Some((point_on(corners, u, v), normal, end))
            });
            let next = self.step(&points, mix(seed ^ mix((side * PACKETS_PER_SIDE + k) as u64)));
            seen.extend(next.into_iter().flatten().map(|(side, _)| side as usize));
        }
        seen
    }
}

/// Sides (ascending) that no path from an emitter hits although they are large enough for many hits, and that see no lit dim
/// side. None in scenes with clusters, whose local pass follows light from point to point, or with a sky.
pub fn unlit_sides(scene: &Scene, elements: &Elements, exact: &Exact, seed: u64) -> Vec<u32> {
    if scene.environment.is_some() || elements.large_from > 0 || lit_emitters(scene, elements) > PATH_PACKETS
    {
        return Vec::new();
    }
    let emitters = Emitters::new(scene, elements);
    let emitters: Vec<_> = emitters.emitters.iter().map(|e| &e.faces).filter(|f| !f.is_empty()).collect();
    if emitters.is_empty() {
        return Vec::new();
    }
    let paths = Paths { scene, rays: SideRays { elements, exact, length: scene.ray_length() } };
    let counts = paths.hits_by_side(&emitters, seed);
    let all: usize = counts.iter().map(|&n| n as usize).sum();
    let expected = |s: usize| {
        let element = elements.sides[s].element as usize;
        all as f64 * elements.elements[element].area / elements.area
    };
    let emits = |s: usize| elements.sides[s].exitance.iter().any(|&m| m > 0.0);
    let mut dark: Vec<bool> =
        (0..counts.len()).map(|s| counts[s] == 0 && expected(s) >= MIN_EXPECTED_HITS && !emits(s)).collect();
    let candidates: Vec<usize> = (0..counts.len()).filter(|&s| dark[s]).collect();
    let seen: Vec<Vec<usize>> = parallel::map(&candidates, |&s| paths.around(s, seed));
    let dim = |s: usize| f64::from(counts[s]) < MAX_DIM_HITS * expected(s);
    loop {
        let lit: Vec<usize> = (candidates.iter().zip(&seen))
            .filter(|(s, seen)| dark[**s] && seen.iter().any(|&t| !dark[t] && dim(t)))
            .map(|(s, _)| *s)
            .collect();
        if lit.is_empty() {
            break;
        }
        lit.into_iter().for_each(|s| dark[s] = false);
    }
    (0..counts.len()).filter(|&s| dark[s]).map(|s| s as u32).collect()
}

/// Number of emitters with a lit side.
fn lit_emitters(scene: &Scene, elements: &Elements) -> usize {
    let mut lit = vec![false; scene.emitters.len()];
    for side in elements.sides.iter().filter(|side| side.exitance.iter().any(|&m| m > 0.0)) {
        lit[scene.triangle_emitter[side.triangles[0] as usize] as usize] = true;
    }
    lit.into_iter().filter(|&lit| lit).count()
}
