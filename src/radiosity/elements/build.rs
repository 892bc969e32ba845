//! From a scene and its hierarchy to the tree of elements.

use super::split::surface;
use super::{Cluster, DIRECTIONS, Element, Elements, Samples, Shape, Side, facing, sides};
use crate::clusters::{Hierarchy, Tree};
use crate::math::{Aabb, triangle_normal};
use crate::scene::Scene;
use rayon::prelude::*;

/// Largest number of times a side may be split: what the ranges of ids leave room for.
const MAX_LEVEL: u32 = 14;

impl Elements {
    /// The elements of a scene: its clusters and the sides that light can reach, nothing split yet.
    ///
    /// `min_area` (scene units squared, above 0) bounds what splitting makes. Parts of the scene that are known to be lit
    /// on both sides are `open`, closed or not ([`lit_inside`](super::lit_inside)).
    pub fn build(scene: &Scene, hierarchy: &Hierarchy, min_area: f64, open: &[u32]) -> Elements {
        Elements::of_seen(scene, hierarchy, min_area, &sides::seen(scene, open))
    }

    /// The same elements without some sides (ascending indices), which no light reaches.
    pub fn without(self, unlit: &[u32], scene: &Scene, hierarchy: &Hierarchy) -> Elements {
        let lit = |side: u32| side != Elements::NONE && unlit.binary_search(&side).is_err();
        let seen: Vec<[bool; 2]> = self.sides_of_triangle.iter().map(|sides| sides.map(lit)).collect();
        Elements::of_seen(scene, hierarchy, self.min_area, &seen)
    }

    /// With the sides of each face, front and back, that light can reach.
    fn of_seen(scene: &Scene, hierarchy: &Hierarchy, min_area: f64, seen: &[[bool; 2]]) -> Elements {
        let trees: Vec<&Tree> =
            [&hierarchy.micro, &hierarchy.large].into_iter().filter(|t| !t.clusters.is_empty()).collect();
        let mut build = Build {
            elements: vec![group(0, 0)],
            ranges: vec![[0, 0]],
            sides: Vec::new(),
            corners: Vec::new(),
        };
        // The roots of the trees are neighbours; then come the other clusters, tree by tree.
        for _ in &trees {
            build.elements.push(group(0, 0));
            build.ranges.push([0, 0]);
        }
        (build.elements[0].first_child, build.elements[0].children) = (1, trees.len() as u16);
        let mut large_from = 0;
        for (k, tree) in trees.iter().enumerate() {
            build.tree(scene, tree, 1 + k as u32, seen);
            if std::ptr::eq(*tree, &hierarchy.micro) {
                large_from = build.sides.len() as u32;
            }
        }
        build.ranges[0] = [0, build.sides.len() as u32];
        Elements { large_from, ..build.finish(scene, min_area) }
    }
}

fn group(cluster: u32, parent: u32) -> Element {
    Element { shape: Shape::Cluster(cluster), parent, ..surface(0, [glam::Vec3::ZERO; 4]) }
}

/// Elements under construction: clusters first, each with its range of sides.
struct Build {
    elements: Vec<Element>,
    ranges: Vec<[u32; 2]>,
    sides: Vec<Side>,
    corners: Vec<[glam::Vec3; 4]>,
}

impl Build {
    fn tree(&mut self, scene: &Scene, tree: &Tree, root: u32, seen: &[[bool; 2]]) {
        let base = self.elements.len() as u32 - 1;
        let place = |c: usize| if c == 0 { root } else { base + c as u32 };
        for cluster in &tree.clusters[1..] {
            self.elements.push(group(self.elements.len() as u32, place(cluster.parent as usize)));
            self.ranges.push([u32::MAX, 0]);
        }
        self.elements[root as usize].shape = Shape::Cluster(root);
        self.ranges[root as usize] = [u32::MAX, 0];
        for (c, cluster) in tree.clusters.iter().enumerate().filter(|(_, c)| !c.is_leaf()) {
            let e = &mut self.elements[place(c) as usize];
            (e.first_child, e.children) = (place(cluster.first_child as usize), cluster.children as u16);
        }
        // Leaves in the order of their triangles, so that the sides of every cluster are neighbours.
        let mut leaves: Vec<usize> =
            (0..tree.clusters.len()).filter(|&c| tree.clusters[c].is_leaf()).collect();
        leaves.sort_by_key(|&c| tree.clusters[c].first_triangle);
        let made: Vec<Vec<(Side, [glam::Vec3; 4])>> =
            leaves.par_iter().map(|&c| sides_of(scene, tree.triangles_of(c), seen)).collect();
        for (&c, made) in leaves.iter().zip(made) {
            let first = self.sides.len() as u32;
            for (side, corners) in made {
                self.sides.push(side);
                self.corners.push(corners);
            }
            self.ranges[place(c) as usize] = [first, self.sides.len() as u32];
        }
        for c in (1..tree.clusters.len()).rev() {
            let [from, to] = self.ranges[place(c) as usize];
            let range = &mut self.ranges[place(tree.clusters[c].parent as usize) as usize];
            *range = [range[0].min(from), range[1].max(to)];
        }
    }

    /// Hangs the sides below their clusters and sums up.
    fn finish(mut self, scene: &Scene, min_area: f64) -> Elements {
        let clusters = self.elements.len();
        for c in 0..clusters {
            if !self.elements[c].is_leaf() {
                continue;
            }
            let [from, to] = self.ranges[c];
            (self.elements[c].first_child, self.elements[c].children) =
                (self.elements.len() as u32, (to - from) as u16);
            for s in from..to {
                self.sides[s as usize].element = self.elements.len() as u32;
                self.elements.push(Element { parent: c as u32, ..surface(s, self.corners[s as usize]) });
            }
        }
        let Build { mut elements, ranges, sides, .. } = self;
        let areas = sides.iter().map(|s| elements[s.element as usize].area);
        let samples = Samples::new(areas.zip(sides.iter().map(|s| facing(s.normal))));
        let made: Vec<Cluster> =
            ranges.iter().map(|&range| cluster(range, &elements, &sides, &samples)).collect();
        for (element, cluster) in elements.iter_mut().zip(&made) {
            element.area = samples.of_range(cluster.sides)[DIRECTIONS];
            element.centre = cluster.bounds.center();
            element.radius = 0.5 * cluster.bounds.diagonal();
        }
        number(&mut elements, min_area);
        let mut sides_of_triangle = vec![[Elements::NONE; 2]; scene.triangles.len()];
        for (s, side) in sides.iter().enumerate() {
            for t in side.triangles {
                sides_of_triangle[t as usize][usize::from(!side.front)] = s as u32;
            }
        }
        let area = elements[0].area;
        Elements {
            elements,
            clusters: made,
            sides,
            sides_of_triangle,
            area,
            large_from: 0,
            min_area,
            samples,
        }
    }
}

/// The seen sides of the faces of a leaf.
fn sides_of(scene: &Scene, faces: &[u32], seen: &[[bool; 2]]) -> Vec<(Side, [glam::Vec3; 4])> {
    let mut made = Vec::new();
    for (triangles, corners) in sides::quads(scene, faces) {
        let t = triangles[0] as usize;
        let [a, b, c] = scene.corners(triangles[0]);
        for front in [true, false].into_iter().filter(|&front| seen[t][usize::from(!front)]) {
            let [p, q, r, s] = corners;
            // The first diagonal stays the edge of the two faces.
            let turned = if r == s { [r, q, p, p] } else { [r, q, p, s] };
            let normal = triangle_normal(a, b, c);
            let emits = front || scene.two_sided_emission;
            let emission = scene.materials[scene.triangle_material[t] as usize].emission;
            let exitance = emission.map(|l| if emits { std::f64::consts::PI * f64::from(l) } else { 0.0 });
            let side = Side {
                triangles,
                normal: if front { normal } else { -normal },
                front,
                reflectance: scene.triangle_reflectance[t],
                exitance,
                element: 0,
            };
            made.push((side, if front { corners } else { turned }));
        }
    }
    made
}

fn cluster(range: [u32; 2], elements: &[Element], sides: &[Side], samples: &Samples) -> Cluster {
    let within = &sides[range[0] as usize..range[1] as usize];
    let (mut bounds, mut reflectance) = (Aabb::EMPTY, 0.0);
    for side in within {
        let element = &elements[side.element as usize];
        let Shape::Surface { corners, .. } = element.shape else { continue };
        bounds = bounds.union(Aabb::of(corners));
        reflectance += element.area * f64::from(side.reflectance.iter().sum::<f32>()) / 3.0;
    }
    let sums = samples.of_range(range);
    Cluster {
        bounds: if within.is_empty() { Aabb::of([glam::Vec3::ZERO]) } else { bounds },
        sides: range,
        projected: std::array::from_fn(|k| sums[k]),
        reflectance: if sums[DIRECTIONS] > 0.0 { (reflectance / sums[DIRECTIONS]) as f32 } else { 0.0 },
    }
}

/// Gives every element a range of ids that holds all there can be below it (method B.3).
fn number(elements: &mut [Element], min_area: f64) {
    let mut size = vec![1u64; elements.len()];
    for e in (0..elements.len()).rev() {
        if !elements[e].is_cluster() {
            let levels = (elements[e].area / min_area).log(4.0).max(0.0).floor() as u32;
            size[e] = ((1u64 << (2 * (levels.min(MAX_LEVEL) + 1))) - 1) / 3;
        }
        if e > 0 {
            size[elements[e].parent as usize] += size[e];
        }
    }
    elements[0].ids = [0, size[0]];
    for e in 0..elements.len() {
        let mut start = elements[e].ids[0] + 1;
        for child in elements[e].child_range() {
            elements[child].ids = [start, start + size[child]];
            start += size[child];
        }
    }
}
