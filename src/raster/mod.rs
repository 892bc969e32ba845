//! Bit images and the sizes of regions in them: exact Euclidean distances, erosion, opening.
//!
//! This room uses no other. [`crate::optics`] measures the largest blocker in silhouettes (millions of small images),
//! [`crate::metrics`] computes feature masks (few large images).
//!
//! Reference: F. Sillion and G. Drettakis, *Feature-based control of visibility error*, INRIA RR-2503, 1995
//! (**\[SD95\]**), section 2.4 and, for sizes of blockers, section 3.3.
//!
//! # Definitions of size
//!
//! Sizes are in pixels. Set pixels are *object*, the others *background*.
//!
//! * [`Morphology::Euclid`] (default): the diameter of the largest disc inside the object. With d the largest distance
//!   from an object pixel's centre to the nearest background pixel's centre, **size = 2·d** (see [`Edt`]). A solid
//!   square of side a has size a (even a) or a + 1 (odd a), as with the paper's counts; a disc or a turned square of
//!   diameter a has size a to within 1.5 pixels, wherever it lies on the grid.
//! * [`Morphology::Paper8`], [`Morphology::Paper4`]: **size = 2·N**, N the number of erosions with 8 or 4 neighbours
//!   until the object is empty [SD95 sec 2.4]. N is the Chebyshev or city-block radius: a square and the same square
//!   turned by 45 degrees get sizes that differ by √2.
//!
//! In all three modes an [`Opener`] keeps an object exactly if its size exceeds the requested size (for the paper's
//! modes: exceeds 2·⌊size/2⌋).

mod bits;
mod disc;
mod edt;
mod erode;
mod fill;
mod opening;

pub use bits::BitImage;
pub use edt::Edt;
pub use erode::expand_by as expand;
pub use fill::fill_triangle;
pub use opening::Opener;

/// Squared distance of every object pixel if there is no background at all.
pub const NO_BACKGROUND: u32 = u32::MAX;

/// State of the pixels outside the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    /// Background: the border limits every object. Used for silhouettes, for their gaps (on the complement: only gaps
    /// *inside* the frame count) and for feature masks.
    #[default]
    Free,
    /// Object: an object at the border continues without end.
    Blocked,
}

/// Measure of the sizes of regions; formulas in `docs/method.md`, Feature-based error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Morphology {
    /// Discs, by the exact Euclidean distance transform; independent of direction.
    #[default]
    Euclid,
    /// Erosions with 8 neighbours: equivalent to the paper's in-place implementation [SD95 sec 2.4, note 2].
    Paper8,
    /// Erosions with 4 neighbours: the paper's definition [SD95 sec 2.4].
    Paper4,
}
