//! Writes image files, completely or not at all.

use std::io::Write;
use std::path::Path;

use image::{DynamicImage, ImageFormat, Rgb32FImage};

use super::picture::{Picture, encode};
use crate::files::WholeFile;
use crate::metrics::Image;
use crate::progress::{Progress, Stoppable};
use crate::{Error, Result};

/// Writes `bytes` to a temporary file beside `path` and renames the file.
///
/// # Errors
/// [`Error::Io`] with `path` if the folder is missing or not writable, or the disk is full; `path` is then unchanged.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    WholeFile::write(path, bytes)
}

/// Writes `width` columns of linear RGB, row by row from the top, as an OpenEXR file of 32-bit floats.
///
/// # Errors
/// [`Error::Argument`] if the image is too large for the format or `pixels` is not a multiple of `width`; errors of
/// [`write_atomically`]; an error if `progress` stops it.
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

/// Writes the picture to `path` as an 8-bit PNG. Errors as for [`Picture::png`] and [`write_atomically`].
pub fn write_png(path: &Path, picture: &Picture) -> Result<()> {
    write_atomically(path, &picture.png()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_replaced_and_nothing_is_left_beside_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for content in ["one", "two"] {
            write_atomically(&path, content.as_bytes()).unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), content);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let missing = folder.path().join("missing/a.txt");
        assert!(write_atomically(&missing, b"x").unwrap_err().to_string().contains("missing/a.txt"));
        // A folder cannot be replaced by a file.
        assert!(write_atomically(folder.path(), b"x").is_err());
    }
}
