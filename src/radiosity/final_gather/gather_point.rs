//! Points at which irradiance is computed.

use crate::radiosity::elements::emitters::EmitterFace;
use crate::ray::EndRule;
use crate::scene::magnitude;
use glam::Vec3;

/// A point at which irradiance is computed.
#[derive(Clone, Copy)]
pub(super) struct GatherPoint {
    pub on_surface: Vec3,
    /// Where its rays start, above the surface.
    pub at: Vec3,
    pub normal: Vec3,
    /// The end rule of its surface.
    pub end: EndRule,
    /// Shadows on its surface smaller than this may be averaged, scene units.
    pub feature_size: f32,
    /// Seed of its samples.
    pub seed: u64,
}

impl GatherPoint {
    /// Whether a corner of a face is above the horizon of the point, and the point in front of the face, both by more than the rounding
    /// error. The other side of a sheet lies in the plane of a point on the sheet. Along its normal a point errs by the rounding of its
    /// surface, otherwise by that of its own coordinates: on a large floor it may be as near to a wall as these allow.
    pub fn faces(&self, face: &EmitterFace) -> bool {
        let along = self.normal.dot(face.normal).abs() * self.end.slack();
        let own = EndRule::new(magnitude([self.on_surface])).slack();
        let rounding = 2.0 * along.max(own).max(face.end.slack());
        let of_horizon = self.end.rounding_of_heights(face.end);
        face.normal.dot(self.on_surface - face.corners[0]) > rounding
            && face.corners.iter().any(|c| self.normal.dot(*c - self.on_surface) > of_horizon)
    }
}
