//! Small pictures of files.

use super::Picture;
use crate::files::input;
use crate::{Error, Result};
use image::{ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;

/// The picture of a PNG file, at most `side` pixels wide and high, and the width and height in the file.
///
/// # Errors
/// The file cannot be read or is no such picture.
pub fn thumbnail(path: &Path, side: u32) -> Result<(Picture, [u32; 2])> {
    let bytes = input::read(path, input::MAX_SMALL_FILE)?;
    // The reader's own limits keep the memory of a damaged file small.
    let decoded = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png).decode();
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
