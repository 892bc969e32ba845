//! How good an image of light is: ordinary norms, and the error by the size of what is wrong.
//!
//! Reference: F. Sillion and G. Drettakis, *Feature-based control of visibility error*, INRIA RR-2503, 1995
//! (**\[SD95\]**), section 2. The choices that the paper leaves open are those of the project's `method.md` A.2-A.4 and
//! are stated where they are made:
//!
//! * An image holds one value a texel (for instance the visible fraction of the light), sampled at texel centres; all
//!   integrals over the image are means over its texels, so that the p = 2 norms are root mean squares in the image's
//!   own units. Per cent of the unoccluded value is 100 · value / [`FeatureOptions::white`].
//! * Sizes are lengths in scene units on the receiver; [`Image::texel`] is the length of a texel's side.
//! * A feature is a connected region that is shadowed (umbra or penumbra), or lit [`Features::Both`].
//!
//! This room compares images and does not know how they were computed.

mod fbem;
mod features;
mod filter;
mod image;
mod missing;
mod norms;

pub use fbem::{Fbem, FbemOptions, Filter, fbem, spectrum, spectrum_sizes};
pub use features::{DEFAULT_THRESHOLD, FeatureOptions, FeatureSet, Features};
pub use filter::box_filter;
pub use image::Image;
pub use missing::{Missing, missing_features};
pub use norms::{Norms, difference, norms};
