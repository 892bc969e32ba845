//! The CIE general skies (ISO 15469:2004, CIE S 011), by type.

use super::gradation::{Gradation, Shape};
use glam::DVec3;

/// Coefficients `a b c d e` of types 1 to 15: ISO 15469:2004, table 1.
const COEFFICIENTS: [[f64; 5]; 15] = [
    [4.0, -0.7, 0.0, -1.0, 0.0],
    [4.0, -0.7, 2.0, -1.5, 0.15],
    [1.1, -0.8, 0.0, -1.0, 0.0],
    [1.1, -0.8, 2.0, -1.5, 0.15],
    [0.0, -1.0, 0.0, -1.0, 0.0],
    [0.0, -1.0, 2.0, -1.5, 0.15],
    [0.0, -1.0, 5.0, -2.5, 0.30],
    [0.0, -1.0, 10.0, -3.0, 0.45],
    [-1.0, -0.55, 2.0, -1.5, 0.15],
    [-1.0, -0.55, 5.0, -2.5, 0.30],
    [-1.0, -0.55, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 24.0, -2.8, 0.15],
];

/// The CIE standard clear sky of low turbidity.
pub(super) const CLEAR: u8 = 12;
/// The traditional overcast sky.
pub(super) const TRADITIONAL_OVERCAST: u8 = 16;

/// Whether the radiance of a type depends on the position of the sun.
pub(super) fn needs_sun(kind: u8) -> bool {
    !matches!(kind, 1 | 3 | 5 | TRADITIONAL_OVERCAST)
}

/// The sky of a type from 1 to 16 with the sun in a local direction.
pub(super) fn shape(kind: u8, sun: DVec3) -> Shape {
    match kind {
        TRADITIONAL_OVERCAST => Shape::Overcast,
        5 => Shape::Uniform,
        _ => Shape::Gradation(Gradation::cie(COEFFICIENTS[usize::from(kind) - 1], sun)),
    }
}
