//! Discs and spheres.

/// `F(point → disc)` for a differential area parallel to a disc and facing it: `gap > 0` away from the disc's plane and
/// `offset` away from its axis.
///
/// The disc is the part of its plane that a circular cone cuts out; integrating Lambert's edge formula around the circle
/// gives `½ (1 − (g² + a² − r²) / √((g² + a² + r²)² − 4 a² r²))` (Hamilton and Morgan 1952; Howell B-13).
pub fn point_to_disc(gap: f64, offset: f64, radius: f64) -> f64 {
    let (g, a, r) = (gap * gap, offset * offset, radius * radius);
    0.5 * (1.0 - (g + a - r) / ((g + a + r).powi(2) - 4.0 * a * r).sqrt())
}

/// `F(point → sphere)` for a differential area whose normal makes an angle of cosine `cosine` with the direction to the
/// sphere's centre at `distance > radius`, for a sphere wholly above the point's horizon.
///
/// A sphere is seen as a cone of half angle `asin(r/d)`; its projected solid angle over π is `(r/d)² cos θ`.
pub fn point_to_sphere(distance: f64, radius: f64, cosine: f64) -> f64 {
    (radius / distance).powi(2) * cosine
}

/// `F(first → second)` of two discs on one axis, in parallel planes at the distance `gap > 0`, facing each other.
///
/// Both discs are sections of one sphere's caps, between which factors are ratios of areas: with
/// `S = 1 + (g² + r2²)/r1²`, `F = ½ (S − √(S² − 4 (r2/r1)²))` (Howell C-41).
pub fn coaxial_discs(first: f64, second: f64, gap: f64) -> f64 {
    let ratio = (second / first).powi(2);
    let s = 1.0 + (gap / first).powi(2) + ratio;
    // The smaller root, written without the difference of two near numbers.
    2.0 * ratio / (s + (s * s - 4.0 * ratio).sqrt())
}
