//! Division of faces whose coordinates are too coarse for small things near them.
//!
//! Positions have a rounding error in proportion to their largest coordinate, and rays start above a face by some of its errors: .1 m
//! above a floor of 100 km. A lamp of 1 m that stands there would light it from below that height. Parts of the floor near the lamp have
//! coordinates as small as those of the lamp. Division helps near the origin of the scene, therefore, where most of its polygons are.

use super::{
    Repairs, Soup,
    connect::Parts,
    faces::{Triangles, has_area},
    magnitudes::magnitude,
    names,
};
use crate::math::Aabb;
use crate::math::parallel;
use glam::Vec3;
use rustc_hash::FxHashMap;
use std::collections::VecDeque;

/// Height at which rays start above a face, relative to its largest coordinate (`ray::EndRule::height`).
const RAY_START_HEIGHT: f32 = 2e-6;
/// Largest start height of rays relative to the size of a small part near the face, or to its distance if that is more. Floors of 10 km
/// below a lamp of 1 m have direct light within .1 % and paths within 1 %.
const MAX_COARSE: f32 = 0.01;
/// The same limit for the halves of a divided face: their neighbours, which count for rounding as well, are up to four times as large.
const MAX_FINE: f32 = 0.25 * MAX_COARSE;
/// Smallest ratio of the largest coordinate of a face to that of a thing for which the face is divided. Parts of the face beside the
/// thing have the coordinates of the thing, so that rays start lower by this ratio at most.
const MIN_GAIN: f32 = 2.0;
/// Largest number of pairs of a face and a thing that are compared: some 0.2 s. Of more, all that emit are compared, and others evenly
/// spread.
const MAX_PAIRS: usize = 100_000_000;
/// Largest number of triangles that are divided before another one: limits the time of one division. Edges that grow slightly from
/// triangle to triangle make a long chain.
const MAX_CHAIN: usize = 256;
/// Largest number of triangles that are added to a scene. A lamp on a floor of 1,000 km needs 300.
const MAX_ADDED: usize = 1 << 16;

/// Divides the triangles that are too coarse for connected parts of the scene near them, at their longest edges, with all that share these.
pub(super) fn divide(
    faces: &mut Triangles,
    parts: &Parts,
    positions: &mut Vec<Vec3>,
    soup: &Soup,
    repairs: &mut Repairs,
) {
    let coarse = coarse(faces, parts, positions, soup);
    let Some((things, coarse)) = coarse else { return };
    let mut names: Vec<u32> = coarse.iter().map(|(t, _)| faces.object[*t as usize]).collect();
    names.sort_unstable();
    names.dedup();
    let before = faces.triangles.len();
    let mut division = Division::new(faces, positions, coarse);
    division.run(&things);
    division.finish();
    let added = faces.triangles.len() - before;
    if added == 0 {
        return;
    }
    repairs.divided_faces += added;
    repairs.messages.push(format!(
        "{} added: faces of {} are so large that rounding of their coordinates would show near small things, and were divided there",
        names::counted(added, "triangle"),
        names::some_names(names.iter().map(|&object| &soup.objects[object as usize]))
    ));
}

/// Triangles with the numbers of the things that they are too coarse for.
type Coarse = Vec<(u32, Vec<u32>)>;

/// Things, and the triangles that are too coarse for some of them with the numbers of these; none if there are none.
fn coarse(faces: &Triangles, parts: &Parts, positions: &[Vec3], soup: &Soup) -> Option<(Vec<Part>, Coarse)> {
    let place = |t: &u32| faces.triangles[*t as usize].map(|v| positions[v as usize]);
    // A face that reaches from its largest coordinate to a thing with less than half of that is about as large.
    let is_wide = |t: &u32| {
        let corners = place(t);
        Aabb::of(corners).extent().max_element() > 0.4 * magnitude(corners)
    };
    let wide: Vec<u32> = (0..faces.triangles.len() as u32).filter(is_wide).collect();
    let largest = wide.iter().map(|t| magnitude(place(t))).fold(0.0, f32::max);
    let (lamps, others): (Vec<Part>, Vec<Part>) =
        things(faces, parts, positions, soup, largest).into_iter().partition(|thing| thing.emits);
    let step = (others.len().saturating_mul(wide.len())).div_ceil(MAX_PAIRS).max(1);
    let things: Vec<Part> = lamps.into_iter().chain(others.into_iter().step_by(step)).collect();
    let near = |t: &u32| {
        let (corners, all) = (place(t), 0..things.len() as u32);
        let (own, magnitude) = (Aabb::of(corners), magnitude(corners));
        let is_near = |i: &u32| things[*i as usize].is_too_small_for(&own, magnitude, MAX_COARSE);
        let near: Vec<u32> = all.filter(is_near).collect();
        (!near.is_empty()).then_some((*t, near))
    };
    let coarse: Coarse = parallel::flat_map(&wide, near);
    (!coarse.is_empty()).then_some((things, coarse))
}

/// A connected part of the scene.
struct Part {
    bounds: Aabb,
    size: f32,
    magnitude: f32,
    emits: bool,
}

impl Part {
    /// Whether rays that start from a face with these bounds and this largest coordinate start too high for the thing, which division
    /// helps.
    fn is_too_small_for(&self, face: &Aabb, magnitude: f32, coarse: f32) -> bool {
        if magnitude <= MIN_GAIN * self.magnitude || RAY_START_HEIGHT * magnitude <= coarse * self.size {
            return false;
        }
        let gap = (self.bounds.min - face.max).max(face.min - self.bounds.max).max(Vec3::ZERO);
        RAY_START_HEIGHT * magnitude > coarse * gap.length()
    }
}

/// The parts of the scene that are too small for a face with this largest coordinate.
fn things(faces: &Triangles, parts: &Parts, positions: &[Vec3], soup: &Soup, largest: f32) -> Vec<Part> {
    let mut all = vec![(Aabb::EMPTY, false); parts.closed.len()];
    for (t, corners) in faces.triangles.iter().enumerate() {
        let (bounds, emits) = &mut all[parts.part[faces.polygon[t] as usize] as usize];
        *bounds = bounds.union(Aabb::of(corners.map(|v| positions[v as usize])));
        *emits |= soup.materials[faces.material[t] as usize].emission != [0.0; 3];
    }
    let thing = |(bounds, emits): (Aabb, bool)| {
        let (size, magnitude) = (bounds.diagonal(), magnitude([bounds.min, bounds.max]));
        let is_small = size > 0.0 && RAY_START_HEIGHT * largest > MAX_COARSE * size;
        is_small.then_some(Part { bounds, size, magnitude, emits })
    };
    all.into_iter().filter(|(own, _)| own.min.x <= own.max.x).filter_map(thing).collect()
}

/// Vertices of an edge, the smaller number first.
type Edge = [u32; 2];

/// Triangles that are being divided.
struct Division<'a> {
    faces: &'a mut Triangles,
    positions: &'a mut Vec<Vec3>,
    /// By triangle, the one of the file that it is a part of.
    whole: Vec<u32>,
    /// Whether a triangle has not been replaced by its parts.
    is_left: Vec<bool>,
    /// By triangle, the things that those of the file were too coarse for.
    near: Vec<Vec<u32>>,
    /// Triangles that may have to be divided.
    queue: VecDeque<u32>,
    /// Triangles at each edge.
    at_edge: FxHashMap<Edge, Vec<u32>>,
    /// The vertex at each position.
    vertices: FxHashMap<[u32; 3], u32>,
}

impl Division<'_> {
    fn new<'a>(faces: &'a mut Triangles, positions: &'a mut Vec<Vec3>, coarse: Coarse) -> Division<'a> {
        let count = faces.triangles.len();
        let mut near = vec![Vec::new(); count];
        let queue = coarse.iter().map(|(t, _)| *t).collect();
        coarse.into_iter().for_each(|(t, things)| near[t as usize] = things);
        let mut at_edge: FxHashMap<Edge, Vec<u32>> = FxHashMap::default();
        for (t, &corners) in (0..).zip(&faces.triangles) {
            edges(corners).into_iter().for_each(|edge| at_edge.entry(edge).or_default().push(t));
        }
        let vertices =
            (0..).zip(positions.iter()).map(|(v, p)| (p.to_array().map(f32::to_bits), v)).collect();
        let (whole, is_left) = ((0..count as u32).collect(), vec![true; count]);
        Division { faces, positions, whole, is_left, near, queue, at_edge, vertices }
    }

    /// Divides triangles as long as they are too coarse for some of the things, the largest first.
    fn run(&mut self, things: &[Part]) {
        let most = self.is_left.len() + 2 * MAX_ADDED;
        while let Some(t) = self.queue.pop_front() {
            let corners = self.faces.triangles[t as usize].map(|v| self.positions[v as usize]);
            let (own, magnitude) = (Aabb::of(corners), magnitude(corners));
            self.near[t as usize].retain(|&i| things[i as usize].is_too_small_for(&own, magnitude, MAX_FINE));
            if self.is_left[t as usize] && !self.near[t as usize].is_empty() && self.is_left.len() < most {
                self.bisect(t);
            }
        }
    }

    /// Divides a triangle at its longest edge, with the others at that edge. If one of these has a longer edge, it is divided there
    /// first, and so on (Rivara 1984), so that triangles meet along whole edges. Triangles at the end of a long chain, and those without
    /// two parts of an area, stay.
    fn bisect(&mut self, t: u32) {
        let mut path = vec![t];
        while let Some(&t) = path.last() {
            let edge = self.longest_edge(t);
            match self.at_edge[&edge].iter().copied().find(|&u| self.longest_edge(u) != edge) {
                Some(longer) if path.len() < MAX_CHAIN => path.push(longer),
                Some(_) => return,
                None if self.divide_at(edge) => _ = path.pop(),
                None => return,
            }
        }
    }

    /// Divides all triangles at an edge; none if one of them would have a part without an area.
    fn divide_at(&mut self, edge: Edge) -> bool {
        let [a, b] = edge.map(|v| self.positions[v as usize]);
        let middle = 0.5 * a + 0.5 * b;
        let at = |v: u32, side: u32| if v == side { middle } else { self.positions[v as usize] };
        let parts_have_area = |u: &u32| {
            let corners = self.faces.triangles[*u as usize];
            edge.into_iter().all(|side| has_area(corners.map(|v| at(v, side))))
        };
        if !self.at_edge[&edge].iter().all(parts_have_area) {
            return false;
        }
        let made = self.positions.len() as u32;
        let vertex = *self.vertices.entry(middle.to_array().map(f32::to_bits)).or_insert(made);
        if vertex == made {
            self.positions.push(middle);
        }
        for u in self.at_edge.remove(&edge).unwrap_or_default() {
            self.is_left[u as usize] = false;
            for other in edges(self.faces.triangles[u as usize]).into_iter().filter(|other| *other != edge) {
                self.at_edge.entry(other).or_default().retain(|&at| at != u);
            }
            edge.into_iter().for_each(|side| self.add_part(u, edge, side, vertex));
        }
        true
    }

    /// Adds the part of a triangle in which the middle of an edge replaces one end of it.
    fn add_part(&mut self, t: u32, edge: Edge, side: u32, middle: u32) {
        let (made, t) = (self.is_left.len() as u32, t as usize);
        let faces = &mut *self.faces;
        let whole = faces.triangles[t];
        let corners = whole.map(|v| if v == side { middle } else { v });
        faces.triangles.push(corners);
        for of in [&mut faces.polygon, &mut faces.object, &mut faces.material] {
            of.push(of[t]);
        }
        faces.reflectance.push(faces.reflectance[t]);
        if let Some(&uv) = faces.texcoords.get(t) {
            let ends: Vec<usize> = (0..3).filter(|&k| edge.contains(&whole[k])).collect();
            let mean = std::array::from_fn(|c| 0.5 * (uv[ends[0]][c] + uv[ends[1]][c]));
            faces.texcoords.push(std::array::from_fn(|k| if whole[k] == side { mean } else { uv[k] }));
        }
        self.whole.push(self.whole[t]);
        self.is_left.push(true);
        self.near.push(self.near[t].clone());
        self.queue.push_back(made);
        edges(corners).into_iter().for_each(|edge| self.at_edge.entry(edge).or_default().push(made));
    }

    /// The longest edge of a triangle; of equal ones that with the smallest numbers.
    fn longest_edge(&self, t: u32) -> Edge {
        let length = |edge: &Edge| {
            let [a, b] = edge.map(|v| self.positions[v as usize]);
            a.distance_squared(b)
        };
        let [a, b, c] = edges(self.faces.triangles[t as usize]);
        let longer =
            |a: Edge, b: Edge| if length(&b).total_cmp(&length(&a)).then(a.cmp(&b)).is_gt() { b } else { a };
        longer(longer(a, b), c)
    }

    /// Leaves the triangles that remain, in the order of those of the file.
    fn finish(self) {
        let mut left: Vec<usize> = (0..self.is_left.len()).filter(|&t| self.is_left[t]).collect();
        left.sort_by_key(|&t| self.whole[t]);
        let faces = self.faces;
        faces.triangles = left.iter().map(|&t| faces.triangles[t]).collect();
        for of in [&mut faces.polygon, &mut faces.object, &mut faces.material] {
            *of = left.iter().map(|&t| of[t]).collect();
        }
        faces.reflectance = left.iter().map(|&t| faces.reflectance[t]).collect();
        if !faces.texcoords.is_empty() {
            faces.texcoords = left.iter().map(|&t| faces.texcoords[t]).collect();
        }
    }
}

/// The edges of a triangle.
fn edges([a, b, c]: [u32; 3]) -> [Edge; 3] {
    [[a, b], [b, c], [c, a]].map(|[v, w]| [v.min(w), v.max(w)])
}

#[cfg(test)]
mod tests {
    use crate::scene::Scene;
    use crate::scene::testing::{Pieces, facing_down, facing_up};
    use glam::DVec3;
    use std::collections::HashMap;

    /// A floor of this width with a wall along one side, and a lamp of 1 at this height.
    fn scene(width: f64, height: f64) -> Scene {
        let half = 0.5 * width;
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([-half, half], [-half, half], 0.0));
        pieces.polygon(&[
            DVec3::new(-half, -half, 0.0),
            DVec3::new(half, -half, 0.0),
            DVec3::new(half, -half, 10.0),
            DVec3::new(-half, -half, 10.0),
        ]);
        pieces.glowing("lamp", 10.0).polygon(&facing_down([0.0, 1.0], [0.0, 1.0], height));
        pieces.scene()
    }

    /// Parts near the lamp are small, meet along whole edges, and cover the floor and the wall.
    #[test]
    fn large_faces_are_divided_near_small_things() {
        let width = 1e6;
        let scene = scene(width, 1.0);
        let triangles = scene.triangles.len();
        assert!(
            scene.repairs.divided_faces > 50 && triangles == scene.repairs.divided_faces + 6,
            "{triangles}"
        );
        assert!(scene.repairs.messages.iter().any(|m| m.contains("faces of `floor`")), "{:?}", scene.repairs);
        assert!(triangles < 400, "{triangles}");
        let magnitudes = scene.face_magnitudes();
        let mut uses = HashMap::new();
        let mut area = 0.0;
        for (t, corners) in (0..).zip(&scene.triangles) {
            let places = scene.corners(t).map(|p| p.as_dvec3());
            area += 0.5 * (places[1] - places[0]).cross(places[2] - places[0]).length();
            let nearest = places.iter().map(|p| p.length()).fold(f64::INFINITY, f64::min);
            // Rays start at most .01 above what lies below the lamp, and at 1/100 of the distance elsewhere.
            let most = 1e4 * nearest.max(1.0);
            assert!(f64::from(magnitudes[t as usize]) < most, "{places:?} {}", magnitudes[t as usize]);
            for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|pair: [usize; 2]| pair.map(|k| corners[k])) {
                *uses.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
            }
        }
        assert!((area / (width * (width + 10.0) + 1.0) - 1.0).abs() < 1e-6, "{area}");
        let is_border = |edge: &[u32; 2]| {
            let [a, b] = edge.map(|v| scene.positions[v as usize]);
            let middle = 0.5 * (a + b);
            let is_floor = middle.x.abs().max(middle.y.abs()) < 0.499 * width as f32 && middle.z == 0.0;
            !is_floor
        };
        let torn: Vec<_> = uses.iter().filter(|(edge, uses)| **uses != 2 && !is_border(edge)).collect();
        assert!(torn.is_empty(), "{torn:?}");
    }

    #[test]
    fn faces_that_are_fine_enough_stay() {
        for (width, height) in [(10.0, 2.0), (5e3, 1.0), (1e5, 100.0)] {
            assert_eq!(scene(width, height).repairs.divided_faces, 0, "{width} {height}");
        }
    }
}
