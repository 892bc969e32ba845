//! What is said of errors, and what clusters are averaged by.

use super::*;

/// The certificate is what rays find wrong in directions that nobody fitted or probed, and what it calls bad is only
/// averaged by beams that are wider than all of it.
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
        let (traced, bounds) = (committed(&scene), tree.clusters[0].bounds.thickened());
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

/// The grain tells contents that extinction describes from contents that it does not (method D.12).
#[test]
fn grain_grows_with_the_structure() {
    let grain = |pieces| whole(pieces, &options()).averaging_width[2];
    // Optical depth 1.5 each: 1.5 n a².
    let fine = grain(cloud(5, 4000, 0.0158, DVec3::ONE, false));
    let coarse = grain(cloud(5, 16, 0.25, DVec3::ONE, false));
    // Everything in one half of the box, and something small that stretches the box.
    let mut lopsided = cloud(5, 2000, 0.0158, DVec3::new(0.5, 1.0, 1.0), false);
    lopsided.cuboid(DVec3::new(0.99, 0.5, 0.5), DVec3::new(1.0, 0.51, 0.51));
    let lopsided = grain(lopsided);
    assert!(fine < 0.5 * coarse, "cubes of 0.016: {fine}, of 0.25: {coarse}");
    assert!(lopsided > 2.0 * fine && lopsided > 0.3, "half a box: {lopsided}, a full one: {fine}");
}
