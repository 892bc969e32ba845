//! Cuts of surfaces along planes, as at the foot of a wall.

use super::subdivision::{area, is_triangle, surface};
use super::{Element, Elements, Shape};
use crate::math::triangle_normal;
use glam::{DVec3, Vec3};
use smallvec::SmallVec;

/// Smallest sine of the angle between a surface and the plane that cuts it: below 6 degrees the line in which they meet is off by more
/// than ten times the error of either.
const MIN_SINE: f64 = 0.1;

/// A plane that cuts surfaces.
#[derive(Clone, Copy)]
pub struct CutPlane {
    normal: DVec3,
    offset: f64,
}

/// Corners of a convex polygon; cuts of quads have up to five.
type Polygon = SmallVec<[Vec3; 5]>;

/// Elements by their corners.
type Parts = SmallVec<[[Vec3; 4]; 2]>;

impl CutPlane {
    /// The plane of a triangle.
    pub fn of(corners: [Vec3; 3]) -> CutPlane {
        let [a, b, c] = corners;
        let normal = triangle_normal(a, b, c).as_dvec3();
        let sum: DVec3 = corners.iter().map(|p| p.as_dvec3()).sum();
        CutPlane { normal, offset: normal.dot(sum / 3.0) }
    }

    /// Height of a point over the plane, scene units.
    fn height(&self, at: Vec3) -> f64 {
        self.normal.dot(at.as_dvec3()) - self.offset
    }

    /// Whether another plane is nearly parallel and nearer than `distance` at a point.
    pub fn is_near(&self, other: &CutPlane, at: Vec3, distance: f32) -> bool {
        let turned = self.normal.dot(other.normal);
        self.normal.cross(other.normal).length() < MIN_SINE
            && (self.height(at) - turned.signum() * other.height(at)).abs() < f64::from(distance)
    }

    /// The two parts of a convex polygon in a plane with a given normal; none if the plane of the cut is nearly parallel to it, or one part
    /// would be no wider than `rounding`.
    fn parts(&self, corners: &[Vec3], normal: Vec3, rounding: f64) -> Option<[Polygon; 2]> {
        let sine = self.normal.cross(normal.as_dvec3()).length();
        if sine < MIN_SINE {
            return None;
        }
        let height = |p: &Vec3| {
            let height = self.height(*p) / sine;
            if height.abs() <= rounding { 0.0 } else { height }
        };
        let heights: SmallVec<[f64; 5]> = corners.iter().map(height).collect();
        if heights.iter().all(|h| *h <= 0.0) || heights.iter().all(|h| *h >= 0.0) {
            return None;
        }
        let mut parts = [Polygon::new(), Polygon::new()];
        for (k, &corner) in corners.iter().enumerate() {
            let next = (k + 1) % corners.len();
            let (own, of_next) = (heights[k], heights[next]);
            let on = [own >= 0.0, own <= 0.0];
            (0..2).filter(|&part| on[part]).for_each(|part| parts[part].push(corner));
            if own * of_next < 0.0 {
                let crossing = between([(corner, own), (corners[next], of_next)]);
                parts.iter_mut().for_each(|part| part.push(crossing));
            }
        }
        Some(parts)
    }
}

/// The point at height 0 between two points with heights of different sign. It has the same bits for both elements beside an edge.
fn between(mut ends: [(Vec3, f64); 2]) -> Vec3 {
    let bits = |p: Vec3| p.to_array().map(f32::to_bits);
    ends.sort_by_key(|(at, _)| bits(*at));
    let [(a, low), (b, high)] = ends;
    a.as_dvec3().lerp(b.as_dvec3(), low / (low - high)).as_vec3()
}

/// A polygon as surfaces of three or four corners.
fn surfaces(polygon: &Polygon) -> Parts {
    match polygon[..] {
        [a, b, c] => SmallVec::from_slice(&[[a, b, c, c]]),
        [a, b, c, d] => SmallVec::from_slice(&[[a, b, c, d]]),
        [a, b, c, d, e] => SmallVec::from_slice(&[[a, b, c, d], [a, d, e, e]]),
        _ => SmallVec::new(),
    }
}

impl Elements {
    /// The area of the smaller part of a leaf that a plane cuts off, scene units squared; 0 if it does not cut the leaf.
    pub fn smaller_part(&self, element: u32, plane: &CutPlane) -> f64 {
        let of = |part: &Parts| part.iter().map(area).sum::<f64>();
        self.parts(element, plane).map_or(0.0, |[a, b]| of(&a).min(of(&b)))
    }

    /// Cuts a leaf of a surface along a plane into two parts of one or two elements each. They send out the light of the whole. Returns
    /// whether the plane cuts the leaf.
    pub fn cut(&mut self, element: u32, plane: &CutPlane) -> bool {
        let Some(parts) = self.parts(element, plane) else { return false };
        self.add_parts(element, parts.into_iter().flatten().collect::<SmallVec<[_; 4]>>());
        self.elements[element as usize].is_irregular = true;
        true
    }

    fn parts(&self, element: u32, plane: &CutPlane) -> Option<[Parts; 2]> {
        let of = &self.elements[element as usize];
        let Shape::Surface { side, corners } = &of.shape else { return None };
        if !of.is_leaf() || !self.has_room_for_parts(element) {
            return None;
        }
        let side = &self.sides[*side as usize];
        let rounding = side.end.slack();
        let [a, b, c, d] = *corners;
        // The triangles of a bent quad are cut one by one, so that the parts lie in its faces.
        let is_bent = (d - a).dot(triangle_normal(a, b, c)).abs() > rounding;
        let polygons: SmallVec<[Polygon; 2]> = match (is_triangle(corners), is_bent) {
            (true, _) => [Polygon::from_slice(&[a, b, c])].into_iter().collect(),
            (false, false) => [Polygon::from_slice(corners)].into_iter().collect(),
            (false, true) => [[a, b, c], [a, c, d]].map(|of| Polygon::from_slice(&of)).into(),
        };
        let (mut parts, mut is_cut) = ([Parts::new(), Parts::new()], false);
        for polygon in polygons {
            if let Some(found) = plane.parts(&polygon, side.normal, f64::from(rounding)) {
                is_cut = true;
                parts.iter_mut().zip(&found).for_each(|(part, found)| part.extend(surfaces(found)));
            } else {
                let middle = polygon.iter().sum::<Vec3>() / polygon.len() as f32;
                parts[usize::from(plane.height(middle) < 0.0)].extend(surfaces(&polygon));
            }
        }
        is_cut.then_some(parts)
    }

    /// Gives a leaf parts with these corners.
    pub(super) fn add_parts(&mut self, element: u32, parts: impl IntoIterator<Item = [Vec3; 4]>) {
        let whole = &self.elements[element as usize];
        let Shape::Surface { side, .. } = whole.shape else { return };
        let (start, level) = (whole.ids[0] + 1, whole.level + 1);
        let room = (whole.ids[1] - start) / 4;
        let (first, state) = (self.elements.len() as u32, self.states[element as usize].of_part());
        for (k, corners) in (0..).zip(parts) {
            let from = start + k * room;
            let part = Element { ids: [from, from + room], parent: element, level, ..surface(side, corners) };
            self.elements.push(part);
            self.states.push(state);
        }
        let children = (self.elements.len() as u32 - first) as u16;
        let whole = &mut self.elements[element as usize];
        (whole.first_child, whole.children) = (first, children);
    }
}

/// A line in the plane of a surface: a unit vector across it, and its offset along that, scene units.
type Line = (Vec3, f32);

/// The lines along the edges of an element; their vectors point inwards.
type Outline = SmallVec<[Line; 4]>;

/// The outlines of an element's parts, to find the part that holds a point.
pub struct ChildrenOutlines {
    first: u32,
    outlines: SmallVec<[Outline; 4]>,
}

impl ChildrenOutlines {
    /// The outlines of the parts of an element.
    pub fn of(elements: &Elements, element: u32) -> ChildrenOutlines {
        let of = &elements.elements[element as usize];
        let outline = |part: usize| {
            let Shape::Surface { side, corners } = &elements.elements[part].shape else {
                return Outline::new();
            };
            let normal = elements.sides[*side as usize].normal;
            let count = if is_triangle(corners) { 3 } else { 4 };
            let line = |k: usize| {
                let (a, b) = (corners[k], corners[(k + 1) % count]);
                let inwards = normal.cross(b - a).normalize_or_zero();
                (inwards, inwards.dot(0.5 * (a + b)))
            };
            (0..count).map(line).collect()
        };
        ChildrenOutlines { first: of.first_child, outlines: of.child_range().map(outline).collect() }
    }

    /// The part that holds a point of the plane, or the nearest one: that with the largest distance from its nearest edge.
    pub fn child_at(&self, point: Vec3) -> u32 {
        let depth = |(inwards, offset): &Line| inwards.dot(point) - offset;
        let (mut found, mut deepest) = (0, f32::NEG_INFINITY);
        for (part, outline) in (0..).zip(&self.outlines) {
            let own = outline.iter().map(depth).fold(f32::INFINITY, f32::min);
            if own > deepest {
                (found, deepest) = (part, own);
            }
        }
        self.first + found
    }
}
