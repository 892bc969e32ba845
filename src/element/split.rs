//! Surfaces in four, and which part of a surface a point lies on.

use super::{Element, Elements, Shape, Side};
use glam::Vec3;

impl Elements {
    /// Whether [`Elements::split`] can give an element children, or it has some.
    pub fn can_open(&self, element: u32) -> bool {
        let e = &self.elements[element as usize];
        // One more level of quarters must fit into the range of ids as well.
        !e.is_leaf() || (!e.is_cluster() && 0.25 * e.area >= self.min_area && e.ids[1] - e.ids[0] >= 5)
    }

    /// Splits a surface into four of half its size, unless it has children already: at the middles of the edges. The
    /// parts of a planar quad and of a triangle meet their neighbours' along whole edges or halves of them.
    pub fn split(&mut self, element: u32) {
        let parent = self.elements[element as usize].clone();
        let Shape::Surface { side, corners } = parent.shape else { return };
        if !parent.is_leaf() {
            return;
        }
        let first = self.elements.len() as u32;
        let room = (parent.ids[1] - parent.ids[0] - 1) / 4;
        for (k, corners) in quarters(corners).into_iter().enumerate() {
            let start = parent.ids[0] + 1 + k as u64 * room;
            self.elements.push(Element {
                ids: [start, start + room],
                parent: element,
                level: parent.level + 1,
                ..surface(side, corners)
            });
        }
        let parent = &mut self.elements[element as usize];
        (parent.first_child, parent.children) = (first, 4);
    }

    /// The leaf of a side that holds a point of its plane; the nearest one for points beside it.
    pub fn leaf_at(&self, side: u32, point: Vec3) -> u32 {
        let Side { normal, element, .. } = &self.sides[side as usize];
        let mut at = *element;
        let e = &self.elements[at as usize];
        let Shape::Surface { corners, .. } = &e.shape else { return at };
        if e.is_leaf() {
            return at;
        }
        let triangle = is_triangle(corners);
        let [mut u, mut v] =
            if triangle { barycentric(corners, *normal, point) } else { bilinear(corners, *normal, point) };
        loop {
            let e = &self.elements[at as usize];
            if e.is_leaf() {
                return at;
            }
            let part;
            (part, u, v) = if triangle { quarter_of_triangle(u, v) } else { quarter_of_quad(u, v) };
            at = e.first_child + part;
        }
    }
}

/// Whether the fourth corner repeats the third.
pub(super) fn is_triangle(corners: &[Vec3; 4]) -> bool {
    corners[2] == corners[3]
}

/// A surface element without relations.
pub(super) fn surface(side: u32, corners: [Vec3; 4]) -> Element {
    let bounds = crate::math::Aabb::of(corners);
    Element {
        area: area(&corners),
        shape: Shape::Surface { side, corners },
        ids: [0, 1],
        parent: 0,
        first_child: 0,
        children: 0,
        level: 0,
        centre: centroid(&corners),
        radius: 0.5 * bounds.diagonal(),
    }
}

fn centroid(c: &[Vec3; 4]) -> Vec3 {
    if is_triangle(c) { (c[0] + c[1] + c[2]) / 3.0 } else { 0.25 * (c[0] + c[1] + c[2] + c[3]) }
}

fn area(corners: &[Vec3; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|p| p.as_dvec3());
    0.5 * (c - a).cross(d - b).length()
}

/// The four parts; each keeps its place: corner k of the whole is a corner of part k (the middle one of a triangle is
/// the last).
fn quarters(c: [Vec3; 4]) -> [[Vec3; 4]; 4] {
    let middle = |i: usize, j: usize| 0.5 * (c[i] + c[j]);
    if is_triangle(&c) {
        let (ab, bc, ca) = (middle(0, 1), middle(1, 2), middle(2, 0));
        return [[c[0], ab, ca, ca], [ab, c[1], bc, bc], [ca, bc, c[2], c[2]], [ab, bc, ca, ca]];
    }
    let m = [middle(0, 1), middle(1, 2), middle(2, 3), middle(3, 0)];
    let centre = 0.5 * (m[0] + m[2]);
    [
        [c[0], m[0], centre, m[3]],
        [m[0], c[1], m[1], centre],
        [centre, m[1], c[2], m[2]],
        [m[3], centre, m[2], c[3]],
    ]
}

/// Parameters of a point in a planar quad: corners at (0, 0), (1, 0), (1, 1), (0, 1), bilinear in between, so that quarters
/// are halves of both parameters. Newton's method; exact after one step for parallelograms.
fn bilinear(c: &[Vec3; 4], normal: Vec3, point: Vec3) -> [f32; 2] {
    let (e, f, g) = (c[1] - c[0], c[3] - c[0], c[0] - c[1] + c[2] - c[3]);
    let h = point - c[0];
    let (mut u, mut v) = (0.5, 0.5);
    let steps = if g == Vec3::ZERO { 1 } else { 4 };
    for _ in 0..steps {
        let rest = h - u * e - v * f - u * v * g;
        let (along_u, along_v) = (e + v * g, f + u * g);
        let area = along_u.cross(along_v).dot(normal);
        u = (u + rest.cross(along_v).dot(normal) / area).clamp(0.0, 1.0);
        v = (v + along_u.cross(rest).dot(normal) / area).clamp(0.0, 1.0);
    }
    [u, v]
}

/// Weights of the second and third corner.
fn barycentric(c: &[Vec3; 4], normal: Vec3, point: Vec3) -> [f32; 2] {
    let (e, f, h) = (c[1] - c[0], c[2] - c[0], point - c[0]);
    let area = e.cross(f).dot(normal);
    [h.cross(f).dot(normal) / area, e.cross(h).dot(normal) / area]
}

/// The quarter that parameters lie in, and the parameters there.
fn quarter_of_quad(u: f32, v: f32) -> (u32, f32, f32) {
    let half = |x: f32| if x < 0.5 { 2.0 * x } else { 2.0 * x - 1.0 };
    let part = match (u < 0.5, v < 0.5) {
        (true, true) => 0,
        (false, true) => 1,
        (false, false) => 2,
        (true, false) => 3,
    };
    (part, half(u), half(v))
}

/// The same for weights of the second and third corner.
fn quarter_of_triangle(b: f32, c: f32) -> (u32, f32, f32) {
    let a = 1.0 - b - c;
    if a > 0.5 {
        (0, 2.0 * b, 2.0 * c)
    } else if b > 0.5 {
        (1, 2.0 * b - 1.0, 2.0 * c)
    } else if c > 0.5 {
        (2, 2.0 * b, 2.0 * c - 1.0)
    } else {
        (3, 1.0 - 2.0 * a, 1.0 - 2.0 * b)
    }
}
