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
        let turned = |p: Point| Point { position: self.turn * p.position, normal: self.turn * p.normal };
        points.into_iter().map(turned).collect()
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

/// A room in a facade without a bottom, and a lamp outside.
#[test]
fn facades_and_the_walls_of_rooms_in_them_keep_their_sides() {
    let light = |gap: f64| {
        let mut pieces = Pieces::empty();
        let (low, high) = (DVec3::ZERO, DVec3::new(3.0, 2.0, 2.5));
        pieces.grey("room", 0.9).room(low, high);
        pieces.glowing("lamp", 10.0).polygon(&facing_down([1.0, 2.0], [0.5, 1.5], 2.4));
        let (from, to) = (low - DVec3::new(gap, gap, 0.0), high + gap);
        let mirrored = [DVec3::new(to.x, from.y, from.z), DVec3::new(from.x, to.y, to.z)];
        pieces.grey("facade", 0.1).room_without(Wall::Floor, mirrored[0], mirrored[1]);
        pieces.glowing("outside", 10.0).rectangle(DVec3::new(5.0, 0.0, 0.0), DVec3::Z, DVec3::Y);
        let on_wall = |x, normal| Point { position: DVec3::new(x, 1.2, 1.2), normal };
        let points = [
            on_wall(3.0, -DVec3::X),
            on_wall(3.0 + gap, DVec3::X),
            at(2.0, 1.2, 2.5 + gap),
            at(1.0, 0.3, 0.0),
        ];
        let scene = pieces.scene();
        [solved(&scene, &points, &quick()).irradiance, traced(&scene, &points, 2048, 1)]
    };
    let wanted = light(1e-3);
    for (found, wanted) in light(0.0).iter().flatten().zip(wanted.iter().flatten()) {
        assert!((found[0] - wanted[0]).abs() <= 0.05 * wanted[0], "{found:?} {wanted:?}");
    }
}

/// A closed showcase with a lamp in it, whose normals point out, on the floor of a room.
#[test]
fn lit_boxes_in_rooms_keep_their_insides() {
    let light = |gap: f64| {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.1).room(DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5));
        pieces.grey("showcase", 0.9).cuboid(DVec3::new(1.0, 1.0, gap), DVec3::new(2.0, 2.0, 1.2));
        pieces.glowing("lamp", 10.0).polygon(&facing_down([1.3, 1.7], [1.3, 1.7], 1.0));
        let points = [at(1.2, 1.2, gap), at(1.5, 1.6, gap)];
        let scene = pieces.scene();
        [solved(&scene, &points, &quick()).irradiance, traced(&scene, &points, 2048, 1)]
    };
    let wanted = light(1e-3);
    for (found, wanted) in light(0.0).iter().flatten().zip(wanted.iter().flatten()) {
        assert!((found[0] / wanted[0] - 1.0).abs() < 0.05, "{found:?} {wanted:?}");
    }
}

/// A glowing box on the floor of the upper one of two rooms, whose bottom is in the plane of the ceiling below, lights both.
#[test]
fn boxes_recessed_in_a_ceiling_light_the_room_below() {
    let light = |gap: f64| {
        let mut pieces = Pieces::empty();
        pieces.grey("upper", 0.2).room(DVec3::new(0.0, 0.0, 2.0 + 2.0 * gap), DVec3::new(3.0, 3.0, 4.0));
        pieces.grey("lower", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 3.0, 2.0));
        pieces.glowing("box", 10.0).cuboid(DVec3::new(1.0, 1.0, 2.0 - gap), DVec3::new(2.0, 2.0, 2.3));
        let points = [at(0.5, 1.5, 0.0), at(1.5, 0.5, 2.0 + 2.0 * gap)];
        let scene = pieces.scene();
        [solved(&scene, &points, &quick()).irradiance, traced(&scene, &points, 2048, 1)]
    };
    let wanted = light(1e-3);
    for (found, wanted) in light(0.0).iter().flatten().zip(wanted.iter().flatten()) {
        assert!((found[0] / wanted[0] - 1.0).abs() < 0.05, "{found:?} {wanted:?}");
    }
}
