//! Light at points that are known only when there is a solution: pixels of pictures.

use super::clock::Clock;
use super::field::Rgb;
use super::receive::fewer;
use super::{Options, Receiver, Solver};
use crate::embree::{CommittedScene, Traversal};
use crate::points::Point;
use crate::scene::Scene;
use glam::Vec3;

/// Part of the time that rays are planned for: a sample says what they take, and others use the machine too.
const PLANNED: f64 = 0.8;
/// Rays between two looks at the clock, about.
const RAYS: usize = 1 << 22;

/// Asks a solution for light at more points.
pub struct More<'a> {
    pub(super) scene: &'a Scene,
    pub(super) solver: &'a Solver,
    pub(super) traced: (&'a CommittedScene, Traversal),
    pub(super) options: &'a Options,
    pub(super) clock: Clock<'a>,
}

/// What it says.
pub struct Answer {
    /// Irradiance at the points, W/m²; nothing if that was interrupted, or if there was no time for a few rays of each point.
    pub irradiance: Option<Vec<Rgb>>,
    /// What a user should know, if that is less than was asked for.
    pub note: Option<String>,
}

impl More<'_> {
    /// Irradiance at points (file coordinates) within a part, in `(0, 1]`, of what is left of [`Options::max_seconds`]: by
    /// fewer rays if there is no time for all of them.
    pub fn irradiance(&self, points: &[Point], part: f64) -> Answer {
        let clock = self.clock.part(part);
        let points = relative(self.scene, points);
        let receiver = |options: &Options| Receiver::new(self.scene, self.solver, self.traced, options);
        let all = receiver(self.options);
        let possible = all.possible(&points, &clock.part(PLANNED));
        let rays = |options: &Options| {
            options.light_rays() + if options.direct_only { 0 } else { options.gather_rays() }
        };
        let least = rays(&fewer(self.options, 0.0)) as f64 / rays(self.options) as f64;
        if possible < least {
            return self.nothing(points.len());
        }
        let hurried = fewer(self.options, possible.min(1.0));
        let receiver = if possible < 1.0 { receiver(&hurried) } else { all };
        let mut irradiance = Vec::with_capacity(points.len());
        for some in points.chunks((RAYS / rays(&hurried)).max(1)) {
            if clock.with_grace().late() {
                return self.nothing(points.len());
            }
            irradiance.extend(receiver.irradiance(some).0);
        }
        let note = (possible < 1.0).then(|| {
            let (few, many) = (rays(&hurried), rays(self.options));
            format!("{}: light at pixels by {few} rays each instead of {many}", self.limit())
        });
        Answer { irradiance: Some(irradiance), note }
    }

    fn nothing(&self, points: usize) -> Answer {
        let why = if self.clock.interrupted() { "interrupted".into() } else { self.limit() };
        let note =
            format!("{why}: light at {points} pixels is that of elements, there was no time to gather it");
        Answer { irradiance: None, note: Some(note) }
    }

    fn limit(&self) -> String {
        format!("--max-seconds {}", self.options.max_seconds.unwrap_or_default())
    }
}

/// Points as rays start from them: relative to the scene's origin, with their normals.
pub(super) fn relative(scene: &Scene, points: &[Point]) -> Vec<(Vec3, Vec3)> {
    points.iter().map(|p| ((p.position - scene.origin).as_vec3(), p.normal.as_vec3())).collect()
}
