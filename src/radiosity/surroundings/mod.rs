//! Properties of the surroundings of every side, from a few rays: enclosure of clusters, ways out of the scene, emitted light
//! that leaves it, sides without light; and the power that arrives from beyond the scene.

mod emission;
mod probe;
mod side_rays;
mod unlit;

use super::rgb::{Rgb, add};
pub use emission::{SampledShare, emitted_share};
use glam::Vec3;
pub use probe::{Surroundings, probe, received_shares};
pub use side_rays::{ESCAPED, SideRays};
pub use unlit::{Unlit, unlit_sides};

/// Power that elements receive from beyond the scene, W/m² times scene units squared.
#[derive(Clone, Copy, Debug, Default)]
pub struct SkyPower {
    /// From the sky and the ground around the scene.
    pub sky: Rgb,
    /// From the suns.
    pub sun: Rgb,
}

impl SkyPower {
    /// The sums over elements with these areas and irradiances of the sky and the suns.
    pub fn of(elements: impl Iterator<Item = (f64, Vec3, Vec3)>) -> SkyPower {
        let mut sums = SkyPower::default();
        for (area, sky, sun) in elements {
            add(&mut sums.sky, area, sky.to_array().map(f64::from));
            add(&mut sums.sun, area, sun.to_array().map(f64::from));
        }
        sums
    }

    /// Adds the power that arrives at other elements.
    pub fn add(&mut self, other: SkyPower) {
        add(&mut self.sky, 1.0, other.sky);
        add(&mut self.sun, 1.0, other.sun);
    }

    /// Both powers times `factor`.
    pub fn times(self, factor: f64) -> SkyPower {
        SkyPower { sky: self.sky.map(|v| factor * v), sun: self.sun.map(|v| factor * v) }
    }
}
