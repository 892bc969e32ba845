//! Blocker sizes, gap sizes and connected sizes.

use super::*;
use std::f64::consts::PI;

/// Every piece of a finely tessellated ball has the size of the whole ball; clusters that hold whole objects keep their
/// own size (docs/method.md, Sizes of a cluster: connected size).
#[test]
fn pieces_of_one_surface_have_the_size_of_all_of_it() {
    let mut pieces = Pieces::new();
    let at = |i: usize, j: usize| {
        let (theta, phi) = (PI * i as f64 / 16.0, PI * j as f64 / 16.0);
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    for (i, j) in (0..16).flat_map(|i| (0..32).map(move |j| (i, j))) {
        let next = (j + 1) % 32;
        pieces.polygon(&[at(i, j), at(i + 1, j), at(i + 1, next)]);
        pieces.polygon(&[at(i, j), at(i + 1, next), at(i, next)]);
    }
    let (tree, optics) = measured(&pieces.scene(), &options());
    assert!(tree.clusters.len() > 50);
    for (c, optics) in optics.iter().enumerate().skip(1) {
        for axis in 0..AXIS_COUNT {
            // The ball's diameter is 2; tolerance two of 64 pixels.
            assert!(optics.feature_size(axis) > 1.9, "cluster {c}, axis {axis}: {optics:?}");
        }
    }
    let (_, optics) = measured(&cloud(1, 200, 0.05, DVec3::ONE, false).scene(), &options());
    let whole = optics.iter().filter(|t| t.connected_size == [0.0; AXIS_COUNT]).count();
    assert!(whole * 3 > optics.len(), "{whole} of {} clusters of cubes hold whole ones", optics.len());
}

/// Bars thinner than a pixel at regular distances do not all fall between pixel centres (docs/method.md, Traps: thin
/// bars).
#[test]
fn thin_bars_do_not_vanish() {
    for (bars, width) in [(5, 0.0125), (9, 0.00625)] {
        let mut fence = Pieces::new();
        for i in 0..bars {
            let x = 0.5 * width + (1.0 - width) * f64::from(i) / f64::from(bars - 1);
            fence.quad(DVec3::new(x, 0.5, 0.0), width * DVec3::X, DVec3::Y);
        }
        let covered = whole(fence, &options()).coverage[2];
        let truth = (f64::from(bars) * width) as f32;
        assert!((covered - truth).abs() < 0.035, "{bars} bars cover {truth}, measured {covered}");
    }
}

/// Largest discs inside projections of a unit square that faces z: 1 along z, 1/√2 along the axes tilted by 45°
/// (shorter side) and along the corners (a rhombus of that height), 0 along its plane. Tolerance: two of 32 pixels.
#[test]
fn size_of_a_plate_by_direction() {
    let mut plate = Pieces::new();
    plate.quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    let optics = whole(plate, &options());
    for (axis, view) in AXES.iter().enumerate() {
        let expect = match view.z.abs() {
            z if z > 0.99 => 1.0,
            z if z > 0.0 => std::f32::consts::FRAC_1_SQRT_2,
            _ => 0.0,
        };
        let found = optics.blocker_size[axis];
        assert!((found - expect).abs() <= 2.0 * 1.42 / 32.0, "{view}: {found}, not {expect}");
        // The box of a plate is thickened: seen from the side one of its pixels can be free.
        assert!(
            optics.gap_size[axis] <= 2.0 * 1.42 / 32.0,
            "{view}: a plate has no gaps of {}",
            optics.gap_size[axis]
        );
    }
}

/// Two unit plates, each of sixteen faces, with a slit of 0.3 between them.
#[test]
fn size_of_a_wall_with_a_slit() {
    let mut wall = Pieces::new();
    for (x, y) in (0..32).map(|k| (0.25 * f64::from(k % 8), 0.25 * f64::from(k / 8))) {
        let x = if x < 1.0 { x } else { x + 0.3 };
        wall.quad(DVec3::new(x + 0.125, y + 0.125, 0.0), 0.25 * DVec3::X, 0.25 * DVec3::Y);
    }
    let optics = whole(wall, &Options { tolerance: 1.0, ..options() });
    let pixel = 2.3 / 64.0;
    assert!((optics.gap_size[2] - 0.3).abs() < 2.0 * pixel, "the slit measures {}", optics.gap_size[2]);
    assert!(
        (optics.blocker_size[2] - 1.0).abs() < 2.0 * pixel,
        "a plate measures {}",
        optics.blocker_size[2]
    );
    assert!(
        optics.feature_size(2) >= optics.blocker_size[2].max(optics.gap_size[2]),
        "features are the larger of the two"
    );
}
