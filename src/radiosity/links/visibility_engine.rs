//! The visibility engines behind one query: the transmittance of sixteen segments.

use crate::math::sampling::{mix, numbers, point_on};
use crate::radiosity::elements::Elements;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{Bundle, Exact, LeafMode, Method, MultiResolution, Work, Workspace};
use std::sync::Arc;

/// The engine that answers visibility queries of links and points.
#[derive(Clone)]
pub enum VisibilityEngine {
    /// Embree rays.
    Exact(Exact),
    /// Multi-resolution or average visibility.
    MultiResolution(Arc<MultiResolution>),
}

/// Numbers of bundles and segments by how they were answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
pub struct Tally {
    /// Bundles whose segments are all clear without a test.
    pub clear: u64,
    /// Bundles answered by triangles alone.
    pub exact: u64,
    /// Bundles answered by clusters alone.
    pub aggregated: u64,
    /// Bundles answered by both.
    pub mixed: u64,
    /// Queried segments.
    pub segments: u64,
    /// Segments for which triangles were tested.
    pub exact_rays: u64,
    /// Segments of bundles that multi-resolution visibility handed to exact rays after all.
    pub handed_over: u64,
}

impl Tally {
    /// Counts rays that were traced for other purposes than queries to an engine.
    pub fn add_rays(&mut self, rays: usize) {
        self.segments += rays as u64;
        self.exact_rays += rays as u64;
    }

    /// Adds another tally.
    pub fn add(&mut self, other: Tally) {
        self.clear += other.clear;
        self.exact += other.exact;
        self.aggregated += other.aggregated;
        self.mixed += other.mixed;
        self.segments += other.segments;
        self.exact_rays += other.exact_rays;
        self.handed_over += other.handed_over;
    }
}

/// Buffers and tally of a thread.
#[derive(Default)]
pub struct Scratch {
    workspace: Workspace,
    packets: Vec<Packet>,
    blocked: Vec<u32>,
    sizes: Vec<f32>,
    /// Queries so far.
    pub tally: Tally,
}

/// Up to sixteen segments from a receiver to an emitter.
#[derive(Clone, Debug)]
pub struct VisibilityQuery {
    /// The segments.
    pub packet: Packet,
    /// See [`Bundle::emitter_size`]; scene units.
    pub emitter_size: f32,
    /// Shadows on the receiver smaller than this may be averaged; scene units.
    pub feature_size: f32,
}

impl VisibilityEngine {
    /// Calls `each` with the index of every query and the transmittances of its segments, 0 in unused lanes.
    ///
    /// Consecutive queries whose ends lie close together, as those of the parts of one link do, share one search for clusters
    /// that their segments may meet.
    pub fn answer_all(
        &self,
        queries: &[VisibilityQuery],
        scratch: &mut Scratch,
        mut each: impl FnMut(usize, &[f32; LANES]),
    ) {
        let Scratch { workspace, packets, blocked, sizes, tally } = scratch;
        match self {
            VisibilityEngine::Exact(engine) => {
                packets.clear();
                packets.extend(queries.iter().map(|q| q.packet.clone()));
                blocked.clear();
                blocked.resize(packets.len(), 0);
                engine.occluded(packets, blocked);
                for (k, (packet, blocked)) in packets.iter().zip(&*blocked).enumerate() {
                    let segments = packet.len() as u64;
                    tally.exact += 1;
                    tally.segments += segments;
                    tally.exact_rays += segments;
                    let clear = packet.active & !blocked;
                    each(k, &std::array::from_fn(|i| (clear >> i & 1) as f32));
                }
            }
            VisibilityEngine::MultiResolution(engine) => {
                sizes.clear();
                sizes.extend(queries.iter().map(|q| q.feature_size));
                engine.answers_lanes(&bundles(queries), sizes, workspace, |k, answer, lanes| {
                    match answer.method {
                        Method::Clear => tally.clear += 1,
                        Method::Exact | Method::Covered => tally.exact += 1,
                        Method::Aggregated => tally.aggregated += 1,
                        Method::Mixed => tally.mixed += 1,
                    }
                    tally.segments += answer.cost.segments;
                    tally.exact_rays += answer.cost.exact_rays;
                    tally.handed_over += answer.cost.handed_over;
                    each(k, lanes);
                });
            }
        }
    }

    /// Transmittance of each segment of one query.
    pub fn transmittances(&self, query: &VisibilityQuery, scratch: &mut Scratch) -> [f32; LANES] {
        let mut found = [0.0; LANES];
        self.answer_all(std::slice::from_ref(query), scratch, |_, lanes| found = *lanes);
        found
    }

    /// The engine for queries like those of these runs of neighbours: exact rays where multi-resolution visibility is not expected
    /// to be faster. The estimate counts operations, not time, so that equal queries have equal answers on every run. Average
    /// visibility never changes to exact rays.
    pub fn for_queries(&self, runs: impl Iterator<Item = Vec<VisibilityQuery>>) -> VisibilityEngine {
        match self {
            VisibilityEngine::MultiResolution(engine) if engine.leaf() == LeafMode::Exact => {
                let (mut workspace, mut work) = (Workspace::default(), Work::default());
                for queries in runs {
                    let sizes: Vec<f32> = queries.iter().map(|q| q.feature_size).collect();
                    work.add(engine.work(&bundles(&queries), &sizes, &mut workspace));
                }
                match work.is_less() {
                    true => self.clone(),
                    false => VisibilityEngine::Exact(engine.exact()),
                }
            }
            _ => self.clone(),
        }
    }

    /// The exact engine.
    pub fn exact(&self) -> Exact {
        match self {
            VisibilityEngine::Exact(exact) => exact.clone(),
            VisibilityEngine::MultiResolution(engine) => engine.exact(),
        }
    }

    /// The engine for packets of unrelated segments, which share no search for clusters: exact rays, unless visibility is
    /// average.
    pub fn scattered(&self) -> VisibilityEngine {
        match self {
            VisibilityEngine::MultiResolution(engine) if engine.leaf() == LeafMode::Exact => {
                VisibilityEngine::Exact(engine.exact())
            }
            _ => self.clone(),
        }
    }
}

fn bundles(queries: &[VisibilityQuery]) -> Vec<Bundle<'_>> {
    queries.iter().map(|q| Bundle::of_packet(&q.packet, q.emitter_size)).collect()
}

/// About `count` bundles of sixteen segments between surfaces that face each other, drawn by area, with the width of the
/// second surface (scene units): a sample of a solver's queries.
pub fn sample_bundles(elements: &Elements, count: usize, seed: u64) -> Vec<(Packet, f32)> {
    let mut running = Vec::with_capacity(elements.sides.len());
    let mut sum = 0.0;
    for side in &elements.sides {
        sum += elements.elements[side.element as usize].area;
        running.push(sum);
    }
    let pick = |share: f32| {
        let at = running.partition_point(|&a| a <= f64::from(share) * sum).min(running.len() - 1);
        let side = &elements.sides[at];
        let width = elements.elements[side.element as usize].radius;
        (elements.corners(side), (side.normal, side.end), width)
    };
    let pair = |k: usize| {
        let [u, v, p, q] = numbers(seed, k as u64);
        let ((ca, (na, here), _), (cb, (nb, there), width)) =
            (pick(u), pick((v + k as f32 / count as f32).fract()));
        let d = point_on(cb, q, p) - point_on(ca, p, q);
        (na.dot(d) > 0.0 && nb.dot(d) < 0.0).then(|| {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let [r, s, t, w] = numbers(mix(seed ^ k as u64), lane as u64);
                let (from, to) = (point_on(ca, r, s), point_on(cb, t, w));
                let rules = [here, there.seen_from(here)];
                packet.set_lifted(lane, rules[0].lifted(from, na), rules[1].lifted(to, nb), rules);
            }
            (packet, width)
        })
    };
    if running.is_empty() { Vec::new() } else { (0..4 * count).filter_map(pair).take(count).collect() }
}
