//! Which axis of a scene points upwards.

use super::Scene;
use glam::Vec3;

/// The upward axis of a scene's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum UpAxis {
    /// +y, as in glTF.
    Y,
    /// +z.
    Z,
}

impl UpAxis {
    /// Its unit vector.
    pub fn vector(self) -> Vec3 {
        match self {
            UpAxis::Y => Vec3::Y,
            UpAxis::Z => Vec3::Z,
        }
    }
}

/// Ratio of extents above which the shorter of y and z is taken as the height: rooms and terrains are wider than high,
/// and a cube that was rounded is no sign.
const FLAT: f32 = 1.1;
/// Part of the emission that must point along an axis before it is a sign: that of a hemisphere of directions about
/// the axis is 0.5, of a sphere 0.
const MAIN_EMISSION: f32 = 0.15;

impl Scene {
    /// The upward axis: as the options say; y in glTF; in other formats the one of y and z along which the scene is shorter, or,
    /// where both are alike, the one along which most light is emitted, or z.
    pub(crate) fn up_axis(&self) -> UpAxis {
        if let Some(up) = self.up {
            return up;
        }
        let kind = self.path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if kind == "gltf" || kind == "glb" {
            return UpAxis::Y;
        }
        let extent = self.world_bounds().extent();
        if extent.y > FLAT * extent.z {
            return UpAxis::Z;
        }
        if extent.z > FLAT * extent.y {
            return UpAxis::Y;
        }
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for emitter in &self.emitters {
            let strength = emitter.area as f32 * emitter.emission.iter().sum::<f32>();
            sum += strength * emitter.normal;
            total += strength;
        }
        let along_y = sum.y.abs() > MAIN_EMISSION * total && sum.y.abs() > sum.z.abs();
        if along_y { UpAxis::Y } else { UpAxis::Z }
    }
}
