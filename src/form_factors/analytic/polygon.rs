//! A differential area and a polygon: Lambert's formula.

use glam::DVec3;

/// `F(point → polygon)`: the share of what a differential area at `point` with the unit normal `normal` sends out that
/// arrives at a planar polygon, in `[-1, 1]`.
///
/// Positive if the point is on the polygon's front side (corners counterclockwise), negative if it is behind; the
/// caller takes the absolute value for surfaces with two sides. Only the part above the point's horizon counts. A point
/// in the polygon's plane gets 0; so does a polygon of fewer than three corners. Concave polygons are allowed.
///
/// Lambert (*Photometria*, 1760): by Stokes' theorem the integral of `cos θ cos θ' / (π r²)` over the polygon is a sum over
/// its edges, `1/2π Σ γ_i · n·(a_i × b_i)/|a_i × b_i|`, with `γ_i` the angle under which the edge is seen from the point.
/// The sum holds above the horizon only, so the polygon is clipped there first (Sutherland and Hodgman 1974); the pieces
/// of the horizon that close it are edges like the others.
pub fn point_to_polygon(point: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let Some(&last) = polygon.last() else { return 0.0 };
    // A point in the plane sees no solid angle, but rounding would give the angles some sign.
    let plane = polygon[0] - point;
    let mut area = DVec3::ZERO;
    let mut sum = 0.0;
    let (mut first_entry, mut exit) = (None, None);
    let mut a = last - point;
    let mut below_a = a.dot(normal);
    let mut size = a.length_squared();
    for &corner in polygon {
        let b = corner - point;
        let below_b = b.dot(normal);
        area += (a - plane).cross(b - plane);
        size = size.max(b.length_squared());
        let crossing = || a + (b - a) * (below_a / (below_a - below_b));
        match (below_a > 0.0, below_b > 0.0) {
            (true, true) => sum += edge(normal, a, b),
            (true, false) => {
                let c = crossing();
                sum += edge(normal, a, c);
                exit = Some(c);
            }
            (false, true) => {
                let c = crossing();
                match exit.take() {
                    Some(e) => sum += edge(normal, e, c),
                    None => first_entry = Some(c),
                }
                sum += edge(normal, c, b);
            }
            (false, false) => {}
        }
        (a, below_a) = (b, below_b);
    }
    if let (Some(exit), Some(entry)) = (exit, first_entry) {
        sum += edge(normal, exit, entry);
    }
    let height = plane.dot(area);
    if height.abs() <= 1e-14 * area.length() * size.sqrt() {
        return 0.0;
    }
    // Seen from its front, a counterclockwise polygon turns the other way about the viewer's normal.
    (-sum / std::f64::consts::TAU).clamp(-1.0, 1.0)
}

/// The angle of one edge about the viewer, times the cosine of its plane's normal with `normal`.
#[inline]
fn edge(normal: DVec3, a: DVec3, b: DVec3) -> f64 {
    let cross = a.cross(b);
    let length = cross.length();
    // An edge that points at the viewer is seen under no angle.
    if length == 0.0 { 0.0 } else { length.atan2(a.dot(b)) * cross.dot(normal) / length }
}
