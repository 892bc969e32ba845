//! Direct light at points: Lambert's formula times the visible part, from bundles of shadow rays.

use super::bright_leaves::BrightLeaves;
use super::gatherer::FinalGather;
use crate::math::sampling::{mix, numbers, pick, point_on};
use crate::radiosity::elements::emission_gain;
use crate::radiosity::elements::emitters::Emitter;
use crate::radiosity::links::{Scratch, VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::{EndRule, LANES, Packet};
use glam::Vec3;

/// Points that are gathered for together, as one task: limits the buffers of a task. 64 points are four packets.
pub(super) const CHUNK: usize = 64;
/// Smallest number of shadow rays of a point and an emitter: two packets, whose difference shows whether more rays are
/// needed. 16 or 64 rays instead change irradiance by less than 0.08 % (`constants.py solve`).
const MIN_SHADOW_RAYS: usize = 2 * LANES;
/// Visible part of an emitter below which a point with little other light traces more rays: that of four of [`MIN_SHADOW_RAYS`]. Of 32 rays to a lamp behind
/// a hole that shows a hundredth of it none passes three times of four, and stopping there would lose a sixth of its light.
const MAX_HIDDEN_VISIBILITY: f64 = 4.0 / MIN_SHADOW_RAYS as f64;
/// Rays after which an emitter counts as hidden if none has passed. Those of a hole that shows a hundredth of it all miss the hole once in thirteen times.
const HIDDEN_RAYS: usize = 256;
/// Expected number of emitters from which no ray has passed to which a point traces [`HIDDEN_RAYS`] in each set. Points of 64 closed cells with 32 lamps take 7 times as long with all lamps.
const TRACED_AGAIN: f64 = 4.0;

/// Largest number of shadow rays of a point to an emitter over [`Options::light_rays`]. Without blockers an emitter behind a louvre may light a point with
/// many times the light that the point has.
///
/// [`Options::light_rays`]: crate::radiosity::options::Options::light_rays
pub(super) const MORE_WHERE_BRIGHT: usize = 16;

/// A point at which irradiance is computed.
#[derive(Clone, Copy)]
pub(super) struct GatherPoint {
    pub on_surface: Vec3,
    /// Where its rays start, above the surface.
    pub at: Vec3,
    pub normal: Vec3,
    /// The end rule of its surface.
    pub end: EndRule,
    /// Shadows on its surface smaller than this may be averaged, scene units.
    pub feature_size: f32,
    /// Seed of its samples.
    pub seed: u64,
}

impl FinalGather<'_> {
    /// Direct irradiance at points, W/m², as the mean over so many sets of shadow rays. All points query an emitter together.
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
                self.measure_visibility(&mut views, (emitter, engine), self.table.len(), scratch, |view| {
                    view.is_uncertain(self.tolerance(view, &values).min(self.visibility_tolerance()))
                });
                for view in views {
                    add(&mut values[view.point], view.visible() / sets as f64, view.free);
                    if view.visible() < MAX_HIDDEN_VISIBILITY {
                        hidden.push((emitter, view));
                    }
                }
            }
        }
        self.trace_hidden(hidden, sets, engines, scratch, &mut values);
        values
    }

    /// Traces more rays to emitters, each by its engine or the last one, that are mostly hidden from points with little other light: the light that has passed may be all that the point has.
    /// Of many emitters from which none has passed only some are chosen at random, in proportion to their unoccluded light, and what their rays find is
    /// divided by the probability of the choice: the mean is that of all.
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
            let chance = match view.seen > 0.0 {
                true => 1.0,
                false => (TRACED_AGAIN * mean(view.free) / unoccluded[view.point]).min(1.0),
            };
            let [random, ..] = numbers(mix(view.from.seed) ^ emitter as u64, 0);
            (f64::from(random) < chance).then_some((emitter, chance, view))
        };
        let chosen: Vec<(usize, f64, EmitterView)> = hidden.into_iter().filter_map(chosen).collect();
        for same in chosen.chunk_by(|a, b| a.0 == b.0) {
            let emitter = same[0].0;
            let mut views: Vec<EmitterView> = same.iter().map(|(.., view)| view.clone()).collect();
            let goes_on = |view: &EmitterView| view.seen > 0.0 || view.traced < HIDDEN_RAYS;
            let engine = &engines[emitter.min(engines.len() - 1)];
            self.measure_visibility(&mut views, (emitter, engine), self.light_rays, scratch, goes_on);
            for ((_, chance, before), view) in same.iter().zip(views) {
                let change = (view.visible() - before.visible()) / (sets as f64 * chance);
                add(&mut values[view.point], change, view.free);
            }
        }
    }

    /// An emitter of the scene by its number; the next number is that of the bright leaves.
    pub(super) fn emitter(&self, number: usize) -> &Emitter {
        let bright = || self.bright.as_ref().map(BrightLeaves::emitter);
        self.emitters
            .emitters
            .get(number)
            .or_else(bright)
            .expect("bright leaves have a number if there are any")
    }

    /// Whether the light of a leaf is received by shadow rays.
    pub(super) fn is_bright(&self, leaf: u32) -> bool {
        self.bright.as_ref().is_some_and(|bright| bright.face_of(leaf).is_some())
    }

    /// Adds the light that bright leaves reflect to that of points, W/m².
    pub(super) fn add_bright_leaves(
        &self,
        points: &[GatherPoint],
        values: &mut [Rgb],
        scratch: &mut Scratch,
    ) {
        if self.bright.is_none() {
            return;
        }
        let number = self.emitters.emitters.len();
        let engine = self.linked.engine.scattered();
        let mut views = self.emitter_views(points, number);
        self.measure_visibility(&mut views, (number, &engine), self.table.len(), scratch, |view| {
            view.is_uncertain(self.tolerance(view, values))
        });
        views.iter().for_each(|view| add(&mut values[view.point], view.visible(), view.free));
        let is_hidden = |view: &EmitterView| view.visible() < MAX_HIDDEN_VISIBILITY;
        let hidden = views.into_iter().filter(is_hidden).map(|view| (number, view)).collect();
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
            for face in faces {
                let (at, normal) = (from.on_surface.as_dvec3(), from.normal.as_dvec3());
                let factor = face.factor(at, normal);
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
                    sum: 0.0,
                    seen: 0.0,
                    squares: 0.0,
                    squares_of_packets: 0.0,
                    count: 0.0,
                    packets: 0.0,
                    traced: 0,
                });
            }
        }
        views
    }

    /// The visible part of an emitter's irradiance: few rays, and more, up to `most`, while `goes_on`, as where they disagree ([`EmitterView::is_uncertain`]). Averaged
    /// visibility varies less and needs fewer rays.
    pub(super) fn measure_visibility(
        &self,
        views: &mut [EmitterView],
        (emitter, engine): (usize, &VisibilityEngine),
        most: usize,
        scratch: &mut Scratch,
        goes_on: impl Fn(&EmitterView) -> bool,
    ) {
        // Without a ray above the horizon nothing is known.
        let is_left = |view: &EmitterView| {
            let few = view.count == 0.0 || view.traced < MIN_SHADOW_RAYS;
            view.traced < most && (few || goes_on(view))
        };
        let mut left: Vec<usize> = (0..views.len()).filter(|&k| is_left(&views[k])).collect();
        while !left.is_empty() {
            let (queries, lanes): (Vec<VisibilityQuery>, Vec<[[f32; LANES]; 2]>) =
                left.iter().map(|&k| self.shadow_rays(&views[k], emitter, views[k].traced)).unzip();
            engine.answer_all(&queries, scratch, |k, through| {
                let [weights, levels] = &lanes[k];
                let arrives = std::array::from_fn(|lane| levels[lane] * through[lane]);
                views[left[k]].add(&queries[k].packet, weights, &arrives);
            });
            left.retain(|&k| {
                views[k].traced += LANES;
                is_left(&views[k])
            });
        }
    }

    /// Largest standard error of a visible part: what all rays would leave in the worst case, 1 / (2 √n).
    pub(super) fn visibility_tolerance(&self) -> f64 {
        0.5 / (self.light_rays as f64).sqrt()
    }

    /// The standard error of the visible part of an emitter with which that of its light is the error asked for, relative to the mean irradiance or, in
    /// brighter places, to the light of the point: `known` by point and that of this emitter.
    fn tolerance(&self, view: &EmitterView, known: &[Rgb]) -> f64 {
        let free = mean(view.free);
        let light = mean(known[view.point]) + view.visible() * free;
        self.error * light.max(self.linked.mean_irradiance) / free
    }

    /// Sixteen shadow rays of a point, beginning with number `first`, their weights, and what the places where they end send over the mean of their faces.
    pub(super) fn shadow_rays(
        &self,
        view: &EmitterView,
        emitter: usize,
        first: usize,
    ) -> (VisibilityQuery, [[f32; LANES]; 2]) {
        let emitter_of = self.emitter(emitter);
        let GatherPoint { at, normal, end, feature_size, seed, .. } = view.from;
        let [shift_u, shift_v, ..] = numbers(seed ^ emitter as u64, 0);
        let mut packet = Packet::EMPTY;
        let (mut weights, mut levels) = ([0.0f32; LANES], [1.0; LANES]);
        for (lane, (weight, [u, v])) in weights.iter_mut().zip(&self.table[first..]).enumerate() {
            let (u, v) = ((u + shift_u).fract(), (v + shift_v).fract());
            let (f, u, share) = pick(&view.shares, u);
            let face = &emitter_of.faces[f];
            let y = point_on(&face.corners, u, v);
            let d = y - at;
            let r2 = d.length_squared().max(f32::MIN_POSITIVE);
            let kernel = (normal.dot(d).max(0.0) / r2) * ((-face.normal.dot(d)).max(0.0) / r2);
            let gain = emission_gain(face.profile.as_deref(), y, face.normal, at);
            *weight = gain * kernel * face.area * mean(face.exitance) as f32 / share;
            if *weight > 0.0 {
                let rules = [end, face.end.seen_from(end)];
                packet.set_lifted(lane, at, rules[1].lifted(y, face.normal), rules);
                levels[lane] = self.level_at(emitter, f, y);
            }
        }
        (VisibilityQuery { packet, emitter_size: emitter_of.width, feature_size }, [weights, levels])
    }

    /// What a place on a face sends over the mean of the face: bright leaves below an element that is sampled as a whole differ.
    fn level_at(&self, emitter: usize, face: usize, at: Vec3) -> f32 {
        let Some(bright) = self.bright.as_ref().filter(|_| emitter >= self.emitters.emitters.len()) else {
            return 1.0;
        };
        let leaf = self.lookup.leaf(bright.sides[face], at);
        mean(self.reflected[leaf as usize].map(f64::from)) as f32
            / mean(bright.emitter().faces[face].exitance) as f32
    }
}

/// A point that faces an emitter, and the results of its shadow rays so far.
#[derive(Clone)]
pub(super) struct EmitterView {
    /// Index of the point.
    point: usize,
    pub(super) from: GatherPoint,
    /// Unoccluded irradiance, W/m².
    free: Rgb,
    /// Running sums of the parts of the faces.
    shares: Vec<f32>,
    /// Sums of weights, of weights times what arrives, as a part of what the mean of the face would send, and of weights times the squares of that.
    sum: f64,
    seen: f64,
    squares: f64,
    /// Sum of weights of packets times the squares of what arrives by them in the mean.
    squares_of_packets: f64,
    /// Numbers of rays above the horizon, of packets with such rays, and of all rays.
    count: f64,
    packets: f64,
    traced: usize,
}

impl EmitterView {
    /// The same view with another set of shadow rays; the first set is its own.
    fn with_set(&self, set: u64) -> EmitterView {
        let seed = if set == 0 { self.from.seed } else { mix(self.from.seed ^ set) };
        EmitterView { from: GatherPoint { seed, ..self.from }, ..self.clone() }
    }

    /// Visible part of the emitter's irradiance.
    pub(super) fn visible(&self) -> f64 {
        if self.sum > 0.0 { self.seen / self.sum } else { 1.0 }
    }

    fn add(&mut self, packet: &Packet, weights: &[f32; LANES], through: &[f32; LANES]) {
        let (mut sum, mut seen) = (0.0, 0.0);
        for lane in packet.lanes() {
            sum += f64::from(weights[lane]);
            seen += f64::from(weights[lane] * through[lane]);
            self.squares += f64::from(weights[lane] * through[lane] * through[lane]);
        }
        if sum > 0.0 {
            (self.sum, self.seen) = (self.sum + sum, self.seen + seen);
            self.squares_of_packets += seen * seen / sum;
            self.count += packet.len() as f64;
            self.packets += 1.0;
        }
    }

    /// Whether the standard error of the visible part exceeds the tolerance. The places of a packet are spread evenly over the emitter, so that packets
    /// differ less than random rays would; one more packet counts as if it differed by as much as those.
    pub(super) fn is_uncertain(&self, tolerance: f64) -> bool {
        if self.sum <= 0.0 {
            return false;
        }
        let square = self.visible().powi(2);
        let of_ray = (self.squares / self.sum - square).max(0.0);
        let of_packet = (self.squares_of_packets / self.sum - square).max(0.0);
        of_ray / self.count + of_packet > self.packets * tolerance * tolerance
    }
}
