//! Mean linear colour of a texture over a triangle.

use crate::error::{quote, shown};
use crate::math::srgb_to_linear;
use crate::{Error, Result};
use image::{ImageReader, RgbaImage};
use std::{io::Cursor, path::Path, sync::Arc};

/// Image that multiplies a reflectance: 8 bits per channel, sRGB, repeated in both directions.
#[derive(Clone, Debug)]
pub struct Texture {
    image: Arc<RgbaImage>,
}

/// Largest number of columns and of rows. Twice the largest side that graphics cards take (16,384).
const MAX_SIDE: u32 = 32_768;

/// Number of barycentric sample points: centres of the 16 triangles of two midpoint subdivisions, each of equal area.
/// Their mean is the one colour of a face; its standard error is a quarter of the spread of the texture in the face.
const SAMPLES: usize = 16;

impl Texture {
    /// Decodes the image of `file`, which may take `limit` bytes.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be decoded or has more than [`MAX_SIDE`] columns or rows, [`Error::OutOfMemory`]
    /// beyond `limit`.
    pub fn decode(file: &Path, bytes: &[u8], limit: u64) -> Result<Texture> {
        let unusable = |e: image::ImageError| {
            Error::format(file, None, format!("cannot be decoded: {}", quote(&e.to_string())))
        };
        let reader = || {
            let guessed = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
            let mut reader = guessed.map_err(|e| Error::io(file, e))?;
            let mut limits = image::Limits::default();
            (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE), Some(MAX_SIDE));
            limits.max_alloc = Some(limit);
            reader.limits(limits);
            Ok(reader)
        };
        let (width, height) = reader()?.into_dimensions().map_err(unusable)?;
        if width.max(height) > MAX_SIDE {
            let what = format!("{width} x {height} texels, more than {MAX_SIDE} on a side");
            return Err(Error::format(file, None, what));
        }
        // The decoded image, of up to 16 bytes a texel, and its conversion to 4 are held at once.
        let needed = 20 * u64::from(width) * u64::from(height);
        if needed > limit {
            return Err(Error::OutOfMemory(format!(
                "the texture {} of {width} x {height} texels needs {:.1} GB, {:.1} GB are left: make the textures \
                 smaller or raise ⟨LoadOptions::max_memory⟩",
                shown(file),
                needed as f64 / 1e9,
                limit as f64 / 1e9
            )));
        }
        Ok(Texture::of(reader()?.decode().map_err(unusable)?.to_rgba8()))
    }

    /// Memory of the image, bytes.
    pub fn bytes(&self) -> u64 {
        self.image.as_raw().len() as u64
    }

    /// Wraps an image.
    pub fn of(image: RgbaImage) -> Texture {
        Texture { image: Arc::new(image) }
    }

    /// Mean colour over the triangle with these texture coordinates (v up), linear RGB in `[0, 1]`.
    ///
    /// Texels are weighted by alpha, because the colour of transparent ones is arbitrary; if all samples are
    /// transparent, the mean is unweighted.
    pub fn mean(&self, [a, b, c]: [[f32; 2]; 3]) -> [f32; 3] {
        let (mut weighted, mut weights, mut plain) = ([0.0f32; 3], 0.0, [0.0f32; 3]);
        for [i, j, k] in barycentric() {
            let at = |x: usize| i * a[x] + j * b[x] + k * c[x];
            let ([r, g, b], alpha) = self.texel(at(0), at(1));
            for (ch, v) in [r, g, b].into_iter().enumerate() {
                weighted[ch] += alpha * v;
                plain[ch] += v;
            }
            weights += alpha;
        }
        if weights > 0.0 { weighted.map(|v| v / weights) } else { plain.map(|v| v / SAMPLES as f32) }
    }

    /// Linear colour and alpha of the nearest texel.
    fn texel(&self, u: f32, v: f32) -> ([f32; 3], f32) {
        let (w, h) = self.image.dimensions();
        // rem_euclid may round to 1.0, and the cast converts NaN to 0.
        let x = ((u.rem_euclid(1.0) * w as f32) as u32).min(w.saturating_sub(1));
        let y = (((1.0 - v).rem_euclid(1.0) * h as f32) as u32).min(h.saturating_sub(1));
        match self.image.get_pixel_checked(x, y) {
            Some(p) => ([linear(p[0]), linear(p[1]), linear(p[2])], f32::from(p[3]) / 255.0),
            None => ([0.5; 3], 1.0),
        }
    }
}

/// The sample points.
fn barycentric() -> impl Iterator<Item = [f32; 3]> {
    let rows = 4;
    (0..rows).flat_map(move |i| {
        (0..2 * (rows - i) - 1).map(move |t| {
            let (j, up) = (t / 2, t % 2 == 0);
            let third = if up { 1.0 / 3.0 } else { 2.0 / 3.0 };
            let (x, y) = (i as f32 + third, j as f32 + third);
            [x / rows as f32, y / rows as f32, 1.0 - (x + y) / rows as f32]
        })
    })
}

/// sRGB to linear (IEC 61966-2-1).
pub(super) fn linear(value: u8) -> f32 {
    srgb_to_linear(f32::from(value) / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    const HALF: [[f32; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

    #[test]
    fn sample_points_are_inside_and_balanced() {
        let points: Vec<_> = barycentric().collect();
        assert_eq!(points.len(), SAMPLES);
        for axis in 0..3 {
            let mean = points.iter().map(|p| p[axis]).sum::<f32>() / SAMPLES as f32;
            assert!((mean - 1.0 / 3.0).abs() < 1e-6, "axis {axis}: {mean}");
        }
        assert!(points.iter().flatten().all(|&x| x > 0.0 && x < 1.0));
    }

    #[test]
    fn mean_is_linear_and_wraps() {
        // Lower half black, upper half white: a quarter of the triangle under the diagonal is in the upper half.
        let image =
            RgbaImage::from_fn(8, 8, |_, y| if y < 4 { Rgba([255; 4]) } else { Rgba([0, 0, 0, 255]) });
        let texture = Texture::of(image);
        assert!((texture.mean(HALF)[0] - 0.25).abs() < 1e-6);
        let shifted = HALF.map(|[u, v]| [u + 7.0, v - 3.0]);
        assert!((texture.mean(shifted)[0] - 0.25).abs() < 1e-6);
        let grey = Texture::of(RgbaImage::from_pixel(1, 1, Rgba([188, 188, 188, 255])));
        assert!((grey.mean(HALF)[1] - 0.5029).abs() < 1e-3);
    }

    #[test]
    fn invisible_texels_do_not_count() {
        let image =
            RgbaImage::from_fn(
                2,
                1,
                |x, _| if x == 0 { Rgba([255, 0, 0, 255]) } else { Rgba([0, 255, 0, 0]) },
            );
        assert_eq!(Texture::of(image).mean(HALF), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn strange_coordinates_do_not_panic() {
        let texture = Texture::of(RgbaImage::from_pixel(3, 3, Rgba([255; 4])));
        for v in [f32::NAN, f32::INFINITY, -1e30, 1e30, -1e-30] {
            assert_eq!(texture.mean([[v, v]; 3]), [1.0; 3]);
        }
    }
}
