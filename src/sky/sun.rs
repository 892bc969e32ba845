//! The sun: a disc of uniform radiance.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Mean angular diameter of the sun, degrees: 1.3927e6 km at 1.496e8 km.
pub const SUN_DIAMETER: f64 = 0.533;

/// A disc in the sky with the same radiance everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards its centre, scene coordinates.
    pub direction: DVec3,
    /// Angular diameter, radians, above 0 and below π.
    pub diameter: f64,
    /// Irradiance of a plane that faces it, W/m² (or lx).
    pub irradiance: [f64; 3],
}

impl Sun {
    /// A sun of the mean diameter.
    pub fn new(direction: DVec3, irradiance: [f64; 3]) -> Sun {
        Sun { direction, diameter: SUN_DIAMETER.to_radians(), irradiance }
    }

    /// Radiance of the disc, W/(m² sr): L with E = π L sin²(diameter / 2).
    pub fn radiance(&self) -> [f64; 3] {
        let sin = (0.5 * self.diameter).sin();
        self.irradiance.map(|e| e / (PI * sin * sin))
    }

    /// Solid angle of the disc, sr.
    pub fn solid_angle(&self) -> f64 {
        // 2π (1 − cos(diameter / 2)) without the difference of nearly equal numbers.
        let sin = (0.25 * self.diameter).sin();
        4.0 * PI * sin * sin
    }

    /// Whether a unit vector points at the disc.
    pub fn contains(&self, direction: DVec3) -> bool {
        self.direction.distance(direction) <= 2.0 * (0.25 * self.diameter).sin()
    }

    /// A direction towards the disc, uniform by solid angle, for `u` in the unit square. The density is 1 / [`Sun::solid_angle`].
    pub fn sample(&self, u: [f64; 2]) -> DVec3 {
        let sin = (0.25 * self.diameter).sin();
        // 1 − cos of the angle to the centre.
        let drop = 2.0 * sin * sin * u[0];
        let radius = (drop * (2.0 - drop)).sqrt();
        let (x, y) = self.direction.any_orthonormal_pair();
        let (s, c) = (TAU * u[1]).sin_cos();
        (1.0 - drop) * self.direction + radius * (c * x + s * y)
    }

    /// Irradiance of a plane with a unit normal, W/m²; the part of the disc below the plane does not count.
    pub fn irradiance_on(&self, normal: DVec3) -> [f64; 3] {
        let (sin, cos) = (0.5 * self.diameter).sin_cos();
        let factor = capped_cosine(sin, cos, normal.dot(self.direction)) / (PI * sin * sin);
        self.irradiance.map(|e| e * factor)
    }
}

/// Cosine-weighted solid angle of the part of a disc above a plane: sine and cosine of the disc's angular radius, and cosine of the angle
/// of its centre to the plane's normal. Half the integral of n·(r × dr) along the boundary: a part of the circle and a part of the
/// horizon.
fn capped_cosine(sin: f64, cos: f64, cosine: f64) -> f64 {
    let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
    if cosine >= sin {
        return PI * sin * sin * cosine;
    }
    if cosine <= -sin {
        return 0.0;
    }
    // Half angles of the parts of the circle, about the disc's centre, and of the horizon, about the plane's normal.
    let circle = (-cos * cosine / (sin * sine)).clamp(-1.0, 1.0).acos();
    let horizon = (cos / sine).clamp(-1.0, 1.0).acos().min(FRAC_PI_2);
    (sin * sin * cosine * circle - cos * sin * sine * circle.sin() + horizon).max(0.0)
}
