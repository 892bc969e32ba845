//! A finished solution, which computes irradiance at points at any time.

use super::notes;
use crate::model::Model;
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::audit::Solved;
use crate::radiosity::deadline::{Deadline, QUERY_SHARE};
use crate::radiosity::final_gather::{FinalGather, with_fewer_rays};
use crate::radiosity::options::Options;
use crate::radiosity::rgb::Rgb;
use crate::scene::Scene;
use glam::Vec3;

/// Approximate number of rays between two checks of the deadline: limits the delay to 4 million rays, half a second at
/// 8 million rays a second.
const RAYS_PER_CHECK: usize = 1 << 22;

/// The light of a scene, from which irradiance at points is computed.
pub struct Solution {
    pub(super) model: Model,
    pub(super) solved: Solved,
    pub(in crate::radiosity) options: Options,
    /// The time limit of the whole solution.
    pub(in crate::radiosity) deadline: Deadline<'static>,
}

/// Irradiance at points within a time limit.
pub struct PointLight {
    /// Irradiance at the points, W/m²; none after an interruption, or if there was no time for the smallest number of rays of each point.
    pub irradiance: Option<Vec<Rgb>>,
    /// A note for the user if fewer rays were traced than asked for.
    pub note: Option<String>,
}

impl Solution {
    /// The model that was solved.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Irradiance at points relative to the scene's origin, with unit normals, W/m², with all rays; none if `progress` has
    /// stopped.
    pub fn irradiance(&self, points: &[(Vec3, Vec3)], progress: &dyn Progress) -> Option<Vec<Rgb>> {
        self.gathered(points, "light at points", Deadline::start(progress, None)).irradiance
    }

    /// Irradiance at points (file coordinates) within a fraction, in `(0, 1]`, of the time that is left of [`Options::max_seconds`]: by
    /// fewer rays if there is no time for all of them.
    pub fn irradiance_within(&self, points: &[Point], part: f64, progress: &dyn Progress) -> PointLight {
        self.gathered_at(points, self.deadline.for_caller(progress).part(part))
    }

    /// Irradiance at points (file coordinates), W/m², with all rays, whatever time limit the solution had; none if `progress` has stopped.
    pub fn irradiance_unless(&self, points: &[Point], progress: &dyn Progress) -> Option<Vec<Rgb>> {
        self.gathered_at(points, Deadline::start(progress, None)).irradiance
    }

    fn gathered_at(&self, pixels: &[Point], deadline: Deadline) -> PointLight {
        self.gathered(&relative(self.model.scene(), pixels), "light at pixels", deadline)
    }

    /// Irradiance at points relative to the scene's origin, with unit normals, in a stage of this name.
    fn gathered(&self, points: &[(Vec3, Vec3)], stage: &str, deadline: Deadline) -> PointLight {
        let gather = |options: &Options| FinalGather::new(&self.model, &self.solved.linked, options);
        let all = gather(&self.options);
        let possible = all.possible_part(points, &deadline.part(QUERY_SHARE));
        let rays = rays_per_point;
        let min_part = rays(&with_fewer_rays(&self.options, 0.0)) as f64 / rays(&self.options) as f64;
        if possible < min_part {
            return self.nothing(points.len(), &deadline);
        }
        let fewer = with_fewer_rays(&self.options, possible.min(1.0));
        let gather = if possible < 1.0 { gather(&fewer) } else { all };
        let mut irradiance = Vec::with_capacity(points.len());
        deadline.stage(stage, points.len());
        let direct = gather.direct_light_for(points);
        let step = (RAYS_PER_CHECK / rays(&fewer)).max(1);
        for first in (0..points.len()).step_by(step) {
            if deadline.with_grace().late() {
                return self.nothing(points.len(), &deadline);
            }
            let part = first..points.len().min(first + step);
            irradiance.extend(gather.irradiance_of(points, part, &direct, &|n| deadline.advance(n)).0);
        }
        let note = (possible < 1.0).then(|| {
            let (few, many) = (rays(&fewer), rays(&self.options));
            format!("{}: light at pixels by {few} rays each instead of {many}", notes::limit(&self.options))
        });
        PointLight { irradiance: Some(irradiance), note }
    }

    fn nothing(&self, points: usize, deadline: &Deadline) -> PointLight {
        let why = if deadline.interrupted() { "interrupted".into() } else { notes::limit(&self.options) };
        let note =
            format!("{why}: light at {points} pixels is that of elements, there was no time to gather it");
        PointLight { irradiance: None, note: Some(note) }
    }
}

/// Rays that are traced from a point.
fn rays_per_point(options: &Options) -> usize {
    options.light_rays() + if options.direct_only { 0 } else { options.gather_rays() }
}

/// Points relative to the scene's origin, with their normals, scene units.
pub fn relative(scene: &Scene, points: &[Point]) -> Vec<(Vec3, Vec3)> {
    points.iter().map(|p| ((p.position - scene.origin).as_vec3(), p.normal.as_vec3())).collect()
}
