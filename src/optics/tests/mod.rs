//! Cluster optics against formulas and traced rays.

mod axes;
mod certificates;
mod extinction;
mod sanity;
mod sizes;

use super::*;
use crate::clusters;
use crate::embree::{CommittedScene, committed};
use crate::ray::{EndRule, LANES, Occluder, Packet};
use crate::scene::testing::{Pieces, cloud, direction, in_cube, unit};
use glam::{DMat3, DVec3, Vec3};
use rand_pcg::Pcg64Mcg;

/// A hierarchy without large surfaces, and the optics of all its clusters.
fn measured(scene: &Scene, options: &Options) -> (clusters::Tree, Vec<ClusterOptics>) {
    let apart = clusters::Options { large_surface: f32::INFINITY, ..Default::default() };
    let hierarchy = clusters::build(scene, &apart);
    hierarchy.check(scene).expect("hierarchy");
    assert!(hierarchy.large.order.is_empty());
    let optics = measure(scene, &hierarchy.micro, options);
    (hierarchy.micro, optics)
}

/// Optics of the root cluster.
fn whole(pieces: Pieces, options: &Options) -> ClusterOptics {
    measured(&pieces.scene(), options).1[0]
}

fn options() -> Options {
    Options { tolerance: 0.1, ..Options::default() }
}

/// Whether each segment is unoccluded, by Embree.
fn clear(scene: &CommittedScene, segments: &[(Vec3, Vec3)]) -> Vec<bool> {
    let packets: Vec<Packet> = segments
        .chunks(LANES)
        .map(|chunk| {
            let mut packet = Packet::EMPTY;
            chunk.iter().enumerate().for_each(|(i, &(a, b))| packet.set(i, a, b, EndRule::new(1.0)));
            packet
        })
        .collect();
    let mut blocked = vec![0; packets.len()];
    scene.occluded(&packets, &mut blocked);
    (0..segments.len()).map(|i| blocked[i / LANES] >> (i % LANES) & 1 == 0).collect()
}

/// A table of 1 x 1 x 1: a top and four legs.
fn table() -> Pieces {
    let mut pieces = Pieces::new();
    pieces.cuboid(DVec3::new(0.0, 0.0, 0.9), DVec3::ONE);
    for (x, y) in [(0.0, 0.0), (0.9, 0.0), (0.0, 0.9), (0.9, 0.9)] {
        pieces.cuboid(DVec3::new(x, y, 0.0), DVec3::new(x + 0.1, y + 0.1, 0.9));
    }
    pieces
}

fn louvres() -> Pieces {
    let mut pieces = Pieces::new();
    for i in 0..10 {
        let turn = DMat3::from_rotation_x(0.6) * DMat3::from_diagonal(DVec3::new(1.0, 0.1, 0.004));
        pieces.block(DVec3::new(0.0, 0.0, 0.1 * f64::from(i)), turn);
    }
    pieces
}

/// Mean transmittance of 20,000 parallel lines through the box along `view`: traced, and by extinction `kappa`.
fn pass_along(
    view: Vec3,
    kappa: f32,
    optics: &ClusterOptics,
    bounds: crate::math::Aabb,
    traced: &CommittedScene,
) -> [f32; 2] {
    let mut random = Pcg64Mcg::new(9);
    let centre = bounds.center();
    let (u, v) = view.any_orthonormal_pair();
    let half = 0.5 * bounds.extent();
    let reach = (half.dot(u.abs()), half.dot(v.abs()));
    let inverse = Vec3::from(view.to_array().map(|d| if d == 0.0 { 1e30 } else { 1.0 / d }));
    let (mut lines, mut paths) = (Vec::new(), Vec::new());
    while lines.len() < 20_000 {
        let mut offset = |reach: f32| (2.0 * unit(&mut random) as f32 - 1.0) * reach;
        let p = centre + offset(reach.0) * u + offset(reach.1) * v;
        let (a, b) = ((bounds.min - p) * inverse, (bounds.max - p) * inverse);
        let path = a.max(b).min_element() - a.min(b).max_element();
        if path > 0.0 {
            let out = 2.0 * bounds.diagonal() * view;
            lines.push((p - out, p + out));
            let middle = p + 0.5 * (a.max(b).min_element() + a.min(b).max_element()) * view;
            paths.push(path * (1.0 + optics.slope.dot(middle - centre)).max(0.0));
        }
    }
    let n = lines.len() as f32;
    let truth = clear(traced, &lines).into_iter().filter(|c| *c).count() as f32 / n;
    [truth, paths.iter().map(|l| (-kappa * l).exp()).sum::<f32>() / n]
}
