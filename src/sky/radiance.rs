//! Radiance of the sky by direction, scaled to a level.

use super::frame::spherical;
use super::gradation::{GradationTable, Shape};
use super::map::SkyMap;
use crate::math::{LUMINANCE, MAX_RADIANCE};
use crate::{Error, Result};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// Columns of the quadrature of skies without a map, and four times its rows. The error of the horizontal irradiance is below 3e-5 for
/// all CIE types and Perez bins (test `levels_are_integrals`).
const COLUMNS: usize = 1024;
/// Largest number of columns of a quadrature: limits it to 8,192² / 4 = 17 million values. Larger maps are not sampled at every texel.
const MAX_COLUMNS: usize = 8192;

/// Value that determines the level of a sky, W/m² and W/(m² sr), or lx and cd/m².
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// Irradiance of a horizontal plane by the sky alone. Colours of a map are kept: the luminance of the result has this value.
    Horizontal(f64),
    /// The same for each channel.
    HorizontalRgb([f64; 3]),
    /// Radiance at the zenith; with a map, the luminance there.
    Zenith(f64),
    /// The values of the shape and the map, times a factor.
    Times(f64),
}

/// Radiance of the sky without the sun's disc. Directions are local: (east, north, up).
#[derive(Clone, Debug)]
pub struct Sky {
    shape: Shape,
    /// The shape's table if it is a gradation.
    table: Option<Arc<GradationTable>>,
    map: Option<Arc<SkyMap>>,
    /// Whether the map also holds the radiance below the horizon.
    has_lower_half: bool,
    scale: [f64; 3],
    /// Irradiance of a horizontal plane by the upper half, W/m².
    horizontal: [f64; 3],
}

impl Sky {
    /// A sky of a shape, of a map (`shape` uniform), or the product of both. With `has_lower_half` a map of the whole sphere is taken
    /// below the horizon, too.
    ///
    /// # Errors
    /// [`Error::Argument`] if a level is negative or not finite, or is asked of a channel that is black, or if the irradiance of the
    /// ground is above [`MAX_RADIANCE`].
    pub fn new(shape: Shape, map: Option<Arc<SkyMap>>, has_lower_half: bool, level: Level) -> Result<Sky> {
        let has_lower_half = has_lower_half && map.as_ref().is_some_and(|m| m.is_sphere());
        let table = match &shape {
            Shape::Gradation(formula) => Some(Arc::new(GradationTable::new(formula))),
            _ => None,
        };
        let mut sky = Sky { shape, table, map, has_lower_half, scale: [1.0; 3], horizontal: [0.0; 3] };
        let unscaled = sky.integrate();
        let wanted = match level {
            Level::HorizontalRgb(values) => values,
            Level::Horizontal(value) | Level::Zenith(value) | Level::Times(value) => [value; 3],
        };
        if let Some(bad) = wanted.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return Err(Error::arguments(format!(
                "the level {bad} of the sky is not a number of at least 0"
            )));
        }
        let native = match level {
            Level::Horizontal(_) => [luminance(unscaled); 3],
            Level::HorizontalRgb(_) => unscaled,
            Level::Zenith(_) => [luminance(sky.radiance(DVec3::Z)); 3],
            Level::Times(_) => [1.0; 3],
        };
        for c in 0..3 {
            if native[c] <= 0.0 && wanted[c] > 0.0 {
                return Err(Error::arguments(
                    "the sky is black where its level is stated: give a map with some light there, or no level".into(),
                ));
            }
            sky.scale[c] = if native[c] > 0.0 { wanted[c] / native[c] } else { 0.0 };
            sky.horizontal[c] = sky.scale[c] * unscaled[c];
            // The irradiance of a stated level has rounding errors.
            if sky.horizontal[c] > (1.0 + 1e-9) * MAX_RADIANCE {
                return Err(Error::arguments(format!(
                    "the sky gives {:.3e} W/m² on the ground: must be at most {MAX_RADIANCE:e}; lower its level",
                    sky.horizontal[c]
                )));
            }
        }
        Ok(sky)
    }

    /// Radiance in a local unit direction, W/(m² sr): 0 below the horizon unless the map has it.
    pub fn radiance(&self, local: DVec3) -> [f64; 3] {
        if local.z <= 0.0 && !self.has_lower_half {
            return [0.0; 3];
        }
        let relative = self.relative(local);
        match &self.map {
            None => self.scale.map(|s| s * relative),
            Some(map) => {
                let colour = map.at(local);
                [0, 1, 2].map(|c| self.scale[c] * relative * colour[c])
            }
        }
    }

    /// Radiance at the centre of a texel of the map, W/(m² sr): as [`Sky::radiance`] there, without interpolation.
    pub(super) fn radiance_of_texel(&self, k: usize) -> [f64; 3] {
        let Some(map) = &self.map else { return [0.0; 3] };
        if !self.has_lower_half && map.is_below(k) {
            return [0.0; 3];
        }
        let relative = match &self.shape {
            Shape::Uniform => 1.0,
            _ => self.relative(map.direction(k)),
        };
        [0, 1, 2].map(|c| self.scale[c] * relative * f64::from(map.texel(k)[c]))
    }

    /// The shape without its level.
    fn relative(&self, local: DVec3) -> f64 {
        match &self.table {
            Some(table) => table.relative(local),
            None => self.shape.relative(local),
        }
    }

    /// Irradiance of a horizontal plane by the sky alone, W/m².
    pub fn horizontal_irradiance(&self) -> [f64; 3] {
        self.horizontal
    }

    /// The map, if there is one.
    pub(super) fn map(&self) -> Option<&SkyMap> {
        self.map.as_deref()
    }

    /// Replaces texels of the map, given by their numbers; scales stay.
    pub(super) fn set_texels(&mut self, texels: impl IntoIterator<Item = (usize, [f32; 3])>) {
        if let Some(map) = &mut self.map {
            let map = Arc::make_mut(map);
            texels.into_iter().for_each(|(k, value)| map.set_texel(k, value));
        }
        self.horizontal = self.integrate();
    }

    /// The same with all radiance times a factor of at least 0.
    pub(super) fn scaled(&self, factor: f64) -> Sky {
        let [scale, horizontal] = [self.scale, self.horizontal].map(|v| v.map(|v| factor * v));
        Sky { scale, horizontal, ..self.clone() }
    }

    /// Whether directions below the horizon have radiance of their own.
    pub fn has_lower_half(&self) -> bool {
        self.has_lower_half
    }

    /// Local direction in which the radiance may have a sharp maximum.
    pub(super) fn peak(&self) -> Option<DVec3> {
        self.shape.peak()
    }

    /// Angle below which the radiance has no detail, radians: the angle between texels of the map; none without a map.
    pub(super) fn detail(&self) -> Option<f64> {
        self.map.as_ref().map(|m| m.step())
    }

    /// Integral of radiance times the sine of the elevation over the upper half, by samples at the centres of rows of equal angle.
    fn integrate(&self) -> [f64; 3] {
        // A map is sampled at every texel: the brightest part may be a single texel.
        let columns =
            self.detail().map_or(COLUMNS, |step| ((TAU / step) as usize).clamp(COLUMNS, MAX_COLUMNS));
        let rows = columns / 4;
        let height = |row: f64| (FRAC_PI_2 * row / rows as f64).sin();
        let mut sum = [0.0; 3];
        for row in 0..rows {
            let (low, middle, high) =
                (height(row as f64), height(row as f64 + 0.5), height(row as f64 + 1.0));
            let weight = 0.5 * (high - low) * (high + low) * TAU / columns as f64;
            for column in 0..columns {
                let value = self.radiance(spherical(middle, TAU * (column as f64 + 0.5) / columns as f64));
                (0..3).for_each(|c| sum[c] += weight * value[c]);
            }
        }
        sum
    }
}

/// Luminance of linear RGB; equal components are returned unchanged.
pub(super) fn luminance(v: [f64; 3]) -> f64 {
    if v[0] == v[1] && v[1] == v[2] { v[0] } else { (0..3).map(|c| LUMINANCE[c] * v[c]).sum() }
}
