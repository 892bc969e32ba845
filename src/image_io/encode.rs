//! Encodes images in memory.

use crate::progress::{Progress, Stoppable};
use crate::{Error, Result};
use image::{DynamicImage, ImageFormat};
use std::io::Cursor;

/// Encodes a picture in memory, unless `progress` stops it; `None` is an image that is too large.
pub(super) fn encode(
    picture: Option<DynamicImage>,
    format: ImageFormat,
    progress: &dyn Progress,
) -> Result<Vec<u8>> {
    let picture = picture.ok_or_else(|| Error::arguments("the image is too large for a file".into()))?;
    let mut bytes = Cursor::new(Vec::new());
    let mut out = Stoppable { out: &mut bytes, progress };
    picture
        .write_to(&mut out, format)
        .map_err(|e| Error::arguments(format!("the image cannot be encoded: {e}")))?;
    Ok(bytes.into_inner())
}
