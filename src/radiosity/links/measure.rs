//! The coupling of two elements: unoccluded exchange and transmittance.

use super::between::between;
use super::ends::{Ends, four, gauss, kernel, mix};
use super::{Between, Link, Question, Scratch, Sight};
use crate::form_factors::analytic::{clip, point_to_polygon, polygon_to_polygon};
use crate::radiosity::elements::{Element, Elements, Shape, facing};
use crate::ray::{EndRule, LANES, Packet};
use glam::{DVec3, Vec3};

/// Nearer than this many times the sum of their radii two surfaces are integrated with Lambert's formula.
const NEAR: f32 = 4.0;
/// Nearer than this many times, and worth it, with the contour integral.
const TOUCHING: f32 = 1.2;
/// Least relative deviation of the coupling over an end, times the square of its radius over the distance: what a kernel that
/// falls as the fourth power of a cosine does.
const BENT: f32 = 0.5;
/// Relative deviation inside a cluster that faces its directions only on average.
const ROUGH: f32 = 0.3;
/// Four segments instead of sixteen are enough where visibility is expected to make the error of a coupling less than this,
/// in units of what is tolerated; half of it between clusters, whose samples vary for other reasons too.
const FEW: f32 = 0.25;
const FEW_RAYS: usize = 4;

/// Measures links.
#[derive(Clone, Copy)]
pub struct Meter<'a> {
    /// The elements.
    pub elements: &'a Elements,
    /// The engine that is asked.
    pub sight: &'a Sight,
    /// What counts as the end of a segment.
    pub ends: EndRule,
    /// Seed of all samples.
    pub seed: u64,
    /// What light does inside clusters.
    pub inside: Inside,
}

/// What happens to light between the surfaces of a cluster that a link ends at and its box [SD95 sec 6.1; method A.11].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Inside {
    /// Surfaces face all directions alike and hide nothing: the cluster kernel of Sillion 95, a quarter of the area.
    Isotropic,
    /// Surfaces have their orientations and hide nothing: more light arrives than the cluster's silhouette lets in.
    Oriented,
    /// Segments end on the surfaces: what the cluster hides from itself gets nothing, and no energy is made.
    #[default]
    Visible,
}

/// How carefully a link is to be measured.
#[derive(Clone, Copy, Debug)]
pub struct Care {
    /// Error that a coupling of one square unit would be, in units of what is tolerated.
    pub worth: f32,
    /// Shadow features smaller than this on the end that receives need not be resolved; scene units.
    pub feature_size: f32,
    /// Standard deviation that the transmittance of a segment is expected to have, in `[0, 1/2]`: where it is small, few
    /// segments say as much as many.
    pub mixed: f32,
    /// What is known to stand between surfaces that the ends are parts of.
    pub between: Between,
    /// Whether rays between those found no way: then it is worth looking for a surface that hides all.
    pub hidden: bool,
    /// Whether it is the first end whose light matters more: features are those of its shadows.
    pub first_receives: bool,
}

/// A pair of elements, not yet a link: the unoccluded exchange is known, and what to ask of visibility.
pub struct Draft {
    ids: [u32; 2],
    swapped: bool,
    /// Unoccluded coupling, and the one that deviations are relative to.
    free: [f32; 2],
    deviation: [f32; 2],
    weights: [f32; LANES],
    between: Between,
}

impl Meter<'_> {
    /// The link between two elements that do not hold each other; none if neither sees the other's front.
    pub fn measure(&self, a: u32, b: u32, care: Care, scratch: &mut Scratch) -> Option<Link> {
        self.measure_all(&[([a, b], care)], scratch).pop()
    }

    /// The links of pairs of elements that do not hold each other, in their order; pairs that do not see each other's fronts
    /// are left out.
    ///
    /// Surfaces: Lambert's formula from four points of the smaller one or, for pairs that touch, the contour integral;
    /// far ones by the kernel alone. Clusters: an unbiased estimate over their sides, drawn with a preference for those
    /// that face the other end. Visibility is asked for the same points, weighted by their kernel, for all pairs together.
    pub fn measure_all(&self, pairs: &[([u32; 2], Care)], scratch: &mut Scratch) -> Vec<Link> {
        let mut links = Vec::with_capacity(pairs.len());
        let (mut drafts, mut questions) = (Vec::with_capacity(pairs.len()), Vec::with_capacity(pairs.len()));
        for &([a, b], care) in pairs {
            let Some((draft, question)) = self.draft(a, b, care) else { continue };
            links.push(draft.link(&Packet::EMPTY, &[0.0; LANES]));
            if !question.packet.is_empty() {
                drafts.push((links.len() - 1, draft));
                questions.push(question);
            } else if draft.between == Between::NOTHING {
                scratch.tally.clear += 1;
            }
        }
        self.sight.ask(&questions, scratch, |k, seen| {
            let (place, draft) = &drafts[k];
            links[*place] = draft.link(&questions[k].packet, seen);
        });
        links
    }

    /// All of a pair but its visibility.
    pub fn draft(&self, a: u32, b: u32, care: Care) -> Option<(Draft, Question)> {
        // The same samples whichever end is named first.
        if self.elements.elements[a as usize].ids > self.elements.elements[b as usize].ids {
            let care = Care { first_receives: !care.first_receives, ..care };
            let (draft, question) = self.draft(b, a, care)?;
            return Some((Draft { swapped: true, ..draft }, question));
        }
        let (ea, eb) = (&self.elements.elements[a as usize], &self.elements.elements[b as usize]);
        if ea.area <= 0.0 || eb.area <= 0.0 || self.behind(ea, eb) || self.behind(eb, ea) {
            return None;
        }
        let seed =
            mix(self.seed ^ mix(ea.ids[0].min(eb.ids[0])) ^ mix(ea.ids[0].max(eb.ids[0])).rotate_left(17));
        match (&ea.shape, &eb.shape) {
            (Shape::Surface { side: sa, corners: ca }, Shape::Surface { side: sb, corners: cb }) => {
                let normals = [sa, sb].map(|&s| self.elements.sides[s as usize].normal);
                self.surfaces([a, b], [ea, eb], [ca, cb], normals, care, seed)
            }
            _ => self.clusters([a, b], [ea, eb], care, seed),
        }
    }

    /// Whether all of `other` lies behind a surface.
    fn behind(&self, surface: &Element, other: &Element) -> bool {
        let Shape::Surface { side, corners } = &surface.shape else { return false };
        let normal = self.elements.sides[*side as usize].normal;
        let height = |p: Vec3| normal.dot(p - corners[0]);
        let highest = match &other.shape {
            Shape::Surface { corners, .. } => corners.iter().map(|&p| height(p)).fold(f32::MIN, f32::max),
            Shape::Cluster(c) => {
                let bounds = self.elements.clusters[*c as usize].bounds;
                height(Vec3::select(normal.cmpgt(Vec3::ZERO), bounds.max, bounds.min))
            }
        };
        highest <= 1e-5 * (surface.radius + other.radius)
    }

    #[allow(clippy::too_many_arguments)] // Both ends in parallel: ids, elements, corners, normals.
    fn surfaces(
        &self,
        ids: [u32; 2],
        [ea, eb]: [&Element; 2],
        [ca, cb]: [&[Vec3; 4]; 2],
        [na, nb]: [Vec3; 2],
        care: Care,
        seed: u64,
    ) -> Option<(Draft, Question)> {
        let nearest = 1e-3 * (ea.radius + eb.radius);
        let distance = (ea.centre - eb.centre).length();
        let reach = ea.radius + eb.radius;
        // The unoccluded part by fixed rules: a noisy one would be refined where it is too large and kept where it is too
        // small.
        let (ga, gb) = (gauss(ca), gauss(cb));
        let (mut free, mut deviation);
        {
            let rows: [f32; 4] = std::array::from_fn(|i| {
                (0..4).map(|j| gb.1[j] * kernel(ga.0[i], Some(na), gb.0[j], Some(nb), nearest)).sum::<f32>()
            });
            let columns: [f32; 4] = std::array::from_fn(|j| {
                (0..4).map(|i| ga.1[i] * kernel(ga.0[i], Some(na), gb.0[j], Some(nb), nearest)).sum::<f32>()
            });
            let over_both = |v: f32| (f64::from(v) * ea.area * eb.area) as f32;
            let (mean, of_a) = moments(rows, ga.1);
            free = over_both(mean);
            deviation = [over_both(of_a), over_both(moments(columns, gb.1).1)];
        }
        // A surface that reaches behind the other may be seen by a corner only, which no fixed point lies in.
        let cut = [reaches_behind(ca, cb, nb, nearest), reaches_behind(cb, ca, na, nearest)];
        if distance < NEAR * reach || cut[0] || cut[1] {
            let small_is_a = ea.area <= eb.area;
            let (small, from, normal, large) = if small_is_a { (ea, ca, na, cb) } else { (eb, cb, nb, ca) };
            let (polygon, other) = (doubles(large), doubles(from));
            let corners = if large[2] == large[3] { &polygon[..3] } else { &polygon[..] };
            let first = if from[2] == from[3] { &other[..3] } else { &other[..] };
            let (points, shares) = if small_is_a { ga } else { gb };
            let factors =
                points.map(|p| point_to_polygon(p.as_dvec3(), normal.as_dvec3(), corners).max(0.0) as f32);
            let (factor, of_small) = moments(factors, shares);
            free = small.area as f32 * factor;
            deviation[usize::from(!small_is_a)] = small.area as f32 * of_small;
            if cut[usize::from(!small_is_a)] {
                free = in_front(first, normal.as_dvec3(), corners) as f32;
            }
            if cut[0] || cut[1] {
                deviation = deviation.map(|d| d.max(free));
            }
            if distance < TOUCHING * reach && care.worth * free > 0.3 {
                free = (small.area * polygon_to_polygon(first, corners)) as f32;
            }
        }
        if free <= 0.0 {
            return None;
        }
        // Four points that lie alike, as below the middle of a lamp, see no variation where there is one.
        for (d, e) in deviation.iter_mut().zip([ea, eb]) {
            *d = d.max(BENT * free * (e.radius / distance).powi(2).min(1.0));
        }
        // A certificate first: it needs no ray and leaves no doubt, for the parts neither.
        let between = between(self.elements, [ca, cb], [na, nb], self.ends, care.between, care.hidden);
        if between == Between::WALL {
            return None;
        }
        if between == Between::NOTHING {
            let draft =
                Draft { ids, swapped: false, free: [free; 2], deviation, weights: [0.0; LANES], between };
            return Some((draft, question(Packet::EMPTY, [shortest(ca), shortest(cb)], care)));
        }
        // Lane i + 4 j: point i of a, point j of b.
        let (pa, pb) = (four(ca, seed), four(cb, mix(seed)));
        let weights: [f32; LANES] =
            std::array::from_fn(|l| kernel(pa[l & 3], Some(na), pb[l >> 2], Some(nb), nearest));
        let few = care.worth * free * care.mixed < FEW;
        let mut packet = Packet::EMPTY;
        for l in lanes(seed).filter(|&l| weights[l] > 0.0).take(if few { FEW_RAYS } else { LANES }) {
            self.set(&mut packet, l, [pa[l & 3], pb[l >> 2]], care);
        }
        let draft = Draft { ids, swapped: false, free: [free; 2], deviation, weights, between };
        Some((draft, question(packet, [shortest(ca), shortest(cb)], care)))
    }

    fn clusters(
        &self,
        ids: [u32; 2],
        [ea, eb]: [&Element; 2],
        care: Care,
        seed: u64,
    ) -> Option<(Draft, Question)> {
        let towards = (eb.centre - ea.centre).normalize_or(Vec3::X);
        let from = Ends::draw(self.elements, ids[0], towards, 0, seed);
        let to = Ends::draw(self.elements, ids[1], -towards, 1, mix(seed));
        let nearest = 0.2 * (ea.radius + eb.radius);
        let distance = (eb.centre - ea.centre).length();
        let isotropic = [ea, eb].map(|e| self.inside == Inside::Isotropic && e.is_cluster());
        let weights: [f32; LANES] = std::array::from_fn(|l| {
            let facing = [
                if isotropic[0] { None } else { Some(from.normals[l]) },
                if isotropic[1] { None } else { Some(to.normals[l]) },
            ];
            kernel(from.points[l], facing[0], to.points[l], facing[1], nearest)
                / from.density[l]
                / to.density[l]
        });
        let most = 0.9 * ea.area.min(eb.area) as f32;
        let free = (weights.iter().sum::<f32>() / LANES as f32).min(most);
        // What the oracle sees is free of noise: else overestimates would be refined and underestimates kept.
        let model = (self.projected(ea, towards) * self.projected(eb, -towards)
            / (std::f32::consts::PI * distance.max(0.5 * (ea.radius + eb.radius)).powi(2)))
        .min(most);
        let deviation = [ea, eb].map(|e| {
            let near = (2.0 * e.radius / distance.max(1e-6 * e.radius)).min(4.0);
            let rough = if e.is_cluster() { ROUGH } else { 0.0 };
            model * near.hypot(rough)
        });
        let few = care.worth * model * care.mixed < 0.5 * FEW;
        let mut packet = Packet::EMPTY;
        for l in lanes(seed).filter(|&l| weights[l] > 0.0).take(if few { FEW_RAYS } else { LANES }) {
            self.set(&mut packet, l, [from.points[l], to.points[l]], care);
        }
        // No sample says that there is nothing; where it would matter the parts are asked.
        if packet.is_empty() && free <= 0.0 && care.worth * deviation[0].max(deviation[1]) <= 1.0 {
            return None;
        }
        if self.inside != Inside::Visible {
            self.between_boxes(&mut packet, if care.first_receives { [ea, eb] } else { [eb, ea] });
        }
        let draft = Draft {
            ids,
            swapped: false,
            free: [free, model],
            deviation,
            weights,
            between: Between::SOMETHING,
        };
        Some((draft, question(packet, [ea.radius, eb.radius], care)))
    }

    /// Puts a segment between the ends into a lane, from the one that receives.
    fn set(&self, packet: &mut Packet, lane: usize, [a, b]: [Vec3; 2], care: Care) {
        let (from, to) = if care.first_receives { (a, b) } else { (b, a) };
        packet.set(lane, from, to, self.ends);
    }

    /// Leaves out what segments meet inside the boxes of clusters they end in.
    fn between_boxes(&self, packet: &mut Packet, ends: [&Element; 2]) {
        for (k, end) in ends.into_iter().enumerate() {
            let Shape::Cluster(c) = end.shape else { continue };
            let bounds = self.elements.clusters[c as usize].bounds;
            for lane in packet.lanes() {
                let (o, d) = (packet.point(lane, 0.0), packet.point(lane, 1.0) - packet.point(lane, 0.0));
                // Where the line leaves the box, and where it enters it. Along an axis that it does not follow it does neither;
                // on a face of the box the quotient would be 0/0.
                let (mut enters, mut leaves) = (f32::MIN, f32::MAX);
                for axis in (0..3).filter(|&axis| d[axis] != 0.0) {
                    let first = (bounds.min[axis] - o[axis]) / d[axis];
                    let last = (bounds.max[axis] - o[axis]) / d[axis];
                    enters = enters.max(first.min(last));
                    leaves = leaves.min(first.max(last));
                }
                let (near, far) = (packet.near[lane], packet.far[lane]);
                if k == 0 {
                    packet.near[lane] = leaves.max(near).min(far);
                } else {
                    packet.far[lane] = enters.max(near).min(far);
                }
            }
        }
    }

    /// Projected area of an element towards a direction; of a surface seen edge-on a little.
    fn projected(&self, e: &Element, towards: Vec3) -> f32 {
        match &e.shape {
            Shape::Surface { side, .. } => {
                e.area as f32 * self.elements.sides[*side as usize].normal.dot(towards).max(0.2)
            }
            Shape::Cluster(c) => {
                let projected = self.elements.clusters[*c as usize].projected;
                let seen: f32 = facing(towards).into_iter().zip(projected).map(|(f, p)| f * p as f32).sum();
                // Flat ones seen edge-on, as a wall with a door is from the room beside, are not nothing.
                seen.max(0.1 * e.area as f32)
            }
        }
    }
}

/// All lanes; every four of them have each row and each column of the grids of both ends once (and, between surfaces, each of
/// the four points). Which come first is by chance: where few are asked for, all pairs of places have their turn in the mean.
fn lanes(seed: u64) -> impl Iterator<Item = usize> {
    let turn = (seed >> 32) as usize & 3;
    (0..LANES).map(move |k| 4 * (k & 3) + ([0, 3, 2, 1][k & 3] ^ (k >> 2) ^ turn))
}

/// What is asked for segments between ends of these widths.
fn question(packet: Packet, [a, b]: [f32; 2], care: Care) -> Question {
    let emitter_size = if care.first_receives { b } else { a };
    Question { packet, emitter_size, feature_size: care.feature_size }
}

impl Draft {
    /// Puts unoccluded coupling and visibility together; a link without a segment counts as clear.
    fn link(&self, packet: &Packet, seen: &[f32; LANES]) -> Link {
        let Draft { free: [free, scale], deviation, weights, between, .. } = *self;
        if packet.is_empty() {
            // Without a certificate only slivers face each other.
            let noise = if between == Between::NOTHING { 0.0 } else { free };
            return self.with(1.0, deviation, noise, 0);
        }
        let (mut sum, mut visible, mut squares) = (0.0, 0.0, 0.0);
        for l in packet.lanes() {
            sum += weights[l];
            visible += weights[l] * seen[l];
            squares += weights[l] * seen[l] * seen[l];
        }
        let transmittance = visible / sum;
        let n = packet.len() as f32;
        // Relative to the unoccluded coupling: √(T (1 - T)) for zero-one visibility (method A.9), and no less than what as
        // many segments of one kind leave possible, alike for those that are seen and those that are not: links that are
        // believed and are not refined then err to either side.
        let mixed = (squares / sum - transmittance * transmittance).max(0.0).sqrt();
        let shadow = scale * mixed.max((n + 1.0).sqrt() / (n + 2.0));
        let noise = shadow / n.sqrt();
        let variation = deviation.map(|d| (d * transmittance).hypot(shadow));
        self.with(transmittance, variation, noise, packet.len() as u32)
    }

    fn with(&self, transmittance: f32, [of_a, of_b]: [f32; 2], noise: f32, rays: u32) -> Link {
        let [a, b] = self.ids;
        let (a, b, variation) = if self.swapped { (b, a, [of_b, of_a]) } else { (a, b, [of_a, of_b]) };
        let coupling = self.free[0] * transmittance;
        Link { a, b, coupling, transmittance, variation, noise, rays, between: self.between }
    }
}

/// Mean and standard deviation of values with weights whose sum is 1.
fn moments(v: [f32; 4], weights: [f32; 4]) -> (f32, f32) {
    let mean: f32 = v.iter().zip(weights).map(|(v, w)| v * w).sum();
    // Kernels of small things are large numbers, and their squares too large ones.
    let squares: f64 = v.iter().zip(weights).map(|(v, w)| f64::from(w) * f64::from(v - mean).powi(2)).sum();
    (mean, squares.sqrt() as f32)
}

/// Whether a surface lies partly in front of and partly behind another's plane, by more than a distance.
fn reaches_behind(corners: &[Vec3; 4], other: &[Vec3; 4], normal: Vec3, distance: f32) -> bool {
    let heights = corners.map(|p| normal.dot(p - other[0]));
    heights.iter().any(|&h| h < -distance) && heights.iter().any(|&h| h > distance)
}

/// Coupling of the part of a surface in front of another's plane, by three points of each triangle that it makes.
fn in_front(surface: &[DVec3], normal: DVec3, other: &[DVec3]) -> f64 {
    let facing = (other[1] - other[0]).cross(other[2] - other[0]).normalize_or_zero();
    let part = clip(surface, other[0], facing);
    let triangle = |k: usize| {
        let [a, b, c] = [part[0], part[k], part[k + 1]];
        let seen = |p: DVec3| point_to_polygon(p, normal, other).max(0.0);
        let points = [(4.0 * a + b + c) / 6.0, (a + 4.0 * b + c) / 6.0, (a + b + 4.0 * c) / 6.0];
        0.5 * (b - a).cross(c - a).length() * points.into_iter().map(seen).sum::<f64>() / 3.0
    };
    (1..part.len().saturating_sub(1)).map(triangle).sum()
}

fn doubles(corners: &[Vec3; 4]) -> [DVec3; 4] {
    corners.map(|p| p.as_dvec3())
}

/// The shortest edge that is one.
fn shortest(c: &[Vec3; 4]) -> f32 {
    let edges = [(0, 1), (1, 2), (2, 3), (3, 0)].map(|(i, j)| c[i].distance(c[j]));
    edges.into_iter().filter(|&l| l > 0.0).fold(f32::MAX, f32::min)
}
