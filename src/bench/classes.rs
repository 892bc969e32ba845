//! Rows by class of receiver: how much MR gains depends on what lies around a receiver point.
//!
//! From each point 64 stratified rays, with the density of the cosine over its hemisphere, find what they meet. A surface is large if its
//! smooth part is at least a 64th of the scene wide, as in the distance cut, which never averages it; others that do not emit are small. A
//! point is
//! * `interior` if large surfaces enclose it: less than a quarter of the rays leave the scene or end on an emitter, and more than half
//!   end on large surfaces. The rays pass up to four small surfaces on the way, and from a point on a small surface as many start on its
//!   back: the underside of a leaf sees nothing but the lawn, and is not in a room;
//! * else `inside` if it lies on a small surface: a leaf, a twig, a blade of grass;
//! * else `near` if a ray meets a small surface within a 64th of the scene;
//! * else `open`.
//!
//! Classes are found before anything is timed, and are the same for both engines.

use super::context::Bench;
use super::context::Measured;
use super::measure::{Queries, Timer};
use super::record::{ClassRecord, ReceiverClass};
use super::workload::{ReceiverPoint, Workload};
use crate::Result;
use crate::embree::Hits;
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::model::Model;
use crate::ray::{EndRule, LANES, Packet};
use crate::visibility::{MIN_LARGE_SURFACE, MultiResolution, Workspace, surface_widths};
use std::time::Duration;

/// Fewest points of a class that are measured: a share of them is known to √(¼ / 50) = 7 %.
const MIN_POINTS: usize = 50;
/// Most points of a class that are measured, evenly chosen along the curve: four classes take less than half of the time of the default
/// 20,000 points.
const MAX_POINTS: usize = 2_000;
/// A further round of the rows of a class starts only if it is expected to end within this time: limits the duration of a benchmark.
const MAX_TIME: Duration = Duration::from_secs(3);

impl Bench<'_> {
    /// Rows of each class that has points, in the order of [`ReceiverClass::ALL`]. `whole` are the rows over all points, which are those
    /// of the class if there is only one.
    pub fn classes(
        &self,
        workload: &Workload,
        engine: &MultiResolution,
        whole: &Measured,
    ) -> Result<Vec<ClassRecord>> {
        self.go_on()?;
        self.progress.stage("classes", ReceiverClass::ALL.len() as u64);
        let points = workload.facing_points();
        let found = Surroundings::of(self.model).classes(&points, self.options.seed);
        let of = |class| -> Vec<ReceiverPoint> {
            points.iter().zip(&found).filter(|(_, of)| **of == class).map(|(point, _)| *point).collect()
        };
        if let Some(&class) = found.first().filter(|first| found.iter().all(|class| class == *first)) {
            let Measured { reference, exact, certified, mr, .. } = whole;
            return Ok(vec![ClassRecord {
                class,
                points: points.len(),
                measured: points.len(),
                reference_rms: reference.standard_error(),
                exact: exact.clone(),
                certified: certified.clone(),
                mr: mr.clone(),
            }]);
        }
        let timer = Timer::new(self.options.threads)?;
        // The stages of each class are not shown.
        let bench = Bench { timer, sizes: self.sizes.clone(), progress: &(), ..*self };
        let mut classes = Vec::new();
        for class in ReceiverClass::ALL {
            self.go_on()?;
            let points = of(class);
            if points.len() >= MIN_POINTS {
                classes.push(bench.class(class, &points, engine));
            }
            self.progress.advance(1);
        }
        Ok(classes)
    }

    /// Measures the rows of one class; their routes are decided on a sample of the class.
    fn class(&self, class: ReceiverClass, points: &[ReceiverPoint], engine: &MultiResolution) -> ClassRecord {
        let measured = points.len().min(MAX_POINTS);
        let chosen = (0..measured).map(|k| points[k * points.len() / measured]).collect();
        let workload = Workload::new(self.model, chosen, self.options.seed ^ 0x63_6c61_7373_6573);
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let queries = Queries { scene: self.scene, workload: &workload, pairs: &every };
        let sample = self.sample(&workload);
        let engine = engine.clone().with_budget(&sample.bundles(1).concat(), &mut Workspace::default());
        let Measured { reference, exact, certified, mr, .. } =
            self.points(queries, &engine, &sample, MAX_TIME);
        let (points, reference_rms) = (points.len(), reference.standard_error());
        ClassRecord { class, points, measured, reference_rms, exact, certified, mr }
    }
}

impl Workload {
    /// The points that face an emitter, in order.
    fn facing_points(&self) -> Vec<ReceiverPoint> {
        let mut facing: Vec<u32> = self.pairs.iter().map(|pair| pair.point).collect();
        facing.dedup();
        facing.into_iter().map(|point| self.points[point as usize]).collect()
    }
}

/// Rays along one side of the square that is mapped to the hemisphere. Shares of 64 stratified rays are known to less than
/// √(¼ / 64) = 6 %.
const RAYS_PER_SIDE: usize = 8;
const RAYS: usize = RAYS_PER_SIDE * RAYS_PER_SIDE;
/// Small surfaces that a ray passes on its way to a large one: both sides of two objects of a room.
const MAX_PASSED: usize = 4;

/// Surfaces of a model by size.
pub(super) struct Surroundings<'a> {
    model: &'a Model,
    /// Width of the smooth surface of each triangle of each mesh, in the frame of the mesh.
    widths: Vec<Vec<f32>>,
    /// Smallest width of a large surface, and distance of what is near; scene units.
    large: f32,
}

/// The first surface that a ray hits.
#[derive(Clone, Copy, PartialEq, Eq)]
enum FirstHit {
    Nothing,
    Emitter,
    Large,
    /// A surface that is not large.
    Small,
}

/// Counts of the rays of a point.
#[derive(Clone, Copy, Default)]
struct Seen {
    rays: usize,
    /// Rays that leave the scene or end on an emitter, small surfaces passed.
    lit: usize,
    /// Rays that end on a large surface, small ones passed.
    large: usize,
    /// Whether a ray meets a small surface near.
    near: bool,
}

impl Seen {
    fn add(&mut self, other: Seen) {
        self.rays += other.rays;
        self.lit += other.lit;
        self.large += other.large;
    }

    /// Whether large surfaces are around on nearly all sides.
    fn encloses(&self) -> bool {
        4 * self.lit < self.rays && 2 * self.large > self.rays
    }
}

impl<'a> Surroundings<'a> {
    pub fn of(model: &'a Model) -> Surroundings<'a> {
        let widths = model.meshes().iter().map(|mesh| surface_widths(mesh.scene())).collect();
        Surroundings { model, widths, large: MIN_LARGE_SURFACE * model.scene().size() }
    }

    /// The class of each point.
    pub fn classes(&self, points: &[ReceiverPoint], seed: u64) -> Vec<ReceiverClass> {
        parallel::map(0..points.len(), |i| self.class(&points[i], mix(seed ^ i as u64)))
    }

    fn class(&self, point: &ReceiverPoint, seed: u64) -> ReceiverClass {
        let own = self.surface_of(point);
        let front = self.seen(point, seed);
        let mut around = front;
        if own == FirstHit::Small {
            let back = ReceiverPoint { normal: -point.normal, ..*point };
            around.add(self.seen(&back, mix(seed)));
        }
        if around.encloses() {
            ReceiverClass::Interior
        } else if own == FirstHit::Small {
            ReceiverClass::Inside
        } else if front.near {
            ReceiverClass::Near
        } else {
            ReceiverClass::Open
        }
    }

    /// The surface that a point lies on.
    fn surface_of(&self, point: &ReceiverPoint) -> FirstHit {
        let rule = EndRule::new(point.magnitude);
        let mut packet = Packet::EMPTY;
        packet.set_ray(0, rule.lifted(point.position, point.normal), -point.normal);
        packet.far[0] = 2.0 * rule.height();
        let mut hits = [Hits::NONE];
        self.model.traced().first_hits(self.model.widest_packets(), &[packet], &mut hits);
        self.met(&hits[0], 0)
    }

    /// Counts of the rays from a point on the side of its normal.
    fn seen(&self, point: &ReceiverPoint, seed: u64) -> Seen {
        let rule = EndRule::new(point.magnitude);
        let from = rule.lifted(point.position, point.normal);
        let mut packets = [Packet::EMPTY; RAYS / LANES];
        for k in 0..RAYS {
            let [u, v, ..] = numbers(seed, k as u64);
            let place = |cell: usize, within: f32| (cell as f32 + within) / RAYS_PER_SIDE as f32;
            let towards =
                cosine_direction(point.normal, place(k % RAYS_PER_SIDE, u), place(k / RAYS_PER_SIDE, v));
            packets[k / LANES].set_ray(k % LANES, from, towards);
        }
        let mut seen = Seen { rays: RAYS, ..Seen::default() };
        for passed in 0..=MAX_PASSED {
            let mut hits = [Hits::NONE; RAYS / LANES];
            self.model.traced().first_hits(self.model.widest_packets(), &packets, &mut hits);
            for (packet, hits) in packets.iter_mut().zip(&hits) {
                for lane in packet.lanes() {
                    match self.met(hits, lane) {
                        FirstHit::Small => {
                            seen.near |= passed == 0 && hits.t[lane] <= self.large;
                            packet.near[lane] = hits.t[lane] + rule.left_out();
                            continue;
                        }
                        FirstHit::Large => seen.large += 1,
                        FirstHit::Nothing | FirstHit::Emitter => seen.lit += 1,
                    }
                    packet.active &= !(1 << lane);
                }
            }
        }
        seen
    }

    fn met(&self, hits: &Hits, lane: usize) -> FirstHit {
        let (triangle, instance) = (hits.triangle[lane], hits.instance[lane] as usize);
        if triangle == Hits::NO_HIT {
            return FirstHit::Nothing;
        }
        let instance = &self.model.instances()[instance];
        // Emitters are among the scene's own triangles, which mesh 0 holds.
        if instance.mesh == 0 && self.model.scene().triangle_emitter[triangle as usize] != u32::MAX {
            return FirstHit::Emitter;
        }
        let width = self.widths[instance.mesh as usize][triangle as usize];
        if width * instance.scale() >= self.large { FirstHit::Large } else { FirstHit::Small }
    }
}

#[cfg(test)]
mod tests;
