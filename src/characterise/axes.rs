//! The thirteen axes: the 26 neighbours of a cell, opposite ones merged (method A.14).

use glam::Vec3;

/// Number of axes.
pub const AXIS_COUNT: usize = 13;

const EDGE: f32 = std::f32::consts::FRAC_1_SQRT_2;
const CORNER: f32 = 0.577_350_26;

/// Unit directions; each also stands for its opposite.
pub const AXES: [Vec3; AXIS_COUNT] = [
    Vec3::X,
    Vec3::Y,
    Vec3::Z,
    Vec3::new(EDGE, EDGE, 0.0),
    Vec3::new(EDGE, -EDGE, 0.0),
    Vec3::new(EDGE, 0.0, EDGE),
    Vec3::new(EDGE, 0.0, -EDGE),
    Vec3::new(0.0, EDGE, EDGE),
    Vec3::new(0.0, EDGE, -EDGE),
    Vec3::new(CORNER, CORNER, CORNER),
    Vec3::new(CORNER, CORNER, -CORNER),
    Vec3::new(CORNER, -CORNER, CORNER),
    Vec3::new(CORNER, -CORNER, -CORNER),
];

/// The axis closest to a direction of any length; the first of equals.
///
/// By symmetry only |x|, |y|, |z| and their order matter: `|d·axis|` is the largest component, the sum of the
/// two largest over √2, or the sum of all three over √3.
#[inline]
pub fn nearest_axis(d: Vec3) -> usize {
    let a = d.abs();
    let face = a.max_element();
    let smallest = a.min_element();
    let edge = (a.x + a.y + a.z - smallest) * EDGE;
    let corner = (a.x + a.y + a.z) * CORNER;
    let opposite = |p: f32, q: f32| usize::from(p * q < 0.0);
    if face >= edge && face >= corner {
        return if a.x == face {
            0
        } else if a.y == face {
            1
        } else {
            2
        };
    }
    if edge >= corner {
        return if a.z == smallest {
            3 + opposite(d.x, d.y)
        } else if a.y == smallest {
            5 + opposite(d.x, d.z)
        } else {
            7 + opposite(d.y, d.z)
        };
    }
    9 + 2 * opposite(d.x, d.y) + opposite(d.x, d.z)
}
