//! Quantities at all samples that depend on the horizon alone: sky view factor, horizon angles, sunlit or shaded.

use super::Grid;
use super::grid::slope;
use super::sweep::{Azimuths, Row, SweepOptions, each, fold};
use crate::{Error, Result};
use std::f64::consts::FRAC_PI_2;

/// Largest number of azimuths: steps of 0.35°, 1 sample in 160 samples of distance.
const MAX_AZIMUTHS: usize = 1024;

pub(super) fn check(azimuths: usize) -> Result<()> {
    match azimuths {
        4..=MAX_AZIMUTHS => Ok(()),
        n => Err(Error::argument("azimuths", n, format!("must lie in 4..{MAX_AZIMUTHS}"))),
    }
}

/// Makes samples without a height NaN.
pub(super) fn with_holes(mut values: Vec<f32>, grid: &Grid) -> Vec<f32> {
    for (value, height) in values.iter_mut().zip(grid.heights()) {
        if height.is_nan() {
            *value = f32::NAN;
        }
    }
    values
}

/// Sky view factor of each sample: the irradiance from a sky of uniform radiance on the sample's sloping surface as a fraction of that
/// on a horizontal surface without horizon, ∫ max(0, n·ω) dω / π over the directions ω above the horizontal and above the
/// horizon. An unobstructed slope of inclination b has (1 + cos b)/2.
///
/// `azimuths`: number of directions in which the horizon is found; half a step from north is the first. Returns `columns * rows` values
/// in 0..1; NaN in holes.
///
/// # Errors
/// [`Error::Argument`] if `azimuths` is not in 4..1024, [`Error::OutOfMemory`].
pub fn sky_view_factor(grid: &Grid, azimuths: usize, options: &SweepOptions) -> Result<Vec<f32>> {
    check(azimuths)?;
    let directions = Azimuths { count: azimuths, first: std::f64::consts::PI / azimuths as f64 };
    let part = 1.0 / azimuths as f32;
    let add = |row: Row, sums: &mut [f32]| {
        let slopes = Slopes::new(row.grid, row.row);
        for (c, sum) in sums.iter_mut().enumerate() {
            let tilt = Tilt::new(slopes.at(c), row.direction);
            *sum += part * tilt.seen(row.tangents[c]);
        }
    };
    Ok(with_holes(fold(grid, directions, options, add)?, grid))
}

/// Elevations of the horizon at all samples.
#[derive(Clone, Debug)]
pub struct Horizon {
    /// Azimuths, radians from north over east, from 0 on at equal distances.
    pub azimuths: Vec<f64>,
    /// For each azimuth `columns * rows` elevations of the horizon, radians, not below 0; NaN in holes.
    pub elevations: Vec<Vec<f32>>,
}

/// Elevation of the horizon of each sample in `azimuths` directions from north over east; 0 where nothing is above the horizontal.
///
/// # Errors
/// [`Error::Argument`] if `azimuths` is not in 4..1024, [`Error::OutOfMemory`].
pub fn horizon(grid: &Grid, azimuths: usize, options: &SweepOptions) -> Result<Horizon> {
    check(azimuths)?;
    let directions = Azimuths { count: azimuths, first: 0.0 };
    let angles: Vec<f64> = (0..azimuths).map(|i| directions.get(i)).collect();
    let add = |row: Row, out: &mut [f32]| {
        for (out, tangent) in out.iter_mut().zip(row.tangents) {
            *out = arctangent(*tangent);
        }
    };
    let elevations = each(grid, directions, options, add)?;
    let elevations = elevations.into_iter().map(|values| with_holes(values, grid)).collect();
    Ok(Horizon { azimuths: angles, elevations })
}

/// Direction of the sun.
#[derive(Clone, Copy, Debug)]
pub struct Sun {
    /// Radians from north over east.
    pub azimuth: f64,
    /// Radians above the horizontal.
    pub elevation: f64,
    /// Half the angle under which the disc is seen, radians; 0 for sharp shadows. That of the sun is 0.00465.
    pub half_angle: f64,
}

impl Sun {
    /// # Errors
    /// [`Error::Argument`] if an angle is out of range.
    pub(super) fn check(&self) -> Result<()> {
        let right = std::f64::consts::FRAC_PI_2;
        let wrong = |name: &str, value: f64, range: &str| {
            Err(Error::argument(name, value, format!("must lie in {range} radians")))
        };
        match *self {
            Sun { azimuth, .. } if !azimuth.is_finite() => wrong("azimuth", azimuth, "0..2π"),
            Sun { elevation, .. } if !(-right..=right).contains(&elevation) => {
                wrong("elevation", elevation, "-π/2..π/2")
            }
            Sun { half_angle, .. } if !(0.0..=0.1).contains(&half_angle) => {
                let (diameter, most) = (2.0 * half_angle.to_degrees(), 0.2f64.to_degrees());
                let what = format!(
                    "the sun has a diameter of {diameter:.1} degrees: a half shadow on terrain is known up to {most:.1} degrees; lower ⟨sun_diameter⟩"
                );
                Err(Error::arguments(what))
            }
            _ => Ok(()),
        }
    }

    /// Fraction of the disc above a horizon, a straight edge with these elevations half a radius to either side of the disc's middle.
    fn part_above(&self, [left, right]: [f32; 2]) -> f32 {
        let (radius, middle) = (self.half_angle as f32, self.elevation as f32);
        if middle - radius >= left.max(right) {
            return 1.0;
        } else if middle + radius <= left.min(right) {
            return 0.0;
        }
        // The distance of the middle from an edge that rises by `right - left` over a radius.
        let steep = if radius > 0.0 { (right - left) / radius } else { 0.0 };
        let above = (middle - 0.5 * (left + right)) / (1.0 + steep * steep).sqrt();
        if above.abs() >= radius {
            return if above > 0.0 { 1.0 } else { 0.0 };
        }
        // A circle cut at x = above/radius from its centre: the part on the longer side for positive x.
        let x = above / radius;
        0.5 + (x * (1.0 - x * x).sqrt() + x.asin()) / std::f32::consts::PI
    }
}

/// Fraction of the sun's disc that each sample sees, 0..1: 0 in shadow. Includes the shadow of a slope that faces away from the sun.
/// Returns `columns * rows` values; NaN in holes.
///
/// # Errors
/// [`Error::Argument`] if an angle is out of range, [`Error::OutOfMemory`].
pub fn sunlit(grid: &Grid, sun: &Sun, options: &SweepOptions) -> Result<Vec<f32>> {
    sun.check()?;
    Ok(with_holes(visible_parts(grid, sun, options)?, grid))
}

/// The values of [`sunlit`] without its checks. Horizons are found half a radius to either side of the sun's middle: the two places of
/// the Gaussian quadrature over a disc's vertical chords, with equal weights.
pub(super) fn visible_parts(grid: &Grid, sun: &Sun, options: &SweepOptions) -> Result<Vec<f32>> {
    let horizon = |azimuth: f64| {
        fold(grid, Azimuths { count: 1, first: azimuth }, options, |row, out| {
            let slopes = Slopes::new(row.grid, row.row);
            for (c, out) in out.iter_mut().enumerate() {
                let own = Tilt::new(slopes.at(c), row.direction).own_horizon();
                *out = row.tangents[c].max(own).atan();
            }
        })
    };
    let aside = (0.5 * sun.half_angle / sun.elevation.cos()).min(FRAC_PI_2);
    let mut parts = horizon(sun.azimuth - aside)?;
    let others = if aside > 0.0 { horizon(sun.azimuth + aside)? } else { Vec::new() };
    for (k, part) in parts.iter_mut().enumerate() {
        *part = sun.part_above([*part, others.get(k).copied().unwrap_or(*part)]);
    }
    Ok(parts)
}

// The sky visible from a sample in one azimuth above its horizon.

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

    /// Slopes along increasing columns and rows at a column, from the central differences of its neighbours; at borders and beside holes
    /// from the differences on one side, 0 if there are none.
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
