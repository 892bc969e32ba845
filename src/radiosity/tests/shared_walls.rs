//! Walls that two parts share, in one place: the light is that of walls with a gap of a millimetre.

use super::sheets::at;
use super::*;
use glam::DMat3;

/// Two closed rooms, white and black, each with a lamp; their walls at x = 2.2 m have a gap.
#[derive(Clone, Copy)]
struct Rooms {
    gap: f64,
    /// The black room ends at this x.
    end: f64,
    white_first: bool,
    /// The normals of the white and of the black room point out.
    outward: [bool; 2],
    /// A glowing panel on the shared wall of the white room, or else a poster there and a cupboard on that of the black room.
    has_panel: bool,
    turn: DMat3,
}

impl Rooms {
    /// The x coordinates of the shared wall in the white and in the black room.
    fn walls(&self) -> [f64; 2] {
        [2.2 - 0.5 * self.gap, 2.2 + 0.5 * self.gap]
    }

    fn scene(&self) -> Scene {
        let mut pieces = Pieces::empty();
        let [white, black] = self.walls();
        let [white_out, black_out] = self.outward;
        let mut rooms =
            [("white", 0.9, 0.0, white, white_out, 0.5), ("black", 0.1, black, self.end, black_out, 2.7)];
        if !self.white_first {
            rooms.reverse();
        }
        for (name, reflectance, from, to, outward, lamp) in rooms {
            let [low, high] = if outward { [to, from] } else { [from, to] };
            pieces.grey(name, reflectance).room(low * DVec3::X, DVec3::new(high, 3.0, 2.5));
            pieces.glowing("lamp", 10.0).polygon(&facing_down([lamp, lamp + 1.0], [1.0, 2.0], 2.4));
        }
        let low = DVec3::new(white - self.gap, 1.0, 0.8);
        if self.has_panel {
            pieces.glowing("panel", 5.0).rectangle(low, DVec3::Z, DVec3::Y);
        } else {
            pieces.grey("poster", 0.2).rectangle(low, DVec3::Z, DVec3::Y);
            let back = black + self.gap;
            pieces.grey("cupboard", 0.7).cuboid(DVec3::new(back, 0.3, 0.6), DVec3::new(back + 0.3, 1.3, 1.8));
        }
        pieces.turned(self.turn).scene()
    }

    /// On the floors, on the shared wall, and on what hangs there.
    fn points(&self) -> Vec<Point> {
        let [white, black] = self.walls();
        let on_wall = |x, y, z, normal| Point { position: DVec3::new(x, y, z), normal };
        let mut points = vec![
            at(1.0, 1.5, 0.0),
            at(1.9, 1.2, 0.0),
            at(2.5, 1.2, 0.0),
            at(3.2, 1.5, 0.0),
            on_wall(white, 2.6, 1.2, -DVec3::X),
            on_wall(black, 1.5, 1.2, DVec3::X),
        ];
        if !self.has_panel {
            points.push(on_wall(white - self.gap, 1.5, 1.2, -DVec3::X));
            points.push(on_wall(black + self.gap + 0.3, 0.8, 1.2, DVec3::X));
        }
        points.into_iter().map(|p| turned(self.turn, p)).collect()
    }

    /// The light of the points, by the solver and by paths.
    fn light(&self) -> [Vec<Rgb>; 2] {
        let (scene, points) = (self.scene(), self.points());
        [solved(&scene, &points, &quick()).irradiance, traced(&scene, &points, 2048, 1)]
    }
}

/// Whichever room is larger or comes first, also in rooms whose normals point out, and rotated.
#[test]
fn walls_of_closed_rooms_in_one_place_keep_their_sides() {
    let turn = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.3);
    for (end, outward, has_panel, turn) in [
        (3.8, [false, false], true, DMat3::IDENTITY),
        (6.0, [false, false], true, DMat3::IDENTITY),
        (6.0, [false, false], false, turn),
        (3.8, [true, true], true, DMat3::IDENTITY),
        (6.0, [false, true], true, DMat3::IDENTITY),
    ] {
        let rooms = |gap, white_first| Rooms { gap, end, white_first, outward, has_panel, turn };
        // Faces in one place do not depend on the winding of the rooms beside them.
        let wanted = Rooms { outward: [false, false], ..rooms(1e-3, true) }.light();
        for white_first in [false, true] {
            let found = rooms(0.0, white_first).light();
            for (found, wanted) in found.iter().flatten().zip(wanted.iter().flatten()) {
                assert!(
                    (found[0] / wanted[0] - 1.0).abs() < 0.05,
                    "{end} {outward:?} {has_panel}: {found:?} {wanted:?}"
                );
            }
        }
    }
}

/// The overlap of a cupboard and the wall of the other room, which keep their sides, is not reported; that of the poster and its wall is.
#[test]
fn faces_on_both_sides_of_a_shared_wall_are_not_reported() {
    let rooms = Rooms {
        gap: 0.0,
        end: 3.8,
        white_first: true,
        outward: [false, false],
        has_panel: false,
        turn: DMat3::IDENTITY,
    };
    let scene = rooms.scene();
    let text = scene.repairs.messages.iter().find(|m| m.contains("in the same plane")).expect("a message");
    assert!(text.contains("`white` and `poster` 1 m²") && !text.contains("cupboard"), "{text}");
}

/// A scene with gaps of this width and points in it.
type WithGap<'a> = &'a dyn Fn(f64) -> (Pieces, Vec<Point>);

/// Faces in one place have the light that they have with a gap of a millimetre, by paths and, with few rays, by the solver, in any order of
/// the file.
pub(super) fn check_contact(name: &str, with_gap: WithGap) {
    let (pieces, points) = with_gap(1e-3);
    let wanted = traced(&pieces.scene(), &points, 2048, 1);
    let mean = mean_at(&wanted);
    for is_reversed in [false, true] {
        let (mut pieces, points) = with_gap(0.0);
        if is_reversed {
            pieces = pieces.reversed();
        }
        let scene = pieces.scene();
        let by_solver = solved(&scene, &points, &quick()).irradiance;
        for (found, tolerance) in [(by_solver, 0.15), (traced(&scene, &points, 2048, 1), 0.1)] {
            for (k, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
                let error = (found[0] - wanted[0]).abs();
                assert!(
                    error <= tolerance * wanted[0] + 2e-3 * mean,
                    "{name}, point {k}: {found:?} {wanted:?}"
                );
            }
        }
    }
}

fn turned(turn: DMat3, p: Point) -> Point {
    Point { position: turn * p.position, normal: turn * p.normal }
}

fn on_wall(x: f64, y: f64, z: f64, normal: DVec3) -> Point {
    Point { position: DVec3::new(x, y, z), normal }
}

/// A lamp of a square metre that faces down.
pub(super) fn lamp(pieces: &mut Pieces, x: f64, y: f64, z: f64) {
    pieces.glowing("lamp", 10.0).polygon(&facing_down([x, x + 1.0], [y, y + 1.0], z));
}

/// A room in a facade without a bottom, and a lamp outside.
#[test]
fn facades_and_the_walls_of_rooms_in_them_keep_their_sides() {
    check_contact("facade", &|gap| {
        let mut pieces = Pieces::empty();
        let (low, high) = (DVec3::ZERO, DVec3::new(3.0, 2.0, 2.5));
        pieces.grey("room", 0.9).room(low, high);
        lamp(&mut pieces, 1.0, 0.5, 2.4);
        let (from, to) = (low - DVec3::new(gap, gap, 0.0), high + gap);
        let mirrored = [DVec3::new(to.x, from.y, from.z), DVec3::new(from.x, to.y, to.z)];
        pieces.grey("facade", 0.1).room_without(Wall::Floor, mirrored[0], mirrored[1]);
        pieces.glowing("outside", 10.0).rectangle(DVec3::new(5.0, 0.0, 0.0), DVec3::Z, DVec3::Y);
        let points = vec![
            on_wall(3.0, 1.2, 1.2, -DVec3::X),
            on_wall(3.0 + gap, 1.2, 1.2, DVec3::X),
            at(2.0, 1.2, 2.5 + gap),
            at(1.0, 0.3, 0.0),
        ];
        (pieces, points)
    });
}

/// A closed showcase with a lamp in it, whose normals point out, on the floor of a room or on a larger slab.
#[test]
fn lit_boxes_keep_their_insides() {
    for has_slab in [false, true] {
        check_contact("showcase", &|gap| {
            let mut pieces = Pieces::empty();
            if has_slab {
                pieces.grey("slab", 0.1).polygon(&facing_up([-3.0, 5.0], [-3.0, 5.0], 0.0));
                pieces.grey("wall", 0.5).rectangle(DVec3::new(-1.0, 0.0, 0.0), DVec3::Y, DVec3::Z);
                lamp(&mut pieces, -2.0, 0.0, 2.0);
            } else {
                pieces.grey("room", 0.1).room(DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5));
            }
            pieces.grey("showcase", 0.9).cuboid(DVec3::new(1.0, 1.0, gap), DVec3::new(2.0, 2.0, 1.2));
            pieces.glowing("lamp", 10.0).polygon(&facing_down([1.3, 1.7], [1.3, 1.7], 1.0));
            (pieces, vec![at(1.2, 1.2, gap), at(1.5, 1.6, gap)])
        });
    }
}

/// A glowing box on the floor of the upper one of two rooms, whose bottom is in the plane of the ceiling below, lights both.
#[test]
fn boxes_recessed_in_a_ceiling_light_the_room_below() {
    check_contact("recessed box", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("upper", 0.2).room(DVec3::new(0.0, 0.0, 2.0 + 2.0 * gap), DVec3::new(3.0, 3.0, 4.0));
        pieces.grey("lower", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 3.0, 2.0));
        pieces.glowing("box", 10.0).cuboid(DVec3::new(1.0, 1.0, 2.0 - gap), DVec3::new(2.0, 2.0, 2.3));
        (pieces, vec![at(0.5, 1.5, 0.0), at(1.5, 0.5, 2.0 + 2.0 * gap)])
    });
}

/// Two rooms whose shared wall is of one face on the white side, and of nine with corners of their own on the black side.
#[test]
fn walls_of_several_faces_keep_their_side() {
    check_contact("tessellated wall", &|gap| {
        let mut pieces = Pieces::empty();
        let (end, high) = (2.2 + gap, DVec3::new(4.0, 3.0, 2.5));
        pieces.grey("white", 0.9).room(DVec3::ZERO, DVec3::new(2.2, 3.0, 2.5));
        pieces.grey("black", 0.1).room_without(Wall::LowX, end * DVec3::X, high);
        for k in 0..9 {
            let corner = DVec3::new(end, f64::from(k / 3), f64::from(k % 3) * 2.5 / 3.0);
            pieces.grey("black", 0.1).rectangle(corner, DVec3::Y, 2.5 / 3.0 * DVec3::Z);
        }
        lamp(&mut pieces, 0.5, 1.0, 2.4);
        lamp(&mut pieces, 2.7, 1.0, 2.4);
        let points = vec![
            at(1.0, 1.5, 0.0),
            at(3.2, 1.5, 0.0),
            on_wall(2.2, 1.2, 1.1, -DVec3::X),
            on_wall(end, 1.2, 1.1, DVec3::X),
        ];
        (pieces, points)
    });
}

/// Cabinets without doors, whose normals point out, side by side: their sides share the edges at the front.
#[test]
fn open_boxes_side_by_side_keep_their_walls() {
    check_contact("cabinets", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 3.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        let mut points = vec![at(1.5, 0.5, 0.0)];
        for (k, reflectance) in [0.9, 0.1, 0.6].into_iter().enumerate() {
            let from = 0.5 + k as f64 * (0.6 + gap);
            let (low, high) = (DVec3::new(3.0 - gap, from, gap), DVec3::new(2.4, from + 0.6, 0.9));
            pieces.grey("cabinet", reflectance).room_without(Wall::HighX, low, high);
            points.push(on_wall(2.7, from, 0.4, DVec3::Y));
            points.push(at(2.7, from + 0.3, gap));
        }
        (pieces, points)
    });
}

/// What stands on a sheet, lies in the plane of its underside, or touches a wall from outside is not visible through it.
#[test]
fn bodies_and_rooms_beyond_a_sheet_are_hidden_by_it() {
    check_contact("crate on a slab", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("slab", 0.1).polygon(&facing_up([0.0, 6.0], [0.0, 6.0], 2.5));
        pieces.grey("floor", 0.3).polygon(&facing_up([0.0, 6.0], [0.0, 6.0], 0.0));
        pieces.grey("crate", 0.9).cuboid(DVec3::new(1.0, 1.0, 2.5 + gap), DVec3::new(4.0, 4.0, 3.5));
        pieces.glowing("lamp", 10.0).polygon(&facing_up([2.0, 3.0], [2.0, 3.0], 0.5));
        let turn = DMat3::from_rotation_x(0.4);
        let points = [at(0.5, 0.5, 0.0), at(5.0, 3.0, 0.0)].map(|p| turned(turn, p));
        (pieces.turned(turn), points.to_vec())
    });
    check_contact("cellar", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ground", 0.1).polygon(&facing_up([-10.0, 10.0], [-10.0, 10.0], 0.0));
        pieces.grey("cellar", 0.9).room(DVec3::new(0.0, 0.0, -2.5 - gap), DVec3::new(3.0, 3.0, -gap));
        pieces.grey("wall", 0.5).rectangle(DVec3::new(-1.0, -1.0, 0.0), 5.0 * DVec3::Y, 2.0 * DVec3::Z);
        lamp(&mut pieces, 1.0, 1.0, -0.5);
        lamp(&mut pieces, 1.0, 1.0, 2.0);
        (pieces, vec![at(0.5, 0.5, -2.5 - gap), on_wall(-1.0, 1.0, 0.5, DVec3::X), at(2.5, 2.0, 0.0)])
    });
    check_contact("crate outside", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        pieces.grey("crate", 0.1).cuboid(DVec3::new(3.0 + gap, 1.0, 0.0), DVec3::new(4.0, 3.0, 2.0));
        (pieces, vec![at(1.0, 3.0, 0.0), on_wall(3.0, 2.0, 1.0, -DVec3::X)])
    });
}

/// A rug and a poster in a room whose normals point out, on a ground that is larger than the room.
#[test]
fn what_hangs_and_lies_in_a_room_stays_inside() {
    check_contact("rug and poster", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ground", 0.9).polygon(&facing_up([-6.0, 9.0], [-6.0, 9.0], -gap));
        pieces.grey("room", 0.5).cuboid(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        pieces.grey("rug", 0.1).polygon(&facing_down([1.0, 2.0], [2.0, 3.0], gap));
        pieces.grey("poster", 0.9).rectangle(DVec3::new(3.0 - gap, 0.5, 0.3), 3.0 * DVec3::Y, 2.0 * DVec3::Z);
        let points = vec![at(0.5, 3.5, 0.0), at(1.5, 2.5, gap), on_wall(3.0 - gap, 2.0, 1.0, -DVec3::X)];
        (pieces, points)
    });
}

/// Lamps on both sides of a partition, and a lamp on one side of a partition of two faces.
#[test]
fn lamps_on_partitions_light_their_own_side() {
    for has_two_faces in [false, true] {
        check_contact("partition", &|gap| {
            let mut pieces = Pieces::empty();
            pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5));
            let (y, z) = (3.0 * DVec3::Y, 2.5 * DVec3::Z);
            pieces.grey("partition", 0.1).rectangle(2.0 * DVec3::X, z, y);
            let at_lamp = |x: f64| DVec3::new(x, 1.0, 0.8);
            pieces.glowing("left", 10.0).rectangle(at_lamp(2.0 - gap), DVec3::Z, DVec3::Y);
            if has_two_faces {
                pieces.grey("right", 0.9).rectangle((2.0 + gap) * DVec3::X, y, z);
                lamp(&mut pieces, 2.5, 1.0, 2.4);
            } else {
                pieces.glowing("right", 5.0).rectangle(at_lamp(2.0 + gap), DVec3::Y, DVec3::Z);
            }
            (pieces, vec![at(1.0, 1.5, 0.0), at(3.0, 1.5, 0.0), on_wall(4.0, 1.0, 1.0, -DVec3::X)])
        });
    }
}

/// A lamp in the ceiling of one room below a rug on the floor of another: points on the rug lie above four moved faces.
#[test]
fn points_on_high_stacks_are_lit() {
    check_contact("rug over lamp", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("lower", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 3.0, 2.5));
        pieces.grey("upper", 0.5).room(DVec3::new(0.0, 0.0, 2.5 + gap), DVec3::new(3.0, 3.0, 5.0));
        lamp(&mut pieces, 1.0, 1.0, 2.5 - gap);
        lamp(&mut pieces, 1.0, 1.0, 4.5);
        pieces.grey("rug", 0.1).polygon(&facing_up([0.7, 2.7], [0.7, 2.7], 2.5 + 2.0 * gap));
        (pieces, vec![at(1.5, 1.5, 2.5 + 2.0 * gap), at(0.3, 0.3, 2.5 + gap), at(1.5, 1.5, 0.0)])
    });
}

/// A slab between two storeys that extends as a balcony, and a road on the ground on which a lit house stands.
#[test]
fn grounds_lie_behind_the_walls_of_rooms() {
    check_contact("slab between storeys", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("lower", 0.5).room(DVec3::ZERO, DVec3::new(4.0, 4.0, 2.5 - gap));
        pieces.grey("upper", 0.9).room(DVec3::new(0.0, 0.0, 2.5 + gap), DVec3::new(4.0, 4.0, 5.0));
        pieces.grey("slab", 0.1).polygon(&facing_up([0.0, 4.0], [-1.5, 4.0], 2.5));
        lamp(&mut pieces, 2.0, 1.5, 2.2);
        lamp(&mut pieces, 2.0, 1.5, 4.6);
        let ceiling = |z| Point { position: DVec3::new(1.0, 1.0, z), normal: -DVec3::Z };
        (pieces, vec![at(1.0, 1.0, 0.0), ceiling(2.5 - gap), at(1.0, 1.0, 2.5 + gap), ceiling(5.0)])
    });
    check_contact("house beside a road", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ground", 0.9).polygon(&facing_up([-20.0, 20.0], [-20.0, 20.0], -gap));
        pieces.grey("road", 0.1).polygon(&facing_up([3.5, 9.0], [-20.0, 20.0], 0.0));
        pieces.grey("house", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        lamp(&mut pieces, 5.0, 1.0, 3.0);
        pieces.grey("sign", 0.5).rectangle(DVec3::new(8.0, 0.0, 0.5), DVec3::Z, 2.0 * DVec3::Y);
        (pieces, vec![on_wall(8.0, 1.0, 1.0, -DVec3::X), at(1.0, 3.0, 0.0), at(5.0, 1.0, 0.0)])
    });
}

/// A closed box in a closed cupboard that has the cupboard's top is not visible.
#[test]
fn boxes_in_bodies_are_hidden() {
    check_contact("box in a cupboard", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.9).room(DVec3::ZERO, DVec3::new(3.0, 3.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        pieces.grey("cupboard", 0.1).cuboid(DVec3::new(0.5, 0.5, 0.0), DVec3::new(2.5, 2.5, 1.0));
        pieces.grey("box", 0.9).room(DVec3::new(0.7, 0.7, 0.3), DVec3::new(2.3, 2.3, 1.0 - gap));
        (pieces, vec![Point { position: DVec3::new(0.5, 0.5, 2.5), normal: -DVec3::Z }, at(1.5, 1.5, 1.0)])
    });
}

/// Sheets whose borders lie on edges of boxes and rooms are not faces of these: a cloth of the size of its table, a cover without a bottom
/// over a crate, a terrace above the wall of a cellar, a deck at the rim of a pool.
#[test]
fn sheets_that_end_at_edges_of_bodies_cover_these() {
    check_contact("sheets outdoors", &|gap| {
        let mut pieces = Pieces::empty();
        let around_pool = [
            ([-9.0, 9.0], [-9.0, 0.0]),
            ([-9.0, 0.0], [0.0, 2.0]),
            ([3.0, 9.0], [0.0, 2.0]),
            ([-9.0, 9.0], [2.0, 9.0]),
        ];
        for (x, y) in around_pool {
            pieces.grey("ground", 0.9).polygon(&facing_up(x, y, 0.0));
        }
        pieces.grey("pool", 0.6).room_without(
            Wall::Ceiling,
            DVec3::new(0.0, 0.0, -1.5),
            DVec3::new(3.0, 2.0, 0.0),
        );
        pieces.grey("deck", 0.05).polygon(&facing_up([0.0, 3.0], [-1.0, 0.0], gap));
        pieces.grey("cellar", 0.6).room(DVec3::new(-5.0, 3.0, -2.5), DVec3::new(-2.0, 6.0, -gap));
        lamp(&mut pieces, -4.0, 4.0, -0.5);
        pieces.grey("terrace", 0.05).polygon(&facing_up([-2.0, 0.0], [3.0, 6.0], gap));
        pieces.grey("table", 0.9).cuboid(DVec3::new(4.0, 3.0, 0.0), DVec3::new(6.0, 4.0, 0.75));
        pieces.grey("cloth", 0.05).polygon(&facing_up([4.0, 6.0], [3.0, 4.0], 0.75 + gap));
        let (low, high) = (DVec3::new(-6.0, -4.0, 0.0), DVec3::new(-4.0, -2.0, 1.0));
        pieces.grey("crate", 0.9).cuboid(low, high);
        let (low, high) = (low - gap * DVec3::new(1.0, 1.0, 0.0), high + gap * DVec3::ONE);
        // A cuboid, the room turned inside out.
        pieces.grey("cover", 0.05).room_without(
            Wall::Floor,
            DVec3::new(high.x, low.y, low.z),
            DVec3::new(low.x, high.y, high.z),
        );
        for (x, y) in [(0.0, -1.0), (-1.5, 4.0), (4.5, 3.0), (-5.5, -3.5)] {
            lamp(&mut pieces, x, y, 4.0);
        }
        let above = |x, y, z| Point { position: DVec3::new(x, y, z), normal: -DVec3::Z };
        let points =
            vec![above(1.5, -0.5, 0.6), above(-1.0, 4.5, 0.6), above(5.0, 3.5, 1.0), above(-5.0, -3.0, 1.6)];
        (pieces, points)
    });
}

/// What shares an edge with a wall without being one: a strip of paving that was welded to a house without a floor, a coping around a pool;
/// and a wallpaper that is longer than the larger hall beyond its wall.
#[test]
fn strips_at_edges_of_walls_are_not_walls() {
    let above = |x, y, z| Point { position: DVec3::new(x, y, z), normal: -DVec3::Z };
    check_contact("strip and coping", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ground", 0.9).polygon(&facing_up([-9.0, 9.0], [-9.0, 9.0], 0.0));
        let (low, high) = (DVec3::new(3.0, 0.0, gap), DVec3::new(0.0, 2.0, 2.5));
        pieces.grey("house", 0.5).room_without(Wall::Floor, low, high);
        pieces.grey("strip", 0.05).polygon(&facing_up([0.0, 3.0], [-1.0, 0.0], gap));
        pieces.grey("pool", 0.6).room_without(
            Wall::Ceiling,
            DVec3::new(5.0, 0.0, -1.5),
            DVec3::new(7.0, 2.0, gap),
        );
        let corner = |x: f64, y: f64, w: f64| DVec3::new(6.0 + (1.0 + w) * x, 1.0 + (1.0 + w) * y, gap);
        for [p, q] in [
            [[-1.0, -1.0], [1.0, -1.0]],
            [[1.0, -1.0], [1.0, 1.0]],
            [[1.0, 1.0], [-1.0, 1.0]],
            [[-1.0, 1.0], [-1.0, -1.0]],
        ] {
            let at = |of: [f64; 2], w: f64| corner(of[0], of[1], w);
            pieces.grey("coping", 0.05).polygon(&[at(p, 0.8), at(q, 0.8), at(q, 0.0), at(p, 0.0)]);
        }
        lamp(&mut pieces, 1.0, -1.0, 4.0);
        lamp(&mut pieces, 5.5, -1.0, 4.0);
        (pieces, vec![above(1.5, -0.5, 0.6), above(6.0, -0.4, 0.5)])
    });
    check_contact("wallpaper", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("corridor", 0.5).room(DVec3::ZERO, DVec3::new(9.0, 2.0, 2.5));
        pieces.grey("hall", 0.5).room(DVec3::new(0.0, 2.0 + gap, 0.0), DVec3::new(5.0, 9.0, 2.5));
        let corner = DVec3::new(0.2, 2.0 - gap, 0.1);
        pieces.grey("paper", 0.05).rectangle(corner, 8.6 * DVec3::X, 2.3 * DVec3::Z);
        lamp(&mut pieces, 3.0, 0.5, 2.4);
        lamp(&mut pieces, 3.0, 5.0, 2.4);
        (pieces, vec![on_wall(6.0, 1.5, 1.0, DVec3::Y), on_wall(3.0, 1.5, 1.0, DVec3::Y)])
    });
}

/// A carpet in a hall is a ground for the booth on it; paving and ground below one house, both larger than it, lie on each other by their
/// sizes.
#[test]
fn grounds_of_one_room_may_lie_in_another_or_on_each_other() {
    check_contact("booth in a hall", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("hall", 0.8).room(DVec3::new(-3.0, -3.0, 0.0), DVec3::new(5.0, 5.0, 4.0));
        pieces.grey("carpet", 0.05).polygon(&facing_up([-1.0, 3.0], [-1.0, 3.0], gap));
        pieces.grey("booth", 0.7).room(DVec3::new(0.0, 0.0, 2.0 * gap), DVec3::new(2.0, 2.0, 2.5));
        lamp(&mut pieces, 0.5, 0.5, 2.4);
        lamp(&mut pieces, 3.0, 3.0, 3.9);
        let down = |x, y, z| Point { position: DVec3::new(x, y, z), normal: -DVec3::Z };
        (pieces, vec![down(1.6, 1.6, 0.5), down(2.7, 1.0, 1.0), at(1.0, 1.5, 2.0 * gap)])
    });
    check_contact("paving on a ground", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("ground", 0.9).polygon(&facing_up([-20.0, 20.0], [-20.0, 20.0], 0.0));
        pieces.grey("paving", 0.05).polygon(&facing_up([-4.0, 7.0], [-4.0, 8.0], gap));
        pieces.grey("house", 0.5).room(DVec3::new(0.0, 0.0, 2.0 * gap), DVec3::new(3.0, 4.0, 2.5));
        lamp(&mut pieces, 1.0, 1.0, 2.4);
        lamp(&mut pieces, 5.0, 1.0, 3.0);
        let down = |x, y, z| Point { position: DVec3::new(x, y, z), normal: -DVec3::Z };
        (pieces, vec![down(5.0, 2.0, 0.5), at(1.0, 3.0, 2.0 * gap), down(1.0, 3.0, 0.5)])
    });
}

/// A cupboard in a room is hidden from outside by the wall; of two open bins side by side, of which one is wound the other way, each keeps
/// its wall; a glowing box does not shine through the table on which it stands.
#[test]
fn bodies_touch_walls_bodies_and_sheets() {
    check_contact("cupboard at an outer wall", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.1).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
        pieces.grey("cupboard", 0.9).cuboid(DVec3::new(2.4, 0.0, 0.0), DVec3::new(3.0 - gap, 4.0, 2.4));
        pieces.glowing("street lamp", 10.0).rectangle(DVec3::new(5.0, 1.5, 1.0), DVec3::Y, -DVec3::Z);
        (pieces, vec![on_wall(3.8, 2.0, 1.0, -DVec3::X)])
    });
    check_contact("bins", &|gap| {
        let mut pieces = Pieces::empty();
        let [low, high] = [DVec3::ZERO, DVec3::new(1.0, 1.0, 1.0)];
        pieces.grey("white bin", 0.9).room_without(Wall::Ceiling, low, high);
        let turned = [DVec3::new(2.0, 0.0, 0.0), DVec3::new(1.0 + gap, 1.0, 1.0)];
        pieces.grey("black bin", 0.1).room_without(Wall::Ceiling, turned[0], turned[1]);
        lamp(&mut pieces, 0.0, 0.0, 2.0);
        lamp(&mut pieces, 1.0, 0.0, 2.0);
        (pieces, vec![on_wall(0.5, 0.5, 0.3, DVec3::X), on_wall(1.5, 0.5, 0.3, -DVec3::X)])
    });
    check_contact("glowing box on a table", &|gap| {
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([-3.0, 3.0], [-3.0, 3.0], 0.0));
        pieces.grey("table", 0.5).polygon(&facing_up([-1.0, 1.0], [-1.0, 1.0], 0.8));
        pieces.glowing("box", 10.0).cuboid(DVec3::new(-0.3, -0.3, 0.8 + gap), DVec3::new(0.3, 0.3, 1.2));
        lamp(&mut pieces, 2.0, 2.0, 2.0);
        (pieces, vec![at(0.2, 0.2, 0.0), at(2.0, 0.5, 0.0)])
    });
}

/// A sheet whose front faces away from the room on whose wall it lies is named: it may belong outside.
#[test]
fn sheets_turned_away_from_a_room_are_named() {
    for (is_turned, count) in [(false, 1), (true, 1)] {
        let mut pieces = Pieces::new();
        pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
        let sides = if is_turned { [DVec3::Z, DVec3::Y] } else { [DVec3::Y, DVec3::Z] };
        pieces.grey("sign", 0.5).rectangle(DVec3::new(0.0, 1.0, 1.0), sides[0], sides[1]);
        let messages = pieces.scene().repairs.messages;
        let named = messages.iter().filter(|m| m.contains("in the same plane") && m.contains("`sign`"));
        assert_eq!(named.count(), count, "{messages:?}");
    }
}
