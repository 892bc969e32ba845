//! Image files in and out, and 8-bit pictures of images.
//!
//! Values are read into and written from [`metrics::Image`](crate::metrics::Image); a [`Picture`] is 8-bit colour for
//! display and carries a value only through the mapping documented at the function that made it. Files are written
//! beside their place and then renamed, so nobody ever reads half of one.
//!
//! This room knows nothing of visibility or of how an image was computed.

mod picture;
mod read;
mod write;

pub use picture::{
    DIVERGING, Picture, SEQUENTIAL, difference, false_colour, grey, linear_to_srgb, mask, mask_overlay,
};
pub use read::{Channel, read_image, srgb_to_linear};
pub use write::{exr_bytes, write_atomically, write_exr, write_exr_rgb, write_png};
