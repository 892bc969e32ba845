//! Two rectangles with parallel sides, in parallel or perpendicular planes.
//!
//! Both follow from the contour integral `A1 F12 = 1/2π ∮∮ ln r dr1·dr2` (Sparrow 1963). Along sides parallel to an
//! axis the integral is elementary: an antiderivative in four coordinates, summed with alternating signs over the
//! sixteen combinations of ends (Howell, *A Catalog of Radiation Heat Transfer Configuration Factors*, C-13 and C-16).

use std::f64::consts::PI;

/// An interval of coordinates, `[from, to]` with `from < to`; scene units.
pub type Span = [f64; 2];

/// `F(first → second)` of two rectangles that face each other in parallel planes at distance `gap > 0`. Each is given
/// by its intervals along x and y. Unitless.
pub fn parallel_rectangles(first: [Span; 2], second: [Span; 2], gap: f64) -> f64 {
    let term = |u: f64, v: f64| {
        let r = (v * v + gap * gap).sqrt();
        u * r * (u / r).atan()
    };
    let sum = corners(first, second, |u, v| {
        term(u, v) + term(v, u) - 0.5 * gap * gap * (u * u + v * v + gap * gap).ln()
    });
    sum / (2.0 * PI * area(first))
}

/// `F(first → second)` of two rectangles in perpendicular planes: the first in the plane `z = 0` with intervals along
/// x and y, the second in the plane `x = 0` with intervals along z and y. x and z are at least 0; the rectangles may
/// touch along the y axis. Unitless.
pub fn perpendicular_rectangles(first: [Span; 2], second: [Span; 2]) -> f64 {
    let [[x, y], [z, w]] = [first, second];
    let mut sum = 0.0;
    for i in 0..16u32 {
        let bit = |k: u32| (i >> k & 1) as usize;
        let across = x[bit(0)].powi(2) + z[bit(2)].powi(2);
        let along = y[bit(1)] - w[bit(3)];
        let r = across.sqrt();
        let far = across + along * along;
        let angle = if r > 0.0 { along * r * (along / r).atan() } else { 0.0 };
        let log = if far > 0.0 { 0.25 * (across - along * along) * far.ln() } else { 0.0 };
        sum += sign(i) * (angle - log);
    }
    sum / (2.0 * PI * area(first))
}

fn corners(first: [Span; 2], second: [Span; 2], term: impl Fn(f64, f64) -> f64) -> f64 {
    (0..16u32)
        .map(|i| {
            let bit = |k: u32| (i >> k & 1) as usize;
            sign(i) * term(first[0][bit(0)] - second[0][bit(2)], first[1][bit(1)] - second[1][bit(3)])
        })
        .sum()
}

fn sign(corner: u32) -> f64 {
    if corner.count_ones().is_multiple_of(2) { 1.0 } else { -1.0 }
}

fn area([u, v]: [Span; 2]) -> f64 {
    (u[1] - u[0]) * (v[1] - v[0])
}
