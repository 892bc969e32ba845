//! Maps of the sky: equirectangular pictures of radiance.

use super::frame::{azimuth, spherical};
use crate::error::quote;
use crate::files::input;
use crate::{Error, Result, memory};
use glam::DVec3;
use image::{ImageFormat, ImageReader, Limits};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::{io::Cursor, path::Path};

/// Largest number of columns and of rows: twice the largest side that graphics cards take (16,384).
const MAX_SIDE: u32 = 32_768;
/// Largest fraction of the texels that may be repaired: cameras and programs leave single bad texels. A map with more of them holds
/// something else than radiance.
const MAX_BAD_FRACTION: f64 = 0.01;

/// An equirectangular map: columns are azimuths, its centre column faces north and east is to the right of it; rows are equal steps of
/// the angle to the zenith, from the zenith to the nadir, or to the horizon if the map is four times as wide as high.
#[derive(Clone, Debug)]
pub struct SkyMap {
    width: usize,
    height: usize,
    /// Angle that the rows cover, radians: π or π/2.
    span: f64,
    /// Azimuth of the first column's left edge, radians.
    start: f64,
    texels: Vec<[f32; 3]>,
    /// Texels that were not finite or negative, and became the mean of their neighbours.
    pub repaired: usize,
}

/// A texel of a Radiance HDR file as Radiance reads it: mantissas of eight bits are cut off when they are written, so that half a step is
/// added to each (Ward 1991, *Real Pixels*). The largest of the three has its highest bit set.
fn with_half_steps(texel: [f32; 3]) -> [f32; 3] {
    let largest = texel.into_iter().fold(0.0, f32::max);
    let power_of_two = f32::from_bits(largest.to_bits() & f32::INFINITY.to_bits());
    texel.map(|v| v + power_of_two / 256.0)
}

impl SkyMap {
    /// Reads an OpenEXR or Radiance HDR file. `north` is the azimuth of its centre column, degrees.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::File`] if it is no such map or holds too many values that no radiance can have;
    /// [`Error::OutOfMemory`].
    pub fn read(path: &Path, north: f64) -> Result<SkyMap> {
        let limit = memory::usable().unwrap_or(u64::MAX >> 1);
        let bytes = input::read(path, limit)?;
        let reader = ImageReader::new(Cursor::new(&bytes[..])).with_guessed_format();
        let mut reader = reader.map_err(|e| Error::io(path, e))?;
        if !matches!(reader.format(), Some(ImageFormat::OpenExr | ImageFormat::Hdr)) {
            return Err(Error::format(
                path,
                None,
                "not an OpenEXR or Radiance HDR file: save the map as one of these",
            ));
        }
        let mut limits = Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE), Some(MAX_SIDE));
        limits.max_alloc = Some(limit);
        reader.limits(limits);
        let is_hdr = reader.format() == Some(ImageFormat::Hdr);
        let undecoded =
            |e| Error::format(path, None, format!("cannot be decoded: {}", quote(&format!("{e}"))));
        let image = input::guarded(path, || reader.decode().map_err(undecoded))?;
        drop(bytes);
        let image = image.into_rgb32f();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let texels = image.pixels().map(|p| if is_hdr { with_half_steps(p.0) } else { p.0 }).collect();
        SkyMap::new(width, height, texels, north).map_err(|what| Error::format(path, None, what))
    }

    /// A map of rows of texels, W/(m² sr) or relative, from the top.
    pub fn new(width: usize, height: usize, texels: Vec<[f32; 3]>, north: f64) -> Result<SkyMap, String> {
        let span = match width {
            _ if height > 0 && width == 2 * height => PI,
            _ if height > 0 && width == 4 * height => FRAC_PI_2,
            _ => {
                return Err(format!(
                    "{width} x {height} texels: an equirectangular map is twice as wide as high (the whole sphere) or \
                     four times (the upper half); resize it"
                ));
            }
        };
        let start = north.to_radians() - PI;
        let mut map = SkyMap { width, height, span, start, texels, repaired: 0 };
        map.repair()?;
        if map.texels.iter().all(|t| t.iter().all(|v| *v == 0.0)) {
            return Err("all texels are black: give a map with some light".into());
        }
        Ok(map)
    }

    /// Replaces texels of impossible radiance by the mean of their good neighbours, or by black if there are none.
    fn repair(&mut self) -> Result<(), String> {
        let good = |t: &[f32; 3]| t.iter().all(|v| v.is_finite() && *v >= 0.0);
        let bad: Vec<usize> = (0..self.texels.len()).filter(|k| !good(&self.texels[*k])).collect();
        if bad.len() as f64 > MAX_BAD_FRACTION * self.texels.len() as f64 {
            let (x, y) = (bad[0] % self.width, bad[0] / self.width);
            return Err(format!(
                "{} of {} texels are negative or not finite, the first at {x},{y}: radiance is a number of at least 0; write the map again",
                bad.len(),
                self.texels.len()
            ));
        }
        let repairs: Vec<[f32; 3]> = bad.iter().map(|k| self.neighbours(*k, good)).collect();
        for (k, value) in bad.iter().zip(repairs) {
            self.texels[*k] = value;
        }
        self.repaired = bad.len();
        Ok(())
    }

    fn neighbours(&self, k: usize, good: impl Fn(&[f32; 3]) -> bool) -> [f32; 3] {
        let (x, y) = (k % self.width, k / self.width);
        let rows = y.saturating_sub(1)..=(y + 1).min(self.height - 1);
        let columns = [x + self.width - 1, x, x + 1].map(|x| x % self.width);
        let around = rows.flat_map(|y| columns.map(|x| self.texels[y * self.width + x]));
        let found: Vec<[f32; 3]> = around.filter(good).collect();
        let mean = |c: usize| found.iter().map(|t| f64::from(t[c])).sum::<f64>() / found.len().max(1) as f64;
        [0, 1, 2].map(|c| mean(c) as f32)
    }

    /// Whether the map covers the directions below the horizon.
    pub fn is_sphere(&self) -> bool {
        self.span > FRAC_PI_2
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// A texel by its number, row after row from the zenith.
    pub fn texel(&self, k: usize) -> [f32; 3] {
        self.texels[k]
    }

    /// Replaces a texel.
    pub fn set_texel(&mut self, k: usize, value: [f32; 3]) {
        self.texels[k] = value;
    }

    /// Local unit vector to the centre of a texel.
    pub fn direction(&self, k: usize) -> DVec3 {
        let (column, row) = (k % self.width, k / self.width);
        let angle = (row as f64 + 0.5) * self.step();
        spherical(angle.cos(), self.start + TAU * (column as f64 + 0.5) / self.width as f64)
    }

    /// Whether the centre of a texel is not above the horizon.
    pub fn is_below(&self, k: usize) -> bool {
        ((k / self.width) as f64 + 0.5) * self.step() >= FRAC_PI_2
    }

    /// Solid angle of a texel, sr.
    pub fn solid_angle(&self, k: usize) -> f64 {
        let angle = (k / self.width) as f64 * self.step();
        TAU / self.width as f64 * (angle.cos() - (angle + self.step()).cos())
    }

    /// Angle between neighbouring rows, radians.
    pub fn step(&self) -> f64 {
        self.span / self.height as f64
    }

    /// The value in a local unit direction, bilinear between the centres of texels; of the lowest row below the map.
    pub fn at(&self, local: DVec3) -> [f64; 3] {
        let angle = local.x.hypot(local.y).atan2(local.z);
        let y = (angle / self.step() - 0.5).clamp(0.0, (self.height - 1) as f64);
        let turn = ((azimuth(local) - self.start) / TAU).rem_euclid(1.0);
        let x = (turn * self.width as f64 - 0.5).rem_euclid(self.width as f64);
        let (column, row) = ((x as usize).min(self.width - 1), y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let next = (column + 1) % self.width;
        let below = (row + 1).min(self.height - 1);
        let texel = |x: usize, y: usize, c: usize| f64::from(self.texels[y * self.width + x][c]);
        [0, 1, 2].map(|c| {
            let upper = (1.0 - fx) * texel(column, row, c) + fx * texel(next, row, c);
            let lower = (1.0 - fx) * texel(column, below, c) + fx * texel(next, below, c);
            (1.0 - fy) * upper + fy * lower
        })
    }
}
