//! Directions of the sky in the coordinates of a scene.

use crate::{Error, Result};
use glam::DVec3;

/// Up, north and east as unit vectors in the coordinates of a scene.
///
/// Local coordinates are (east, north, up). Azimuths count clockwise from north, as seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Towards the zenith.
    pub up: DVec3,
    /// Horizontal, towards north.
    pub north: DVec3,
    /// Horizontal, towards east.
    pub east: DVec3,
}

/// Largest deviation of `north` from the horizontal plane, sine of the angle: vectors with three digits.
const MAX_NORTH_SLOPE: f64 = 1e-3;

impl Frame {
    /// The frame with these directions of any length.
    ///
    /// # Errors
    /// [`Error::Argument`] if a vector is zero or not finite, or `north` is not horizontal.
    pub fn new(up: DVec3, north: DVec3) -> Result<Frame> {
        let unit = |v: DVec3, name: &str| {
            v.try_normalize().ok_or_else(|| {
                Error::argument(name, v, "no direction").with_cure("give three numbers that are not all 0")
            })
        };
        let (up, north) = (unit(up, "up")?, unit(north, "north")?);
        if up.dot(north).abs() > MAX_NORTH_SLOPE {
            let cure = format!("give a direction perpendicular to the upward axis {up}");
            return Err(Error::argument("north", north, "not horizontal").with_cure(cure));
        }
        let north = north.reject_from_normalized(up).normalize();
        Ok(Frame { up, north, east: north.cross(up) })
    }

    /// The frame with this upward axis and the usual north: +y below the upward axis +z, as on maps; −z below +y, as in glTF, where
    /// east is +x in both cases. For other axes a horizontal direction near to +y.
    pub fn upright(up: DVec3) -> Result<Frame> {
        let unit = up.try_normalize().unwrap_or(DVec3::ZERO);
        let wanted = if unit.y.abs() < 0.9 { DVec3::Y } else { DVec3::NEG_Z };
        Frame::new(up, wanted.reject_from(unit))
    }

    /// The axes in words.
    pub fn note(&self) -> String {
        let name = |v: DVec3| {
            let axes = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)];
            let found = axes.into_iter().find(|(_, a)| v.dot(*a).abs() > 1.0 - 1e-9);
            found.map_or_else(
                || format!("[{:.4}, {:.4}, {:.4}]", v.x, v.y, v.z),
                |(name, a)| format!("{}{name}", if v.dot(a) > 0.0 { '+' } else { '-' }),
            )
        };
        format!("up is {}, north {}, east {}", name(self.up), name(self.north), name(self.east))
    }

    /// (east, north, up) of a vector in scene coordinates.
    pub fn local(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.east.dot(v), self.north.dot(v), self.up.dot(v))
    }

    /// Scene coordinates of a vector (east, north, up).
    pub fn world(&self, v: DVec3) -> DVec3 {
        v.x * self.east + v.y * self.north + v.z * self.up
    }

    /// The unit vector with an azimuth and an elevation above the horizon, degrees.
    pub fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        self.world(spherical(elevation.to_radians().sin(), azimuth.to_radians()))
    }

    /// Azimuth in `[0, 360)` and elevation of a unit vector, degrees.
    pub fn angles(&self, direction: DVec3) -> [f64; 2] {
        let v = self.local(direction);
        let azimuth = v.x.atan2(v.y).to_degrees().rem_euclid(360.0);
        // The remainder of a small negative number may be rounded to 360.
        [if azimuth < 360.0 { azimuth } else { 0.0 }, v.z.atan2(v.x.hypot(v.y)).to_degrees()]
    }
}

/// The local unit vector with the height `z`, the sine of the elevation, and an azimuth in radians.
pub(super) fn spherical(z: f64, azimuth: f64) -> DVec3 {
    let horizontal = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
    let (sin, cos) = azimuth.sin_cos();
    DVec3::new(horizontal * sin, horizontal * cos, z)
}

/// Azimuth of a local direction, radians in `[0, 2π)`.
pub(super) fn azimuth(local: DVec3) -> f64 {
    let angle = local.x.atan2(local.y);
    if angle < 0.0 { (angle + std::f64::consts::TAU).min(std::f64::consts::TAU.next_down()) } else { angle }
}
