//! Form factors to discs and spheres.

/// `F(point → disc)` for a differential area parallel to the disc and facing it, `gap > 0` from the disc's plane and
/// `offset` from its axis (scene units); unitless.
///
/// `½ (1 − (g² + a² − r²) / √((g² + a² + r²)² − 4 a² r²))`: Lambert's edge formula, integrated around the circle
/// (Hamilton and Morgan 1952; Howell B-13).
pub fn point_to_disc(gap: f64, offset: f64, radius: f64) -> f64 {
    let (g, a, r) = (gap * gap, offset * offset, radius * radius);
    0.5 * (1.0 - (g + a - r) / ((g + a + r).powi(2) - 4.0 * a * r).sqrt())
}

/// `F(point → sphere)` for a differential area; `cosine` is that of the angle between its normal and the direction to
/// the sphere's centre, at `distance > radius` (scene units). The whole sphere must lie above the point's horizon.
/// Unitless.
///
/// The sphere subtends a cone of half angle `asin(r/d)`; its projected solid angle divided by π is `(r/d)² cos θ`.
pub fn point_to_sphere(distance: f64, radius: f64, cosine: f64) -> f64 {
    (radius / distance).powi(2) * cosine
}

/// `F(first → second)` of two coaxial discs with radii `first` and `second` in parallel planes at distance `gap > 0`,
/// facing each other; unitless.
///
/// With `S = 1 + (g² + r2²)/r1²`, `F = ½ (S − √(S² − 4 (r2/r1)²))` (Howell C-41).
pub fn coaxial_discs(first: f64, second: f64, gap: f64) -> f64 {
    let ratio = (second / first).powi(2);
    let s = 1.0 + (gap / first).powi(2) + ratio;
    // The smaller root in a form that avoids cancellation.
    2.0 * ratio / (s + (s * s - 4.0 * ratio).sqrt())
}
