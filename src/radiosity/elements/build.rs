//! Builds the tree of elements from a scene and its cluster hierarchy.

use super::lit_sides::lit_sides;
use super::subdivision::surface;
use super::{Cluster, DIRECTIONS, Element, ElementState, Elements, Shape, Side, SideSampler, facing};
use crate::clusters::{Hierarchy, Tree};
use crate::math::parallel;
use crate::math::{Aabb, triangle_normal};
use crate::model::face_magnitudes;
use crate::ray::EndRule;
use crate::scene::Scene;
use glam::Vec3;
use rustc_hash::FxHashSet;

/// Largest number of subdivisions of a side: parts of 2⁻²⁰ of its width are 16 roundings of its coordinates wide.
const MAX_LEVEL: u32 = 20;
/// The same in scenes with placed meshes, where 64 bits hold the number of a side and the place of a part within it
/// ([`Elements::surface_id`]).
pub(super) const MAX_PLACED_LEVEL: u32 = 14;
/// Bits of the ids of all elements: four times an id is a seed of 64 bits.
const ID_BITS: u32 = 61;

impl Elements {
    /// The elements of a scene before subdivision: its clusters and the sides that light can reach.
    ///
    /// `min_area` (scene units squared, above 0) limits subdivision. `open` lists the parts of the scene that are known to be lit
    /// on both sides, closed or not ([`lit_inside`](super::lit_inside)).
    pub fn build(scene: &Scene, hierarchy: &Hierarchy, min_area: f64, open: &[u32]) -> Elements {
        Elements::of_lit(scene, hierarchy, min_area, &lit_sides(scene, open))
    }

    /// The same elements without the sides in `unlit` (ascending indices), which no light reaches.
    pub fn without(self, unlit: &[u32], scene: &Scene, hierarchy: &Hierarchy) -> Elements {
        let lit = |side: u32, front: bool| {
            let is_own = self.sides.get(side as usize).is_some_and(|side| side.front == front);
            is_own && unlit.binary_search(&side).is_err()
        };
        let of_face = |&[front, back]: &[u32; 2]| [lit(front, true), lit(back, false)];
        let lit: Vec<[bool; 2]> = self.sides_of_triangle.iter().map(of_face).collect();
        let sides = unlit.iter().map(|&side| &self.sides[side as usize]);
        let dark = sides.map(|side| (side.clone(), *self.corners(side))).collect();
        Elements { dark, ..Elements::of_lit(scene, hierarchy, self.min_area, &lit) }
    }

    /// The elements for given lit sides of each face, front and back.
    fn of_lit(scene: &Scene, hierarchy: &Hierarchy, min_area: f64, lit: &[[bool; 2]]) -> Elements {
        let trees: Vec<&Tree> =
            [&hierarchy.micro, &hierarchy.large].into_iter().filter(|t| !t.clusters.is_empty()).collect();
        // The root, the roots of the trees, then the other clusters tree by tree.
        let magnitudes = face_magnitudes(scene);
        let roots = (0..=trees.len()).map(|_| NewCluster::new(0, 0, [0, 0])).collect();
        let mut build = Build { clusters: roots, sides: Vec::new() };
        let root = &mut build.clusters[0].element;
        (root.first_child, root.children) = (1, trees.len() as u16);
        let mut large_from = 0;
        for (k, tree) in trees.iter().enumerate() {
            build.tree(scene, &magnitudes, tree, 1 + k as u32, lit);
            if std::ptr::eq(*tree, &hierarchy.micro) {
                large_from = build.sides.len() as u32;
            }
        }
        build.clusters[0].sides = [0, build.sides.len() as u32];
        Elements { large_from, ..build.finish(scene, min_area) }
    }
}

/// One side with its corners.
struct NewSide {
    side: Side,
    corners: [glam::Vec3; 4],
}

/// One cluster element with its range of sides.
struct NewCluster {
    element: Element,
    sides: [u32; 2],
}

impl NewCluster {
    fn new(cluster: u32, parent: u32, sides: [u32; 2]) -> NewCluster {
        let element = Element { shape: Shape::Cluster(cluster), parent, ..surface(0, [glam::Vec3::ZERO; 4]) };
        NewCluster { element, sides }
    }
}

/// The range of sides of a cluster before its sides are known.
const NO_SIDES: [u32; 2] = [u32::MAX, 0];

/// Elements under construction: all clusters come first, sides are appended below them.
struct Build {
    clusters: Vec<NewCluster>,
    sides: Vec<NewSide>,
}

impl Build {
    fn tree(&mut self, scene: &Scene, magnitudes: &[f32], tree: &Tree, root: u32, lit: &[[bool; 2]]) {
        let base = self.clusters.len() as u32 - 1;
        let place = |c: usize| if c == 0 { root } else { base + c as u32 };
        for cluster in &tree.clusters[1..] {
            let (index, parent) = (self.clusters.len() as u32, place(cluster.parent as usize));
            self.clusters.push(NewCluster::new(index, parent, NO_SIDES));
        }
        self.clusters[root as usize].element.shape = Shape::Cluster(root);
        self.clusters[root as usize].sides = NO_SIDES;
        for (c, cluster) in tree.clusters.iter().enumerate().filter(|(_, c)| !c.is_leaf()) {
            let e = &mut self.clusters[place(c) as usize].element;
            (e.first_child, e.children) = (place(cluster.first_child as usize), cluster.children as u16);
        }
        // Leaves in the order of their triangles: the sides of every cluster become consecutive.
        let mut leaves: Vec<usize> =
            (0..tree.clusters.len()).filter(|&c| tree.clusters[c].is_leaf()).collect();
        leaves.sort_by_key(|&c| tree.clusters[c].first_triangle);
        let made: Vec<Vec<NewSide>> =
            parallel::map(&leaves, |&c| sides_of(scene, magnitudes, tree.triangles_of(c), lit));
        for (&c, made) in leaves.iter().zip(made) {
            let first = self.sides.len() as u32;
            self.sides.extend(made);
            self.clusters[place(c) as usize].sides = [first, self.sides.len() as u32];
        }
        for c in (1..tree.clusters.len()).rev() {
            let [from, to] = self.clusters[place(c) as usize].sides;
            let range = &mut self.clusters[place(tree.clusters[c].parent as usize) as usize].sides;
            *range = [range[0].min(from), range[1].max(to)];
        }
    }

    /// Appends the sides below their clusters and computes the properties of clusters.
    fn finish(self, scene: &Scene, min_area: f64) -> Elements {
        let Build { clusters, sides: mut new_sides } = self;
        let ranges: Vec<[u32; 2]> = clusters.iter().map(|c| c.sides).collect();
        let mut elements: Vec<Element> = Vec::new();
        for cluster in clusters {
            elements.push(cluster.element);
        }
        for (c, [from, to]) in ranges.iter().copied().enumerate() {
            if !elements[c].is_leaf() {
                continue;
            }
            (elements[c].first_child, elements[c].children) = (elements.len() as u32, (to - from) as u16);
            for s in from..to {
                let NewSide { side, corners } = &mut new_sides[s as usize];
                side.element = elements.len() as u32;
                elements.push(Element { parent: c as u32, ..surface(s, *corners) });
            }
        }
        let mut sides: Vec<Side> = Vec::new();
        for NewSide { side, .. } in new_sides {
            sides.push(side);
        }
        let areas = sides.iter().map(|s| elements[s.element as usize].area);
        let samples = SideSampler::new(areas.zip(sides.iter().map(|s| facing(s.normal))));
        let made: Vec<Cluster> = parallel::map(&ranges, |&range| cluster(range, &elements, &sides, &samples));
        for (element, cluster) in elements.iter_mut().zip(&made) {
            element.area = samples.of_range(cluster.sides)[DIRECTIONS];
            element.centre = cluster.bounds.center();
            element.radius = 0.5 * cluster.bounds.diagonal();
        }
        let instances = scene.triangles_of_instances();
        let deepest = if instances.len() > 1 { MAX_PLACED_LEVEL } else { MAX_LEVEL };
        number(&mut elements, sides.len(), deepest);
        let mut sides_of_triangle = vec![[Elements::NONE; 2]; scene.triangles.len()];
        for (s, side) in sides.iter().enumerate() {
            for t in side.triangles {
                sides_of_triangle[t as usize][usize::from(!side.front)] = s as u32;
            }
        }
        // Fine ground has slopes in all directions: a ray that meets it from above may meet the face that represents it from below.
        let is_fine = |t: usize| scene.fine_ground.as_ref().is_some_and(|ground| ground.replaces(t as u32));
        for (_, [front, back]) in sides_of_triangle.iter_mut().enumerate().filter(|(t, _)| is_fine(*t)) {
            match (*front, *back) {
                (Elements::NONE, only) => *front = only,
                (only, Elements::NONE) => *back = only,
                _ => {}
            }
        }
        let area = elements[0].area;
        Elements {
            states: vec![ElementState::DARK; elements.len()],
            elements,
            clusters: made,
            sides,
            sides_of_triangle,
            area,
            large_from: 0,
            min_area,
            dark: Vec::new(),
            samples,
            instances,
        }
    }
}

/// The lit sides of the faces of a leaf; `magnitudes` are [`Scene::face_magnitudes`].
fn sides_of(scene: &Scene, magnitudes: &[f32], faces: &[u32], lit: &[[bool; 2]]) -> Vec<NewSide> {
    let mut made = Vec::new();
    for (triangles, corners) in quads(scene, faces) {
        let t = triangles[0] as usize;
        let [a, b, c] = scene.corners(triangles[0]);
        for front in [true, false].into_iter().filter(|&front| lit[t][usize::from(!front)]) {
            let [p, q, r, s] = corners;
            // The first diagonal remains the edge between the two faces.
            let turned = if r == s { [r, q, p, p] } else { [r, q, p, s] };
            let normal = triangle_normal(a, b, c);
            let material = &scene.materials[scene.triangle_material[t] as usize];
            let emits = front || (scene.two_sided_emission && material.profile.is_none());
            let exitance =
                material.emission.map(|l| if emits { std::f64::consts::PI * f64::from(l) } else { 0.0 });
            let side = Side {
                triangles,
                normal: if front { normal } else { -normal },
                end: EndRule::new(triangles.map(|t| magnitudes[t as usize]).into_iter().fold(0.0, f32::max)),
                front,
                reflectance: scene.triangle_reflectance[t],
                exitance,
                profile: material.profile.clone().filter(|_| front),
                element: 0,
            };
            made.push(NewSide { side, corners: if front { corners } else { turned } });
        }
    }
    made
}

fn cluster(range: [u32; 2], elements: &[Element], sides: &[Side], samples: &SideSampler) -> Cluster {
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

/// Gives every element a range of ids for all possible elements below it: as many levels as the bits of ids have room for, at most
/// `deepest`.
fn number(elements: &mut [Element], sides: usize, deepest: u32) {
    let levels = ((ID_BITS - sides.max(1).ilog2()) / 2 - 1).min(deepest);
    let mut size = vec![1u64; elements.len()];
    for e in (0..elements.len()).rev() {
        if !elements[e].is_cluster() {
            size[e] = ((1u64 << (2 * (levels + 1))) - 1) / 3;
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

/// Groups faces into single triangles and pairs that are convex planar quads of one object, material and part; pairs with the
/// longest shared edge come first. The corners are counterclockwise; a triangle repeats its last corner.
pub(super) fn quads(scene: &Scene, faces: &[u32]) -> Vec<([u32; 2], [Vec3; 4])> {
    let edge = |t: u32, i: usize| {
        let v = scene.triangles[t as usize];
        let (a, b) = (v[i], v[(i + 1) % 3]);
        ((a.min(b), a.max(b)), t, i)
    };
    let mut edges: Vec<_> = faces.iter().flat_map(|&t| (0..3).map(move |i| edge(t, i))).collect();
    edges.sort_unstable();
    let mut pairs: Vec<(f32, [u32; 2], [Vec3; 4])> = edges
        .chunk_by(|a, b| a.0 == b.0)
        .filter_map(|uses| match *uses {
            [(_, t, i), (_, u, j)] => quad(scene, t, i, u, j),
            _ => None,
        })
        .collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut used = FxHashSet::default();
    let mut groups: Vec<([u32; 2], [Vec3; 4])> = Vec::new();
    for (_, pair, corners) in pairs {
        if !used.contains(&pair[0]) && !used.contains(&pair[1]) {
            used.extend(pair);
            groups.push((pair, corners));
        }
    }
    for &t in faces.iter().filter(|t| !used.contains(*t)) {
        let [a, b, c] = scene.corners(t);
        groups.push(([t, t], [a, b, c, c]));
    }
    groups.sort_by_key(|(triangles, _)| *triangles);
    groups
}

/// The quad of two faces that share an edge, `i` of the one and `j` of the other, with the length of that edge.
fn quad(scene: &Scene, t: u32, i: usize, u: u32, j: usize) -> Option<(f32, [u32; 2], [Vec3; 4])> {
    let alike = |of: &[u32]| of[t as usize] == of[u as usize];
    let (v, w) = (scene.triangles[t as usize], scene.triangles[u as usize]);
    let same = alike(&scene.triangle_object)
        && alike(&scene.triangle_material)
        && alike(&scene.triangle_component)
        && alike(&scene.triangle_emitter)
        && scene.triangle_reflectance[t as usize] == scene.triangle_reflectance[u as usize]
        && scene.triangle_sides[t as usize] == scene.triangle_sides[u as usize]
        // Equal winding: the faces run through the edge in opposite directions.
        && v[i] == w[(j + 1) % 3];
    if !same {
        return None;
    }
    let at = |v: u32| scene.positions[v as usize];
    // In order: start of the edge, third corner of the other face, end of the edge, third corner of this face.
    let corners = [at(v[i]), at(w[(j + 2) % 3]), at(v[(i + 1) % 3]), at(v[(i + 2) % 3])];
    let n: [Vec3; 4] = std::array::from_fn(|k| {
        let (a, b, c) = (corners[(k + 3) % 4], corners[k], corners[(k + 1) % 4]);
        triangle_normal(a, b, c)
    });
    // Convex, without a straight corner, and in one plane.
    let planar = n.iter().all(|m| m.dot(n[0]) > 1.0 - 1e-6);
    planar.then(|| ((corners[2] - corners[0]).length(), [t, u], corners))
}
