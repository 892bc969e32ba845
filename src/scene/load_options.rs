//! What a file does not state.

use super::read_luminaire::Luminaire;
use super::{Photometry, Strength, UpAxis};
use glam::DVec3;
use std::{path::PathBuf, sync::Arc};

/// Properties that a file does not state or states wrongly: [`LoadOptions::default`], then `with_…`.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LoadOptions {
    /// Name of the unit of length; default `m`.
    pub(crate) unit: String,
    /// Objects, groups or materials that become emitters, with what they send out.
    pub(crate) emitters: Vec<(String, Strength)>,
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
    /// Largest file and largest sum of decoded textures, bytes; `None`: a part of the available memory.
    pub(crate) max_memory: Option<u64>,
}

/// The luminaires of a placement file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Placements {
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
    /// Factor of all intensities.
    pub(super) scale: f64,
}

impl Default for LoadOptions {
    /// Metres; emission and sides as the file says; all cores.
    fn default() -> Self {
        LoadOptions {
            unit: "m".into(),
            emitters: Vec::new(),
            luminaires: Placements::default(),
            photometry: Photometry::default(),
            up: None,
            two_sided_emission: false,
            sides: None,
            threads: 0,
            max_memory: None,
        }
    }
}

impl LoadOptions {
    /// The length unit of the scene's coordinates: `m` (default), `cm`, `mm`, `km`, `in` or `ft`; any other name counts as metres where
    /// power is concerned.
    #[must_use]
    pub fn with_unit(mut self, unit: impl Into<String>) -> LoadOptions {
        self.unit = unit.into();
        self
    }

    /// Makes the object, group or material `name` emit `watts` in each channel. May be called several times.
    #[must_use]
    pub fn with_emitter(mut self, name: impl Into<String>, watts: f64) -> LoadOptions {
        self.emitters.push((name.into(), Strength::Watts(watts)));
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
