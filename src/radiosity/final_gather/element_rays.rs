//! Rays of elements from points on them: packets are filled across elements, and the light that is found is summed by element.

use super::element_samples::{DirectRay, ElementLight, REFLECTED, variance_of_quarters};
use super::gatherer::{Buffers, FinalGather, PathVertex, RayResult};
use super::paths::{EmitterRay, EndOfPaths, to_vec, weight};
use crate::form_factors::analytic::clip;
use crate::math::sampling::{mix, point_on, shifted};
use crate::radiosity::elements::emitter_tree::EmitterCut;
use crate::radiosity::elements::emitters::{EmitterFace, Emitters, density_ratio};
use crate::radiosity::elements::{Elements, Shape, Side, centroid, emission_gain, inner_radius, mean_over};
use crate::radiosity::links::{VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::{Rgb, add};
use crate::ray::{LANES, Packet};
use glam::{DVec3, Vec3};
use sobol_burley::sample_4d;
use std::ops::Range;

/// Distance of the start points of rays from the edges of their element, in heights at which rays start above it: a wall that leans over
/// an edge by up to 63° lies beside these starts and not below them.
const EDGE_HEIGHTS: f32 = 2.0;
/// Ratio of an element's radius to its distance from a face up to which the closed form is evaluated at the centre alone. The
/// midpoint rule leaves an error of about half the square of this ratio: 0.1 %.
const MIDPOINT_RADIUS: f32 = 0.05;

/// A leaf and the number of its rays in each half.
#[derive(Clone, Copy)]
pub struct LeafRays {
    /// The element.
    pub leaf: u32,
    /// Rays of one half.
    pub count: u32,
    /// Whether each of these rays has a ray to an emitter beside it.
    pub to_emitters: bool,
    /// Rays to each sun for each of these rays, from points near its start.
    pub suns: u32,
    /// The random numbers of each half.
    pub sequences: [Sequence; HALVES],
}

/// Irradiance of a leaf from all emitters if nothing blocked them.
#[derive(Clone, Copy)]
pub(super) struct Unblocked {
    /// W/m².
    light: Vec3,
    /// Whether a face is so near that a few points on it would carry most of its light: rays into the scene then find only some of it.
    near: bool,
}

/// The part of a low-discrepancy sequence that starts at a number (Burley 2020).
#[derive(Clone, Copy)]
pub struct Sequence {
    /// Seed of the sequence.
    seed: u32,
    /// Number of its first point.
    first: u32,
}

impl Sequence {
    /// The part of the sequence that starts `count` numbers later.
    fn after(self, count: u32) -> Sequence {
        Sequence { first: self.first + count, ..self }
    }
}

/// Longest sequence of `sobol_burley`.
const MAX_SEQUENCE: u32 = 1 << 16;

/// Gives neighbouring leaves parts of one sequence that follow each other: the rays of all leaves that share their light then cover the
/// hemisphere evenly together (Ahmed and Wonka 2020). Both halves of a leaf follow each other if `joins_halves`; otherwise each half has
/// its own sequence.
pub fn join_sequences(leaves: &mut [&mut LeafRays], joins_halves: bool) {
    let Some(mut next) = leaves.first().map(|of| of.sequences) else { return };
    for of in leaves {
        let used = if joins_halves { 2 * of.count } else { of.count };
        if next[0].first + used > MAX_SEQUENCE {
            next = of.sequences;
        }
        of.sequences = if joins_halves { [next[0], next[0].after(of.count)] } else { next };
        next = next.map(|sequence| sequence.after(used));
    }
}

/// Index of the first of the two sequences of an element's own light. An element has four sequences.
pub const LIGHT_SET: u64 = 0;
/// Index of the first of the two sequences of an element's rays of the exchange.
pub const EXCHANGE_SET: u64 = 2;
/// Halves of the rays of an element.
const HALVES: usize = 2;

/// Rays per parallel task: enough to fill packets, and few enough to balance the load of the threads.
const BATCH: usize = 1024;

/// Parts of a list of leaves with about [`BATCH`] rays in each half.
pub fn batches(leaves: &[LeafRays]) -> Vec<Range<usize>> {
    let (mut parts, mut first, mut rays) = (Vec::new(), 0, 0);
    for (k, of) in leaves.iter().enumerate() {
        rays += of.count as usize;
        if rays >= BATCH || k + 1 == leaves.len() {
            parts.push(first..k + 1);
            (first, rays) = (k + 1, 0);
        }
    }
    parts
}

impl FinalGather<'_> {
    /// Irradiance of a batch of leaves: a ray into the scene and a ray to an emitter from each of their points.
    pub(super) fn light_of(&self, batch: &[LeafRays], buffers: &mut Buffers) -> Vec<ElementLight> {
        let cuts = self.cuts_of(batch, buffers);
        let unblocked = |of: &LeafRays, cut| of.to_emitters.then(|| self.unblocked(of.leaf, cut)).flatten();
        let free: Vec<Option<Unblocked>> =
            batch.iter().zip(&cuts).map(|(of, cut)| unblocked(of, cut)).collect();
        let random = self.starts(batch, buffers);
        let direct = self.trace_leaves(batch, &random, &cuts, &free, buffers);
        buffers.cuts = cuts;
        let mut light = vec![ElementLight::default(); batch.len()];
        let mut first = 0;
        for ((of, light), free) in batch.iter().zip(&mut light).zip(free) {
            let half = of.count as usize;
            let range = first..first + 2 * half;
            first = range.end;
            light.rays = half as u32;
            let quarters = buffers.quarters[range.clone()].iter();
            let (beyond_range, beyond) = (range.clone(), &buffers.results[range.clone()]);
            match free {
                Some(Unblocked { light: free, .. }) => {
                    let (rays, level) = (&direct[range], free.element_sum() / 3.0);
                    let of = |(&quarter, ray): (&u8, &DirectRay)| {
                        let all = ray.free.element_sum();
                        (quarter, all, level * ray.seen.element_sum() / all.max(f32::MIN_POSITIVE))
                    };
                    light.variance_over_quarters = variance_of_quarters(quarters.zip(rays).map(of));
                    light.direct_of_fraction(free, half, rays);
                }
                None => {
                    let results = &buffers.results[range];
                    let of = |(&quarter, result): (&u8, &RayResult)| {
                        (quarter, 1.0, result.direct.element_sum() / 3.0)
                    };
                    light.variance_over_quarters = variance_of_quarters(quarters.zip(results).map(of));
                    light.direct_of_rays(half, results);
                }
            }
            if self.has_environment() {
                light.add_beyond(half, &buffers.quarters[beyond_range], beyond);
            }
        }
        let bright = self.light_of_bright_leaves(batch, &random, buffers);
        self.add_reflected(batch, bright, &mut light, buffers);
        light
    }

    /// For each of `buffers.vertices`: the light of bright leaves by a separate shadow ray to one of them, and the weight (balance
    /// heuristic) of the light of a bright leaf that the ray from the vertex has hit. `None` if there are no bright leaves.
    fn light_of_bright_leaves(
        &self,
        batch: &[LeafRays],
        random: &[[f32; 4]],
        buffers: &mut Buffers,
    ) -> Option<Vec<(Vec3, f32)>> {
        let bright = self.bright()?;
        let mut cuts = std::mem::take(&mut buffers.bright_cuts);
        cuts.resize_with(batch.len().max(cuts.len()), EmitterCut::default);
        batch.iter().zip(&mut cuts).for_each(|(of, cut)| self.cut_of(&bright.emitters, of.leaf, cut));
        let cut = |vertex: &PathVertex| &cuts[vertex.path as usize / HALVES];
        let light_of = |ray: &EmitterRay| {
            let leaf = self.lookup.leaf(bright.sides[ray.face], ray.ends[1]);
            let level = Vec3::from(bright.emitter().faces[ray.face].exitance.map(|m| m as f32));
            ray.light.element_sum() / level.element_sum() * self.reflected_from(leaf)
        };
        let sent =
            self.visible_parts(&bright.emitters, |vertex| (cut(vertex), false), light_of, random, buffers);
        let met = |(vertex, found): (&PathVertex, &RayResult)| {
            let met = &found.met;
            let face = (met.side != Elements::NONE).then(|| bright.face_of(met.leaf)).flatten()?;
            let sides = &self.linked.elements.sides;
            let [own, other] = [vertex.side, met.side].map(|side| &sides[side as usize]);
            let q = density_ratio(
                vertex.at,
                own.normal,
                met.at,
                other.normal,
                own.end.rounding_of_heights(other.end),
                bright.emitter().faces[face as usize].exitance,
                bright.emitters.density(cut(vertex), face),
            );
            Some(weight(q))
        };
        let parts = buffers.vertices.iter().zip(&buffers.results).zip(sent);
        let parts = parts.map(|(ray, (light, through))| (through * light, met(ray).unwrap_or(1.0))).collect();
        buffers.bright_cuts = cuts;
        Some(parts)
    }

    /// The groups of emitting faces for each leaf of a batch, none for leaves without rays to emitters, in a list that the caller must
    /// return to `buffers.cuts`.
    pub(super) fn cuts_of(&self, batch: &[LeafRays], buffers: &mut Buffers) -> Vec<EmitterCut> {
        let mut cuts = std::mem::take(&mut buffers.cuts);
        cuts.resize_with(batch.len().max(cuts.len()), EmitterCut::default);
        for (of, cut) in batch.iter().zip(&mut cuts) {
            cut.clear();
            if of.to_emitters {
                self.cut_of(&self.emitters, of.leaf, cut);
            }
        }
        cuts
    }

    /// Traces the rays of a batch of leaves from `buffers.vertices` and writes `buffers.results`, in the order of leaves, halves and
    /// numbers. Returns the light of emitters from each of these points. Where the unoccluded light of the leaf, `free`, is not known,
    /// this light is added to the results.
    pub(super) fn trace_leaves(
        &self,
        batch: &[LeafRays],
        random: &[[f32; 4]],
        cuts: &[EmitterCut],
        free: &[Option<Unblocked>],
        buffers: &mut Buffers,
    ) -> Vec<DirectRay> {
        self.trace_scene_rays(&|i| random[i], buffers);
        let leaf = |vertex: &PathVertex| vertex.path as usize / HALVES;
        // Rays into the scene and to emitters find the same light, with the weights of the balance heuristic.
        let both = |vertex: &PathVertex| free[leaf(vertex)].is_none_or(|free| free.near);
        self.read_hits(|_, vertex| both(vertex).then_some(&cuts[leaf(vertex)]), buffers);
        let emitters = |vertex: &PathVertex| (&cuts[leaf(vertex)], !both(vertex));
        let parts = self.visible_parts(&self.emitters, emitters, |ray| ray.light, random, buffers);
        let of_part = |(light, through)| DirectRay { free: light, seen: through * light };
        let mut rays: Vec<DirectRay> = parts.into_iter().map(of_part).collect();
        self.add_suns(&|i| random[i], |vertex| batch[leaf(vertex)].suns, buffers);
        if self.has_environment() {
            self.compare_with_open_sky(batch, HALVES, buffers);
        }
        let Buffers { packets, vertices, results, .. } = buffers;
        for (i, ((vertex, result), ray)) in vertices.iter().zip(results).zip(&mut rays).enumerate() {
            match free[leaf(vertex)] {
                None => result.direct += ray.seen,
                Some(Unblocked { near: true, .. }) => {
                    let packet = &packets[i / LANES];
                    let along = [0.0, 1.0].map(|t| packet.point(i % LANES, t));
                    ray.free += self.unblocked_along(vertex, &cuts[leaf(vertex)], along, result.met.side);
                    ray.seen += result.direct;
                }
                Some(_) => {}
            }
        }
        rays
    }

    /// Light of the emitting faces that a cosine-weighted ray from a vertex would meet if nothing blocked it, with the weight of the
    /// balance heuristic, W/m². `met` is the side that it has met.
    fn unblocked_along(&self, vertex: &PathVertex, cut: &EmitterCut, ray: [Vec3; 2], met: u32) -> Vec3 {
        let Side { normal, end, .. } = self.linked.elements.sides[vertex.side as usize];
        let light = |(face, at, density): (&EmitterFace, Vec3, f32)| {
            let rounding = end.rounding_of_heights(face.end);
            let q = density_ratio(vertex.at, normal, at, face.normal, rounding, face.exitance, density);
            emission_gain(face.profile.as_deref(), at, face.normal, vertex.at)
                * weight(q)
                * to_vec(face.exitance)
        };
        self.emitters.faces_along(cut, ray, met).map(light).sum()
    }

    /// Independent sequences for the halves of a leaf's rays: [`LIGHT_SET`] or [`EXCHANGE_SET`].
    pub(super) fn sequences_of(&self, leaf: u32, kind: u64) -> [Sequence; HALVES] {
        let id = self.linked.elements.elements[leaf as usize].ids[0];
        let seed = |half: u64| mix(!self.linked.settings.seed ^ mix(4 * id + kind + half)) as u32;
        [0, 1].map(|half| Sequence { seed: seed(half), first: 0 })
    }

    /// Writes the points from which the rays of a batch start to `buffers.vertices`, with a path for each half of a leaf. Returns four
    /// random numbers in `[0, 1)` for each point.
    pub(super) fn starts(&self, batch: &[LeafRays], buffers: &mut Buffers) -> Vec<[f32; 4]> {
        let mut random = Vec::with_capacity(2 * BATCH);
        buffers.vertices.clear();
        buffers.quarters.clear();
        buffers.sun_places.clear();
        let mut path = 0;
        for of in batch {
            let leaf = of.leaf;
            let element = &self.linked.elements.elements[leaf as usize];
            let Shape::Surface { side, corners } = element.shape else { unreachable!("leaves are surfaces") };
            let height = self.linked.elements.sides[side as usize].end.height();
            let rim = self.linked.elements.states[leaf as usize].rim;
            let corners = inset(corners, rim.max(EDGE_HEIGHTS * height));
            for Sequence { seed, first } in of.sequences {
                for k in first..first + of.count {
                    let [u, v, ..] = sample_4d(k, 1, seed);
                    buffers.quarters.push(2 * u8::from(u >= 0.5) + u8::from(v >= 0.5));
                    let at = point_on(&corners, u, v);
                    buffers.vertices.push(PathVertex {
                        at,
                        side,
                        leaf,
                        triangle: Elements::NONE,
                        path,
                        share: Vec3::ONE,
                    });
                    random.push(sample_4d(k, 0, seed));
                    // Further start points of rays to suns, in the same quarter of the element.
                    let place = |m: u32| {
                        let turned = shifted([2.0 * u, 2.0 * v], m).map(|t| 0.5 * t);
                        point_on(
                            &corners,
                            0.5 * (2.0 * u).floor() + turned[0],
                            0.5 * (2.0 * v).floor() + turned[1],
                        )
                    };
                    buffers.sun_places.extend((1..of.suns).map(place));
                }
                path += 1;
            }
        }
        random
    }

    /// Irradiance of an element from all emitters if nothing blocked them, W/m², by closed form or quadrature. None if too many faces
    /// light the element.
    fn unblocked(&self, leaf: u32, cut: &EmitterCut) -> Option<Unblocked> {
        let elements = &self.linked.elements;
        let element = &elements.elements[leaf as usize];
        let Shape::Surface { side, corners } = element.shape else { return None };
        let Side { normal: facing, end, .. } = elements.sides[side as usize];
        let normal = facing.as_dvec3();
        let (mut sum, mut is_near) = ([0.0; 3], false);
        for face in self.emitters.faces(cut)? {
            // The back of a lamp lies in the plane of its front.
            let rounding = end.rounding_of_heights(face.end);
            let in_front = |at: Vec3, normal: Vec3, corners: &[Vec3; 4]| {
                corners.iter().any(|c| normal.dot(*c - at) > rounding)
            };
            if !in_front(element.centre, facing, &face.corners)
                || !in_front(face.corners[0], face.normal, &corners)
            {
                continue;
            }
            let of = |at: Vec3| face.factor(at.as_dvec3(), normal);
            let middle = 0.25 * face.corners.iter().sum::<Vec3>();
            let radius = face.corners.iter().map(|c| (*c - middle).length()).fold(0.0, f32::max);
            // The distance from the face is at least the distance from its centre minus the radius of the face.
            let distance = (middle - element.centre).length() - radius;
            let near = element.radius > MIDPOINT_RADIUS * distance;
            // Few rays to a near face leave a bias: fins 2 cm before a lamp of 4 m had 60 % too much light.
            is_near |= distance < radius;
            if face.profile.is_some() {
                // Close to a face, the quadrature of its profile takes up to 3,072 directions for each of 256 points. Rays take less time.
                if distance < radius {
                    return None;
                }
                // A beam that misses all sample points has no closed form: rays estimate the light instead.
                let mean = Some(mean_over(&of, corners)).filter(|mean| *mean > 0.0)?;
                add(&mut sum, mean, face.exitance);
                continue;
            }
            let mean = match near {
                true => mean_before(&of, corners, face, rounding),
                false => of(element.centre),
            };
            add(&mut sum, mean, face.exitance);
        }
        Some(Unblocked { light: Vec3::from(sum.map(|s| s as f32)), near: is_near })
    }

    /// Traces a shadow ray from each of `buffers.vertices` to one of `emitters`. Returns its unoccluded light over its density, W/m², and
    /// its transmittance. `cut_of` returns the cut for a vertex, and whether its unoccluded light is known; if not, light has the weight of
    /// the balance heuristic. `light_of` returns the light of a ray.
    fn visible_parts<'c>(
        &self,
        emitters: &Emitters,
        cut_of: impl Fn(&PathVertex) -> (&'c EmitterCut, bool),
        light_of: impl Fn(&EmitterRay) -> Vec3,
        random: &[[f32; 4]],
        buffers: &mut Buffers,
    ) -> Vec<(Vec3, f32)> {
        let Buffers { vertices, scratch, .. } = buffers;
        let mut parts = vec![(Vec3::ZERO, 0.0); vertices.len()];
        let engine = self.of_elements.get_or_init(|| self.engine_of_elements());
        // Exact rays of several leaves fill packets together; other engines take one feature size a packet.
        let mixes = matches!(engine, VisibilityEngine::Exact(_));
        let (mut packet, mut rays) = (Packet::EMPTY, [0usize; LANES]);
        let mut used = 0;
        for (i, vertex) in vertices.iter().enumerate() {
            let (cut, free) = cut_of(vertex);
            let ray = self.emitter_ray(emitters, cut, vertex, if free { |q| q } else { weight }, random[i]);
            if let Some(ray) = ray {
                let light = light_of(&ray);
                // A sample at the distance 0 from the element has no finite weight.
                if light.is_finite() {
                    packet.set_blocked_from_start(used, ray.ends[0], ray.ends[1], ray.rules);
                    parts[i].0 = light;
                    rays[used] = i;
                    used += 1;
                }
            }
            let next = vertices.get(i + 1);
            let ends = next.is_none_or(|next| !mixes && next.leaf != vertex.leaf);
            if used == LANES || ends && used > 0 {
                let feature_size = self.feature_size_of(vertex.leaf);
                let query = VisibilityQuery { packet, emitter_size: emitters.width, feature_size };
                let through = engine.transmittances(&query, scratch);
                rays[..used].iter().zip(through).for_each(|(&i, through)| parts[i].1 = through);
                (packet, used) = (Packet::EMPTY, 0);
            }
        }
        parts
    }

    /// Adds the light of the elements that the rays in `buffers.results` met; rays that ended too near go on as paths. `bright` is
    /// [`FinalGather::light_of_bright_leaves`].
    fn add_reflected(
        &self,
        batch: &[LeafRays],
        bright: Option<Vec<(Vec3, f32)>>,
        light: &mut [ElementLight],
        buffers: &mut Buffers,
    ) {
        // By half of a leaf, the sum of the light of its rays and of the squares of their mean over the channels.
        let mut sums = vec![(Vec3::ZERO, 0.0); 2 * batch.len()];
        let mut add_to = |half: u32, value: Vec3| {
            let sum = &mut sums[half as usize];
            *sum = (sum.0 + value, sum.1 + (value.element_sum() / 3.0).powi(2));
        };
        let (mut near, mut halves) = (Vec::new(), Vec::new());
        for (i, (vertex, found)) in buffers.vertices.iter().zip(&buffers.results).enumerate() {
            let (of_bright, part) = bright.as_ref().map_or((Vec3::ZERO, 1.0), |bright| bright[i]);
            let other = found.sky + of_bright;
            if found.met.side == Elements::NONE {
                add_to(vertex.path, other);
                continue;
            }
            match self.reflected_or_next(found.met, found.distance, 0.0, near.len() as u32) {
                Ok(value) => add_to(vertex.path, other + part * value),
                Err(next) => {
                    near.push(PathVertex { share: part * next.share, ..next });
                    halves.push((vertex.path, other));
                }
            }
        }
        std::mem::swap(&mut buffers.vertices, &mut near);
        let mut followed: Vec<Rgb> = vec![[0.0; 3]; halves.len()];
        let seed = batch.first().map_or(0, |of| mix(u64::from(of.leaf)));
        self.follow(self.linked.settings.seed ^ seed, EndOfPaths::Read, &mut followed, buffers);
        for ((half, other), value) in halves.into_iter().zip(followed) {
            add_to(half, other + Vec3::from(value.map(|v| v as f32)));
        }
        for (light, sums) in light.iter_mut().zip(sums.chunks_exact(2)) {
            let half = light.rays as f32;
            light.halves[REFLECTED] = [sums[0].0 / half, sums[1].0 / half];
            let mean = light.mean(REFLECTED) as f32;
            light.squares[REFLECTED] = (sums[0].1 + sums[1].1 - 2.0 * half * mean * mean).max(0.0);
        }
    }
}

/// The corners of an element, moved towards their mean by at most half of the way, so that its edges lie inwards by `distance`.
fn inset(corners: [Vec3; 4], distance: f32) -> [Vec3; 4] {
    let middle = centroid(&corners);
    let scale = (1.0 - distance / inner_radius(&corners)).max(0.5);
    corners.map(|c| middle + scale * (c - middle))
}

/// Mean of `of` over an element of which only the part before a face is lit. Points in the plane of the face within `rounding` count as
/// before it.
fn mean_before(of: &dyn Fn(Vec3) -> f64, corners: [Vec3; 4], face: &EmitterFace, rounding: f32) -> f64 {
    if !corners.iter().any(|c| face.normal.dot(face.corners[0] - *c) > rounding) {
        return mean_over(of, corners);
    }
    let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
    let triangles = |polygon: &[DVec3]| -> Vec<[DVec3; 3]> {
        (2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]]).collect()
    };
    let corners = corners.map(|c| c.as_dvec3());
    let lit = clip(&corners, face.polygon[0], face.normal.as_dvec3());
    let light = |triangle: [DVec3; 3]| {
        let [a, b, c] = triangle.map(|p| p.as_vec3());
        area(triangle) * mean_over(of, [a, b, c, c])
    };
    let whole: f64 = triangles(&corners).into_iter().map(area).sum();
    triangles(&lit).into_iter().map(light).sum::<f64>() / whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Parts of a sequence follow each other without gaps, and a sequence that is used up is followed by the leaf's own one. Halves that
    /// must be independent have no sequence in common.
    #[test]
    fn leaves_take_parts_of_sequences_that_follow_each_other() {
        let of = |leaf: u32| LeafRays {
            leaf,
            count: 8 * (1 + leaf % 128),
            to_emitters: true,
            suns: 1,
            sequences: [0, 1].map(|half| Sequence { seed: 2 * leaf + half, first: 0 }),
        };
        for joins_halves in [true, false] {
            let mut leaves: Vec<LeafRays> = (0..200).map(of).collect();
            join_sequences(&mut leaves.iter_mut().collect::<Vec<_>>(), joins_halves);
            let mut used: HashMap<u32, u32> = HashMap::new();
            for LeafRays { count, sequences, .. } in leaves {
                assert_eq!(sequences[0].seed == sequences[1].seed, joins_halves);
                for Sequence { seed, first } in sequences {
                    let next = used.entry(seed).or_default();
                    assert_eq!(first, *next);
                    *next += count;
                    assert!(*next <= MAX_SEQUENCE);
                }
            }
            // 87,072 rays in each half, and 65,536 numbers in a sequence.
            assert_eq!(used.len(), if joins_halves { 3 } else { 2 * 2 });
            let odd = used.keys().filter(|seed| *seed % 2 == 1).count();
            assert_eq!(odd, if joins_halves { 0 } else { 2 });
        }
    }
}
