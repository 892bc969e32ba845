//! The upward axis of a scene.

use super::Scene;
use glam::{DMat3, DVec3, Vec3};

/// The upward axis of a scene's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// +y, as in glTF.
    Y,
    /// +z.
    Z,
}

/// Source of the upward axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpFrom {
    /// An option.
    Given,
    /// glTF.
    Format,
    /// The direction of most light.
    Light,
    /// The shortest extent.
    Extents,
}

impl UpFrom {
    /// In words: "given" or "guessed from ...".
    pub fn words(self) -> &'static str {
        match self {
            UpFrom::Given => "given",
            UpFrom::Format => "that of glTF",
            UpFrom::Light => "guessed from the direction of most light",
            UpFrom::Extents => "guessed from the extents",
        }
    }
}

impl UpAxis {
    /// `y` or `z`.
    #[doc(hidden)]
    pub fn name(self) -> &'static str {
        match self {
            UpAxis::Y => "y",
            UpAxis::Z => "z",
        }
    }

    /// Its unit vector.
    #[doc(hidden)]
    pub fn vector(self) -> Vec3 {
        match self {
            UpAxis::Y => Vec3::Y,
            UpAxis::Z => Vec3::Z,
        }
    }
}

/// Smallest fraction of the emission down an axis that selects the axis: a hemisphere of directions about the axis has 0.5, a sphere 0.
const MAIN_EMISSION: f32 = 0.15;
/// Ratio of extents above which the shorter of y and z is taken as the height: above the rounding of a cube, below rooms and terrains.
const MIN_FLATNESS: f32 = 1.1;

impl Scene {
    /// The upward axis, see [`Scene::up_from`].
    #[doc(hidden)]
    pub fn up_axis(&self) -> UpAxis {
        self.up_from().0
    }

    /// The upward axis, and where it is from: as the options say; y in glTF; in other formats the one of y and z down which most light is
    /// emitted; without such light the one along which the scene is shorter, or z where both are alike.
    #[doc(hidden)]
    pub fn up_from(&self) -> (UpAxis, UpFrom) {
        if let Some(up) = self.up {
            return (up, UpFrom::Given);
        }
        let kind = self.path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if kind == "gltf" || kind == "glb" {
            return (UpAxis::Y, UpFrom::Format);
        }
        let (mut down, mut total) = (Vec3::ZERO, 0.0);
        for emitter in &self.emitters {
            let strength = emitter.area as f32 * emitter.emission.iter().sum::<f32>();
            down -= strength * emitter.normal;
            total += strength;
        }
        let (main, along_y) = (down.y.max(down.z), down.y > down.z);
        let extent = self.world_bounds().extent();
        let lower_along_y = extent.z > MIN_FLATNESS * extent.y;
        let (is_y, from) = if main > MAIN_EMISSION * total {
            (along_y, UpFrom::Light)
        } else {
            (lower_along_y, UpFrom::Extents)
        };
        (if is_y { UpAxis::Y } else { UpAxis::Z }, from)
    }
}

/// Turns coordinates whose upward axis is y, as in glTF files, to those whose upward axis is z; the inverse turns them back.
pub(super) fn from_y_to_z() -> DMat3 {
    DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y)
}
