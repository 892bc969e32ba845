//! The visibility engines behind one question: which of sixteen segments get through.

use super::ends::{mix, numbers, point_on};
use crate::radiosity::elements::{Elements, Shape};
use crate::ray::{EndRule, LANES, Occluder, Packet};
use crate::visibility::{Bundle, Exact, Leaf, Method, MultiResolution, Workspace};
use std::sync::Arc;

/// How links ask for visibility.
#[derive(Clone)]
pub enum Sight {
    /// Embree rays.
    Exact(Exact),
    /// Multi-resolution or average visibility, as the engine was made.
    MultiResolution(Arc<MultiResolution>),
}

/// Bundles and segments asked for, by how they were answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Tally {
    /// Bundles of which all segments got through without a test.
    pub clear: u64,
    /// Bundles answered by triangles alone.
    pub exact: u64,
    /// Bundles answered by clusters alone.
    pub aggregated: u64,
    /// Bundles answered by both.
    pub mixed: u64,
    /// Segments asked for.
    pub segments: u64,
    /// Segments for which triangles were tested.
    pub exact_rays: u64,
    /// Segments of bundles that multi-resolution visibility handed to exact rays after all.
    pub handed_over: u64,
}

impl Tally {
    /// Adds another.
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

/// Buffers and counts of a thread.
#[derive(Default)]
pub struct Scratch {
    workspace: Workspace,
    packets: Vec<Packet>,
    blocked: Vec<u32>,
    sizes: Vec<f32>,
    /// What has been asked for.
    pub tally: Tally,
}

/// Segments between two ends: up to sixteen, from the receiver to the emitter.
#[derive(Clone, Debug)]
pub struct Question {
    /// The segments.
    pub packet: Packet,
    /// As [`Bundle::emitter_size`]; scene units.
    pub emitter_size: f32,
    /// Shadows on the receiver smaller than this may be averaged; scene units.
    pub feature_size: f32,
}

impl Sight {
    /// Transmittance of each segment of every question, 0 in unused lanes; `each` is told which question is meant.
    ///
    /// Questions that follow each other and whose ends lie close together, as those of the parts of one link do, share what
    /// they may meet: it is looked for once.
    pub fn ask(
        &self,
        questions: &[Question],
        scratch: &mut Scratch,
        mut each: impl FnMut(usize, &[f32; LANES]),
    ) {
        let Scratch { workspace, packets, blocked, sizes, tally } = scratch;
        match self {
            Sight::Exact(engine) => {
                packets.clear();
                packets.extend(questions.iter().map(|q| q.packet.clone()));
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
            Sight::MultiResolution(engine) => {
                sizes.clear();
                sizes.extend(questions.iter().map(|q| q.feature_size));
                engine.answers_lanes(&bundles(questions), sizes, workspace, |k, answer, lanes| {
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

    /// Transmittance of each segment of one question.
    pub fn transmittances(&self, question: &Question, scratch: &mut Scratch) -> [f32; LANES] {
        let mut found = [0.0; LANES];
        self.ask(std::slice::from_ref(question), scratch, |_, lanes| found = *lanes);
        found
    }

    /// What to ask for questions like these: exact rays where the engine is not likely to take less time for them (it counts
    /// work, so that the same question has the same answer on every run). Average visibility is never exact.
    pub fn for_these(&self, questions: &[Question], scratch: &mut Scratch) -> Sight {
        match self {
            Sight::MultiResolution(engine) if engine.leaf() == Leaf::Exact => {
                let sizes: Vec<f32> = questions.iter().map(|q| q.feature_size).collect();
                match engine.pays_each(&bundles(questions), &sizes, &mut scratch.workspace) {
                    true => self.clone(),
                    false => Sight::Exact(engine.exact()),
                }
            }
            _ => self.clone(),
        }
    }

    /// Embree rays, whatever else is asked.
    pub fn exact(&self) -> Exact {
        match self {
            Sight::Exact(exact) => exact.clone(),
            Sight::MultiResolution(engine) => engine.exact(),
        }
    }

    /// What to ask for packets whose segments have nothing in common, and so no clusters that one would look at for all:
    /// exact rays, unless visibility is average.
    pub fn scattered(&self) -> Sight {
        match self {
            Sight::MultiResolution(engine) if engine.leaf() == Leaf::Exact => Sight::Exact(engine.exact()),
            _ => self.clone(),
        }
    }
}

fn bundles(questions: &[Question]) -> Vec<Bundle<'_>> {
    fn one(q: &Question) -> Bundle<'_> {
        Bundle { packets: std::slice::from_ref(&q.packet), emitter_size: q.emitter_size, emitter: &[] }
    }
    questions.iter().map(one).collect()
}

/// About `count` bundles of sixteen segments between surfaces that face each other, chosen by their areas, with the width of
/// the second one: what a solver asks for, on the whole.
pub fn across(elements: &Elements, ends: EndRule, count: usize, seed: u64) -> Vec<(Packet, f32)> {
    let mut running = Vec::with_capacity(elements.sides.len());
    let mut sum = 0.0;
    for side in &elements.sides {
        sum += elements.elements[side.element as usize].area;
        running.push(sum);
    }
    let pick = |share: f32| {
        let at = running.partition_point(|&a| a <= f64::from(share) * sum).min(running.len() - 1);
        let side = &elements.sides[at];
        let Shape::Surface { corners, .. } = &elements.elements[side.element as usize].shape else {
            return None;
        };
        Some((corners, side.normal, elements.elements[side.element as usize].radius))
    };
    let pair = |k: usize| {
        let [u, v, p, q] = numbers(seed, k as u64);
        let ((ca, na, _), (cb, nb, width)) = (pick(u)?, pick((v + k as f32 / count as f32).fract())?);
        let d = point_on(cb, q, p) - point_on(ca, p, q);
        (na.dot(d) > 0.0 && nb.dot(d) < 0.0).then(|| {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let [r, s, t, w] = numbers(mix(seed ^ k as u64), lane as u64);
                packet.set(lane, point_on(ca, r, s), point_on(cb, t, w), ends);
            }
            (packet, width)
        })
    };
    if running.is_empty() { Vec::new() } else { (0..4 * count).filter_map(pair).take(count).collect() }
}
