//! Heights from grey values of PNG pictures.

use super::{Raw, ReadOptions, check_size};
use crate::{Error, Result};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;

/// Values of one byte of a PNG file at most: the highest rate of compression by Deflate is 1032, of one-bit pixels 8 a byte.
const MAX_VALUES_OF_BYTE: usize = 8 * 1032;

/// Reads a grey picture of 8 or 16 bits.
pub fn read(path: &Path, bytes: Vec<u8>, options: &ReadOptions) -> Result<Raw> {
    if options.height_scale.is_none() {
        let what = "a picture does not say what its grey values mean: set ⟨height_scale⟩ to the metres of one step of grey";
        return Err(Error::format(path, None, what));
    }
    let broken = |e: image::ImageError| Error::format(path, None, format!("cannot be read as PNG: {e}"));
    let possible = bytes.len().saturating_mul(MAX_VALUES_OF_BYTE);
    let mut reader = ImageReader::with_format(Cursor::new(&bytes[..]), ImageFormat::Png);
    // The size is checked below, before pixels are read.
    reader.no_limits();
    let decoder = reader.into_decoder().map_err(broken)?;
    let (columns, rows) = decoder.dimensions();
    let (columns, rows) = (columns as usize, rows as usize);
    check_size(path, columns, rows, possible)?;
    let mut notes = Vec::new();
    let decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
    drop(bytes);
    let values = match decoded {
        DynamicImage::ImageLuma16(image) => image.as_raw().iter().map(|&v| f32::from(v)).collect(),
        DynamicImage::ImageLuma8(image) => {
            notes.push("the picture has 8 bits: slopes are in steps".into());
            image.as_raw().iter().map(|&v| f32::from(v)).collect()
        }
        other => {
            let what = format!(
                "is a picture of kind {:?}: heights need one channel of grey, 16 bits",
                other.color()
            );
            return Err(Error::format(path, None, what));
        }
    };
    Ok(Raw { columns, rows, values, notes, ..Raw::default() })
}
