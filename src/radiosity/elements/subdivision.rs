//! Subdivision of surfaces into four parts.

use super::{Element, Elements, Shape};
use glam::Vec3;

impl Elements {
    /// Whether an element has children or [`Elements::split`] can make them.
    pub fn can_open(&self, element: u32) -> bool {
        !self.elements[element as usize].is_leaf() || self.can_split(element, self.min_area)
    }

    /// Whether [`Elements::split`] can make children of an element, and they have at least this area.
    pub fn can_split(&self, element: u32, min_area: f64) -> bool {
        let e = &self.elements[element as usize];
        e.is_leaf() && !e.is_cluster() && 0.25 * e.area >= min_area && self.has_room_for_parts(element)
    }

    /// Whether the range of ids of an element holds four children of one id each.
    pub(super) fn has_room_for_parts(&self, element: u32) -> bool {
        let [start, end] = self.elements[element as usize].ids;
        end - start >= 5
    }

    /// Whether an element is a part of one that was cut.
    pub fn is_part_of_cut(&self, element: u32) -> bool {
        self.elements[self.elements[element as usize].parent as usize].is_irregular
    }

    /// Approximate number of elements after all surfaces are split down to [`Elements::min_area`].
    pub fn expected_after_split(&self) -> usize {
        let below = |e: &Element| {
            let levels = if e.is_leaf() && !e.is_cluster() {
                (e.area / self.min_area).log(4.0).floor().max(0.0)
            } else {
                0.0
            };
            (4f64.powf(levels + 1.0) - 1.0) / 3.0
        };
        self.elements.iter().map(below).sum::<f64>() as usize
    }

    /// Splits a surface without children into four parts at the midpoints of its edges. Parts meet the parts of neighbouring
    /// surfaces along whole edges or half edges. They send out the light of the whole.
    pub fn split(&mut self, element: u32) {
        let whole = &self.elements[element as usize];
        let Shape::Surface { corners, .. } = whole.shape else { return };
        if whole.is_leaf() && self.has_room_for_parts(element) {
            let is_part_of_cut = self.is_part_of_cut(element);
            self.add_parts(element, quarters(corners));
            self.elements[element as usize].is_irregular = is_part_of_cut;
        }
    }
}

/// Whether the fourth corner repeats the third.
pub(super) fn is_triangle(corners: &[Vec3; 4]) -> bool {
    corners[2] == corners[3]
}

/// A surface element without parent, children and ids.
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
        is_irregular: false,
        centre: centroid(&corners),
        radius: 0.5 * bounds.diagonal(),
    }
}

/// Smallest distance of an edge of a triangle or quad from the [`centroid`], scene units.
pub fn inner_radius(corners: &[Vec3; 4]) -> f32 {
    let (count, middle) = (if is_triangle(corners) { 3 } else { 4 }, centroid(corners));
    let to_edge = |k: usize| {
        let (a, edge) = (corners[k], corners[(k + 1) % count] - corners[k]);
        edge.cross(middle - a).length() / edge.length()
    };
    (0..count).map(to_edge).fold(f32::INFINITY, f32::min)
}

/// The mean of the corners of a triangle or quad.
pub fn centroid(c: &[Vec3; 4]) -> Vec3 {
    if is_triangle(c) { (c[0] + c[1] + c[2]) / 3.0 } else { 0.25 * (c[0] + c[1] + c[2] + c[3]) }
}

/// Area of a surface with these corners, scene units squared.
pub fn area(corners: &[Vec3; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|p| p.as_dvec3());
    0.5 * (c - a).cross(d - b).length()
}

/// The four parts of a surface: corner k of the whole is a corner of part k; the middle part of a triangle is the last.
///
/// The parts of a quad meet at the midpoint of its first diagonal, which is the edge between its two faces: two parts are similar
/// to the quad, two are parallelograms, and all lie in the faces even if the quad is slightly bent. (Parts that met at the mean
/// of the corners would lie behind bent faces, which would hide them.)
pub fn quarters(c: [Vec3; 4]) -> [[Vec3; 4]; 4] {
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

/// The centres of the four parts that subdivision would make of an element; their mean is its centre.
pub fn centres_of_quarters(corners: &[Vec3; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = *corners;
    if c == d {
        let middle = (a + b + c) / 3.0;
        return [middle, 0.5 * (a + middle), 0.5 * (b + middle), 0.5 * (c + middle)];
    }
    let at = |u: f32, v: f32| (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * d + u * c);
    [at(0.25, 0.25), at(0.75, 0.25), at(0.75, 0.75), at(0.25, 0.75)]
}
