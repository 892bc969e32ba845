//! Finite, bounded optics for every generated scene, independent of the number of threads.

use super::*;
use crate::scene::generate::{self, KINDS, Spec};

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
        let opaque = 3f32.sqrt() * OPAQUE_DEPTH / cluster.bounds.thickened().extent().min_element();
        assert!(optics.is_in_range(longest), "{cluster:?}: {optics:?}");
        assert!(optics.extinction.iter().all(|&kappa| kappa <= 1.001 * opaque), "{cluster:?}: {optics:?}");
    }
}
