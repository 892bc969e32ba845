//! Aggregated clusters: boxes with extinction, and the transmittance of segments through them.

use super::shaft::{FromReceiver, Shaft};
use super::wide::WideNode;
use crate::ray::{Lanes, Packet};
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd, decay};
use glam::Vec3;

/// Aggregated boxes of one node, in its lanes. Coordinates are relative to the common receiver end, or to the scene's
/// origin if there is none.
#[derive(Clone)]
#[repr(C, align(64))]
struct SlabRow {
    min: [[f32; LANES]; 3],
    max: [[f32; LANES]; 3],
    /// Extinction at the boxes' centres, 1/length.
    extinction: [f32; LANES],
    /// The extinction at x is `max(0, density + slope · x)` times `extinction`.
    slope: [[f32; LANES]; 3],
    density: [f32; LANES],
    /// Root mean square errors of the boxes' transmittances for the bundle's beam, in `[0, 1]`.
    error: [f32; LANES],
    lanes: u32,
}

impl SlabRow {
    const EMPTY: SlabRow = SlabRow {
        min: [[0.0; LANES]; 3],
        max: [[0.0; LANES]; 3],
        extinction: [0.0; LANES],
        slope: [[0.0; LANES]; 3],
        density: [0.0; LANES],
        error: [0.0; LANES],
        lanes: 0,
    };
}

/// The aggregated boxes of a walk.
#[derive(Default)]
pub(super) struct Slabs {
    /// Rows in use, followed by rows allocated for earlier walks.
    rows: Vec<SlabRow>,
    used: usize,
    boxes: usize,
}

impl Slabs {
    /// Removes all boxes.
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

    /// Adds the children `lanes` of a node, relative to `from`, with their extinctions and errors.
    #[inline(always)]
    pub fn add<S: Simd>(
        &mut self,
        simd: S,
        node: &WideNode,
        lanes: u32,
        from: Vec3,
        extinctions: S::F,
        errors: S::F,
    ) {
        if self.used == self.rows.len() {
            self.rows.push(SlabRow::EMPTY);
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

/// Results of [`pass`], summed over unblocked segments. Segments that are folded (see [`pass`]) count with the values
/// of the mean of their two or four.
#[derive(Clone, Copy, Default)]
pub(super) struct BoxSums {
    /// Product of the boxes' transmittances along the segment [SD95 sec 3.1].
    pub transmittance: f32,
    /// Squares of the transmittances.
    pub square: f32,
    /// Fréchet's lower bound 1 - Σ(1 - T_i), bounded from below with Σ κ l >= Σ (1 - T_i) (docs/method.md,
    /// Certificates and intervals).
    pub lo: f32,
    /// Fréchet's upper bound, the smallest T_i.
    pub hi: f32,
    /// Root mean square error due to the boxes' own errors ε_i, taken as independent: T² Σ (ε_i / T_i)². ε_i² is at
    /// most T_i (1 - T_i), the variance of zero-one visibility with mean T_i.
    pub error: f32,
    /// Number of segments that meet a box.
    pub met: f32,
    /// Number of packets of lines traced through the boxes, after folding.
    pub times: u64,
}

impl BoxSums {
    pub(super) fn add(&mut self, other: BoxSums) {
        self.transmittance += other.transmittance;
        self.square += other.square;
        self.lo += other.lo;
        self.hi += other.hi;
        self.error += other.error;
        self.met += other.met;
        self.times += other.times;
    }
}

/// 1/d, finite for d = 0, so that 0 · 1/d is never NaN.
#[inline(always)]
fn reciprocal<S: Simd>(simd: S, d: S::F) -> S::F {
    let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
    simd.div(simd.splat(1.0), simd.select(tiny, simd.splat(1e-30), d))
}

/// Lines prepared for intersection with boxes.
struct Beam<S: Simd> {
    /// Start points, unless all lines start at the reference point of the boxes.
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
    fn depth(&self, simd: S, row: &SlabRow, lane: usize) -> S::F {
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
        // At most 2 inside any box; the limits keep the value finite for boxes far from the line.
        let density = simd.min(simd.max(simd.fma(climb, twice, at_origin), zero), simd.splat(2.0));
        simd.mul(simd.mul(path, simd.splat(row.extinction[lane])), density)
    }
}

/// Sums over the boxes that sixteen lines pass.
struct LineSums<S: Simd> {
    /// Optical depth.
    depth: S::F,
    /// Largest optical depth of a single box.
    deepest: S::F,
    /// Sum of the squared relative errors of the boxes.
    errors: S::F,
}

impl<S: Simd> LineSums<S> {
    /// Adds the boxes of `slabs`.
    #[inline(always)]
    fn through(mut self, simd: S, lines: &Lines<S>, slabs: &Slabs, shared: bool) -> LineSums<S> {
        let one = simd.splat(1.0);
        let beam = Beam::of(simd, lines, shared);
        for row in &slabs.rows[..slabs.used] {
            for lane in Lanes(row.lanes) {
                let d = beam.depth(simd, row, lane);
                self.depth = simd.add(self.depth, d);
                self.deepest = simd.max(self.deepest, d);
                // 1/T_i = e^d >= 1 + d + d²/2; for large d T is small and the error with it.
                let inverse = simd.fma(d, simd.fma(d, simd.splat(0.5), one), one);
                let error = simd.mul(simd.splat(row.error[lane]), inverse);
                self.errors = simd.add(self.errors, simd.min(simd.mul(error, error), simd.sub(inverse, one)));
            }
        }
        self
    }

    /// The weighted transmittance of each line, and sums over the lines with their weights.
    #[inline(always)]
    fn passed(&self, simd: S, weights: S::F) -> (S::F, BoxSums) {
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let each = decay(simd, self.depth);
        let transmittance = simd.mul(weights, each);
        let passed = BoxSums {
            transmittance: simd.sum(transmittance),
            square: simd.sum(simd.mul(transmittance, each)),
            lo: simd.sum(simd.mul(weights, simd.max(simd.sub(one, self.depth), zero))),
            hi: simd.sum(simd.mul(weights, decay(simd, self.deepest))),
            error: simd.sum(simd.mul(transmittance, simd.root(self.errors))),
            met: simd.sum(simd.keep(simd.lt(zero, self.depth), weights)),
            times: 1,
        };
        (transmittance, passed)
    }
}

/// Sums over the boxes that the segments of one packet pass, kept while the boxes of several frames are added.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct PacketSums {
    depth: [f32; LANES],
    deepest: [f32; LANES],
    errors: [f32; LANES],
}

impl PacketSums {
    /// No box yet.
    pub const EMPTY: PacketSums =
        PacketSums { depth: [0.0; LANES], deepest: [0.0; LANES], errors: [0.0; LANES] };

    #[inline(always)]
    fn loaded<S: Simd>(&self, simd: S) -> LineSums<S> {
        LineSums {
            depth: simd.load(&self.depth),
            deepest: simd.load(&self.deepest),
            errors: simd.load(&self.errors),
        }
    }

    /// Adds the boxes of `slabs`, which are seen from the common origin of the segments if it is `shared`.
    #[inline(always)]
    pub fn add<S: Simd>(&mut self, simd: S, slabs: &Slabs, packet: &Packet, shared: bool) {
        let sums = self.loaded(simd).through(simd, &Lines::of(simd, packet, 0), slabs, shared);
        simd.store(sums.depth, &mut self.depth);
        simd.store(sums.deepest, &mut self.deepest);
        simd.store(sums.errors, &mut self.errors);
    }

    /// The transmittance of each segment that is not blocked, 0 in other lanes, and their sums.
    #[inline(always)]
    pub fn passed<S: Simd>(&self, simd: S, clear: u32) -> ([f32; LANES], BoxSums) {
        let weights = simd.keep(simd.mask(clear), simd.splat(1.0));
        let (transmittance, passed) = self.loaded(simd).passed(simd, weights);
        let mut each = [0.0; LANES];
        simd.store(transmittance, &mut each);
        (each, passed)
    }
}

/// Sixteen lines, with the number of unblocked segments that each represents.
struct Lines<S: Simd> {
    origin: Vector<S>,
    direction: Vector<S>,
    weights: S::F,
}

/// Lanes of the folded lines that hold the segments of each of four (two) packets.
const LANES_OF_FOUR: [u32; 4] = [0x8421, 0x4812, 0x2184, 0x1248];
const LANES_OF_TWO: [u32; 4] = [0x5555, 0xaaaa, 0, 0];

impl<S: Simd> Lines<S> {
    /// All segments of a packet, unfolded.
    #[inline(always)]
    fn of(simd: S, packet: &Packet, blocked: u32) -> Lines<S> {
        let FromReceiver { origin, direction, .. } = FromReceiver::of(simd, packet);
        Lines { origin, direction, weights: simd.keep(simd.mask(packet.active & !blocked), simd.splat(1.0)) }
    }

    /// The means of four (two) adjacent segments each, of up to four (two) full packets; `None` if any end lies
    /// farther than `reach` (scene units, per axis) from that of its mean.
    ///
    /// The transmittance varies slowly between adjacent segments, and where it varies linearly the mean segment has
    /// their mean transmittance.
    #[inline(always)]
    fn folded(
        simd: S,
        packets: &[Packet],
        blocked: &[u32],
        lanes: &[u32; 4],
        shared: bool,
        reach: f32,
    ) -> Option<Lines<S>> {
        let fours = lanes[0] == LANES_OF_FOUR[0];
        let part = simd.splat(if fours { 0.25 } else { 0.5 });
        let mut lines = Lines::of(simd, &packets[0], u32::MAX);
        let mut apart = simd.splat(0.0);
        for ((packet, blocked), &lanes) in packets.iter().zip(blocked).zip(lanes) {
            let lanes = simd.mask(lanes);
            let FromReceiver { origin, direction, .. } = FromReceiver::of(simd, packet);
            for axis in 0..3 {
                for (of, v, skip) in
                    [(&mut lines.direction, &direction, false), (&mut lines.origin, &origin, shared)]
                {
                    if !skip {
                        let v = v[axis];
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

    /// Traces the lines through the boxes: the weighted transmittance of each line, and all sums.
    #[inline(always)]
    fn pass(&self, simd: S, slabs: &Slabs, shared: bool) -> (S::F, BoxSums) {
        let zero = simd.splat(0.0);
        LineSums::<S> { depth: zero, deepest: zero, errors: zero }
            .through(simd, self, slabs, shared)
            .passed(simd, self.weights)
    }
}

/// Bundles of at least this many packets are folded by four, smaller ones by two: at least two folded packets remain,
/// so that their errors average.
const MIN_FOLD_BY_FOUR_PACKETS: usize = 8;

/// Traces the unblocked segments of a bundle through the aggregated boxes: one by one, or, in bundles of several
/// packets whose adjacent lanes end close together (see [`crate::ray::gather_neighbours`]), as means of two or four
/// segments.
///
/// Appends the summed transmittance of each packet to `sums`; folded lines never mix packets. For a bundle of one
/// packet, which is never folded, `each` receives the transmittance of every segment, 0 in unused lanes; for other
/// bundles its content is undefined.
#[inline(always)]
pub(super) fn pass<S: Simd>(
    simd: S,
    slabs: &Slabs,
    packets: &[Packet],
    blocked: &[u32],
    shaft: &Shaft,
    sums: &mut Vec<f32>,
    each: &mut [f32; LANES],
) -> BoxSums {
    // All segments start at the boxes' reference point.
    let shared = shaft.apex.is_some();
    // Adjacent segments are folded if their ends are at most a quarter of the bundle's width from their mean.
    let reach = 0.5 * shaft.ends[0].half.max(shaft.ends[1].half).max_element();
    let mut all = BoxSums::default();
    let (fold, lanes) = match packets.len() {
        ..2 => (1, &LANES_OF_TWO),
        2..MIN_FOLD_BY_FOUR_PACKETS => (2, &LANES_OF_TWO),
        MIN_FOLD_BY_FOUR_PACKETS.. => (4, &LANES_OF_FOUR),
    };
    for (packets, blocked) in packets.chunks(fold).zip(blocked.chunks(fold)) {
        let full = packets.len() > 1 && packets.iter().all(|packet| packet.active == 0xffff);
        let folded = if full { Lines::folded(simd, packets, blocked, lanes, shared, reach) } else { None };
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
