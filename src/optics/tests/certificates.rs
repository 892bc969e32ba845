//! Stated errors of clusters, and averaging widths where the errors are large.

use super::*;

/// The stated error agrees with rays in directions that are neither fitted nor probed. Clusters with large errors have
/// averaging widths larger than the whole cluster.
#[test]
fn certificates_hold_in_other_directions() {
    let mut random = Pcg64Mcg::new(21);
    let plate = || {
        let mut plate = Pieces::new();
        plate.block(
            DVec3::ZERO,
            DMat3::from_rotation_y(0.5) * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.002)),
        );
        plate
    };
    let cases = [
        ("leaves", cloud(2, 3000, 0.03, DVec3::ONE, true), true),
        ("cubes", cloud(1, 2000, 0.03, DVec3::ONE, false), true),
        ("louvres", louvres(), false),
        ("plate", plate(), false),
    ];
    for (name, pieces, good) in cases {
        let scene = pieces.scene();
        let (tree, optics) = measured(&scene, &options());
        let (traced, bounds) =
            (committed(&scene.positions, &scene.triangles), tree.clusters[0].bounds.thickened());
        let mut square = 0.0;
        for _ in 0..40 {
            let view = direction(&mut random);
            let kappa = AxisMix::around(view).mix(|axis| optics[0].extinction[axis]);
            let [truth, model] = pass_along(view, kappa, &optics[0], bounds, &traced);
            square += (truth - model).powi(2) / 40.0;
        }
        let (found, stated) = (square.sqrt(), optics[0].error);
        assert!(found < 2.0 * stated + 0.02, "{name}: {found} in 40 directions, certificate {stated}");
        assert!(found > 0.3 * stated - 0.01, "{name}: {found} in 40 directions, certificate {stated}");
        assert_eq!(stated < 0.05, good, "{name}: {stated}");
        let e = bounds.extent();
        let least = e.x.min(e.y).min(e.z).max(0.3 * e.max_element());
        let width = optics[0].averaging_width.iter().copied().fold(f32::MAX, f32::min);
        assert!(good || width > least, "{name}: averaged by beams of {width}");
    }
}

/// The averaging width separates contents that extinction describes from contents that it does not.
#[test]
fn averaging_width_grows_with_the_structure() {
    let width_of = |pieces| whole(pieces, &options()).averaging_width[2];
    // Each has optical depth 1.5 across the box: 1.5 n a² for n cubes of edge a.
    let fine = width_of(cloud(5, 1000, 0.0316, DVec3::ONE, false));
    let coarse = width_of(cloud(5, 16, 0.25, DVec3::ONE, false));
    // All contents in one half of the box, and one small cube that stretches the box.
    let mut lopsided = cloud(5, 500, 0.0316, DVec3::new(0.5, 1.0, 1.0), false);
    lopsided.cuboid(DVec3::new(0.99, 0.5, 0.5), DVec3::new(1.0, 0.51, 0.51));
    let lopsided = width_of(lopsided);
    assert!(fine < 0.5 * coarse, "cubes of 0.03: {fine}, of 0.25: {coarse}");
    assert!(lopsided > 2.0 * fine && lopsided > 0.3, "half a box: {lopsided}, a full one: {fine}");
}
