//! The paper's visibility in its plainest form: each segment descends the clusters by itself.
//!
//! The engines of [`mrvis::internals::visibility`] answer bundles of segments sixteen at a time and hand costly ones to Embree. Both hide
//! how the time depends on clusters, leaves and feature sizes, which the paper makes statements about.
//!
//! Clusters of the k-d tree of Sillion 94 fill their cells here. The builder of [`mrvis::internals::clusters`] fits boxes to their
//! contents, which mends much of what the paper found missing: in a cell most of a desk's extinction is spread over air.

use glam::Vec3;
use mrvis::Scene;
use mrvis::internals::clusters::{Cluster, FAN_OUT, Tree};
use mrvis::internals::math::{Aabb, triangle_area};
use mrvis::internals::optics;

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

    /// Counts of one of `n` equal runs.
    pub fn of_one(self, n: u64) -> Visits {
        Visits { clusters: self.clusters / n, triangles: self.triangles / n }
    }

    /// Sum of visits and tests.
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

/// Fraction of a segment at its ends on which triangles do not block: surfaces that the ends lie on, in spite of rounding in single
/// precision.
const END_FRACTION: f32 = 1e-5;

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
        p >= 0.0 && r >= 0.0 && p + r <= 1.0 && (END_FRACTION..=1.0 - END_FRACTION).contains(&t)
    }
}

/// Number of halvings, at most: 20 an axis.
const MAX_HALVINGS: usize = 60;

/// A cell with what it holds.
struct KdCell {
    bounds: Aabb,
    parent: usize,
    faces: Vec<u32>,
    halvings: usize,
    /// Whether it holds the triangles that a plane cuts, which are not divided further.
    is_cut: bool,
}

/// The tree over some triangles of a scene, as we read [Sillion 94]: cells are halved in the middle of their longest edge until they hold
/// at most [`FAN_OUT`] triangles; what the plane cuts becomes a cell that is not divided, so that leaves may hold more triangles than
/// that.
pub fn cell_tree(scene: &Scene, faces: &[u32]) -> Tree {
    let bounds = |faces: &[u32]| Aabb::of(faces.iter().flat_map(|&t| scene.corners(t)));
    let first =
        KdCell { bounds: bounds(faces), parent: 0, faces: faces.to_vec(), halvings: 0, is_cut: false };
    let mut cells = vec![first];
    let mut tree = Tree::default();
    while let Some(cell) = cells.get(tree.clusters.len()) {
        let (here, first_child) = (tree.clusters.len(), cells.len() as u32);
        let divides = cell.faces.len() > FAN_OUT && !cell.is_cut && cell.halvings < MAX_HALVINGS;
        let children = if divides { halves(scene, cell, here) } else { Vec::new() };
        tree.clusters.push(Cluster {
            bounds: cell.bounds,
            parent: cell.parent as u32,
            first_child: if children.is_empty() { 0 } else { first_child },
            children: children.len() as u32,
            first_triangle: 0,
            triangles: cell.faces.len() as u32,
        });
        cells.extend(children);
    }
    // Triangles leaf by leaf in depth-first order.
    let mut stack = vec![0usize];
    while let Some(c) = stack.pop() {
        tree.clusters[c].first_triangle = tree.order.len() as u32;
        if tree.clusters[c].is_leaf() {
            tree.order.extend(&cells[c].faces);
        }
        stack.extend(tree.clusters[c].child_range().rev());
    }
    tree
}

fn halves(scene: &Scene, cell: &KdCell, here: usize) -> Vec<KdCell> {
    let axis = cell.bounds.extent().max_position();
    let middle = 0.5 * (cell.bounds.min[axis] + cell.bounds.max[axis]);
    let mut parts = [Vec::new(), Vec::new(), Vec::new()];
    for &t in &cell.faces {
        let Aabb { min, max } = Aabb::of(scene.corners(t));
        let part = if max[axis] <= middle {
            0
        } else if min[axis] >= middle {
            1
        } else {
            2
        };
        parts[part].push(t);
    }
    let mut bounds = [cell.bounds; 3];
    (bounds[0].max[axis], bounds[1].min[axis]) = (middle, middle);
    let made = parts.into_iter().zip(bounds).enumerate().map(|(k, (faces, bounds))| KdCell {
        bounds,
        parent: here,
        faces,
        halvings: cell.halvings + 1,
        is_cut: k == 2,
    });
    made.filter(|cell| !cell.faces.is_empty()).collect()
}
