//! The sky visible from a sample in one azimuth above its horizon.

use super::Grid;
use super::grid::slope;

/// Angle whose tangent is `t` ≥ 0, radians, to 1e-5 (Abramowitz and Stegun, *Handbook of mathematical functions*, 4.4.47). It has
/// no branches, so that loops over rows are vectorised; the error in a sky view factor is below 1e-5.
#[inline]
pub fn arctangent(t: f32) -> f32 {
    let is_large = t > 1.0;
    let x = if is_large { 1.0 / t } else { t };
    let y = x * x;
    let a = x * (0.999_866 + y * (-0.330_299_5 + y * (0.180_141 + y * (-0.085_133 + y * 0.020_835_1))));
    if is_large { std::f32::consts::FRAC_PI_2 - a } else { a }
}

/// A row of samples with their slopes.
pub struct Slopes<'a> {
    above: &'a [f32],
    here: &'a [f32],
    below: &'a [f32],
    scale: [f32; 2],
}

impl<'a> Slopes<'a> {
    /// Slopes of row `row` of a grid.
    pub fn new(grid: &'a Grid, row: usize) -> Slopes<'a> {
        let columns = grid.columns();
        let line = |r: usize| &grid.heights()[r * columns..(r + 1) * columns];
        // A row beyond the border is a copy of the border: `at` recognises it by its address.
        let (above, below) = (line(row.saturating_sub(1)), line((row + 1).min(grid.rows() - 1)));
        Slopes { above, here: line(row), below, scale: grid.cell().map(|d| 1.0 / d as f32) }
    }

    /// Slopes along increasing columns and rows at a column, from the central differences of its neighbours; at borders and beside holes from the
    /// differences on one side, 0 if there are none.
    #[inline]
    pub fn at(&self, c: usize) -> [f32; 2] {
        let get = |line: &[f32], c: usize| line.get(c).copied().unwrap_or(f32::NAN);
        let here = self.here[c];
        let across = |line: &[f32]| if std::ptr::eq(line, self.here) { f32::NAN } else { line[c] };
        [
            slope(get(self.here, c.wrapping_sub(1)), here, get(self.here, c + 1), self.scale[0]),
            slope(across(self.above), here, across(self.below), self.scale[1]),
        ]
    }
}

/// A sample's surface as seen in one azimuth.
#[derive(Clone, Copy)]
pub struct Tilt {
    /// Upward component of the unit normal.
    pub up: f32,
    /// Component of the normal along the azimuth.
    pub along: f32,
}

impl Tilt {
    /// From the slopes along columns and rows and the azimuth's direction along them.
    #[inline]
    pub fn new([p, q]: [f32; 2], direction: [f32; 2]) -> Tilt {
        let up = 1.0 / (1.0 + p * p + q * q).sqrt();
        Tilt { up, along: -(p * direction[0] + q * direction[1]) * up }
    }

    /// Tangent of the elevation above which the sample's own plane does not hide the sky; 0 or more.
    #[inline]
    pub fn own_horizon(self) -> f32 {
        (-self.along / self.up).max(0.0)
    }

    /// ∫ 2 max(0, n·ω) cos e de over elevations e from the higher of the horizon with this tangent and the own one to the zenith:
    /// 1 for a horizontal sample without horizon.
    #[inline]
    pub fn seen(self, tangent: f32) -> f32 {
        let t = tangent.max(self.own_horizon());
        // n·ω = up sin e + along cos e; the antiderivative of 2 (up sin e + along cos e) cos e is −up cos² e + along (e + sin e
        // cos e).
        let square = 1.0 / (1.0 + t * t);
        let seen = self.up * square + self.along * (std::f32::consts::FRAC_PI_2 - arctangent(t) - t * square);
        // Rounding may give negative values near the zenith.
        seen.max(0.0)
    }
}
