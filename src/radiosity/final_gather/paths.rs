//! Paths: single rays from surface points, followed until an element may stand for the light at the point met.

use super::gatherer::{Buffers, FinalGather, PathVertex, RayResult};
use crate::embree::Hits;
use crate::math::on_plane;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::radiosity::elements::emitter_tree::{EmitterCut, Receiver};
use crate::radiosity::elements::emitters::{Emitters, density_ratio};
use crate::radiosity::elements::{Elements, Side, emission_gain};
use crate::radiosity::links::{VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::{Rgb, add};
use crate::ray::{EndRule, LANES, Packet};
use glam::Vec3;
use smallvec::SmallVec;

/// Largest number of bounces of a path: limits the time where all reflectances are 0.999, with 0.999^256 = 77 % of the light left;
/// at 0.9 the limit leaves 2e-12.
const MAX_BOUNCES: u64 = 256;
/// Bounce from which Russian roulette may end a path (Arvo and Kirk 1990): affects noise and time, not the mean.
const FIRST_ROULETTE_BOUNCE: u64 = 3;

/// Condition at which paths end.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum EndOfPaths {
    /// Paths are followed to the last bounce: no light of the solution is used, and rays are exact.
    Nowhere,
    /// Paths end at elements whose mean light represents the light at the hit point.
    Read,
    /// Paths end at the same elements, whose light is not known yet: the ends are listed in [`Buffers::path_ends`].
    Listed,
}

/// Mean result of the paths that continue from an element outside the exchange.
#[derive(Default)]
pub(super) struct PathMean {
    /// Irradiance at their start, without the light of their ends, W/m².
    pub light: Vec3,
    /// The leaves where the paths end, and the fractions of the radiosity reflected there that arrive.
    pub ends: SmallVec<[(u32, Vec3); PATHS_ONWARDS]>,
}

/// Number of paths that continue where a ray of the exchange hits an element outside of the exchange. Two, because an element most of
/// whose few rays hit such elements would depend on very few others. 1, 2 and 4 take 9.8, 10.0 and 10.7 s of processor time in the scene
/// of `mrvis generate office` (`mrvis solve office.obj --output vtu`).
const PATHS_ONWARDS: usize = 2;

/// A shadow ray to a point on an emitter.
pub(super) struct EmitterRay {
    /// Its ends, above the surfaces.
    pub ends: [Vec3; 2],
    pub rules: [EndRule; 2],
    /// Irradiance that it carries if nothing blocks it, W/m².
    pub light: Vec3,
    /// The face of the emitter.
    pub face: usize,
}

impl FinalGather<'_> {
    /// Traces one cosine-weighted ray and one shadow ray from each of `buffers.vertices`, and writes `buffers.results`. `random`
    /// returns four numbers in `[0, 1)` for each vertex: for the direction, and for the point on an emitter.
    fn trace(&self, engine: &VisibilityEngine, random: impl Fn(usize) -> [f32; 4], buffers: &mut Buffers) {
        let cuts = self.cuts_of_vertices(buffers);
        self.trace_scene_rays(&random, buffers);
        self.read_hits(|i, _| Some(&cuts[i]), buffers);
        self.add_suns(&random, |_| 1, buffers);
        let Buffers { vertices, results, scratch, .. } = buffers;
        let scattered = engine.scattered();
        for (g, group) in vertices.chunks(LANES).enumerate() {
            let (mut packet, mut light) = (Packet::EMPTY, [Vec3::ZERO; LANES]);
            for (lane, vertex) in group.iter().enumerate() {
                let i = g * LANES + lane;
                let ray = self.emitter_ray(&self.emitters, &cuts[i], vertex, weight, random(i));
                if let Some(ray) = ray {
                    packet.set_blocked_from_start(lane, ray.ends[0], ray.ends[1], ray.rules);
                    light[lane] = ray.light;
                }
            }
            if packet.is_empty() {
                continue;
            }
            // Rays of one element to one emitter share a search for clusters.
            let together = self.emitters.emitters.len() == 1 && group.iter().all(|p| p.leaf == group[0].leaf);
            let engine = if together { engine } else { &scattered };
            let feature_size = self.feature_size_of(group[0].leaf);
            let query = VisibilityQuery { packet, emitter_size: self.emitters.width, feature_size };
            let through = engine.transmittances(&query, scratch);
            for lane in query.packet.lanes() {
                results[g * LANES + lane].direct += through[lane] * light[lane];
            }
        }
        buffers.cuts = cuts;
    }

    /// The groups of emitting faces from which the emitter rays of `buffers.vertices` are drawn, in the buffer for them.
    pub(super) fn cuts_of_vertices(&self, buffers: &mut Buffers) -> Vec<EmitterCut> {
        let mut cuts = std::mem::take(&mut buffers.cuts);
        cuts.resize_with(cuts.len().max(buffers.vertices.len()), EmitterCut::default);
        for (vertex, cut) in buffers.vertices.iter().zip(&mut cuts) {
            let Side { normal, .. } = self.linked.elements.sides[vertex.side as usize];
            self.emitters.cut(&Receiver { centre: vertex.at, radius: 0.0, normal }, cut);
        }
        cuts
    }

    /// Writes the hits of the scene rays to `buffers.results`. The light of an emitter that a ray hit is included if `cut`
    /// returns the emitters to which the vertex, with its number, also sends shadow rays.
    pub(super) fn read_hits<'c>(
        &self,
        cut: impl Fn(usize, &PathVertex) -> Option<&'c EmitterCut>,
        buffers: &mut Buffers,
    ) {
        let Buffers { packets, hits, vertices, results, .. } = buffers;
        results.clear();
        for (i, vertex) in vertices.iter().enumerate() {
            let (packet, hits, lane) = (&packets[i / LANES], &hits[i / LANES], i % LANES);
            results.push(self.result(vertex, cut(i, vertex), packet, hits, lane));
        }
    }

    /// The first hits of one cosine-weighted ray from each vertex.
    pub(super) fn trace_scene_rays(&self, random: &impl Fn(usize) -> [f32; 4], buffers: &mut Buffers) {
        let Buffers { packets, hits, vertices, scratch, .. } = buffers;
        packets.clear();
        for (i, vertex) in vertices.iter().enumerate() {
            if i % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let [u, v, ..] = random(i);
            let Side { normal, end, .. } = self.linked.elements.sides[vertex.side as usize];
            let from = end.lifted(vertex.at, normal);
            let to = from + self.length * cosine_direction(normal, u, v);
            packets[i / LANES].set_between(i % LANES, from, to, [0.0, 1.0]);
        }
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        scratch.tally.add_rays(vertices.len());
    }

    /// The result of a ray from a vertex. The light of an emitter that the ray hit has the weight q / (1 + q) of the
    /// balance heuristic, where q is the ratio of the densities of both strategies.
    fn result(
        &self,
        vertex: &PathVertex,
        cut: Option<&EmitterCut>,
        packet: &Packet,
        hits: &Hits,
        lane: usize,
    ) -> RayResult {
        let elements = &self.linked.elements;
        let escaped = hits.triangle[lane] == Hits::NO_HIT;
        let mut result = RayResult { escaped, ..RayResult::EMPTY };
        if escaped && self.has_environment() {
            result.sky = self.sky_of_ray(packet.point(lane, 1.0) - packet.point(lane, 0.0));
        }
        if let Some(met) = self.met(packet, hits, lane) {
            (result.met, result.distance) = (met, hits.t[lane] * self.length);
            let side = &elements.sides[met.side as usize];
            let emits = side.exitance.iter().any(|&m| m > 0.0);
            if let Some(cut) = cut.filter(|_| emits) {
                let Side { normal, end, .. } = elements.sides[vertex.side as usize];
                let density = self.emitters.density(cut, met.side);
                let rounding = end.rounding_of_heights(side.end);
                let q =
                    density_ratio(vertex.at, normal, met.at, side.normal, rounding, side.exitance, density);
                let gain = emission_gain(side.profile.as_deref(), met.at, side.normal, vertex.at);
                result.direct = gain * weight(q) * to_vec(side.exitance);
            }
        }
        result
    }

    /// A shadow ray from a vertex to a point on one of some emitters, drawn from a cut.
    pub(super) fn emitter_ray(
        &self,
        emitters: &Emitters,
        cut: &EmitterCut,
        vertex: &PathVertex,
        weight: impl Fn(f32) -> f32,
        [.., u, v]: [f32; 4],
    ) -> Option<EmitterRay> {
        let (at, [emitter, number], density) = emitters.sample(cut, u, v)?;
        let face = &emitters.emitters[emitter].faces[number];
        let Side { normal, end, .. } = self.linked.elements.sides[vertex.side as usize];
        let rounding = end.rounding_of_heights(face.end);
        let q = density_ratio(vertex.at, normal, at, face.normal, rounding, face.exitance, density);
        if q <= 0.0 {
            return None;
        }
        let rules = [end, face.end.seen_from(end)];
        let gain = emission_gain(face.profile.as_deref(), at, face.normal, vertex.at);
        let light = gain * weight(q) * to_vec(face.exitance);
        let ends = [rules[0].lifted(vertex.at, normal), rules[1].lifted(at, face.normal)];
        Some(EmitterRay { ends, rules, light, face: number })
    }

    /// Adds the light that reaches the path starts through all of `buffers.vertices` to the sums of their paths: direct light at each
    /// vertex, and the light of the element that its ray hits, or the light of a longer path where that element is too near.
    pub(super) fn follow(&self, seed: u64, ends: EndOfPaths, sums: &mut [Rgb], buffers: &mut Buffers) {
        buffers.path_ends.clear();
        self.follow_from(1, seed, ends, sums, buffers);
    }

    /// [`FinalGather::follow`] from the bounce with this number on.
    pub(super) fn follow_from(
        &self,
        first: u64,
        seed: u64,
        ends: EndOfPaths,
        sums: &mut [Rgb],
        buffers: &mut Buffers,
    ) {
        let exact;
        let engine = if ends == EndOfPaths::Nowhere {
            exact = VisibilityEngine::Exact(self.linked.engine.exact());
            &exact
        } else {
            &self.linked.engine
        };
        for bounce in first..=MAX_BOUNCES {
            if buffers.vertices.is_empty() {
                return;
            }
            let seed = mix(seed ^ bounce);
            self.trace(engine, |i| numbers(seed, i as u64), buffers);
            self.advance(bounce, seed, ends, sums, buffers);
        }
    }

    /// Adds `buffers.results` to the sums of their paths, and replaces `buffers.vertices` by those from which paths continue.
    pub(super) fn advance(
        &self,
        bounce: u64,
        seed: u64,
        ends: EndOfPaths,
        sums: &mut [Rgb],
        buffers: &mut Buffers,
    ) {
        let Buffers { vertices, results, next_vertices, path_ends, .. } = buffers;
        next_vertices.clear();
        for (i, (vertex, found)) in vertices.iter().zip(results.iter()).enumerate() {
            let mut received = found.direct + found.sun + found.sky;
            if found.met.side != Elements::NONE {
                let reflected = &self.reflected[found.met.leaf as usize];
                if ends != EndOfPaths::Nowhere && found.distance >= reflected.trusted_from {
                    match ends {
                        EndOfPaths::Listed => path_ends.push((vertex.path, found.met.leaf, vertex.share)),
                        _ => received += Vec3::from(reflected.light),
                    }
                } else {
                    let next = self.continued(found.met, vertex.share, vertex.path);
                    let survival = next.share.max_element().min(1.0);
                    let [chance, ..] = numbers(!seed, i as u64);
                    if bounce < FIRST_ROULETTE_BOUNCE {
                        next_vertices.push(next);
                    } else if chance < survival {
                        next_vertices.push(PathVertex { share: next.share / survival, ..next });
                    }
                }
            }
            add(&mut sums[vertex.path as usize], 1.0, (vertex.share * received).to_array().map(f64::from));
        }
        std::mem::swap(vertices, next_vertices);
    }

    /// The reflected radiosity at the point that a ray has met, or the vertex from which its path continues if the element is too near:
    /// nearer than [`Reflected::trusted_from`](super::reflected::Reflected::trusted_from), or nearer than `least`, scene units.
    pub(super) fn reflected_or_next(
        &self,
        met: PathVertex,
        distance: f32,
        least: f32,
        path: u32,
    ) -> Result<Vec3, PathVertex> {
        let reflected = &self.reflected[met.leaf as usize];
        if distance >= reflected.trusted_from.max(least) {
            Ok(Vec3::from(reflected.light))
        } else {
            Err(self.continued(met, Vec3::ONE, path))
        }
    }

    /// For each of `buffers.results` that hit an element outside the exchange, the result of the paths that continue there.
    pub(super) fn paths_onwards(&self, seed: u64, buffers: &mut Buffers) -> Vec<Option<PathMean>> {
        let results = std::mem::take(&mut buffers.results);
        buffers.vertices.clear();
        let part = 1.0 / PATHS_ONWARDS as f32;
        let mut count = 0;
        let paths: Vec<Option<u32>> = results
            .iter()
            .map(|found| {
                let met = &found.met;
                let goes_on = met.side != Elements::NONE && self.reflected[met.leaf as usize].is_excluded();
                goes_on.then(|| {
                    let start = self.continued(*met, Vec3::ONE, count);
                    buffers.vertices.extend([start; PATHS_ONWARDS]);
                    count += 1;
                    count - 1
                })
            })
            .collect();
        let mut sums: Vec<Rgb> = vec![[0.0; 3]; count as usize];
        self.follow(self.linked.settings.seed ^ seed, EndOfPaths::Listed, &mut sums, buffers);
        buffers.results = results;
        let mut found: Vec<PathMean> = sums
            .into_iter()
            .map(|sum| PathMean { light: part * Vec3::from(sum.map(|v| v as f32)), ends: SmallVec::new() })
            .collect();
        for &(path, leaf, share) in &buffers.path_ends {
            found[path as usize].ends.push((leaf, part * share));
        }
        paths.into_iter().map(|path| path.map(|path| std::mem::take(&mut found[path as usize]))).collect()
    }

    /// The vertex from which a path goes on where a ray has ended. It lies in the plane of the triangle: the rounding error at the end of
    /// a long ray exceeds the height to which the next ray is lifted.
    fn continued(&self, met: PathVertex, share: Vec3, path: u32) -> PathVertex {
        let reflectance = Vec3::from(self.linked.elements.sides[met.side as usize].reflectance);
        let at = on_plane(self.scene.corners(met.triangle), met.at);
        PathVertex { at, share: share * reflectance, path, ..met }
    }
}

/// The weight `q / (1 + q)` of an emitter that a ray has met, for `q` from 0 to infinity.
pub(super) fn weight(q: f32) -> f32 {
    if q.is_finite() { q / (1.0 + q) } else { 1.0 }
}

pub(super) fn to_vec(exitance: Rgb) -> Vec3 {
    Vec3::from(exitance.map(|m| m as f32))
}
