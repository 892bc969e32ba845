//! Power that arrives from beyond the scene.

use crate::radiosity::rgb::{Rgb, add};
use glam::Vec3;

/// Power that elements receive from beyond the scene, W/m² times scene units squared.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arrived {
    /// From the sky and the ground around the scene.
    pub sky: Rgb,
    /// From the suns.
    pub sun: Rgb,
}

impl Arrived {
    /// The sums over elements with these areas and irradiances of the sky and the suns.
    pub fn of(elements: impl Iterator<Item = (f64, Vec3, Vec3)>) -> Arrived {
        let mut sums = Arrived::default();
        for (area, sky, sun) in elements {
            add(&mut sums.sky, area, sky.to_array().map(f64::from));
            add(&mut sums.sun, area, sun.to_array().map(f64::from));
        }
        sums
    }

    /// A multiple of both.
    pub fn times(self, factor: f64) -> Arrived {
        Arrived { sky: self.sky.map(|v| factor * v), sun: self.sun.map(|v| factor * v) }
    }
}
