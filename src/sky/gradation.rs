//! Relative radiance as a function of the elevation and of the angle to the sun.

use glam::DVec3;
use std::f64::consts::FRAC_PI_2;

/// Radiance over the sky, relative to any unit. Directions are local: (east, north, up).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// The same radiance everywhere.
    Uniform,
    /// The traditional overcast sky of Moon and Spencer (1942), CIE sky 16: (1 + 2 sin elevation) / 3.
    Overcast,
    /// A gradation with elevation times an indicatrix about the sun.
    Gradation(Gradation),
}

/// φ(Z) f(χ) with the gradation φ = 1 + a exp(b / cos Z) and the indicatrix f = 1 + c (exp(d χ) − k) + e cos² χ, where Z is the angle to
/// the zenith and χ that to the sun (CIE S 011 with k = exp(d π/2); Perez, Seals and Michalsky 1993 with k = 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradation {
    /// a and b.
    gradation: [f64; 2],
    /// c, d and e.
    indicatrix: [f64; 3],
    /// 1 − c k.
    offset: f64,
    /// Smallest cos Z.
    min_cosine: f64,
    /// Local unit vector towards the sun.
    sun: DVec3,
}

impl Shape {
    /// Relative radiance in a local unit direction above the horizon.
    pub fn relative(&self, local: DVec3) -> f64 {
        match self {
            Shape::Uniform => 1.0,
            Shape::Overcast => (1.0 + 2.0 * local.z) / 3.0,
            Shape::Gradation(gradation) => gradation.relative(local),
        }
    }

    /// Direction in which the relative radiance may have a sharp maximum: the sun.
    pub fn peak(&self) -> Option<DVec3> {
        match self {
            Shape::Gradation(g) if g.indicatrix[0] != 0.0 => Some(g.sun),
            _ => None,
        }
    }
}

impl Gradation {
    /// The CIE form with coefficients `a b c d e`, which is φ(0) f(Zs) at the zenith.
    pub fn cie([a, b, c, d, e]: [f64; 5], sun: DVec3) -> Gradation {
        // exp(b / cos Z) is 0 in the limit of the horizon, as all b are negative.
        let offset = 1.0 - c * (d * FRAC_PI_2).exp();
        Gradation { gradation: [a, b], indicatrix: [c, d, e], offset, min_cosine: f64::MIN_POSITIVE, sun }
    }

    /// The Perez form with coefficients `a b c d e`.
    pub fn perez([a, b, c, d, e]: [f64; 5], sun: DVec3) -> Gradation {
        // b may be positive, with which the formula has no limit at the horizon. Radiance's perezlum.cal has the same least cosine.
        Gradation { gradation: [a, b], indicatrix: [c, d, e], offset: 1.0, min_cosine: 0.01, sun }
    }

    /// φ f, at least 0: some coefficients of Perez give small negative values opposite to the sun.
    fn relative(&self, local: DVec3) -> f64 {
        (self.gradation(local.z) * self.indicatrix(local.distance(self.sun))).max(0.0)
    }

    /// φ at a cosine of the angle to the zenith.
    fn gradation(&self, cosine: f64) -> f64 {
        let [a, b] = self.gradation;
        if a == 0.0 { 1.0 } else { 1.0 + a * (b / cosine.max(self.min_cosine)).exp() }
    }

    /// f at a distance of the unit vectors to the point and to the sun, 2 sin(χ / 2). It is accurate near the sun also for directions
    /// that were rounded to f32, unlike the cosine of χ.
    fn indicatrix(&self, distance: f64) -> f64 {
        let [c, d, e] = self.indicatrix;
        let sin = (0.5 * distance).min(1.0);
        let cosine = 1.0 - 2.0 * sin * sin;
        let glow = if c == 0.0 { 0.0 } else { c * (d * 2.0 * sin.asin()).exp() };
        self.offset + glow + e * cosine * cosine
    }
}

/// Steps of the tables below: see [`GradationTable`] for the error that they leave.
const TABLE_STEPS: usize = 2000;

/// φ and f of a [`Gradation`] tabulated, for many evaluations: by the square root of cos Z, because φ changes most at the horizon, and by
/// the distance to the sun on the unit sphere, in which f is smooth there. Values between entries are linear. The largest error of all
/// CIE types and of Perez skies in all bins is 0.013 % (test `tables_agree_with_formulas`), in a quarter of the formula's time.
#[derive(Clone, Debug)]
pub(super) struct GradationTable {
    gradation: Vec<f32>,
    indicatrix: Vec<f32>,
    sun: DVec3,
}

impl GradationTable {
    pub fn new(formula: &Gradation) -> GradationTable {
        let part = |k: usize| k as f64 / TABLE_STEPS as f64;
        let table = |value: &dyn Fn(f64) -> f64| (0..=TABLE_STEPS).map(|k| value(part(k)) as f32).collect();
        GradationTable {
            gradation: table(&|t| formula.gradation(t * t)),
            indicatrix: table(&|t| formula.indicatrix(2.0 * t)),
            sun: formula.sun,
        }
    }

    /// Relative radiance in a local unit direction above the horizon.
    pub fn relative(&self, local: DVec3) -> f64 {
        let gradation = interpolated(&self.gradation, local.z.max(0.0).sqrt());
        let indicatrix = interpolated(&self.indicatrix, 0.5 * local.distance(self.sun));
        (gradation * indicatrix).max(0.0)
    }
}

/// The value of a table at a fraction of its range, in `[0, 1]` but for rounding.
fn interpolated(table: &[f32], part: f64) -> f64 {
    let at = part * TABLE_STEPS as f64;
    let k = (at as usize).min(TABLE_STEPS - 1);
    let [low, high] = [table[k], table[k + 1]].map(f64::from);
    low + (at - k as f64) * (high - low)
}

// The CIE general skies (ISO 15469:2004, CIE S 011), by type.

/// Coefficients `a b c d e` of types 1 to 15: ISO 15469:2004, table 1.
const CIE_COEFFICIENTS: [[f64; 5]; 15] = [
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
pub(super) const CIE_CLEAR: u8 = 12;
/// The traditional overcast sky.
pub(super) const TRADITIONAL_OVERCAST: u8 = 16;

/// Whether the radiance of a type depends on the position of the sun.
pub(super) fn cie_needs_sun(kind: u8) -> bool {
    !matches!(kind, 1 | 3 | 5 | TRADITIONAL_OVERCAST)
}

/// The sky of a type from 1 to 16 with the sun in a local direction.
pub(super) fn cie_shape(kind: u8, sun: DVec3) -> Shape {
    match kind {
        TRADITIONAL_OVERCAST => Shape::Overcast,
        5 => Shape::Uniform,
        _ => Shape::Gradation(Gradation::cie(CIE_COEFFICIENTS[usize::from(kind) - 1], sun)),
    }
}
