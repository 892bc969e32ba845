//! Pictures: mappings from values to colours, and smaller versions of pictures in files.

use super::Stoppable;
use crate::files::input;
use crate::metrics::Image;
use crate::progress::Progress;
use crate::raster::BitImage;
use crate::{Error, Result};
use image::codecs::{openexr::OpenExrEncoder, png::PngEncoder};
use image::{DynamicImage, ImageFormat, ImageReader, RgbImage};
use std::io::Cursor;
use std::path::Path;

/// Colour map for signed values: blue for negative, near white for zero, red for positive (after *RdBu* of C. Brewer),
/// linear in sRGB between anchors.
const DIVERGING: [[u8; 3]; 9] = [
    [5, 48, 97],
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [247, 247, 247],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
    [103, 0, 31],
];

/// Colour map for values: dark for small, light for large ones, with evenly increasing lightness (after *viridis* of
/// S. van der Walt and N. Smith), linear in sRGB between anchors.
const SEQUENTIAL: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// An 8-bit sRGB picture, row by row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` pixels: red, green, blue.
    pub pixels: Vec<[u8; 3]>,
}

impl Picture {
    /// Encodes the picture as a PNG file.
    ///
    /// # Errors
    /// [`Error::Argument`] if the number of pixels is not `width * height`, or a side is zero or too large.
    pub fn png(&self) -> Result<Vec<u8>> {
        if self.pixels.len() != self.width * self.height || self.pixels.is_empty() {
            return Err(Error::arguments(format!("{} pixels do not make a picture", self.pixels.len())));
        }
        let sides = u32::try_from(self.width).ok().zip(u32::try_from(self.height).ok());
        let picture = sides.and_then(|(w, h)| RgbImage::from_raw(w, h, self.pixels.as_flattened().to_vec()));
        encode(picture.map(DynamicImage::ImageRgb8), ImageFormat::Png, &())
    }

    /// Maps each value to a colour.
    fn of(image: &Image, colour: impl Fn(f32) -> [u8; 3]) -> Picture {
        let pixels = image.data().iter().map(|&v| colour(v)).collect();
        Picture { width: image.width(), height: image.height(), pixels }
    }
}

/// Encodes a picture in memory as OpenEXR or else as PNG, unless `progress` stops it; `None` is an image that is too large.
pub(super) fn encode(
    picture: Option<DynamicImage>,
    format: ImageFormat,
    progress: &dyn Progress,
) -> Result<Vec<u8>> {
    let picture = picture.ok_or_else(|| Error::arguments("the image is too large for a file".into()))?;
    let mut bytes = Cursor::new(Vec::new());
    let mut out = Stoppable { out: &mut bytes, progress };
    // `DynamicImage::write_to` would bring the encoders of all formats along.
    let written = match format {
        ImageFormat::OpenExr => picture.write_with_encoder(OpenExrEncoder::new(&mut out)),
        _ => picture.write_with_encoder(PngEncoder::new(&mut out)),
    };
    written.map_err(|e| Error::arguments(format!("the image cannot be encoded: {e}")))?;
    Ok(bytes.into_inner())
}

/// The sRGB component of a linear value, both in [0, 1] (IEC 61966-2-1).
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.0031308 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Greyscale picture: value / `white`, clamped to [0, 1] and sRGB encoded.
/// [`read_image`](super::read_image) of the PNG gives value / `white` to 8 bits.
pub fn grey(image: &Image, white: f32) -> Picture {
    Picture::of(image, |v| [(linear_to_srgb((v / white).clamp(0.0, 1.0)) * 255.0).round() as u8; 3])
}

/// `approximation` − `reference` on `DIVERGING`: −`range` dark blue (too dark), 0 white, `range` dark red (too
/// bright), linear between, clamped at the ends.
///
/// # Errors
/// [`Error::Argument`] if the images differ in columns or rows.
pub fn difference(reference: &Image, approximation: &Image, range: f32) -> Result<Picture> {
    let d = crate::metrics::difference(reference, approximation)?;
    let pixels = d.iter().map(|&d| colour(&DIVERGING, 0.5 + 0.5 * d as f32 / range)).collect();
    Ok(Picture { width: reference.width(), height: reference.height(), pixels })
}

/// The colour of a value at `t` in [0, 1] of a scale, on [`SEQUENTIAL`].
pub fn false_colour(t: f32) -> [u8; 3] {
    colour(&SEQUENTIAL, t)
}

/// [`grey`] with the texels of `mask` tinted orange.
///
/// # Errors
/// [`Error::Argument`] if mask and image differ in columns or rows.
pub fn mask_overlay(image: &Image, white: f32, mask: &BitImage) -> Result<Picture> {
    if (mask.width(), mask.height()) != (image.width(), image.height()) {
        return Err(Error::arguments("the mask and the image differ in size".into()));
    }
    let mut picture = grey(image, white);
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        if mask.get(i % image.width(), i / image.width()) {
            for (c, tint) in pixel.iter_mut().zip([240u16, 130, 20]) {
                *c = ((u16::from(*c) * 11 + tint * 9) / 20) as u8;
            }
        }
    }
    Ok(picture)
}

/// The colour at `t` in [0, 1] on the map; NaN gives the middle.
fn colour(map: &[[u8; 3]; 9], t: f32) -> [u8; 3] {
    let t = if t.is_nan() { 0.5 } else { t.clamp(0.0, 1.0) } * 8.0;
    let i = (t as usize).min(7);
    let mix = |a: u8, b: u8| (f32::from(a) + (f32::from(b) - f32::from(a)) * (t - i as f32)).round() as u8;
    std::array::from_fn(|c| mix(map[i][c], map[i + 1][c]))
}

/// The picture of a PNG file, at most `side` pixels wide and high, and the width and height in the file.
///
/// # Errors
/// The file cannot be read or is no such picture.
pub fn thumbnail(path: &Path, side: u32) -> Result<(Picture, [u32; 2])> {
    let bytes = input::read(path, input::MAX_SMALL_FILE)?;
    // The reader's own limits keep the memory of a damaged file small.
    let decoded = ImageReader::with_format(Cursor::new(&bytes[..]), ImageFormat::Png).decode();
    let whole = decoded.map_err(|e| Error::format(path, None, format!("is no picture ({e})")))?;
    let size = [whole.width(), whole.height()];
    let small = if whole.width().max(whole.height()) > side { whole.thumbnail(side, side) } else { whole };
    let small = small.to_rgb8();
    let (width, height) = (small.width() as usize, small.height() as usize);
    Ok((Picture { width, height, pixels: small.pixels().map(|p| p.0).collect() }, size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_hit_their_anchors() {
        let image = Image::new(5, 1, 1.0, vec![-9.0, 0.0, 0.5, 1.0, 9.0]).unwrap();
        let zero = Image::new(5, 1, 1.0, vec![0.0; 5]).unwrap();
        let p = difference(&zero, &image, 1.0).unwrap().pixels;
        assert_eq!((p[0], p[1], p[2], p[3], p[4]), {
            (DIVERGING[0], DIVERGING[4], DIVERGING[6], DIVERGING[8], DIVERGING[8])
        });
        assert_eq!(difference(&image, &image, 0.0).unwrap().pixels, [DIVERGING[4]; 5]);
        let g = grey(&image, 1.0).pixels;
        assert_eq!((g[0], g[2], g[4]), ([0; 3], [188; 3], [255; 3]));
    }

    #[test]
    fn broken_pictures_are_errors() {
        assert!(Picture { width: 2, height: 2, pixels: vec![[0; 3]; 3] }.png().is_err());
        assert!(Picture { width: 0, height: 2, pixels: vec![] }.png().is_err());
        let image = Image::new(2, 1, 1.0, vec![0.0, 1.0]).unwrap();
        assert!(mask_overlay(&image, 1.0, &BitImage::new(3, 1)).is_err());
    }

    #[test]
    fn masks_are_orange() {
        let bits = BitImage::from_fn(2, 1, |x, _| x == 1);
        let image = Image::new(2, 1, 1.0, vec![1.0, 1.0]).unwrap();
        let overlay = mask_overlay(&image, 1.0, &bits).unwrap().pixels;
        assert_eq!(overlay[0], [255; 3]);
        assert!(overlay[1][0] > overlay[1][2]);
    }

    #[test]
    fn pictures_shrink_and_keep_their_shape() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        let large = Picture { width: 40, height: 20, pixels: vec![[7, 8, 9]; 800] };
        std::fs::write(&path, large.png().expect("encoded")).expect("written");
        let (small, size) = thumbnail(&path, 10).expect("read");
        assert_eq!(size, [40, 20]);
        assert_eq!((small.width, small.height, small.pixels[0]), (10, 5, [7, 8, 9]));
        assert_eq!(thumbnail(&path, 100).expect("read").0, large);
        std::fs::write(&path, "no picture").expect("written");
        assert!(thumbnail(&path, 10).is_err());
    }
}
