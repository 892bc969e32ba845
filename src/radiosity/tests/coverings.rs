//! Sheets of several faces, in the planes of what they cover: the light is that of sheets a millimetre above.

use super::shared_walls::{check_contact, lamp};
use super::sheets::at;
use super::*;

fn above(x: f64, y: f64, z: f64) -> Point {
    Point { position: DVec3::new(x, y, z), normal: -DVec3::Z }
}

/// A road whose triangles are those of the terrain below it, across a crest and through a valley. It is larger than the tiles of a terrain
/// of nine parts.
#[test]
fn roads_lie_on_terrain_of_the_same_triangles() {
    for tiles in [1, 3] {
        check_contact(&format!("road on {tiles} x {tiles} tiles"), &|gap| {
            let height = |x: f64, y: f64| 0.5 * (0.7 * x).sin() + 0.3 * (0.5 * y).cos();
            let mut pieces = Pieces::empty();
            let mut strip = |name: &str, reflectance: f32, area: [std::ops::Range<i32>; 2], lift: f64| {
                pieces.grey(name, reflectance);
                let [columns, rows] = area;
                for (i, j) in columns.flat_map(|i| rows.clone().map(move |j| (i, j))) {
                    let at = |i: i32, j: i32| {
                        let [x, y] = [i, j].map(f64::from);
                        DVec3::new(x, y, height(x, y) + lift)
                    };
                    pieces.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                    pieces.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            };
            let size = 12 / tiles;
            for (a, b) in (0..tiles).flat_map(|a| (0..tiles).map(move |b| (a, b))) {
                let area = [a, b].map(|k| k * size - 6..(k + 1) * size - 6);
                strip(&format!("terrain {a} {b}"), 0.9, area, 0.0);
            }
            strip("road", 0.05, [-1..1, -6..6], gap);
            lamp(&mut pieces, -3.0, 0.0, 5.0);
            lamp(&mut pieces, 3.0, -2.0, 5.0);
            (pieces, vec![above(0.0, 0.0, 1.2), above(0.0, 4.0, 0.8), above(4.0, 0.0, 1.5)])
        });
    }
}

/// A runner on the treads and risers of an open stair, or on these, the floor of a room and the landing; a cloth on two tables that are
/// open below; and mats on a roof terrace with two parapets and in a corner of two walls, which has the mat's size.
#[test]
fn runners_and_mats_lie_on_stairs_terraces_and_in_corners() {
    /// Faces between the points of a profile in the plane of x and z.
    fn faces(pieces: &mut Pieces, name: &str, reflectance: f32, y: [f64; 2], profile: &[[f64; 2]]) {
        pieces.grey(name, reflectance);
        for ends in profile.windows(2) {
            let at = |end: usize, side: usize| DVec3::new(ends[end][0], y[side], ends[end][1]);
            pieces.polygon(&[at(0, 1), at(0, 0), at(1, 0), at(1, 1)]);
        }
    }
    let stair = [[0.0, 0.0], [0.0, 0.25], [0.4, 0.25], [0.4, 0.5], [0.8, 0.5], [0.8, 0.75]];
    for is_long in [false, true] {
        check_contact(if is_long { "long runner" } else { "runner" }, &|gap| {
            let mut pieces = Pieces::empty();
            pieces.grey("room", 0.5).room(DVec3::new(-3.0, -1.0, 0.0), DVec3::new(5.0, 3.0, 4.0));
            let mut under = stair.to_vec();
            let mut runner: Vec<[f64; 2]> = stair.iter().map(|[x, z]| [x - gap, z + gap]).collect();
            if is_long {
                under.push([3.0, 0.75]);
                runner.insert(0, [-2.0, gap]);
                runner.push([2.5, 0.75 + gap]);
            }
            faces(&mut pieces, "stair", 0.9, [0.0, 2.0], &under);
            faces(&mut pieces, "runner", 0.05, [0.6, 1.4], &runner);
            lamp(&mut pieces, 0.0, 0.5, 3.9);
            lamp(&mut pieces, 3.0, 1.0, 3.9);
            (pieces, vec![at(-0.1, 1.0, 0.12), above(0.2, 1.0, 0.7), above(0.6, 1.0, 0.9)])
        });
    }
    check_contact("cloth", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([-3.0, 5.0], [-3.0, 5.0], 0.0));
        for table in [0.0, 1.0] {
            let profile = [[table, 0.4], [table, 0.7], [table + 1.0, 0.7], [table + 1.0, 0.4]];
            faces(&mut pieces, &format!("table {table}"), 0.9, [0.0, 1.0], &profile);
            let corner = |k: usize| DVec3::new(profile[k][0], 0.0, profile[k][1]);
            pieces.polygon(&[corner(0), corner(3), corner(2), corner(1)]);
            pieces.polygon(&[1, 2, 3, 0].map(|k| corner(k) + DVec3::Y));
        }
        let cloth = [[-gap, 0.5], [-gap, 0.7 + gap], [2.0 + gap, 0.7 + gap], [2.0 + gap, 0.5]];
        faces(&mut pieces, "cloth", 0.05, [0.2, 0.8], &cloth);
        lamp(&mut pieces, 0.5, 0.5, 3.0);
        (pieces, vec![above(0.5, 0.5, 1.0), above(1.5, 0.5, 1.0)])
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

/// Boards from x = -0.02 to `width` + 0.02, and as long, each shifted by `offset` so that they share no corners.
fn boards(pieces: &mut Pieces, reflectance: f32, [width, length]: [f64; 2], offset: f64, z: f64) {
    for k in 0..5 {
        let [x, y] = [0.2 * (width + 0.04) * f64::from(k) - 0.02, offset * f64::from(k) - 0.02];
        let board = facing_up([x, x + 0.2 * (width + 0.04)], [y, y + length + 0.04], z);
        pieces.grey(&format!("board {k}"), reflectance).polygon(&board);
    }
}

#[derive(Clone, Copy, Debug)]
enum Walls {
    FacingIn,
    FacingOut,
    Boxes,
}

/// Walls around a floor, 2 m high.
fn walls(pieces: &mut Pieces, of: Walls, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) {
    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| DVec3::new(x, y, 0.0));
    for k in 0..4 {
        let [a, b] = [corners[k], corners[(k + 1) % 4]];
        let out = 0.1 * (b - a).normalize().cross(DVec3::Z);
        pieces.grey(&format!("wall {k} at {x0}"), 0.5);
        match of {
            Walls::FacingIn => pieces.rectangle(b, a - b, 2.0 * DVec3::Z),
            Walls::FacingOut => pieces.rectangle(a, b - a, 2.0 * DVec3::Z),
            Walls::Boxes => {
                let [from, to] = [a.min(b).min(a + out), a.max(b).max(b + out)];
                pieces.cuboid(from, to + 2.0 * DVec3::Z)
            }
        };
    }
}

/// A carpet that is smaller than the floor of boards below it, and larger than each board; boards that reach a little below the walls of
/// one or two rooms, on the floors of these; and a mat on boards that touches a wall.
#[test]
fn carpets_lie_on_boards_and_these_on_floors() {
    for [offset, margin] in [[0.013, 0.12], [0.002, 0.01]] {
        check_contact(&format!("carpet, {margin} m before the end of the boards"), &|gap| {
            let mut pieces = Pieces::empty();
            boards(&mut pieces, 0.9, [5.0; 2], offset, 0.0);
            let [from, to] = [margin - 0.02, 5.02 - margin];
            pieces.grey("carpet", 0.05).polygon(&facing_up([from, to], [from + offset, to + offset], gap));
            lamp(&mut pieces, 2.5, 2.5, 3.0);
            (pieces, vec![above(1.5, 1.5, 0.5)])
        });
    }
    for (width, of) in [(1.2, Walls::FacingIn), (5.0, Walls::FacingOut), (5.0, Walls::Boxes)] {
        check_contact(&format!("boards in a room of {width} m, walls {of:?}"), &|gap| {
            let mut pieces = Pieces::empty();
            boards(&mut pieces, 0.05, [width; 2], 0.003, gap);
            pieces.grey("floor", 0.9).polygon(&facing_up([0.0, width], [0.0, width], 0.0));
            walls(&mut pieces, of, [0.0, width], [0.0, width]);
            lamp(&mut pieces, 0.5 * width, 0.5 * width, 3.0);
            (pieces, vec![above(0.3 * width, 0.3 * width, 0.3)])
        });
    }
    check_contact("boards on a screed on a slab, above a room", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ceiling below", 0.5).polygon(&facing_down([0.0, 5.0], [0.0, 5.0], -2.0 * gap));
        pieces.grey("slab", 0.9).polygon(&facing_up([0.0, 5.0], [0.0, 5.0], -gap));
        pieces.grey("screed", 0.9).polygon(&facing_up([0.0, 5.0], [0.0, 5.0], 0.0));
        boards(&mut pieces, 0.05, [5.0; 2], 0.003, gap);
        walls(&mut pieces, Walls::FacingIn, [0.0, 5.0], [0.0, 5.0]);
        for (k, [x, y]) in [[0.0, 0.0], [0.0, 5.0]].into_iter().enumerate() {
            let foot = DVec3::new(x, y, -2.0);
            pieces.grey(&format!("lower wall {k}"), 0.5).rectangle(foot, 5.0 * DVec3::X, 2.0 * DVec3::Z);
        }
        for (k, x) in [0.0, 5.0].into_iter().enumerate() {
            let foot = DVec3::new(x, 0.0, -2.0);
            pieces.grey(&format!("lower side {k}"), 0.5).rectangle(foot, 5.0 * DVec3::Y, 2.0 * DVec3::Z);
        }
        lamp(&mut pieces, 2.5, 2.5, 1.9);
        (pieces, vec![above(1.5, 1.5, 0.3)])
    });
    check_contact("boards in two rooms with a carpet", &|gap| {
        let mut pieces = Pieces::empty();
        for (k, x) in [[0.0, 5.0], [5.0, 7.0]].into_iter().enumerate() {
            pieces.grey(&format!("floor {k}"), 0.5).polygon(&facing_up(x, [0.0, 5.0], -gap));
            walls(&mut pieces, Walls::FacingIn, x, [0.0, 5.0]);
        }
        boards(&mut pieces, 0.9, [7.0, 5.0], 0.002, 0.0);
        pieces.grey("carpet", 0.05).polygon(&facing_up([0.5, 4.5], [0.5, 4.5], gap));
        lamp(&mut pieces, 2.5, 2.5, 1.9);
        (pieces, vec![above(1.5, 1.5, 0.3), above(4.8, 2.5, 0.3)])
    });
    check_contact("boards below closed rooms whose faces have a smaller area", &|gap| {
        let mut pieces = Pieces::empty();
        boards(&mut pieces, 0.05, [6.2, 4.2], 0.003, gap);
        for (k, [x, y]) in [[0.0, 0.0], [3.2, 0.0], [0.0, 2.2], [3.2, 2.2]].into_iter().enumerate() {
            let low = DVec3::new(x, y, 0.0);
            pieces.grey(&format!("room {k}"), 0.9).room(low, low + DVec3::new(3.0, 2.0, 1.2));
        }
        lamp(&mut pieces, 1.0, 0.5, 1.1);
        (pieces, vec![above(0.5, 0.5, 0.3), above(2.5, 1.5, 0.3)])
    });
    check_contact("mat at a wall, on boards", &|gap| {
        let mut pieces = Pieces::empty();
        boards(&mut pieces, 0.9, [5.0; 2], 0.002, 0.0);
        walls(&mut pieces, Walls::FacingIn, [0.0, 5.0], [0.0, 5.0]);
        pieces.grey("mat", 0.05).polygon(&facing_up([0.0, 3.0], [1.1, 4.2], gap));
        lamp(&mut pieces, 2.5, 2.5, 3.0);
        (pieces, vec![above(1.5, 2.5, 0.3)])
    });
}

/// A rug around the hole of a storey, on whose inner border the railing stands: the floor is larger than the rug.
#[test]
fn a_rug_around_a_stairwell_lies_on_the_floor() {
    check_contact("rug around a stairwell", &|gap| {
        let corners = |[x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64| {
            [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| DVec3::new(x, y, z))
        };
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.8);
        pieces.polygon(&facing_up([-3.0, 4.0], [-3.0, 0.0], 0.0));
        pieces.polygon(&facing_up([-3.0, 4.0], [2.0, 5.0], 0.0));
        pieces.polygon(&facing_up([-3.0, 0.0], [0.0, 2.0], 0.0));
        pieces.polygon(&facing_up([1.0, 4.0], [0.0, 2.0], 0.0));
        let hole = corners([0.0, 1.0], [0.0, 2.0], 0.0);
        let inner = corners([0.0, 1.0], [0.0, 2.0], gap);
        let outer = corners([-0.8, 1.8], [-0.8, 2.8], gap);
        pieces.grey("railing", 0.4);
        for k in 0..4 {
            let [a, b] = [hole[k], hole[(k + 1) % 4]];
            pieces.rectangle(a, b - a, 0.9 * DVec3::Z);
        }
        pieces.grey("rug", 0.05);
        for k in 0..4 {
            let next = (k + 1) % 4;
            pieces.polygon(&[outer[k], outer[next], inner[next], inner[k]]);
        }
        lamp(&mut pieces, -1.0, 1.0, 2.8);
        (pieces, vec![above(-0.4, 1.0, 0.3)])
    });
}

/// A room on a ground of two slabs whose joint is staggered, with and without a ceiling, also on soil and in a hall; and mats in a doorway,
/// with the threshold between them.
#[test]
fn grounds_of_slabs_lie_below_rooms_and_mats_in_doorways_above_floors() {
    for (has_ceiling, below) in [(true, ""), (false, ""), (true, "soil"), (true, "hall")] {
        check_contact(&format!("room on two slabs, with a ceiling: {has_ceiling}, {below}"), &|gap| {
            let mut pieces = Pieces::empty();
            let corner = |width: f64, z: f64| DVec3::new(2.0 + width, 2.0 + width, z);
            match below {
                "soil" => pieces.grey(below, 0.5).cuboid(corner(-6.0, -1.0), corner(6.0, -2.0 * gap)),
                "hall" => pieces.grey(below, 0.5).room(corner(-6.0, -2.0 * gap), corner(6.0, 5.0)),
                _ => &mut pieces,
            };
            pieces.grey("west", 0.05).polygon(&facing_up([-0.5, 2.0], [-0.5, 4.5], -gap));
            pieces.grey("east", 0.05).polygon(&facing_up([2.0, 4.5], [-0.5, 4.49], -gap));
            let [low, high] = [DVec3::ZERO, DVec3::new(4.0, 4.0, 2.5)];
            pieces.grey("room", 0.9);
            if has_ceiling {
                pieces.room(low, high);
            } else {
                pieces.room_without(Wall::Ceiling, low, high);
            }
            lamp(&mut pieces, 1.5, 1.5, 2.4);
            (pieces, vec![above(1.0, 1.0, 0.3), above(3.0, 3.0, 0.3)])
        });
    }
    check_contact("mats in a doorway", &|gap| {
        let mut pieces = Pieces::empty();
        for (wall, x, end, out) in [(Wall::HighX, [0.0, 3.0], 3.0, 1.0), (Wall::LowX, [3.2, 6.2], 3.2, -1.0)]
        {
            let [low, high] = [DVec3::new(x[0], 0.0, 0.0), DVec3::new(x[1], 3.0, 2.5)];
            pieces.grey("room", 0.8).room_without(wall, low, high);
            let [y, z] = [3.0 * DVec3::Y, 2.5 * DVec3::Z];
            match wall {
                Wall::HighX => pieces.pierced(end * DVec3::X, [z, y], [[0.0, 1.0], [2.0, 2.0]]),
                _ => pieces.pierced(end * DVec3::X, [y, z], [[1.0, 0.0], [2.0, 2.0]]),
            };
            let inner: f64 = end - 0.6 * out;
            let mat = facing_up([inner.min(end), inner.max(end)], [1.0, 2.0], gap);
            pieces.grey("mat", 0.05).polygon(&mat);
            lamp(&mut pieces, x[0] + 1.0, 1.0, 2.4);
        }
        let [low, high] = [DVec3::new(3.0, 1.0, 0.0), DVec3::new(3.2, 2.0, 2.0)];
        pieces.grey("doorway", 0.8);
        for (wall, corners) in crate::scene::testing::walls(low, high) {
            if !matches!(wall, Wall::LowX | Wall::HighX) {
                pieces.polygon(&corners);
            }
        }
        pieces.grey("threshold", 0.05).polygon(&facing_up([3.0, 3.2], [1.0, 2.0], gap));
        (pieces, [2.7, 3.1, 3.5].map(|x| above(x, 1.5, 0.2)).to_vec())
    });
}
