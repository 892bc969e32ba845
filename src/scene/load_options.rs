//! Options of loading: properties that a file does not state.

use super::added::AddedFiles;
use super::read_luminaire::Luminaire;
use super::{Channels, Photometry, Strength, UpAxis, moves::Move};
use crate::terrain::ReadOptions;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;

options! {
    /// Properties that a file does not state or states wrongly: [`LoadOptions::default`] with other values of some fields.
    ///
    /// ```
    /// use mrvis::{LoadOptions, Strength};
    ///
    /// let mut options = LoadOptions::default();
    /// options.unit = "cm".into();
    /// options.emitters.push(("lamp".into(), Strength::Watts(40.0)));
    /// ```
    #[derive(Clone, Debug)]
    #[non_exhaustive]
    pub struct LoadOptions {
        /// The length unit of the scene's coordinates: `m` (default), `dm`, `cm`, `mm`, `km`, `in` or `ft`; any other name counts as
        /// metres where power is concerned.
        pub unit: String = "m".into();
        /// Objects, groups or materials that become emitters, with what they send out, at least 0; 0 switches an emitter off.
        pub emitters: Vec<(String, Strength)> = Vec::new();
        /// Which channels hold light as the eye weighs it, for luminaires and luminous emitters; default [`Channels::Rgb`].
        pub channels: Channels = Channels::default();
        /// Upward axis of the scene's coordinates, for automatic cameras and files that have one; default: y in glTF, elsewhere as the
        /// light and the extents say.
        pub up: Option<UpAxis> = None;
        /// Whether emissive faces emit from both sides; default false: only from the front.
        pub two_sided_emission: bool = false;
        /// Overrides what connectivity says: 1 all faces bound solids, 2 all are sheets that are seen from both sides.
        pub sides: Option<u8> = None;
        /// Threads, at most 1024; 0 (default) for one a core. Calls from inside a rayon pool use that pool instead.
        pub threads: usize = 0;
        /// Largest file and largest sum of decoded textures, bytes; default: four fifths of the available memory.
        pub max_memory: Option<u64> = None;
        /// Objects and glTF nodes that are moved, in this order.
        pub(crate) moves: Vec<Move> = Vec::new();
        /// Luminaires with photometric files.
        pub(crate) luminaires: Placements = Placements::default();
        /// Properties that the file of a height field does not state.
        pub(crate) grid: ReadOptions = ReadOptions::default();
        /// Further files of the scene.
        pub(crate) added: AddedFiles = AddedFiles::default();
        /// Radius of the earth, as a fraction of its mean radius, along which height fields curve; `None`: a flat earth.
        pub(crate) curvature: Option<f64> = None;
    }
}

/// The luminaires of a placement file.
#[derive(Clone, Debug, Default)]
pub struct Placements {
    pub(super) list: Vec<PlacedLuminaire>,
    /// Files that were read: the placement file, then the photometric files, without repetition.
    pub(super) files: Vec<PathBuf>,
}

/// A luminaire of a placement file.
#[derive(Clone, Debug)]
pub(crate) struct PlacedLuminaire {
    /// Name of its object and material.
    pub(super) name: String,
    pub(super) luminaire: Arc<Luminaire>,
    /// Position, scene units in the coordinates of the scene's file.
    pub(super) at: DVec3,
    /// Unit vectors towards γ = 0, C = 0 and C = 90°.
    pub(super) axes: [DVec3; 3],
    /// Factor of all intensities, besides the two below.
    pub(super) scale: f64,
    /// Dimming and maintenance factor, above 0 and at most 1.
    pub(super) factors: [f64; 2],
}

impl LoadOptions {
    /// Conversion of luminous quantities of the input to radiometric ones.
    pub(crate) fn photometry(&self) -> Photometry {
        Photometry::from(self.channels)
    }
}
