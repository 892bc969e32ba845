//! Irradiance at points: direct light by shadow rays, reflected light by a hemisphere of rays.

use super::direct_light::CHUNK;
use super::gatherer::{Buffers, FinalGather};
use super::smooth_light::SmoothLight;
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::options::Options;
use crate::radiosity::rgb::{Rgb, add, mean};
use glam::Vec3;
use std::ops::Range;
use std::sync::Arc;

/// Points whose rays are timed for an estimate: a quarter of the points of one task. Used with a time limit only.
const TIMED_POINTS: usize = CHUNK / 4;
/// Smallest number of rays of each kind, however short the time: the lower bounds of [`Options::light_rays`] and [`Options::gather_rays`].
const MIN_POINT_RAYS: usize = 64;

/// Options with this fraction of the rays of a point, but at least a minimum of each kind.
pub fn with_fewer_rays(options: &Options, part: f64) -> Options {
    let fewer = |rays: usize| Some(((rays as f64 * part) as usize).clamp(MIN_POINT_RAYS.min(rays), rays));
    Options {
        light_rays: fewer(options.light_rays()),
        gather_rays: fewer(options.gather_rays()),
        ..options.clone()
    }
}

/// Engines and data for direct light at many points.
pub struct DirectLight {
    /// By emitter.
    engines: Vec<VisibilityEngine>,
    smooth: SmoothLight,
    /// Places in openings through which the sky lights rooms.
    openings: Arc<Vec<Vec3>>,
}

impl FinalGather<'_> {
    /// Irradiance (W/m²) at points (scene units relative to the scene's origin, unit normals), in their order, and the tally of
    /// the visibility queries. `done` is called with the number of further points finished.
    pub fn irradiance(&self, points: &[(Vec3, Vec3)], done: &(dyn Fn(usize) + Sync)) -> (Vec<Rgb>, Tally) {
        let direct = self.direct_light_for(points);
        let (values, mut tally) = self.irradiance_of(points, 0..points.len(), &direct, done);
        tally.add(direct.smooth.tally);
        (values, tally)
    }

    /// Prepares direct light for all of these points.
    pub fn direct_light_for(&self, points: &[(Vec3, Vec3)]) -> DirectLight {
        let cut = self.cut_for(points.len());
        let engines = self.engines(points, cut.clone());
        let smooth = cut.map(|cut| self.smooth_light(points, &cut, &engines)).unwrap_or_default();
        let is_needed = !points.is_empty() && !self.hemispheres.is_empty();
        DirectLight { engines, smooth, openings: if is_needed { self.openings() } else { Arc::default() } }
    }

    /// [`FinalGather::irradiance`] of a part of the points. The tally excludes the preparation for all points.
    pub fn irradiance_of(
        &self,
        points: &[(Vec3, Vec3)],
        part: Range<usize>,
        direct: &DirectLight,
        done: &(dyn Fn(usize) + Sync),
    ) -> (Vec<Rgb>, Tally) {
        let rows = self.ranks.rows(part.len().div_ceil(CHUNK));
        let made: Vec<(Vec<Rgb>, Tally)> =
            parallel::map_with(rows.numbers(), Buffers::default, |buffers, chunk| {
                buffers.scratch.tally = Tally::default();
                let first = part.start + CHUNK * chunk;
                let range = first..part.end.min(first + CHUNK);
                let count = range.len();
                let values = self.light_of_chunk(points, range, direct, buffers);
                done(rows.steps(count));
                (values, buffers.scratch.tally)
            });
        let (mut values, mut tally) = (Vec::with_capacity(part.len()), Tally::default());
        for (part, counts) in rows.gather(made) {
            // The light of leaves has noise on both sides of 0.
            values.extend(part.into_iter().map(|light| light.map(|of| if of < 0.0 { 0.0 } else { of })));
            tally.add(counts);
        }
        (values, tally)
    }

    /// Irradiance at the points of one task.
    fn light_of_chunk(
        &self,
        points: &[(Vec3, Vec3)],
        range: Range<usize>,
        DirectLight { engines, smooth, openings }: &DirectLight,
        buffers: &mut Buffers,
    ) -> Vec<Rgb> {
        let reflects = !self.hemispheres.is_empty();
        let point = |i: usize| {
            let seed = mix(self.linked.settings.seed ^ mix(i as u64));
            self.gather_point(points[i].0, points[i].1, seed)
        };
        let (mut values, mut asked, mut places) = (Vec::new(), Vec::new(), Vec::new());
        let mut all = Vec::new();
        for i in range {
            let known = smooth.at(i);
            if known.is_none() || reflects {
                let point = point(i);
                if known.is_none() {
                    asked.push(point);
                    places.push(values.len());
                }
                all.push(point);
            }
            values.push(known.unwrap_or_default());
        }
        for (place, light) in places.into_iter().zip(self.direct(&asked, 1, engines, &mut buffers.scratch)) {
            values[place] = light;
        }
        if reflects {
            for (value, sun) in values.iter_mut().zip(self.suns_at(&all, &mut buffers.scratch)) {
                add(value, 1.0, sun);
            }
            self.add_bright_leaves(&all, &mut values, &mut buffers.scratch);
            for (value, point) in values.iter_mut().zip(&all) {
                let known = mean(*value);
                add(value, 1.0, self.irradiance_of_rays(point, known, openings, buffers));
            }
        }
        values
    }

    /// Options with fewer rays, if the time is too short for all rays at these points.
    pub fn options_within_time(
        &self,
        points: &[(Vec3, Vec3)],
        options: &Options,
        deadline: &Deadline,
    ) -> Option<Options> {
        let part = self.possible_part(points, deadline);
        (part < 1.0).then(|| with_fewer_rays(options, part))
    }

    /// The fraction of the rays at these points that the time allows, from a timed sample of the points.
    pub fn possible_part(&self, points: &[(Vec3, Vec3)], deadline: &Deadline) -> f64 {
        if deadline.late() {
            0.0
        } else if deadline.limited() && points.len() > TIMED_POINTS {
            let sample: Vec<(Vec3, Vec3)> =
                points.iter().copied().step_by(points.len().div_ceil(TIMED_POINTS)).collect();
            let start = deadline.elapsed();
            // The sample is one task; all points are tasks for all threads.
            self.irradiance(&sample, &|_| ());
            let each = (deadline.elapsed() - start) / sample.len() as f64;
            deadline.left() * rayon::current_num_threads() as f64 / (each * points.len() as f64)
        } else {
            1.0
        }
    }
}
