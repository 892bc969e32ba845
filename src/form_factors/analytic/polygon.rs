//! Form factor from a differential area to a polygon: Lambert's formula.

use glam::DVec3;

/// `F(point → polygon)`: the fraction of the flux leaving a differential area at `point` with unit normal `normal` that
/// arrives at a planar polygon, in `[-1, 1]`.
///
/// Positive if the point is on the polygon's front side (corners counterclockwise), negative if behind; for two-sided
/// surfaces take the absolute value. Only the part above the point's horizon counts. The result is 0 for a point in the
/// polygon's plane and for fewer than three corners. Concave polygons are allowed.
///
/// Lambert (*Photometria*, 1760): by Stokes' theorem the integral of `cos θ cos θ' / (π r²)` over the polygon is
/// `1/2π Σ γ_i · n·(a_i × b_i)/|a_i × b_i|` over its edges, `γ_i` the angle that edge i subtends at the point. The sum
/// requires a polygon above the horizon, so the polygon is clipped first (Sutherland and Hodgman 1974); edges along the
/// horizon close the clipped polygon.
pub fn point_to_polygon(point: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let Some(&last) = polygon.last() else { return 0.0 };
    // For a point in the plane rounding would give the angles an arbitrary sign.
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
    // Seen from its front, a counterclockwise polygon has the opposite orientation about the receiver's normal.
    (-sum / std::f64::consts::TAU).clamp(-1.0, 1.0)
}

/// Angle that an edge subtends at the origin, times the cosine between its plane's normal and `normal`.
#[inline]
fn edge(normal: DVec3, a: DVec3, b: DVec3) -> f64 {
    let cross = a.cross(b);
    let length = cross.length();
    // An edge that points at the origin subtends no angle.
    if length == 0.0 { 0.0 } else { length.atan2(a.dot(b)) * cross.dot(normal) / length }
}
