//! Error measures for images of light: ordinary norms, and errors by feature size.
//!
//! Reference: F. Sillion and G. Drettakis, *Feature-based control of visibility error*, INRIA RR-2503, 1995
//! (**\[SD95\]**), section 2. Choices where the paper gives no details (docs/method.md, Feature-based error):
//!
//! * An image holds one value per texel (such as the visible fraction of an emitter), sampled at texel centres.
//!   Integrals over the image are means over its texels, so that the p = 2 norms are root mean squares in the image's
//!   own units. Per cent of the unoccluded value is 100 · value / [`FeatureOptions::white`].
//! * Sizes are lengths in scene units on the receiver; an [`Image`] knows the side of a texel.
//! * A feature is a connected region that is shadowed (umbra or penumbra) or, with [`Features::Both`], lit.
//!
//! This room does not depend on how images were computed.

pub(crate) mod fbem;
pub(crate) mod features;
mod filter;
mod image;
#[cfg(any(test, feature = "reports"))]
mod missing;
pub(crate) mod norms;

pub use crate::raster::Morphology;
pub use fbem::{Fbem, FbemOptions, Filter, fbem};
pub use features::{FeatureOptions, Features};
pub use image::Image;

#[cfg(feature = "reports")]
pub(crate) use {
    fbem::spectrum_sizes,
    features::FeatureSet,
    missing::missing_features,
    norms::{difference, norms},
};
