//! Light sources at infinity: the sky and the suns.

use super::cells::{Cells, GroundRadiance};
use super::frame::Frame;
use super::patches::Patches;
use super::planes::Planes;
use super::radiance::Sky;
use super::sun::Sun;
use crate::Result;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

/// A sky, suns, and the ground below the horizon. Directions are unit vectors in the coordinates of the scene, from the scene outwards.
/// Irradiance is in W/m² and radiance in W/(m² sr), or in lx and cd/m² if [`SkyOptions`](super::SkyOptions) says so. Clones share tables.
#[derive(Clone, Debug)]
pub struct Environment {
    frame: Frame,
    sky: Option<Arc<Sky>>,
    suns: Vec<Sun>,
    /// Radiance of the ground.
    ground: [f64; 3],
    cells: Arc<Cells>,
    patches: Arc<Patches>,
    planes: Arc<Planes>,
    /// Notes for the user about the sky, north, the sun and repairs; one line each.
    pub notes: Vec<String>,
}

/// A direction that was drawn in proportion to radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkySample {
    /// Unit vector in scene coordinates.
    pub direction: DVec3,
    /// Radiance of sky or ground, W/(m² sr), without the sun's disc.
    pub radiance: [f64; 3],
    /// Density of directions, 1/sr, above 0.
    pub pdf: f64,
}

impl Environment {
    /// A sky and suns over a ground of a diffuse reflectance, which has the radiance reflectance × E / π of the horizontal irradiance E
    /// by sky and suns. A sky with a lower half of its own has no ground.
    pub fn new(frame: Frame, sky: Option<Sky>, suns: Vec<Sun>, reflectance: [f64; 3]) -> Environment {
        let mut irradiance = sky.as_ref().map_or([0.0; 3], |s| s.horizontal_irradiance());
        for sun in &suns {
            let direct = sun.irradiance_on(frame.up);
            (0..3).for_each(|c| irradiance[c] += direct[c]);
        }
        let is_detailed = sky.as_ref().is_some_and(Sky::has_lower_half);
        let ground = [0, 1, 2].map(|c| if is_detailed { 0.0 } else { reflectance[c] * irradiance[c] / PI });
        let value = |local: DVec3| radiance_of(sky.as_ref(), ground, local);
        let has_ground = ground.iter().any(|v| *v > 0.0);
        let lower = match is_detailed {
            true => GroundRadiance::Detailed,
            false if has_ground => GroundRadiance::Uniform,
            false => GroundRadiance::Black,
        };
        let detail = sky.as_ref().and_then(Sky::detail);
        let cells = Cells::new(lower, detail, |local| value(local).iter().sum());
        let patches = Patches::new(frame, lower, detail, sky.as_ref().and_then(Sky::peak), value);
        let (cells, patches) = (Arc::new(cells), Arc::new(patches));
        let (sky, planes) = (sky.map(Arc::new), Arc::new(Planes::new()));
        Environment { frame, sky, suns, ground, cells, patches, planes, notes: Vec::new() }
    }

    /// Suns alone, in a scene with this upward axis.
    pub fn of_suns(up: DVec3, suns: Vec<Sun>) -> Result<Environment> {
        let frame = Frame::upright(up)?;
        let notes = vec![frame.note(), notes_of_suns(&frame, OF_FILE, &suns)];
        Ok(Environment { notes, ..Environment::new(frame, None, suns, [0.0; 3]) })
    }

    /// Up, north and east.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The sky, if there is one.
    pub fn sky(&self) -> Option<&Sky> {
        self.sky.as_deref()
    }

    /// Whether the sky has a map.
    pub fn has_map(&self) -> bool {
        self.sky.as_ref().is_some_and(|sky| sky.map().is_some())
    }

    /// The suns.
    pub fn suns(&self) -> &[Sun] {
        &self.suns
    }

    /// Whether no light comes from below the horizon.
    pub fn is_dark_below(&self) -> bool {
        let has_lower_half = self.sky.as_ref().is_some_and(|sky| sky.has_lower_half());
        let is_up = |sun: &Sun| sun.direction.dot(self.frame.up) > 0.0;
        !has_lower_half && self.ground == [0.0; 3] && self.suns.iter().all(is_up)
    }

    /// The patches of sky and ground.
    pub fn patches(&self) -> &Patches {
        &self.patches
    }

    /// Radiance of sky or ground in a direction, without the suns' discs.
    pub fn radiance(&self, direction: DVec3) -> [f64; 3] {
        radiance_of(self.sky.as_deref(), self.ground, self.frame.local(direction))
    }

    /// The same with all irradiance and radiance times a factor of at least 0, for other units.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Environment {
        let mut scaled = self.clone();
        scaled.sky = self.sky.as_ref().map(|sky| Arc::new(sky.scaled(factor)));
        scaled.suns.iter_mut().for_each(|sun| sun.irradiance = sun.irradiance.map(|e| factor * e));
        scaled.ground = self.ground.map(|l| factor * l);
        scaled.patches = Arc::new(self.patches.scaled(factor));
        scaled.planes = Arc::new(Planes::new());
        scaled
    }

    /// Radiance in a direction with the suns' discs, for pictures.
    pub fn radiance_with_suns(&self, direction: DVec3) -> [f64; 3] {
        let mut sum = self.radiance(direction);
        for sun in self.suns.iter().filter(|sun| sun.contains(direction)) {
            let disc = sun.radiance();
            (0..3).for_each(|c| sum[c] += disc[c]);
        }
        sum
    }

    /// A direction of sky or ground with a density near to proportional to radiance, for `u` in the unit square.
    pub fn sample(&self, u: [f64; 2]) -> SkySample {
        let (local, pdf) = self.cells.sample(u);
        let radiance = radiance_of(self.sky.as_deref(), self.ground, local);
        SkySample { direction: self.frame.world(local), radiance, pdf }
    }

    /// Density of [`Environment::sample`] at a direction, 1/sr; 0 below the horizon if the ground is black.
    pub fn pdf(&self, direction: DVec3) -> f64 {
        self.cells.pdf(self.frame.local(direction))
    }

    /// Irradiance of an unobstructed plane with a unit normal by sky and ground, W/m², to 0.05 %.
    pub fn sky_irradiance(&self, normal: DVec3) -> [f64; 3] {
        self.patches.irradiance_to(0.0, normal)
    }

    /// The same from a table, for many planes: it adds at most a thousandth of the irradiance of a horizontal plane if the sky has no sun
    /// in it.
    pub fn tabulated_sky_irradiance(&self, normal: DVec3) -> [f64; 3] {
        self.planes.irradiance(&self.patches, normal)
    }

    /// Irradiance of an unobstructed plane with a unit normal by sky, ground and suns, W/m², to 0.05 %.
    pub fn irradiance(&self, normal: DVec3) -> [f64; 3] {
        let mut sum = self.sky_irradiance(normal);
        for sun in &self.suns {
            let direct = sun.irradiance_on(normal);
            (0..3).for_each(|c| sum[c] += direct[c]);
        }
        sum
    }
}

fn radiance_of(sky: Option<&Sky>, ground: [f64; 3], local: DVec3) -> [f64; 3] {
    match sky {
        Some(sky) if local.z > 0.0 || sky.has_lower_half() => sky.radiance(local),
        _ if local.z > 0.0 => [0.0; 3],
        _ => ground,
    }
}

/// Title of the suns of a scene's file in notes.
pub(super) const OF_FILE: &str = "suns of the file";

/// The positions of suns in one sentence.
pub(super) fn notes_of_suns(frame: &Frame, title: &str, suns: &[Sun]) -> String {
    let note = |sun: &Sun| {
        let [azimuth, elevation] = frame.angles(sun.direction);
        let [r, g, b] = sun.irradiance;
        format!(
            "azimuth {azimuth:.4}, elevation {elevation:.4} degrees, normal irradiance {r:.4} {g:.4} {b:.4}"
        )
    };
    let notes: Vec<String> = suns.iter().map(note).collect();
    let is_below = |sun: &Sun| sun.direction.dot(frame.up) < 0.0;
    let cure = match title == OF_FILE && suns.iter().any(is_below) {
        true => "; light comes from below the horizon: turn the node of that sun, or state `sun` as none",
        false => "",
    };
    format!("{title}: {}{cure}", notes.join("; "))
}
