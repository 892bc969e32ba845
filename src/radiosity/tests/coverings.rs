//! Sheets of several faces, in the planes of what they cover: the light is that of sheets a millimetre above.

use super::shared_walls::{check_contact, lamp};
use super::sheets::at;
use super::*;

fn above(x: f64, y: f64, z: f64) -> Point {
    Point { position: DVec3::new(x, y, z), normal: -DVec3::Z }
}

/// A road whose triangles are those of the terrain below it, across a crest and through a valley.
#[test]
fn roads_lie_on_terrain_of_the_same_triangles() {
    check_contact("road", &|gap| {
        let height = |x: f64, y: f64| 0.5 * (0.7 * x).sin() + 0.3 * (0.5 * y).cos();
        let mut pieces = Pieces::empty();
        let mut strip = |name: &str, reflectance: f32, columns: std::ops::Range<i32>, lift: f64| {
            pieces.grey(name, reflectance);
            for (i, j) in columns.flat_map(|i| (-6..6).map(move |j| (i, j))) {
                let at = |i: i32, j: i32| {
                    let [x, y] = [i, j].map(f64::from);
                    DVec3::new(x, y, height(x, y) + lift)
                };
                pieces.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                pieces.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        };
        strip("terrain", 0.9, -6..6, 0.0);
        strip("road", 0.05, -1..1, gap);
        lamp(&mut pieces, -3.0, 0.0, 5.0);
        lamp(&mut pieces, 3.0, -2.0, 5.0);
        (pieces, vec![above(0.0, 0.0, 1.2), above(0.0, 4.0, 0.8), above(4.0, 0.0, 1.5)])
    });
}

/// A runner on the treads and risers of an open stair, and mats on a roof terrace with two parapets and in a corner of two walls, which has the mat's size.
#[test]
fn runners_and_mats_lie_on_stairs_terraces_and_in_corners() {
    check_contact("runner", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([-3.0, 5.0], [-3.0, 5.0], 0.0));
        let mut stair = |name: &str, reflectance: f32, y: [f64; 2], lift: f64| {
            pieces.grey(name, reflectance);
            for step in 0..3 {
                let (x, z) = (0.4 * f64::from(step) - lift, 0.25 * f64::from(step) + lift);
                let corner = |x: f64, z: f64| DVec3::new(x, y[0], z);
                let across = (y[1] - y[0]) * DVec3::Y;
                let (foot, edge, end) = (
                    corner(x, if step == 0 { 0.0 } else { z }),
                    corner(x, z + 0.25),
                    corner(x + 0.4, z + 0.25),
                );
                pieces.polygon(&[foot + across, foot, edge, edge + across]);
                pieces.polygon(&[edge, end, end + across, edge + across]);
            }
        };
        stair("stair", 0.9, [0.0, 2.0], 0.0);
        stair("runner", 0.05, [0.5, 1.5], gap);
        lamp(&mut pieces, 0.0, 0.5, 3.0);
        (pieces, vec![above(0.2, 1.0, 0.7), above(0.6, 1.0, 0.9)])
    });
    check_contact("terrace", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(4.0, 4.0, 2.5 - gap));
        lamp(&mut pieces, 1.0, 1.0, 2.2);
        pieces.grey("terrace", 0.9).polygon(&facing_up([0.0, 5.0], [0.0, 5.0], 2.5));
        pieces.rectangle(DVec3::new(0.0, 0.0, 2.5), 5.0 * DVec3::Y, DVec3::Z);
        pieces.grey("mat", 0.05).polygon(&facing_up([1.0, 3.0], [1.0, 3.0], 2.5 + gap));
        lamp(&mut pieces, 3.0, 1.0, 5.0);
        (pieces, vec![above(2.0, 2.0, 3.0), at(2.0, 3.0, 0.0)])
    });
    check_contact("corner", &|gap| {
        let mut pieces = Pieces::empty();
        let size = [2.9, 3.7];
        pieces.grey("mat", 0.05).polygon(&facing_up([gap, size[0]], [gap, size[1]], gap));
        pieces.grey("set", 0.9).polygon(&facing_up([0.0, size[0]], [0.0, size[1]], 0.0));
        pieces.rectangle(DVec3::ZERO, size[1] * DVec3::Y, 2.1 * DVec3::Z);
        pieces.rectangle(DVec3::ZERO, 2.1 * DVec3::Z, size[0] * DVec3::X);
        lamp(&mut pieces, 1.0, 1.0, 3.0);
        (pieces, vec![above(1.4, 1.8, 0.5)])
    });
}
