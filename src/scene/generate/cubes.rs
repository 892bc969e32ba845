//! Scenes of cubes: the paper's four groups, and random cubes.

use super::{
    Spec,
    shapes::{Builder, Random},
};
use crate::{Result, scene::Soup};
use glam::{DVec2, DVec3};

/// Edges of the cubes of the four groups, metres, from left to right.
pub(super) const EDGES: [f64; 4] = [0.1, 0.15, 0.2, 0.3];
/// Extents of the box of each group, metres: along the wall, perpendicular to the wall, vertical.
const GROUP: DVec3 = DVec3::new(2.0, 1.0, 2.0);
/// Distance between the centres of adjacent groups, metres.
const PITCH: f64 = 2.6;
/// Total area of the cubes' front faces relative to the front area of the group; equal for all groups, so that their
/// coverage is equal: −ln(1 − [`COVERAGE`]) = 0.56, rounded.
const LAYERS: f64 = 0.55;
/// Covered fraction of the group's silhouette seen along the line to the wall; each group is generated again until its
/// coverage is within [`COVERAGE_SLACK`]. The mean coverage of independent random cubes is about 1 − exp(−[`LAYERS`]).
pub(super) const COVERAGE: f64 = 0.43;
const COVERAGE_SLACK: f64 = 0.01;

/// Four groups of non-overlapping cubes, smallest on the left, largest on the right, before a wall; a small square
/// emitter on the other side (Sillion and Drettakis 1995, figures 1 and 9; the paper gives no dimensions).
pub(super) fn groups(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("cube-groups"), Random::new(spec.seed));
    b.object("wall").material("wall", [0.7; 3]);
    // The front faces +y, towards the groups.
    b.rectangle(DVec3::new(0.0, 0.0, 2.0), 12.0 * DVec3::Z, 12.0 * DVec3::X);
    b.material("cube", [0.5, 0.5, 0.55]);
    for (i, edge) in EDGES.into_iter().enumerate() {
        let centre = DVec3::new((i as f64 - 1.5) * PITCH, 1.6, 2.0);
        b.object(format!("group {}", i + 1));
        for p in group(&mut random, edge) {
            b.cuboid(centre + p, centre + p + DVec3::splat(edge));
        }
    }
    let size = spec.light_size.unwrap_or(0.25);
    b.light(DVec3::new(0.0, 8.0, 2.0), size * DVec3::X, size * DVec3::Z, 800.0);
    Ok(b.soup)
}

/// Lower corners of one group's cubes, relative to its centre.
fn group(random: &mut Random, edge: f64) -> Vec<DVec3> {
    let count = (LAYERS * GROUP.x * GROUP.z / (edge * edge)).round() as usize;
    let mut best = (f64::MAX, Vec::new());
    // Limits the number of attempts; the best one is used.
    for _ in 0..300 {
        let cubes = place(random, edge, count);
        let miss = (coverage(&cubes, edge) - COVERAGE).abs();
        if miss < best.0 {
            best = (miss, cubes);
        }
        if miss < COVERAGE_SLACK {
            break;
        }
    }
    best.1
}

/// Cubes of one size with gaps of at least 2 % of their edge, so that none touch; by rejection.
fn place(random: &mut Random, edge: f64, count: usize) -> Vec<DVec3> {
    let (lo, hi) = (-0.5 * GROUP, 0.5 * GROUP - DVec3::splat(edge));
    let mut cubes: Vec<DVec3> = Vec::with_capacity(count);
    for _ in 0..10_000 {
        if cubes.len() == count {
            break;
        }
        let p = random.point(lo, hi);
        if cubes.iter().all(|q| (p - q).abs().max_element() > 1.02 * edge) {
            cubes.push(p);
        }
    }
    cubes
}

/// Covered fraction of the group's front, by sampling.
pub(super) fn coverage(cubes: &[DVec3], edge: f64) -> f64 {
    let n = 128;
    let hit = |i: usize| {
        let cell = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / n as f64;
        let p = (cell - 0.5) * DVec2::new(GROUP.x, GROUP.z);
        cubes.iter().any(|c| (0.0..edge).contains(&(p.x - c.x)) && (0.0..edge).contains(&(p.y - c.z)))
    };
    (0..n * n).filter(|&i| hit(i)).count() as f64 / (n * n) as f64
}

/// Randomly turned cubes in a 10 m box above a floor. n cubes of edge a have a mean projected area of 1.5 n a²; the
/// edge is chosen so that the optical depth is about 1 for any n.
pub(super) fn random(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("cubes"), Random::new(spec.seed));
    let (count, size) = (spec.count.unwrap_or(200), 10.0);
    let edge = size / (1.5 * count as f64).sqrt();
    b.object("floor").material("floor", [0.6; 3]);
    b.rectangle(DVec3::ZERO, 2.0 * size * DVec3::X, 2.0 * size * DVec3::Y);
    b.object("cubes").material("cube", [0.5, 0.45, 0.4]);
    let half = 0.5 * size;
    for _ in 0..count {
        let centre = random.point(DVec3::new(-half, -half, edge), DVec3::new(half, half, size));
        b.turned_box(centre, DVec3::splat(edge), random.rotation());
    }
    let light = spec.light_size.unwrap_or(4.0);
    b.light(DVec3::new(0.0, 0.0, 2.0 * size), light * DVec3::Y, light * DVec3::X, 50.0);
    Ok(b.soup)
}
