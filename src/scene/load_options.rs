//! What a file does not state.

use super::read_luminaire::Luminaire;
use super::{Channels, Photometry, Strength, UpAxis, moves::Move};
use crate::terrain::ReadOptions;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;

/// Properties that a file does not state or states wrongly: [`LoadOptions::default`], then `with_…`.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LoadOptions {
    /// Name of the unit of length; default `m`.
    pub(crate) unit: String,
    /// Objects, groups or materials that become emitters, with what they send out.
    pub(crate) emitters: Vec<(String, Strength)>,
    /// Objects and glTF nodes that are moved, in this order.
    pub(crate) moves: Vec<Move>,
    /// Luminaires with photometric files.
    pub(crate) luminaires: Placements,
    /// How luminous quantities of the input become radiometric.
    pub(crate) photometry: Photometry,
    /// Upward axis; none for that of the format.
    pub(crate) up: Option<UpAxis>,
    /// Emissive faces emit from both sides; default: from the front only.
    pub(crate) two_sided_emission: bool,
    /// Overrides detection: 1: all faces bound solids, 2: all faces are sheets.
    pub(crate) sides: Option<u8>,
    /// Threads; 0 for all cores.
    pub(crate) threads: usize,
    /// What the file of a height field does not state.
    pub(crate) grid: ReadOptions,
    /// Largest file and largest sum of decoded textures, bytes; `None`: a part of the available memory.
    pub(crate) max_memory: Option<u64>,
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

impl Default for LoadOptions {
    /// Metres; emission and sides as the file says; all cores.
    fn default() -> Self {
        LoadOptions {
            unit: "m".into(),
            emitters: Vec::new(),
            moves: Vec::new(),
            luminaires: Placements::default(),
            photometry: Photometry::default(),
            up: None,
            two_sided_emission: false,
            sides: None,
            threads: 0,
            grid: ReadOptions::default(),
            max_memory: None,
        }
    }
}

impl LoadOptions {
    /// The length unit of the scene's coordinates: `m` (default), `dm`, `cm`, `mm`, `km`, `in` or `ft`; any other name counts as metres where
    /// power is concerned.
    #[must_use]
    pub fn with_unit(mut self, unit: impl Into<String>) -> LoadOptions {
        self.unit = unit.into();
        self
    }

    /// Makes the object, group or material `name` emit `watts` in each channel, at least 0; 0 switches it off. May be called several times.
    #[must_use]
    pub fn with_emitter(mut self, name: impl Into<String>, watts: f64) -> LoadOptions {
        self.emitters.push((name.into(), Strength::Watts(watts)));
        self
    }

    /// Makes the object, group or material `name` emit a luminous flux, lm. May be called several times.
    #[must_use]
    pub fn with_emitter_lumens(mut self, name: impl Into<String>, lumens: f64) -> LoadOptions {
        self.emitters.push((name.into(), Strength::Lumens(lumens)));
        self
    }

    /// Makes the object, group or material `name` emit light of a luminance, cd/m². May be called several times.
    #[must_use]
    pub fn with_emitter_luminance(mut self, name: impl Into<String>, luminance: f64) -> LoadOptions {
        self.emitters.push((name.into(), Strength::Luminance(luminance)));
        self
    }

    /// Which channels hold light as the eye weighs it, for luminaires and luminous emitters; default [`Channels::Rgb`].
    #[must_use]
    pub fn with_channels(mut self, channels: Channels) -> LoadOptions {
        self.photometry = Photometry::from(channels);
        self
    }

    /// Upward axis of the scene's coordinates, for automatic cameras and files that have one; default: y in glTF, elsewhere as the light and
    /// the extents say.
    #[must_use]
    pub fn with_up(mut self, up: UpAxis) -> LoadOptions {
        self.up = Some(up);
        self
    }

    /// Largest file and largest sum of decoded textures, bytes; default: four fifths of the available memory.
    #[must_use]
    pub fn with_max_memory(mut self, bytes: u64) -> LoadOptions {
        self.max_memory = Some(bytes);
        self
    }

    /// Whether emissive faces emit from both sides; default: only from the front.
    #[must_use]
    pub fn with_two_sided_emission(mut self, two_sided: bool) -> LoadOptions {
        self.two_sided_emission = two_sided;
        self
    }

    /// Overrides what connectivity says: 1 all faces bound solids, 2 all are sheets that are seen from both sides.
    #[must_use]
    pub fn with_sides(mut self, sides: u8) -> LoadOptions {
        self.sides = Some(sides);
        self
    }

    /// Threads, at most 1024; 0 (default) for one a core. Calls from inside a rayon pool use that pool instead.
    #[must_use]
    pub fn with_threads(mut self, threads: usize) -> LoadOptions {
        self.threads = threads;
        self
    }
}
