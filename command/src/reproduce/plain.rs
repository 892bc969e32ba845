//! The paper's visibility in its plainest form: each segment descends the clusters by itself.
//!
//! The engines of [`mrvis::internals::visibility`] answer bundles of segments sixteen at a time and hand costly ones to Embree. Both hide how the time
//! depends on clusters, leaves and feature sizes, which the paper makes statements about.

use glam::Vec3;
use mrvis::Scene;
use mrvis::internals::clusters::Tree;
use mrvis::internals::math::{Aabb, triangle_area};
use mrvis::internals::{SceneParts, optics};

/// Treatment of leaves that are reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaves {
    /// Their triangles are tested: surface visibility.
    Surfaces,
    /// They transmit according to their extinction: average visibility [Sillion 94]. Leaves that hold faces of emitters are
    /// tested all the same, as in the engines: a surface does not block its own light.
    Extinction,
}

impl Leaves {
    /// Name of images.
    pub fn name(self) -> &'static str {
        match self {
            Leaves::Surfaces => "Exact leaves",
            Leaves::Extinction => "Extinction in leaves, as in the paper",
        }
    }
}

/// A cluster tree with extinction and blocker sizes.
pub struct PlainTree<'a> {
    scene: &'a Scene,
    tree: &'a Tree,
    boxes: Vec<Aabb>,
    extinction: Vec<f32>,
    /// Whether a cluster holds faces of emitters.
    emits: Vec<bool>,
    blocker_size: &'a [f32],
}

/// Visits of clusters and tests of triangles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Visits {
    pub clusters: u64,
    pub triangles: u64,
}

impl Visits {
    pub fn add(&mut self, other: Visits) {
        self.clusters += other.clusters;
        self.triangles += other.triangles;
    }

    /// Those of one of `n` equal runs.
    pub fn of_one(self, n: u64) -> Visits {
        Visits { clusters: self.clusters / n, triangles: self.triangles / n }
    }

    /// Both.
    pub fn all(self) -> u64 {
        self.clusters + self.triangles
    }
}

/// How a segment descends.
#[derive(Clone, Copy, Debug)]
pub struct Descent {
    pub leaves: Leaves,
    /// Width of the emitter and feature size on the receiver; none: no cluster is averaged before its leaves.
    pub sizes: Option<(f32, f32)>,
}

impl<'a> PlainTree<'a> {
    /// A tree over triangles of a scene, with κ = Σ sides·A / 4V [SD95 sec 3.1]. `blocker_size`: BSIZE of each cluster, may be
    /// empty without feature sizes.
    pub fn new(scene: &'a Scene, tree: &'a Tree, blocker_size: &'a [f32]) -> PlainTree<'a> {
        let boxes: Vec<Aabb> = tree.clusters.iter().map(|c| c.bounds.thickened()).collect();
        let area = |c: usize| -> f64 {
            let own = |&t: &u32| {
                let [a, b, c] = scene.corners(t);
                f64::from(scene.parts().triangle_sides[t as usize]) * triangle_area(a, b, c)
            };
            tree.triangles_of(c).iter().map(own).sum()
        };
        let extinction = (0..boxes.len()).map(|c| optics::extinction(area(c), boxes[c])).collect();
        let emits = |c: usize| {
            tree.triangles_of(c).iter().any(|&t| scene.parts().triangle_emitter[t as usize] != u32::MAX)
        };
        let emits = (0..boxes.len()).map(emits).collect();
        PlainTree { scene, tree, boxes, extinction, emits, blocker_size }
    }

    /// Transmittance from a receiver point to an emitter point.
    pub fn transmittance(&self, from: Vec3, to: Vec3, descent: Descent, visits: &mut Visits) -> f32 {
        let segment = Segment { from, direction: to - from, length: from.distance(to) };
        let mut depth = 0.0;
        let mut stack = vec![0usize];
        while let Some(c) = stack.pop() {
            visits.clusters += 1;
            let Some((enter, leave)) = segment.overlap(self.boxes[c]) else { continue };
            let cluster = &self.tree.clusters[c];
            if cluster.is_leaf() && (descent.leaves == Leaves::Surfaces || self.emits[c]) {
                let faces = self.tree.triangles_of(c);
                visits.triangles += faces.len() as u64;
                if faces.iter().any(|&t| segment.hits(self.scene.corners(t))) {
                    return 0.0;
                }
            } else if cluster.is_leaf() || self.is_averaged(c, &segment, (enter, leave), descent) {
                depth += self.extinction[c] * (leave - enter) * segment.length;
            } else {
                stack.extend(cluster.child_range());
            }
        }
        (-depth).exp()
    }

    /// Whether the umbra of the fictitious blocker at the centre of the cluster, projected onto the segment, is smaller than the feature
    /// size [SD95 sec 3.2]. A cluster that holds an end of the segment is opened.
    fn is_averaged(&self, c: usize, segment: &Segment, (enter, leave): (f32, f32), descent: Descent) -> bool {
        let Some((e, s)) = descent.sizes else { return false };
        let (centre, b) = (
            segment.nearest(0.5 * (self.boxes[c].min + self.boxes[c].max)).clamp(enter, leave),
            self.blocker_size[c],
        );
        // The receiver is at parameter 0: d2/d1 = t / (1 − t).
        enter > 0.0 && leave < 1.0 && b + (b - e) * centre / (1.0 - centre) < s
    }
}

/// A segment from a receiver point, at parameter 0, to an emitter point, at 1.
struct Segment {
    from: Vec3,
    direction: Vec3,
    length: f32,
}

/// Part of a segment at its ends on which triangles do not block.
const END: f32 = 1e-5;

impl Segment {
    /// Parameter of the point of the line that is nearest to `point`.
    fn nearest(&self, point: Vec3) -> f32 {
        (point - self.from).dot(self.direction) / (self.length * self.length)
    }

    fn overlap(&self, bounds: Aabb) -> Option<(f32, f32)> {
        let inverse = 1.0 / self.direction;
        let (a, b) = ((bounds.min - self.from) * inverse, (bounds.max - self.from) * inverse);
        let (enter, leave) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(1.0));
        (enter < leave).then_some((enter, leave))
    }

    /// Möller and Trumbore 1997.
    fn hits(&self, [a, b, c]: [Vec3; 3]) -> bool {
        let (u, v) = (b - a, c - a);
        let across = self.direction.cross(v);
        let determinant = u.dot(across);
        let from = self.from - a;
        let (p, q) = (from.dot(across) / determinant, from.cross(u));
        let (r, t) = (self.direction.dot(q) / determinant, v.dot(q) / determinant);
        p >= 0.0 && r >= 0.0 && p + r <= 1.0 && (END..=1.0 - END).contains(&t)
    }
}
