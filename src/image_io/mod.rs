//! Image files, and 8-bit pictures of images.
//!
//! Values are read into and written from [`metrics::Image`](crate::metrics::Image). A [`Picture`] is 8-bit colour for
//! display; the function that makes a picture documents the mapping of values. Files are written beside their target
//! and renamed, so that no reader sees a partial file.

mod file;
mod picture;
mod stoppable;

pub use file::{Channel, luminance, read_image, write_exr, write_exr_rgb, write_png};
pub use picture::{Picture, difference, false_colour, grey, linear_to_srgb, mask_overlay, thumbnail};
pub use stoppable::Stoppable;
