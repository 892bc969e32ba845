//! Proves without a ray that two surfaces see each other completely, or that one polygon hides them from each other.
//!
//! The convex hull of two polygons is a shaft [Haines and Wallace 1994]: their own planes, their common box, and the planes
//! through an edge of one and a corner of the other that have both on one side. Polygons outside the shaft block no segment; if
//! no polygon lies inside, the two surfaces and all their parts see each other completely. A convex polygon that the segments
//! between all pairs of corners cross in its interior blocks every segment: a segment's crossing point is a weighted mean of
//! those of the corners. See `docs/method.md`, Certificates and intervals.

use crate::math::Aabb;
use crate::radiosity::elements::{Elements, Shape};
use crate::ray::EndRule;
use crate::scene::magnitude;
use glam::{DVec3, Vec3};

/// Largest number of clusters and surfaces that are tested for one pair, or for one link to the sky; beyond that the pair has no
/// certificate and the link is traced. Limits the time of a pair to 96 tests, and the stack to 97 entries.
pub(super) const MAX_TESTS: usize = 96;
/// Distance of a blocked segment's crossing point from the edges of the blocker, relative to its size: 1,700 roundings
/// of f32 (2⁻²⁴). Pairs nearer to an edge are traced.
const MIN_EDGE_DISTANCE: f64 = 1e-4;

/// Proof by geometry alone about the space between two ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
pub struct BlockerCertificate(u32);

impl BlockerCertificate {
    /// No surface lies between the ends: all segments get through, also those between parts.
    pub const CLEAR: BlockerCertificate = BlockerCertificate(u32::MAX);
    /// One surface blocks every segment.
    pub const BLOCKED: BlockerCertificate = BlockerCertificate(u32::MAX - 1);
    /// Nothing is proved.
    pub const UNKNOWN: BlockerCertificate = BlockerCertificate(u32::MAX - 2);

    /// A side of [`Elements::sides`] may block some segments.
    fn possible_blocker(side: u32) -> BlockerCertificate {
        BlockerCertificate(side)
    }

    pub(super) fn side(self) -> Option<u32> {
        (self.0 < BlockerCertificate::UNKNOWN.0).then_some(self.0)
    }
}

/// The convex hull of two surfaces that face each other. Heights above planes are computed in double precision, so that their only
/// error is the rounding of a point's own coordinates.
struct Shaft {
    bounds: Aabb,
    /// Points inside satisfy `normal · (x - point) < 0` for every (normal, point).
    planes: [(DVec3, DVec3); MAX_PLANES],
    count: usize,
    corners: [[DVec3; 4]; 2],
    /// End rules of the surfaces.
    rules: [EndRule; 2],
}

/// Two own planes, and one through each of eight edges.
const MAX_PLANES: usize = 10;

impl Shaft {
    fn new(corners: [&[Vec3; 4]; 2], normals: [Vec3; 2], rules: [EndRule; 2]) -> Shaft {
        let bounds = Aabb::of(corners.into_iter().flatten().copied());
        let corners = corners.map(|of| of.map(|c| c.as_dvec3()));
        let mut shaft =
            Shaft { bounds, planes: [(DVec3::ZERO, DVec3::ZERO); MAX_PLANES], count: 0, corners, rules };
        for ((corners, normal), rule) in corners.iter().zip(normals).zip(rules) {
            // Points behind a surface or in its plane block nothing in front of it. A bent surface may block itself, so
            // its lowest corner counts.
            let normal = normal.as_dvec3();
            let height = |p: &DVec3| normal.dot(*p - corners[0]);
            let lowest = corners.iter().map(height).fold(0.0, f64::min);
            shaft.add(-normal, corners[0] + (lowest + f64::from(rule.slack())) * normal);
        }
        for (own, other) in [(&corners[0], &corners[1]), (&corners[1], &corners[0])] {
            for k in 0..4 {
                let (start, edge) = (own[k], own[(k + 1) & 3] - own[k]);
                if edge != DVec3::ZERO {
                    shaft.add_side(start, edge, own, other);
                }
            }
        }
        shaft
    }

    fn add(&mut self, normal: DVec3, point: DVec3) {
        self.planes[self.count] = (normal, point);
        self.count += 1;
    }

    /// Adds the plane through an edge of one end and a corner of the other that has both ends on one side, if it exists.
    fn add_side(&mut self, start: DVec3, edge: DVec3, own: &[DVec3; 4], other: &[DVec3; 4]) {
        let slack = self.rules.map(|rule| f64::from(rule.slack())).into_iter().fold(0.0, f64::max);
        for corner in other {
            let normal = edge.cross(*corner - start).normalize_or_zero();
            if normal == DVec3::ZERO {
                continue;
            }
            let (mut lowest, mut highest) = (0.0f64, 0.0f64);
            for p in own.iter().chain(other) {
                let height = normal.dot(*p - start);
                (lowest, highest) = (lowest.min(height), highest.max(height));
            }
            let outward = if highest <= -lowest { 1.0 } else { -1.0 };
            let beyond = highest.min(-lowest);
            if beyond <= slack && highest.max(-lowest) > slack {
                // The plane is moved so far outwards that both ends lie behind it, bent ends included.
                self.add(outward * normal, start + outward * beyond * normal);
                return;
            }
        }
    }

    fn meets_box(&self, b: &Aabb) -> bool {
        b.min.cmple(self.bounds.max).all()
            && b.max.cmpge(self.bounds.min).all()
            && self.planes[..self.count].iter().all(|(n, at)| {
                let lowest = Vec3::select(n.as_vec3().cmplt(Vec3::ZERO), b.max, b.min);
                n.dot(lowest.as_dvec3() - *at) < 0.0
            })
    }

    fn meets(&self, polygon: &[Vec3; 4], normal: Vec3) -> bool {
        // Inside by more than the rounding of the coordinates of the polygon's corner.
        let is_inside = |(n, at): &(DVec3, DVec3)| {
            let rounding = |p: &Vec3| f64::from(EndRule::new(magnitude([*p])).slack());
            polygon.iter().any(|p| n.dot(p.as_dvec3() - *at) < -rounding(p))
        };
        if !self.planes[..self.count].iter().all(is_inside) {
            return false;
        }
        let (normal, first, bend) = (normal.as_dvec3(), polygon[0].as_dvec3(), bend(polygon, normal));
        // One corner of the ends lies below the polygon's plane and another above it, each by more than the rounding at its own end.
        let beyond = |side: f64| {
            self.corners.iter().zip(self.rules).any(|(corners, rule)| {
                let flat = f64::from(rule.slack() - bend);
                corners.iter().any(|p| side * normal.dot(*p - first) > flat)
            })
        };
        beyond(1.0) && beyond(-1.0)
    }

    /// Whether every segment between the ends crosses a convex polygon, away from the polygon's edges and from both ends.
    fn covered_by(&self, polygon: &[Vec3; 4], normal: Vec3) -> bool {
        // Rounding of the polygon, and of a ray at it that starts at the end with the smaller coordinates.
        let slack =
            EndRule::new(magnitude(*polygon)).slack().max(self.rules[0].slack().min(self.rules[1].slack()));
        if bend(polygon, normal) > slack {
            return false;
        }
        let (polygon, normal) = (polygon.map(|p| p.as_dvec3()), normal.as_dvec3());
        let size = (polygon[2] - polygon[0]).length().max((polygon[3] - polygon[1]).length());
        let rim = (MIN_EDGE_DISTANCE * size).max(2.0 * f64::from(slack));
        let mut edges = [(DVec3::ZERO, DVec3::ZERO); 4];
        for k in 0..4 {
            let inward = normal.cross(polygon[(k + 1) & 3] - polygon[k]).normalize_or_zero();
            edges[k] = (inward, polygon[k] + rim * inward);
        }
        self.corners[0].iter().all(|a| {
            self.corners[1].iter().all(|b| {
                let d = *b - *a;
                let (from, to) = (normal.dot(polygon[0] - *a), normal.dot(polygon[0] - *b));
                let t = from / (from - to);
                let [start, end] = self.rules.map(|rule| 2.0 * f64::from(rule.slack()) / d.length());
                let [below, above] = self.rules.map(|rule| 2.0 * f64::from(rule.height()));
                let at = *a + t * d;
                // Comparisons with NaN are false.
                from.abs() > below
                    && to.abs() > above
                    && t > start
                    && t < 1.0 - end
                    && edges.iter().all(|(n, edge)| *n == DVec3::ZERO || n.dot(at - *edge) > 0.0)
            })
        })
    }
}

/// Largest distance of a quad's corners from its plane.
fn bend(polygon: &[Vec3; 4], normal: Vec3) -> f32 {
    polygon.iter().map(|p| normal.dot(*p - polygon[0]).abs()).fold(0.0, f32::max)
}

/// The certificate of two surfaces that face each other; `before` is that of the surfaces they are parts of.
///
/// The search ends at the first possible blocker. If `blocked` is set (all rays between those surfaces were blocked), the
/// search continues for a polygon that blocks every segment.
pub(super) fn certify(
    elements: &Elements,
    corners: [&[Vec3; 4]; 2],
    normals: [Vec3; 2],
    rules: [EndRule; 2],
    before: BlockerCertificate,
    blocked: bool,
) -> BlockerCertificate {
    if matches!(before, BlockerCertificate::CLEAR | BlockerCertificate::BLOCKED) {
        return before;
    }
    let shaft = Shaft::new(corners, normals, rules);
    let test = |side: u32| -> Option<BlockerCertificate> {
        let s = &elements.sides[side as usize];
        let corners = elements.corners(s);
        if !shaft.meets(corners, s.normal) {
            return None;
        }
        Some(if shaft.covered_by(corners, s.normal) {
            BlockerCertificate::BLOCKED
        } else {
            BlockerCertificate::possible_blocker(side)
        })
    };
    let mut found = BlockerCertificate::CLEAR;
    if let Some(side) = before.side() {
        match test(side) {
            Some(BlockerCertificate::BLOCKED) => return BlockerCertificate::BLOCKED,
            Some(other) if !blocked => return other,
            Some(other) => found = other,
            None => {}
        }
    }
    let mut stack = [0u32; MAX_TESTS + 1];
    let (mut height, mut tests) = (1, 0);
    while height > 0 {
        height -= 1;
        let element = &elements.elements[stack[height] as usize];
        for child in element.child_range() {
            tests += 1;
            if tests > MAX_TESTS {
                return if found == BlockerCertificate::CLEAR { BlockerCertificate::UNKNOWN } else { found };
            }
            match elements.elements[child].shape {
                Shape::Cluster(c) => {
                    // Each test pushes at most one entry, so that the stack is large enough.
                    if shaft.meets_box(&elements.clusters[c as usize].bounds) {
                        stack[height] = child as u32;
                        height += 1;
                    }
                }
                Shape::Surface { side, .. } => match test(side) {
                    Some(BlockerCertificate::BLOCKED) => return BlockerCertificate::BLOCKED,
                    Some(other) if !blocked => return other,
                    Some(other) => found = other,
                    None => {}
                },
            }
        }
    }
    found
}
