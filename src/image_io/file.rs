//! Image files: reads one scalar quantity, writes values and pictures.

use super::Stoppable;
use super::picture::{Picture, encode};
use crate::files::{WholeFile, input};
use crate::math::srgb_to_linear;
use crate::metrics::Image;
use crate::progress::Progress;
use crate::{Error, Result, error::quote, memory};
use image::{DynamicImage, ImageError, ImageFormat, ImageReader, Rgb32FImage};
use std::io::{Cursor, Write};
use std::path::Path;

/// The value of a pixel as a function of its components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Channel {
    /// Relative luminance of linear Rec. 709 primaries: 0.2126 R + 0.7152 G + 0.0722 B.
    #[default]
    Luminance,
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
}

impl Channel {
    /// The value of a pixel with these linear components.
    fn of(self, [r, g, b]: [f32; 3]) -> f32 {
        match self {
            // Equal components are returned unchanged: the weights may not sum to exactly 1.
            Channel::Luminance if r == g && g == b => r,
            Channel::Luminance => luminance([r, g, b]),
            Channel::Red => r,
            Channel::Green => g,
            Channel::Blue => b,
        }
    }
}

/// Luminance of linear sRGB (Rec. 709).
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Reads a PNG, OpenEXR, Radiance HDR, JPEG, BMP or TGA file; the format is detected from the content.
///
/// OpenEXR and HDR values are linear and unchanged. 8- and 16-bit formats are decoded from sRGB to linear values in
/// [0, 1]. Alpha is ignored. Texels get the side `texel` in scene units (with 1, sizes are in texels).
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened, [`Error::File`] if the file is no such image or holds a value that is
/// not finite, [`Error::Argument`] if `texel` is not a positive length.
pub fn read_image(path: &Path, channel: Channel, texel: f64) -> Result<Image<'static>> {
    let bytes = input::read(path, memory::usable().unwrap_or(u64::MAX >> 1))?;
    let reader = ImageReader::new(Cursor::new(&bytes[..])).with_guessed_format();
    let reader = reader.map_err(|e| Error::io(path, e))?;
    let linear =
        reader.format().is_some_and(|f| matches!(f, image::ImageFormat::OpenExr | image::ImageFormat::Hdr));
    if reader.format().is_none() {
        return Err(Error::format(path, None, "not a PNG, EXR, HDR, JPEG, BMP or TGA image"));
    }
    let undecoded =
        |e: ImageError| Error::format(path, None, format!("cannot be decoded: {}", quote(&e.to_string())));
    let decoded = input::guarded(path, || reader.decode().map_err(undecoded))?;
    drop(bytes);
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let data = values(decoded, channel, linear);
    // Checked here because a bad `texel` is an error of the caller, and later errors are errors of the file.
    if !(texel.is_finite() && texel > 0.0) {
        return Err(Error::argument("texel", texel, "the side of a texel must be a positive length"));
    }
    Image::new(width, height, texel, data).map_err(|e| Error::format(path, None, e.to_string()))
}

/// One linear value per pixel.
fn values(decoded: DynamicImage, channel: Channel, linear: bool) -> Vec<f32> {
    let rgb = decoded.into_rgb32f();
    let decode = |v: f32| if linear { v } else { srgb_to_linear(v) };
    rgb.pixels().map(|p| channel.of(p.0.map(decode))).collect()
}

/// Writes `width` columns of linear RGB, row by row from the top, as an OpenEXR file of 32-bit floats.
///
/// # Errors
/// [`Error::Argument`] if the image is too large for the format or `pixels` is not a multiple of `width`; errors of
/// [`WholeFile::create`]; an error if `progress` stops it.
pub fn write_exr_rgb(path: &Path, width: usize, pixels: &[[f32; 3]], progress: &dyn Progress) -> Result<()> {
    let side = |n: usize| u32::try_from(n).ok();
    let image = side(width)
        .zip(side(pixels.len() / width.max(1)))
        .and_then(|(w, h)| Rgb32FImage::from_raw(w, h, pixels.as_flattened().to_vec()));
    let bytes = encode(image.map(DynamicImage::ImageRgb32F), ImageFormat::OpenExr, progress)?;
    let mut file = WholeFile::create(path)?;
    Stoppable { out: &mut file, progress }.write_all(&bytes).map_err(|e| Error::io(path, e))?;
    file.commit()
}

/// Writes the image as an OpenEXR file of 32-bit floats: three equal channels R, G, B, values unchanged. The texel side is not stored.
/// Errors as for [`write_exr_rgb`].
pub fn write_exr(path: &Path, image: &Image) -> Result<()> {
    let pixels: Vec<[f32; 3]> = image.data().iter().map(|&v| [v; 3]).collect();
    write_exr_rgb(path, image.width(), &pixels, &())
}

/// Writes the picture to `path` as an 8-bit PNG. Errors as for [`Picture::png`] and [`WholeFile::create`].
pub fn write_png(path: &Path, picture: &Picture) -> Result<()> {
    WholeFile::write(path, picture.png()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_io::{grey, write_exr, write_png};

    fn ramp() -> Image<'static> {
        Image::from_fn(256, 4, 1.0, |x, y| (x as f32 / 255.0) * if y == 0 { 1.0 } else { 0.5 }).unwrap()
    }

    #[test]
    fn exr_keeps_every_value() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = Image::from_fn(5, 3, 1.0, |x, y| x as f32 * 1e-3 - y as f32 * 1e5).unwrap();
        write_exr(&path, &image).unwrap();
        assert_eq!(read_image(&path, Channel::Luminance, 1.0).unwrap(), image);
        assert_eq!(read_image(&path, Channel::Blue, 1.0).unwrap(), image);
    }

    #[test]
    fn png_is_decoded_to_linear_values() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_png(&path, &grey(&ramp(), 1.0)).unwrap();
        let back = read_image(&path, Channel::Green, 2.0).unwrap();
        assert_eq!((back.width(), back.height(), back.texel()), (256, 4, 2.0));
        // Tolerance: half a step of 8 bits at the steepest part of the curve.
        assert!(back.data().iter().zip(ramp().data()).all(|(a, b)| (a - b).abs() < 0.005));
        assert_eq!((back.at(0, 0), back.at(255, 0)), (0.0, 1.0));
    }

    #[test]
    fn bad_files_are_errors_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.exr");
        let message = |path: &Path| read_image(path, Channel::Luminance, 1.0).unwrap_err().to_string();
        assert!(message(&path).contains("bad.exr"));
        for bytes in [&b""[..], b"not an image", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"#?RADIANCE\n"] {
            WholeFile::write(&path, bytes).unwrap();
            assert!(message(&path).contains("bad.exr"), "{}", message(&path));
        }
        assert!(message(folder.path()).contains(&folder.path().display().to_string()));
        let mut nan = image::Rgb32FImage::new(2, 2);
        nan.put_pixel(1, 0, image::Rgb([f32::NAN; 3]));
        nan.save(&path).unwrap();
        assert!(message(&path).contains("1,0"), "{}", message(&path));
    }
}
