//! Surfaces in four, and which part of a surface a point lies on.

use super::{Element, Elements, Shape};
use glam::Vec3;

impl Elements {
    /// Whether [`Elements::split`] can give an element children, or it has some.
    pub fn can_open(&self, element: u32) -> bool {
        let e = &self.elements[element as usize];
        // One more level of quarters must fit into the range of ids as well.
        !e.is_leaf() || (!e.is_cluster() && 0.25 * e.area >= self.min_area && e.ids[1] - e.ids[0] >= 5)
    }

    /// Splits a surface into four of half its size, unless it has children already: at the middles of the edges. The
    /// parts of a quad and of a triangle meet their neighbours' along whole edges or halves of them.
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
///
/// A quad's meet at the middle of its first diagonal, the edge of its two faces: two parts are its likeness, two are
/// parallelograms, and all lie in the faces even where these are bent a little. (Parts that meet at the mean of the corners lie
/// behind such faces, which hide them.)
fn quarters(c: [Vec3; 4]) -> [[Vec3; 4]; 4] {
    let middle = |i: usize, j: usize| 0.5 * (c[i] + c[j]);
    if is_triangle(&c) {
        let (ab, bc, ca) = (middle(0, 1), middle(1, 2), middle(2, 0));
        return [[c[0], ab, ca, ca], [ab, c[1], bc, bc], [ca, bc, c[2], c[2]], [ab, bc, ca, ca]];
    }
    let m = [middle(0, 1), middle(1, 2), middle(2, 3), middle(3, 0)];
    let centre = middle(0, 2);
    [
        [c[0], m[0], centre, m[3]],
        [m[0], c[1], m[1], centre],
        [centre, m[1], c[2], m[2]],
        [m[3], centre, m[2], c[3]],
    ]
}
