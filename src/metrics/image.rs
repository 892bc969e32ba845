//! An image of one scalar quantity on a receiver.

use crate::{Error, Result};
use std::borrow::Cow;

/// Values on a grid of square texels, row by row from the top left, each sampled at its texel's centre.
///
/// The constructor guarantees finite values and at least one texel; the metrics rely on that.
///
/// Borrows the values of a slice, or owns those of a vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<'a> {
    width: usize,
    height: usize,
    texel: f64,
    data: Cow<'a, [f32]>,
}

impl<'a> Image<'a> {
    /// An image of `width` x `height` values with texels of side `texel` (scene units; with 1, sizes are in texels).
    ///
    /// # Errors
    /// [`Error::Argument`] if a side is zero, `data` has another length than `width * height`, `texel` is not positive
    /// and finite, or a value is not finite (the message names the first such texel).
    pub fn new(
        width: usize,
        height: usize,
        texel: f64,
        data: impl Into<Cow<'a, [f32]>>,
    ) -> Result<Image<'a>> {
        let data = data.into();
        let argument = |what: String| Err(Error::arguments(what));
        if width == 0 || height == 0 {
            return argument(format!("an image of {width} x {height} texels is empty"));
        }
        if width.checked_mul(height) != Some(data.len()) {
            return argument(format!(
                "{} values do not make an image of {width} x {height} texels",
                data.len()
            ));
        }
        if !(texel.is_finite() && texel > 0.0) {
            return Err(Error::argument("texel", texel, "the side of a texel must be a positive length"));
        }
        if let Some(i) = data.iter().position(|v| !v.is_finite()) {
            return argument(format!("texel {},{} holds {}, not a number", i % width, i / width, data[i]));
        }
        Ok(Image { width, height, texel, data })
    }

    /// The image of `value(x, y)`, x and y in texels from the top left. Errors as for [`Image::new`].
    pub fn from_fn(
        width: usize,
        height: usize,
        texel: f64,
        mut value: impl FnMut(usize, usize) -> f32,
    ) -> Result<Image<'a>> {
        let data: Vec<f32> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Image::new(width, height, texel, data)
    }

    /// Number of columns, at least 1.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows, at least 1.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Side of a texel in scene units, greater than 0.
    pub fn texel(&self) -> f64 {
        self.texel
    }

    /// All values, row by row: `width * height` finite numbers.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// The value at (x, y). Panics outside the image.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }

    /// [`Error::Argument`] unless `other` has the same number of columns and rows.
    pub(crate) fn check_same_sides(&self, other: &Image) -> Result<()> {
        if (self.width, self.height) == (other.width, other.height) {
            return Ok(());
        }
        Err(Error::arguments(format!(
            "⟨reference⟩ has {} x {} texels, ⟨approximation⟩ {} x {}: compare images of the same size",
            self.width, self.height, other.width, other.height
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_images_are_refused() {
        assert!(Image::new(0, 3, 1.0, vec![]).is_err());
        assert!(Image::new(2, 2, 1.0, vec![0.0; 3]).is_err());
        assert!(Image::new(usize::MAX, 2, 1.0, vec![0.0; 3]).is_err());
        for texel in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Image::new(1, 1, texel, vec![0.0]).is_err());
        }
        let message = Image::new(2, 2, 1.0, vec![0.0, 0.0, 0.0, f32::NAN]).unwrap_err().to_string();
        assert!(message.contains("1,1"), "{message}");
    }
}
