//! Aggregated clusters: boxes with extinction, and the segments that pass through them.

use super::wide::Node;
use crate::ray::{Lanes, Packet};
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd, decay};
use glam::Vec3;

/// Boxes that are answered by their extinction, in the lanes of the node that they come from, as seen from the common
/// receiver end or from the scene's origin.
#[derive(Clone)]
#[repr(C, align(64))]
struct Row {
    min: [[f32; LANES]; 3],
    max: [[f32; LANES]; 3],
    /// Extinction in their middle.
    extinction: [f32; LANES],
    /// Extinction elsewhere is `density + slope · x` times that, or 0.
    slope: [[f32; LANES]; 3],
    density: [f32; LANES],
    /// Root mean square error of their transmittance for the bundle's beam, in `[0, 1]`.
    error: [f32; LANES],
    lanes: u32,
}

impl Row {
    const EMPTY: Row = Row {
        min: [[0.0; LANES]; 3],
        max: [[0.0; LANES]; 3],
        extinction: [0.0; LANES],
        slope: [[0.0; LANES]; 3],
        density: [0.0; LANES],
        error: [0.0; LANES],
        lanes: 0,
    };
}

/// The boxes of a walk.
#[derive(Default)]
pub(super) struct Slabs {
    /// Those in use, and room that was used before.
    rows: Vec<Row>,
    used: usize,
    boxes: usize,
}

impl Slabs {
    /// Forgets the last walk.
    pub fn clear(&mut self) {
        (self.used, self.boxes) = (0, 0);
    }

    pub fn is_empty(&self) -> bool {
        self.used == 0
    }

    /// Number of boxes.
    pub fn len(&self) -> usize {
        self.boxes
    }

    /// Adds some children of a node, seen from a point, with their extinctions and errors.
    #[inline(always)]
    pub fn add<S: Simd>(
        &mut self,
        simd: S,
        (node, lanes): (&Node, u32),
        from: Vec3,
        (extinctions, errors): (S::F, S::F),
    ) {
        if self.used == self.rows.len() {
            self.rows.push(Row::EMPTY);
        }
        let row = &mut self.rows[self.used];
        (self.used, self.boxes) = (self.used + 1, self.boxes + lanes.count_ones() as usize);
        row.lanes = lanes;
        let mut density = simd.splat(1.0);
        for (axis, from) in vector::splat(simd, from).into_iter().enumerate() {
            let min = simd.sub(simd.load(&node.min[axis]), from);
            let max = simd.sub(simd.load(&node.max[axis]), from);
            let slope = simd.load(&node.slope[axis]);
            density = simd.fma(simd.mul(simd.splat(-0.5), slope), simd.add(min, max), density);
            simd.store(min, &mut row.min[axis]);
            simd.store(max, &mut row.max[axis]);
            simd.store(slope, &mut row.slope[axis]);
        }
        simd.store(extinctions, &mut row.extinction);
        simd.store(density, &mut row.density);
        simd.store(errors, &mut row.error);
    }
}

/// What passes through, summed over clear segments. Where neighbouring segments of several packets pass as one (see
/// [`pass`]), each counts with the values of the mean of its two or four.
#[derive(Clone, Copy, Default)]
pub(super) struct Passed {
    /// Product of the boxes' transmittances along the line [SD95 sec 3.1].
    pub transmittance: f32,
    /// Squares of them.
    pub square: f32,
    /// Fréchet's lower bound of it, 1 - Σ(1 - T), from Σ κ l >= Σ (1 - T) (method D.7).
    pub lo: f32,
    /// Fréchet's upper bound, the least of the factors.
    pub hi: f32,
    /// Root mean square error that the boxes' own errors make, taken as independent: T² Σ (ε_i / T_i)², with ε_i² no more
    /// than T_i (1 - T_i), the variance of a box that passes all or nothing (method A.9).
    pub error: f32,
    /// Segments that meet a box.
    pub met: f32,
    /// How many lines were sent through the boxes, in packets: fewer than the packets asked for where those are folded.
    pub times: u64,
}

impl Passed {
    fn add(&mut self, other: Passed) {
        self.transmittance += other.transmittance;
        self.square += other.square;
        self.lo += other.lo;
        self.hi += other.hi;
        self.error += other.error;
        self.met += other.met;
        self.times += other.times;
    }
}

/// 1/d, finite even for zero, so that 0 · 1/d is never NaN.
#[inline(always)]
fn reciprocal<S: Simd>(simd: S, d: S::F) -> S::F {
    let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
    simd.div(simd.splat(1.0), simd.select(tiny, simd.splat(1e-30), d))
}

/// Lines from end to end, made ready for boxes.
struct Beam<S: Simd> {
    /// Where they begin, if not at one place.
    origin: Option<Vector<S>>,
    half: Vector<S>,
    inverse: Vector<S>,
    length: S::F,
}

impl<S: Simd> Beam<S> {
    #[inline(always)]
    fn of(simd: S, Lines { origin, direction, .. }: &Lines<S>, shared: bool) -> Beam<S> {
        let inverse =
            [reciprocal(simd, direction[0]), reciprocal(simd, direction[1]), reciprocal(simd, direction[2])];
        Beam {
            origin: (!shared).then_some(*origin),
            half: vector::scaled(simd, simd.splat(0.5), direction),
            inverse,
            length: simd.root(vector::dot(simd, direction, direction)),
        }
    }

    /// Optical depth of each line in a box.
    #[inline(always)]
    fn depth(&self, simd: S, row: &Row, lane: usize) -> S::F {
        let zero = simd.splat(0.0);
        let (mut enter, mut leave) = (zero, simd.splat(1.0));
        for axis in 0..3 {
            let (mut a, mut b) = (simd.splat(row.min[axis][lane]), simd.splat(row.max[axis][lane]));
            if let Some(origin) = &self.origin {
                (a, b) = (simd.sub(a, origin[axis]), simd.sub(b, origin[axis]));
            }
            (a, b) = (simd.mul(a, self.inverse[axis]), simd.mul(b, self.inverse[axis]));
            enter = simd.max(simd.min(a, b), enter);
            leave = simd.min(simd.max(a, b), leave);
        }
        let path = simd.mul(simd.max(simd.sub(leave, enter), zero), self.length);
        let twice = simd.add(enter, leave);
        let slope = vector::splat(simd, Vec3::from(row.slope.map(|axis| axis[lane])));
        let climb = vector::dot(simd, &slope, &self.half);
        let mut at_origin = simd.splat(row.density[lane]);
        if let Some(origin) = &self.origin {
            at_origin = simd.add(at_origin, vector::dot(simd, &slope, origin));
        }
        // No more than 2 in any box, and finite for boxes that are missed by far.
        let density = simd.min(simd.max(simd.fma(climb, twice, at_origin), zero), simd.splat(2.0));
        simd.mul(simd.mul(path, simd.splat(row.extinction[lane])), density)
    }
}

/// Sixteen lines, and how many clear segments each of them stands for.
struct Lines<S: Simd> {
    origin: Vector<S>,
    direction: Vector<S>,
    weights: S::F,
}

/// Which lanes each of four, and each of two packets gets where they are folded: one of each four, of each two.
const OF_FOUR: [u32; 4] = [0x8421, 0x4812, 0x2184, 0x1248];
const OF_TWO: [u32; 4] = [0x5555, 0xaaaa, 0, 0];

impl<S: Simd> Lines<S> {
    /// Every segment of a packet for itself.
    #[inline(always)]
    fn of(simd: S, packet: &Packet, blocked: u32) -> Lines<S> {
        Lines {
            origin: vector::load(simd, &packet.origin),
            direction: vector::load(simd, &packet.direction),
            weights: simd.keep(simd.mask(packet.active & !blocked), simd.splat(1.0)),
        }
    }

    /// The means of four or two neighbouring segments each, of as many full packets at most; none if the ends of
    /// segments lie farther than `reach` from those of their mean along an axis.
    ///
    /// What passes changes little from neighbour to neighbour, and where it changes evenly the mean passes as much as
    /// they do on the average.
    #[inline(always)]
    fn folded(
        simd: S,
        packets: &[Packet],
        blocked: &[u32],
        lanes: &[u32; 4],
        (shared, reach): (bool, f32),
    ) -> Option<Lines<S>> {
        let fours = lanes[0] == OF_FOUR[0];
        let part = simd.splat(if fours { 0.25 } else { 0.5 });
        let mut lines = Lines::of(simd, &packets[0], u32::MAX);
        let mut apart = simd.splat(0.0);
        for ((packet, blocked), &lanes) in packets.iter().zip(blocked).zip(lanes) {
            let lanes = simd.mask(lanes);
            for axis in 0..3 {
                for (of, v, skip) in [
                    (&mut lines.direction, &packet.direction, false),
                    (&mut lines.origin, &packet.origin, shared),
                ] {
                    if !skip {
                        let v = simd.load(&v[axis]);
                        let sum = if fours { simd.sum_fours(v) } else { simd.sum_twos(v) };
                        let mean = simd.mul(part, sum);
                        apart = simd.max(apart, simd.abs(simd.sub(v, mean)));
                        of[axis] = simd.select(lanes, mean, of[axis]);
                    }
                }
            }
            let clear = simd.keep(simd.mask(!blocked & 0xffff), simd.splat(1.0));
            let clear = if fours { simd.sum_fours(clear) } else { simd.sum_twos(clear) };
            lines.weights = simd.select(lanes, clear, lines.weights);
        }
        (simd.greatest(apart) <= reach).then_some(lines)
    }

    /// Sends them through the boxes; the transmittance of each times its weight, and all sums.
    #[inline(always)]
    fn pass(&self, simd: S, slabs: &Slabs, shared: bool) -> (S::F, Passed) {
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let beam = Beam::of(simd, self, shared);
        let (mut depth, mut deepest, mut errors) = (zero, zero, zero);
        for row in &slabs.rows[..slabs.used] {
            for lane in Lanes(row.lanes) {
                let d = beam.depth(simd, row, lane);
                depth = simd.add(depth, d);
                deepest = simd.max(deepest, d);
                // 1/T_i = e^d >= 1 + d + d²/2; past that T is small anyway.
                let inverse = simd.fma(d, simd.fma(d, simd.splat(0.5), one), one);
                let error = simd.mul(simd.splat(row.error[lane]), inverse);
                errors = simd.add(errors, simd.min(simd.mul(error, error), simd.sub(inverse, one)));
            }
        }
        let weights = self.weights;
        let each = decay(simd, depth);
        let transmittance = simd.mul(weights, each);
        let passed = Passed {
            transmittance: simd.sum(transmittance),
            square: simd.sum(simd.mul(transmittance, each)),
            lo: simd.sum(simd.mul(weights, simd.max(simd.sub(one, depth), zero))),
            hi: simd.sum(simd.mul(weights, decay(simd, deepest))),
            error: simd.sum(simd.mul(transmittance, simd.root(errors))),
            met: simd.sum(simd.keep(simd.lt(zero, depth), weights)),
            times: 1,
        };
        (transmittance, passed)
    }
}

/// Bundles of so many packets are folded by four, smaller ones by two: measured in a forest, where neither adds more than
/// half a percent to the error. (Four packets folded by four add five.)
const MANY: usize = 8;

/// Sends the clear segments of a bundle through the boxes: one by one, or where there are many packets whose neighbouring
/// lanes end close together (see [`crate::ray::gather_neighbours`]) the means of a few of them. `reach` is how far from
/// their mean they may end.
///
/// The summed transmittance of each packet is added to `sums`, folded or not: a fold holds neighbours of one packet, never of
/// two. `each` is for bundles of a single packet, which is not folded: it gets the transmittance of every segment, 0 in other
/// lanes; with several packets it holds that of the last one that passed one by one, and means nothing.
#[inline(always)]
pub(super) fn pass<S: Simd>(
    simd: S,
    slabs: &Slabs,
    (packets, blocked): (&[Packet], &[u32]),
    (shared, reach): (bool, f32),
    sums: &mut Vec<f32>,
    each: &mut [f32; LANES],
) -> Passed {
    let mut all = Passed::default();
    let (fold, lanes) = match packets.len() {
        ..2 => (1, &OF_TWO),
        2..MANY => (2, &OF_TWO),
        MANY.. => (4, &OF_FOUR),
    };
    for (packets, blocked) in packets.chunks(fold).zip(blocked.chunks(fold)) {
        let full = packets.len() > 1 && packets.iter().all(|packet| packet.active == 0xffff);
        let folded = if full { Lines::folded(simd, packets, blocked, lanes, (shared, reach)) } else { None };
        if let Some(lines) = folded {
            let (transmittance, passed) = lines.pass(simd, slabs, shared);
            let of_packet = |&lanes: &u32| simd.sum(simd.keep(simd.mask(lanes), transmittance));
            sums.extend(lanes[..packets.len()].iter().map(of_packet));
            all.add(passed);
            continue;
        }
        for (packet, &blocked) in packets.iter().zip(blocked) {
            let (transmittance, passed) = Lines::of(simd, packet, blocked).pass(simd, slabs, shared);
            simd.store(transmittance, each);
            sums.push(passed.transmittance);
            all.add(passed);
        }
    }
    all
}
