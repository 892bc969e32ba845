//! Bit images and the size of what they show: exact Euclidean distances, erosion, opening.
//!
//! A leaf room: it uses nothing of the crate. Two rooms stand on it: `characterise` asks for the size of the
//! largest blocker in a silhouette (millions of small images), `metrics` for feature masks (few large ones).
//!
//! Reference: F. Sillion and G. Drettakis, *Feature-based control of visibility error*, INRIA RR-2503, 1995
//! (**\[SD95\]**), section 2.4 and, for BSIZE, section 3.3.
//!
//! # What "size" means here
//!
//! All sizes are in pixels. A set pixel is *object*, the others are *background*.
//!
//! * [`Morphology::Euclid`] (default): the diameter of the largest disc that fits into the object. With d the
//!   largest distance from an object pixel's centre to the nearest background pixel's centre, **size = 2·d**
//!   ([`diameter`], method A.7). A solid a × a square has size a (even a) or a + 1 (odd a), as with the paper's
//!   counts; a disc or a turned square of diameter a has size a to within 1.5 pixels, wherever it lies on the grid.
//! * [`Morphology::Paper8`], [`Morphology::Paper4`]: **size = 2·N**, N the number of erosions with 8 or 4
//!   neighbours until the object is empty, as [SD95 sec 2.4] states it. These measure Chebyshev and city-block
//!   radii: a square and its copy turned by 45 degrees get sizes that differ by √2.
//!
//! In all three an [`Opener`] keeps an object exactly when its size is greater than the size asked for
//! (for the paper's modes: greater than 2·⌊size/2⌋).

mod bits;
mod disc;
mod edt;
mod erode;
mod fill;
mod opening;

pub use bits::BitImage;
pub use edt::{Edt, NO_BACKGROUND, diameter};
pub use fill::fill_triangle;
pub use opening::{Opener, opening};

/// What lies outside the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    /// Background: the border limits every object. The choice for silhouettes, for the gaps in them (on the
    /// complement: only gaps *inside* the silhouette's frame count) and for feature masks (method A.4, A.7).
    #[default]
    Free,
    /// Object: an object at the border goes on without end.
    Blocked,
}

/// How sizes are measured. See the [module](self) for the definition of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Morphology {
    /// Discs, by the exact Euclidean distance transform: independent of direction.
    #[default]
    Euclid,
    /// Erosions with 8 neighbours: what the paper's in-place implementation amounts to [SD95 sec 2.4, note 2].
    Paper8,
    /// Erosions with 4 neighbours: the paper's definition [SD95 sec 2.4].
    Paper4,
}

impl Morphology {
    /// The name used on the command line and in reports: `euclid`, `paper8` or `paper4`.
    pub fn name(self) -> &'static str {
        match self {
            Morphology::Euclid => "euclid",
            Morphology::Paper8 => "paper8",
            Morphology::Paper4 => "paper4",
        }
    }
}
