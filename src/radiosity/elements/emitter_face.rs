//! A face that emits.

use super::profiles::profile_factor;
use crate::form_factors::analytic::{point_to_far_polygon, point_to_polygon};
use crate::radiosity::rgb::{Rgb, mean};
use crate::ray::EndRule;
use crate::scene::Profile;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// One emitting face.
pub struct EmitterFace {
    /// Counterclockwise seen from its side; a triangle repeats its third corner.
    pub corners: [Vec3; 4],
    /// The same corners in double precision, for closed forms.
    pub polygon: [DVec3; 4],
    /// Number of distinct corners: 3 or 4.
    pub count: usize,
    /// Unit normal.
    pub normal: Vec3,
    /// The rule for ends of segments on the face.
    pub end: EndRule,
    /// Exitance, W/m².
    pub exitance: Rgb,
    /// Area, scene units squared.
    pub area: f32,
    /// Directions in which the face emits; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
}

impl EmitterFace {
    /// Form factor from a point (position, unit normal) to the face: of a diffuse face in closed form, or by quadrature to 0.1 % if it is
    /// far; of one with a profile with its radiance relative to a diffuse face as weight.
    pub fn factor(&self, at: DVec3, normal: DVec3) -> f64 {
        let polygon = &self.polygon[..self.count];
        match &self.profile {
            None => {
                let far = point_to_far_polygon(at, normal, polygon);
                far.unwrap_or_else(|| point_to_polygon(at, normal, polygon)).max(0.0)
            }
            Some(profile) => profile_factor(profile, (at, normal), polygon),
        }
    }
}

/// Power of a face over π, W/π.
pub fn power_of(face: &EmitterFace) -> f32 {
    face.area * mean(face.exitance) as f32
}
