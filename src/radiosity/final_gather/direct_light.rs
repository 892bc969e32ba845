//! Direct light at points: the unoccluded irradiance by Lambert's formula times the visible fraction, estimated by bundles of shadow rays.

use super::bright_leaves::{BrightLeaves, FRACTION_OF_ERROR, MIN_SHADOW_RAYS};
use super::face_parts::{Part, part_of};
use super::gather_point::GatherPoint;
use super::gatherer::FinalGather;
use crate::math::sampling::{mix, numbers, pick, point_on};
use crate::radiosity::elements::emitters::Emitter;
use crate::radiosity::elements::{emission_gain, surface_area};
use crate::radiosity::links::{Scratch, VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::{LANES, Packet};
use glam::{DVec3, Vec3};

/// Points per parallel task: limits the buffers of the task. 64 points fill four packets.
pub(super) const CHUNK: usize = 64;
/// Visible fraction of an emitter below which a point with little other light traces more rays: the fraction if four of
/// [`MIN_SHADOW_RAYS`] rays pass. If a hole shows a hundredth of a lamp, none of 32 rays passes in three cases of four; without more rays
/// a sixth of the lamp's light would be lost.
const MAX_HIDDEN_VISIBILITY: f64 = 4.0 / MIN_SHADOW_RAYS as f64;
/// Mean number of emitters without a passing ray to which a point traces all rays in each set, chosen at random in proportion to their
/// light. Without a limit, a point of one of many closed cells would trace rays to the lamps of all cells.
const RETRACED_EMITTERS: f64 = 4.0;

impl FinalGather<'_> {
    /// Direct irradiance at points, W/m²: the mean over `sets` sets of shadow rays. All points query one emitter together.
    pub(super) fn direct(
        &self,
        points: &[GatherPoint],
        sets: u64,
        engines: &[VisibilityEngine],
        scratch: &mut Scratch,
    ) -> Vec<Rgb> {
        let mut values = vec![[0.0; 3]; points.len()];
        let mut hidden = Vec::new();
        for (emitter, engine) in engines.iter().enumerate() {
            let views = self.emitter_views(points, emitter);
            for set in 0..sets {
                let mut views: Vec<EmitterView> = views.iter().map(|view| view.with_set(set)).collect();
                self.measure_visibility(&mut views, emitter, engine, scratch, |view| {
                    view.rays_for(self.tolerance(view, 0.0).min(self.visibility_tolerance()))
                });
                for view in views {
                    add(&mut values[view.point], 1.0 / sets as f64, view.light());
                    if self.is_hidden(&view) {
                        hidden.push((emitter, view));
                    }
                }
            }
        }
        self.trace_hidden(hidden, sets, engines, scratch, &mut values);
        values
    }

    /// Traces more rays to emitters that are mostly hidden from points with little other light, because the small visible fraction may be
    /// all the light of the point. `engines` are in the order of the emitters; the last one serves all further emitters. Of many emitters
    /// without a passing ray, only some are drawn at random, in proportion to their unoccluded light. Their results are divided by the
    /// probability of the choice, so that the mean is that of all.
    fn trace_hidden(
        &self,
        mut hidden: Vec<(usize, EmitterView)>,
        sets: u64,
        engines: &[VisibilityEngine],
        scratch: &mut Scratch,
        values: &mut [Rgb],
    ) {
        hidden.retain(|(_, view)| mean(values[view.point]) < mean(view.free));
        let mut unoccluded = vec![0.0; values.len()];
        hidden.iter().for_each(|(_, view)| unoccluded[view.point] += mean(view.free) / sets as f64);
        let chosen = |(emitter, view): (usize, EmitterView)| {
            let chance = match view.visible() > 0.0 {
                true => 1.0,
                false => (RETRACED_EMITTERS * mean(view.free) / unoccluded[view.point]).min(1.0),
            };
            let [random, ..] = numbers(mix(view.from.seed) ^ emitter as u64, 0);
            (f64::from(random) < chance).then_some((emitter, chance, view))
        };
        let chosen: Vec<(usize, f64, EmitterView)> = hidden.into_iter().filter_map(chosen).collect();
        for same in chosen.chunk_by(|a, b| a.0 == b.0) {
            let emitter = same[0].0;
            let mut views: Vec<EmitterView> = same.iter().map(|(.., view)| view.clone()).collect();
            let engine = &engines[emitter.min(engines.len() - 1)];
            self.trace_anew(&mut views, emitter, engine, scratch, |_| self.light_rays);
            for ((_, chance, before), view) in same.iter().zip(views) {
                let part = 1.0 / (sets as f64 * chance);
                add(&mut values[view.point], part, view.light());
                add(&mut values[view.point], -part, before.light());
            }
        }
    }

    /// An emitter of the scene by its number; the number after the last emitter stands for the bright leaves.
    pub(super) fn emitter(&self, number: usize) -> &Emitter {
        let bright = || self.bright().map(BrightLeaves::emitter);
        self.emitters
            .emitters
            .get(number)
            .or_else(bright)
            .expect("bright leaves have a number if there are any")
    }

    /// Whether the light of a leaf is received by shadow rays.
    pub(super) fn is_bright(&self, leaf: u32) -> bool {
        self.bright().is_some_and(|bright| bright.face_of(leaf).is_some())
    }

    /// Adds the irradiance by the reflected light of bright leaves to the `values` of points, W/m².
    pub(super) fn add_bright_leaves(
        &self,
        points: &[GatherPoint],
        values: &mut [Rgb],
        scratch: &mut Scratch,
    ) {
        if self.bright().is_none() {
            return;
        }
        let number = self.emitters.emitters.len();
        let engine = self.linked.engine.scattered();
        let mut views = self.emitter_views(points, number);
        self.measure_visibility(&mut views, number, &engine, scratch, |view| {
            view.rays_for(self.tolerance(view, mean(values[view.point])))
        });
        views.iter().for_each(|view| add(&mut values[view.point], 1.0, view.light()));
        let hidden = views.into_iter().filter(|view| self.is_hidden(view));
        let hidden = hidden.map(|view| (number, view)).collect();
        self.trace_hidden(hidden, 1, std::slice::from_ref(&engine), scratch, values);
    }

    /// Irradiance at a point if nothing blocked the light, mean over the channels, W/m².
    pub(super) fn unblocked_at(&self, point: &GatherPoint) -> f64 {
        let views = |emitter| self.emitter_views(std::slice::from_ref(point), emitter);
        (0..self.emitters.emitters.len()).flat_map(views).map(|view| f64::from(mean(view.free) as f32)).sum()
    }

    /// The points that face an emitter's front, with their unoccluded irradiance.
    pub(super) fn emitter_views(&self, points: &[GatherPoint], emitter: usize) -> Vec<EmitterView> {
        let faces = &self.emitter(emitter).faces;
        let mut views = Vec::new();
        for (point, &from) in points.iter().enumerate() {
            let (mut free, mut total, mut shares) = ([0.0; 3], 0.0, Vec::with_capacity(faces.len()));
            let (at, normal) = (from.on_surface.as_dvec3(), from.normal.as_dvec3());
            for face in faces {
                let factor = if from.faces(face) { face.factor(at, normal) } else { 0.0 };
                add(&mut free, factor, face.exitance);
                total += (factor * mean(face.exitance)) as f32;
                shares.push(total);
            }
            if total > 0.0 {
                views.push(EmitterView {
                    point,
                    from,
                    free,
                    shares,
                    found: ShadowRaySums::default(),
                    traced: 0,
                });
            }
        }
        views
    }

    /// Estimates the visible fraction of an emitter's irradiance by few rays, or by as many new rays as `rays` computes from the results
    /// of these. Averaged visibility varies less and needs fewer rays.
    pub(super) fn measure_visibility(
        &self,
        views: &mut [EmitterView],
        emitter: usize,
        engine: &VisibilityEngine,
        scratch: &mut Scratch,
        rays: impl Fn(&EmitterView) -> usize,
    ) {
        let few = self.first_rays();
        // Without a ray above the horizon there is no estimate yet.
        let is_unknown = |view: &EmitterView| view.found.count == 0.0 && view.traced < self.light_rays;
        self.trace_views(views, emitter, engine, scratch, |_, view| view.traced < few || is_unknown(view));
        self.trace_anew(views, emitter, engine, scratch, rays);
    }

    /// Number of the first shadow rays of a point to an emitter.
    fn first_rays(&self) -> usize {
        MIN_SHADOW_RAYS.min(self.light_rays)
    }

    /// Whether few rays have shown that an emitter is mostly hidden.
    fn is_hidden(&self, view: &EmitterView) -> bool {
        view.traced <= self.first_rays() && view.visible() < MAX_HIDDEN_VISIBILITY
    }

    /// Replaces the results by those of `rays` new rays, if that number is not 0. The number depends on the results of the first rays, so
    /// that the mean over both sets would be too small: where the first rays happen to find little light, no more rays would follow. The
    /// new rays have a random shift of their own, because the points of one sequence avoid its earlier points.
    fn trace_anew(
        &self,
        views: &mut [EmitterView],
        emitter: usize,
        engine: &VisibilityEngine,
        scratch: &mut Scratch,
        rays: impl Fn(&EmitterView) -> usize,
    ) {
        let end = |view: &mut EmitterView| match rays(view).min(self.table.len()) {
            0 => view.traced,
            more => {
                let from = GatherPoint { seed: mix(!view.from.seed), ..view.from };
                (view.from, view.found, view.traced) = (from, ShadowRaySums::default(), 0);
                more
            }
        };
        let ends: Vec<usize> = views.iter_mut().map(end).collect();
        let is_unknown = |view: &EmitterView| view.found.count == 0.0 && view.traced < self.table.len();
        self.trace_views(views, emitter, engine, scratch, |k, view| {
            view.traced < ends[k] || is_unknown(view)
        });
    }

    /// Traces sixteen shadow rays of each view at a time, as long as `is_left` is true for the view.
    fn trace_views(
        &self,
        views: &mut [EmitterView],
        emitter: usize,
        engine: &VisibilityEngine,
        scratch: &mut Scratch,
        is_left: impl Fn(usize, &EmitterView) -> bool,
    ) {
        let mut left: Vec<usize> = (0..views.len()).filter(|&k| is_left(k, &views[k])).collect();
        while !left.is_empty() {
            let (queries, lanes): (Vec<VisibilityQuery>, Vec<[ShadowRay; LANES]>) =
                left.iter().map(|&k| self.shadow_rays(&views[k], emitter, views[k].traced)).unzip();
            engine.answer_all(&queries, scratch, |k, through| {
                views[left[k]].found.add(&queries[k].packet, &lanes[k], through);
            });
            left.retain(|&k| {
                views[k].traced += LANES;
                is_left(k, &views[k])
            });
        }
    }

    /// Tolerated standard error of a visible fraction: that of all n rays in the worst case, 1 / (2 √n).
    pub(super) fn visibility_tolerance(&self) -> f64 {
        0.5 / (self.light_rays as f64).sqrt()
    }

    /// The standard error of an emitter's visible fraction at which the standard error of its light is [`FRACTION_OF_ERROR`] of the error
    /// asked for, relative to the mean irradiance. At brighter points it is relative to the light of the point: `known`, W/m², plus the
    /// light that has arrived from this emitter.
    fn tolerance(&self, view: &EmitterView, known: f64) -> f64 {
        let free = mean(view.free);
        let light = known + view.visible() * free;
        FRACTION_OF_ERROR * self.error * light.max(self.linked.mean_irradiance) / free
    }

    /// Sixteen shadow rays of a point, beginning with number `first`.
    pub(super) fn shadow_rays(
        &self,
        view: &EmitterView,
        emitter: usize,
        first: usize,
    ) -> (VisibilityQuery, [ShadowRay; LANES]) {
        let emitter_of = self.emitter(emitter);
        let GatherPoint { at, normal, end, feature_size, seed, .. } = view.from;
        let [shift_u, shift_v, ..] = numbers(seed ^ emitter as u64, 0);
        let mut packet = Packet::EMPTY;
        let mut rays = [ShadowRay::default(); LANES];
        for (lane, (ray, [u, v])) in rays.iter_mut().zip(&self.table[first..]).enumerate() {
            let (u, v) = ((u + shift_u).fract(), (v + shift_v).fract());
            let (f, u, share) = pick(&view.shares, u);
            let face = &emitter_of.faces[f];
            let Part { corners, u, probability } = part_of(&face.corners, u, at, normal);
            let y = face.off_the_rim(point_on(&corners, u, v));
            let d = y - at;
            let r2 = d.length_squared().max(f32::MIN_POSITIVE);
            let kernel = (normal.dot(d).max(0.0) / r2) * ((-face.normal.dot(d)).max(0.0) / r2);
            let gain = emission_gain(face.profile.as_deref(), y, face.normal, at);
            let weight = gain * kernel * (surface_area(&corners) as f32) / (share * probability);
            if weight * mean(face.exitance) as f32 > 0.0 {
                let rules = [end, face.end.seen_from(end)];
                packet.set_lifted(lane, at, rules[1].lifted(y, face.normal), rules);
                let of_face = Vec3::from(face.exitance.map(|m| m as f32));
                let of_place = self.reflected_at(emitter, f, y).unwrap_or(of_face);
                *ray = ShadowRay { of_face: weight * of_face, of_place: weight * of_place };
            }
        }
        (VisibilityQuery { packet, emitter_size: emitter_of.width, feature_size }, rays)
    }

    /// Radiosity reflected at a point on a face of the bright leaves, W/m²; `None` for emitters. The leaves below one face differ.
    fn reflected_at(&self, emitter: usize, face: usize, at: Vec3) -> Option<Vec3> {
        let bright = self.bright().filter(|_| emitter >= self.emitters.emitters.len())?;
        Some(self.reflected_from(self.lookup.leaf(bright.sides[face], at)))
    }
}

/// Unoccluded light of a shadow ray over its density, up to a factor: by the mean exitance of the face, and by the exitance where the ray
/// ends.
#[derive(Clone, Copy, Default)]
pub(super) struct ShadowRay {
    of_face: Vec3,
    of_place: Vec3,
}

/// A point that faces an emitter, and the results of its shadow rays so far.
#[derive(Clone)]
pub(super) struct EmitterView {
    /// Index of the point.
    point: usize,
    pub(super) from: GatherPoint,
    /// Unoccluded irradiance, W/m².
    free: Rgb,
    /// Running sums of the unoccluded irradiance by each face, mean over the channels, W/m².
    shares: Vec<f32>,
    found: ShadowRaySums,
    /// Number of rays, those below the horizon included.
    traced: usize,
}

impl EmitterView {
    /// The same view with another set of shadow rays; the first set is its own.
    fn with_set(&self, set: u64) -> EmitterView {
        let seed = if set == 0 { self.from.seed } else { mix(self.from.seed ^ set) };
        EmitterView { from: GatherPoint { seed, ..self.from }, ..self.clone() }
    }

    /// Visible fraction of the emitter's irradiance, mean over the channels.
    pub(super) fn visible(&self) -> f64 {
        self.found.visible()
    }

    /// Irradiance by the visible fraction, W/m². Each channel has its own visible fraction: of faces of several colours some may be hidden.
    fn light(&self) -> Rgb {
        let ShadowRaySums { free, seen, .. } = self.found;
        std::array::from_fn(|k| if free[k] > 0.0 { self.free[k] * seen[k] / free[k] } else { self.free[k] })
    }

    /// Number of rays for which the standard error of the visible fraction equals the tolerance; 0 if the traced rays already keep it.
    pub(super) fn rays_for(&self, tolerance: f64) -> usize {
        let variance = self.found.variance();
        match variance <= tolerance * tolerance {
            true => 0,
            false => (self.traced as f64 * variance / (tolerance * tolerance)) as usize,
        }
    }
}

/// Sums over the shadow rays to an emitter.
#[derive(Clone, Copy, Default)]
struct ShadowRaySums {
    /// Sums of the unoccluded light by the mean exitance of each face (`free`), and of the light that arrives (`seen`).
    free: DVec3,
    seen: DVec3,
    /// Sum over rays of the unoccluded light times the square of the fraction that arrives, means over the channels.
    squares: f64,
    /// The same over packets.
    squares_of_packets: f64,
    /// Numbers of rays above the horizon, and of packets with such rays.
    count: f64,
    packets: f64,
}

impl ShadowRaySums {
    fn add(&mut self, packet: &Packet, rays: &[ShadowRay; LANES], through: &[f32; LANES]) {
        let level = |light: DVec3| light.element_sum() / 3.0;
        let (mut free, mut seen) = (DVec3::ZERO, DVec3::ZERO);
        for lane in packet.lanes() {
            let ShadowRay { of_face, of_place } = rays[lane];
            let (of_ray, arrives) = (of_face.as_dvec3(), (through[lane] * of_place).as_dvec3());
            (free, seen) = (free + of_ray, seen + arrives);
            self.squares += level(arrives).powi(2) / level(of_ray);
        }
        if level(free) > 0.0 {
            (self.free, self.seen) = (self.free + free, self.seen + seen);
            self.squares_of_packets += level(seen).powi(2) / level(free);
            self.count += packet.len() as f64;
            self.packets += 1.0;
        }
    }

    fn visible(&self) -> f64 {
        let free = self.free.element_sum();
        if free > 0.0 { self.seen.element_sum() / free } else { 1.0 }
    }

    /// Variance of the visible fraction; 0 without rays. The points of a packet are spread evenly over the emitter, so that packets
    /// differ less than random rays. Few packets determine their variance poorly: it is the variance of these packets and one more that
    /// varies like sixteen random rays.
    fn variance(&self) -> f64 {
        let free = self.free.element_sum() / 3.0;
        if free <= 0.0 {
            return 0.0;
        }
        let square = self.visible().powi(2);
        let of_ray = (self.squares / free - square).max(0.0);
        let of_packet = (self.squares_of_packets / free - square).max(0.0);
        (of_ray / self.count + of_packet) / self.packets
    }
}
