//! Irradiance on all samples from the sun and from a sky whose radiance depends on the direction.

use super::Grid;
use super::quantities::{Slopes, Sun, Tilt, arctangent, visible_parts, with_holes};
use super::sweep::{Azimuths, Row, SweepOptions, fold};
use crate::math::parallel;
use crate::{Error, Result};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Light from sun and sky at one time. All light is in one unit: W/m² and W/(m² sr), or lx and cd/m².
pub struct Light<'a> {
    /// Direction of the sun and size of its disc.
    pub sun: Sun,
    /// Irradiance from the sun on a surface that faces it.
    pub direct_normal: f64,
    /// Radiance of the sky by direction: a unit vector to the east, north and up, above the horizontal.
    pub sky: &'a (dyn Fn(DVec3) -> f64 + Sync),
}

/// Elevations between the horizontal and the zenith at which integrals over the sky are stored. Between them the integrals are
/// interpolated linearly: an error of (π/2 / 256)²/8 = 5e-6 of the zenith's radiance for a sky that is smooth over steps of
/// 0.35°.
const ELEVATIONS: usize = 256;

/// Azimuths within one sector over which the radiance is averaged: with 16 and more sectors directions less than 6° apart.
const SUBSECTORS: usize = 4;

/// Integrals of the radiance of one sector of azimuths from each elevation to the zenith: ∫ L sin e cos e de and ∫ L cos² e de,
/// times the sector's angle.
type Sector = Vec<[f32; 2]>;

/// Irradiance on the sloping surface of each sample, direct and diffuse, without light from other terrain. `azimuths`: number of
/// sectors of the sky. Returns `columns * rows` values in the unit of `light`; NaN in holes.
///
/// # Errors
/// [`Error::Argument`] if the irradiance or a radiance is negative or not finite or an argument is out of range,
/// [`Error::OutOfMemory`].
pub fn irradiance(grid: &Grid, light: &Light, azimuths: usize, options: &SweepOptions) -> Result<Vec<f32>> {
    super::quantities::check(azimuths)?;
    light.sun.check()?;
    if !(light.direct_normal >= 0.0 && light.direct_normal.is_finite()) {
        let value = light.direct_normal;
        return Err(Error::argument("direct_normal", value, "must be 0 or more and finite"));
    }
    let directions = Azimuths { count: azimuths, first: PI / azimuths as f64 };
    let sectors: Vec<Sector> =
        (0..azimuths).map(|i| sector(light.sky, directions.get(i), azimuths)).collect::<Result<_>>()?;
    let diffuse = |row: Row, sums: &mut [f32]| {
        let slopes = Slopes::new(row.grid, row.row);
        let sector = &sectors[row.azimuth];
        for (c, sum) in sums.iter_mut().enumerate() {
            let tilt = Tilt::new(slopes.at(c), row.direction);
            let place =
                arctangent(row.tangents[c].max(tilt.own_horizon())) * (ELEVATIONS as f32 / FRAC_PI_2 as f32);
            let i = (place as usize).min(ELEVATIONS - 1);
            let [up, along]: [f32; 2] = std::array::from_fn(|k| {
                sector[i][k] + (sector[i + 1][k] - sector[i][k]) * (place - i as f32)
            });
            *sum += tilt.up * up + tilt.along * along;
        }
    };
    let mut values = fold(grid, directions, options, diffuse)?;
    if light.direct_normal > 0.0 && light.sun.elevation + light.sun.half_angle > 0.0 {
        let direct = direct(grid, light, options)?;
        values.iter_mut().zip(&direct).for_each(|(value, direct)| *value += direct);
    }
    Ok(with_holes(values, grid))
}

/// Irradiance from the sun.
fn direct(grid: &Grid, light: &Light, options: &SweepOptions) -> Result<Vec<f32>> {
    let sun = &light.sun;
    let (rise, level) = sun.elevation.sin_cos();
    let (rise, level, normal) = (rise as f32, level as f32, light.direct_normal as f32);
    let mut values = visible_parts(grid, sun, options)?;
    // Rows increase to the south.
    let direction = [sun.azimuth.sin(), -sun.azimuth.cos()].map(|d| d as f32);
    parallel::for_each_chunk_mut(&mut values, grid.columns(), |row, values| {
        let slopes = Slopes::new(grid, row);
        for (c, value) in values.iter_mut().enumerate() {
            let tilt = Tilt::new(slopes.at(c), direction);
            *value *= normal * (tilt.up * rise + tilt.along * level).max(0.0);
        }
    });
    Ok(values)
}

/// The integrals of one sector around an azimuth.
fn sector(sky: &(dyn Fn(DVec3) -> f64 + Sync), azimuth: f64, count: usize) -> Result<Sector> {
    let (angle, step) = (TAU / count as f64, FRAC_PI_2 / ELEVATIONS as f64);
    let mut sums = [0.0f64; 2];
    let mut out = vec![[0.0f32; 2]; ELEVATIONS + 1];
    for i in (0..ELEVATIONS).rev() {
        let elevation = (i as f64 + 0.5) * step;
        let (rise, level) = elevation.sin_cos();
        let mut radiance = 0.0;
        for k in 0..SUBSECTORS {
            let (east, north) = (azimuth + angle * ((k as f64 + 0.5) / SUBSECTORS as f64 - 0.5)).sin_cos();
            let value = sky(DVec3::new(level * east, level * north, rise));
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::arguments(format!(
                    "the sky has the radiance {value} at an elevation of {:.1}°: must be 0 or more and finite",
                    elevation.to_degrees()
                )));
            }
            radiance += value / SUBSECTORS as f64;
        }
        // Over a step, ∫ sin e cos e de = sin e cos e sin δ for a step δ around e, and ∫ cos² e de = (δ + cos 2e sin δ)/2.
        sums[0] += radiance * angle * rise * level * step.sin();
        sums[1] += radiance * angle * 0.5 * (step + (2.0 * elevation).cos() * step.sin());
        out[i] = sums.map(|s| s as f32);
    }
    Ok(out)
}
