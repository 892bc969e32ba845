//! Cluster optics against formulas and traced rays.

mod certificates;
mod extinction;
mod sizes;

use super::*;
use crate::clusters;
use crate::embree::{CommittedScene, committed};
use crate::ray::{EndRule, LANES, Occluder, Packet};
use crate::scene::generate::{self, KINDS, Spec};
use crate::scene::testing::{Pieces, cloud, direction, in_cube, unit};
use glam::{DMat3, DQuat, DVec3, Vec3};
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

// The 13 axes and the interpolation between them.

#[test]
fn axis_mix_surrounds_the_direction() {
    let n = 21;
    for i in 0..n * n * n {
        let d = Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) - Vec3::splat(10.3);
        let mix = AxisMix::around(d);
        let sum: f32 = mix.weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5 && mix.weights.iter().all(|&w| w >= -1e-6), "{d}: {mix:?}");
        // The unnormalised axes, turned to the direction's side and weighted, sum to the direction.
        let length = [1.0f32, 2.0f32.sqrt(), 3.0f32.sqrt()];
        let back: Vec3 = (0..3)
            .map(|k| {
                let axis = AXES[mix.axes[k]];
                mix.weights[k] * length[k] * axis * axis.dot(d).signum()
            })
            .sum();
        assert!((back - d / d.abs().max_element()).length() < 1e-5, "{d}: {back}");
    }
}

#[test]
fn thirteen_axes_are_the_neighbours_of_a_cell() {
    for (i, a) in AXES.iter().enumerate() {
        assert!((a.length() - 1.0).abs() < 1e-6);
        let cell = a.to_array().map(|c| c.partial_cmp(&0.0).expect("a number") as i32 as f32);
        assert!((Vec3::from(cell).normalize() - a).length() < 1e-6, "axis {i} points at no neighbour");
        assert!(AXES[..i].iter().all(|b| a.dot(*b).abs() < 0.99), "axis {i} is there twice");
        let mix = AxisMix::around(-2.5 * a);
        let own = mix.axes.iter().zip(mix.weights).find(|(axis, _)| **axis == i);
        assert!(own.is_some_and(|(_, w)| (w - 1.0).abs() < 1e-5), "axis {i} is not its own mix: {mix:?}");
    }
}

/// A disc perpendicular to an axis has its largest blocker size along that axis: indices are not mixed up.
#[test]
fn each_axis_measures_its_own_direction() {
    for (k, &view) in AXES.iter().enumerate() {
        let turn = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, view.as_dvec3()));
        let corners: Vec<DVec3> = (0..48)
            .map(|i| turn * (DMat3::from_rotation_z(f64::from(i) * std::f64::consts::TAU / 48.0) * DVec3::X))
            .collect();
        let mut disc = Pieces::new();
        disc.polygon(&corners);
        let optics = whole(disc, &options());
        let largest =
            (0..AXIS_COUNT).max_by(|&a, &b| optics.blocker_size[a].total_cmp(&optics.blocker_size[b]));
        assert_eq!(largest, Some(k), "{optics:?}");
        assert!(
            (optics.blocker_size[k] - 2.0).abs() < 0.12,
            "axis {k}: a disc of diameter 2 measures {}",
            optics.blocker_size[k]
        );
    }
}

// Finite, bounded optics for every generated scene, independent of the number of threads.

#[test]
fn traits_are_sane_everywhere() {
    for kind in KINDS {
        let mut spec = Spec::new(kind.name);
        (spec.trees, spec.leaves, spec.trunks) = (9, 100, true);
        let scene = generate::build(&spec).expect(kind.name);
        let hierarchy = clusters::build(&scene, &Default::default());
        for extinction in [Extinction::Analytic, Extinction::Measured] {
            let optics = measure(&scene, &hierarchy.micro, &Options { extinction, ..options() });
            assert_eq!(optics.len(), hierarchy.micro.clusters.len());
            for (c, (t, cluster)) in optics.iter().zip(&hierarchy.micro.clusters).enumerate() {
                let size = cluster.bounds.thickened().diagonal();
                for (axis, view) in AXES.iter().enumerate() {
                    let place = format!("{}, cluster {c}, axis {axis}: {t:?}", kind.name);
                    assert!(t.extinction[axis].is_finite() && t.extinction[axis] >= 0.0, "{place}");
                    assert!((0.0..=1.0).contains(&t.coverage[axis]), "{place}");
                    // Tolerance: three of at least 32 pixels.
                    assert!((0.0..=1.1 * size).contains(&t.blocker_size[axis]), "{place}");
                    assert!((0.0..=1.1 * size).contains(&t.gap_size[axis]), "{place}");
                    assert!(t.averaging_width[axis].is_finite() && t.averaging_width[axis] >= 0.0, "{place}");
                    let feature = t.feature_size(axis);
                    assert!(feature >= t.blocker_size[axis] && feature.is_finite(), "{place}");
                    // Contents that cover less than a tenth may be thinner than a pixel; all others have a size. Of
                    // closed solids half of the faces are behind others.
                    let shown: f64 = hierarchy
                        .micro
                        .triangles_of(c)
                        .iter()
                        .map(|&t| {
                            let [a, b, c] = scene.corners(t);
                            let facing = crate::math::triangle_normal(a, b, c).dot(*view).abs();
                            let sides = f64::from(scene.triangle_sides[t as usize]);
                            0.5 * sides * f64::from(facing) * crate::math::triangle_area(a, b, c)
                        })
                        .sum();
                    let e = cluster.bounds.thickened().extent();
                    let front = Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y).dot(view.abs());
                    let edge_on = shown < 0.1 * f64::from(front);
                    assert!(feature > 0.0 || edge_on, "{} of the front: {place}", shown / f64::from(front));
                }
            }
        }
    }
}

/// Rectangles on the diagonal of boxes: along some axes they block all pixels of the box.
#[test]
fn optics_of_closed_silhouettes_are_in_range() {
    let mut random = rand_pcg::Pcg64Mcg::new(3);
    let mut pieces = Pieces::new();
    for _ in 0..2000 {
        let [p, size] = [5.0, 1e-3].map(|length| length * in_cube(&mut random));
        pieces.polygon(&[p, p + size.z * DVec3::Z, p + size, p + size.with_z(0.0)]);
    }
    let scene = pieces.scene();
    let tree = clusters::build(&scene, &Default::default()).micro;
    let longest = 4.0 * scene.bounds.diagonal();
    for (optics, cluster) in measure(&scene, &tree, &options()).iter().zip(&tree.clusters) {
        // The mean path along a diagonal of a box is at least the shortest edge divided by √3.
        let opaque = 3f32.sqrt() * SOLID_DEPTH / cluster.bounds.thickened().extent().min_element();
        assert!(optics.is_in_range(longest), "{cluster:?}: {optics:?}");
        assert!(optics.extinction.iter().all(|&kappa| kappa <= 1.001 * opaque), "{cluster:?}: {optics:?}");
    }
}
