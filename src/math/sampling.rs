//! Random numbers, points on surfaces and directions about normals.

use glam::Vec3;
use sobol_burley::sample_4d;

/// A point of a surface.
#[derive(Clone, Copy)]
pub struct Site {
    pub position: Vec3,
    /// Unit normal of its face.
    pub normal: Vec3,
    /// Largest absolute coordinate of its face and that face's neighbours: the scale of rounding errors.
    pub magnitude: f32,
}

/// Four numbers in `[0, 1)` for an item and a seed (SplitMix64, Steele et al. 2014).
pub fn numbers(seed: u64, item: u64) -> [f32; 4] {
    let first = mix(seed ^ item.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let second = mix(first);
    let unit = |v: u64| (v >> 40) as f32 / (1u64 << 24) as f32;
    [unit(first), unit(first << 24), unit(second), unit(second << 24)]
}

/// Hash of a 64-bit number: one step of SplitMix64.
pub fn mix(v: u64) -> u64 {
    let v = v.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let v = (v ^ v >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let v = (v ^ v >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ v >> 31
}

/// Four numbers in `[0, 1)` of point `i` of a scrambled Sobol sequence, which serves 65,536 points; later ones are of sequences with other
/// seeds. `set`: further numbers of the same point.
pub fn sobol(i: u32, set: u32, seed: u32) -> [f32; 4] {
    sample_4d(i & 0xffff, set, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9))
}

/// A place in the unit square, moved by the `m`-th term of the sequence R2 (Roberts 2018) modulo 1: the first terms are evenly spread
/// around it.
pub fn shifted([u, v]: [f32; 2], m: u32) -> [f32; 2] {
    const R2_STEPS: [f32; 2] = [0.754_877_7, 0.569_840_3];
    [(u + R2_STEPS[0] * m as f32).fract(), (v + R2_STEPS[1] * m as f32).fract()]
}

/// The entry of a table of running sums that a number `u` in `[0, 1)` selects, each with a probability proportional to its own fraction
/// of the total, with the share of `u` that is left inside the entry, in `[0, 1]`, and the entry's own fraction. The table is not empty;
/// entries with a fraction of 0 are not selected unless all are 0.
pub fn pick(running_sums: &[f32], u: f32) -> (usize, f32, f32) {
    let last = running_sums.len() - 1;
    let target = u * running_sums[last];
    let mut k = running_sums.partition_point(|&s| s <= target).min(last);
    // The product was rounded up to the total: the last entry with a part.
    while k > 0 && running_sums[k] == running_sums[k - 1] {
        k -= 1;
    }
    let before = if k > 0 { running_sums[k - 1] } else { 0.0 };
    let part = running_sums[k] - before;
    (k, ((target - before) / part).clamp(0.0, 1.0), part)
}

/// Largest skew of a quad that counts as a parallelogram, relative to its diagonal: as much may the density of points be off.
const PARALLELOGRAM: f32 = 1e-4;

/// The point of a triangle or convex quad for `(u, v)` in the unit square. Equal areas of the square give equal areas of the surface.
pub fn point_on(corners: &[Vec3; 4], u: f32, v: f32) -> Vec3 {
    let [a, b, c, d] = *corners;
    if c == d {
        return on_triangle([a, b, c], u, v);
    }
    // Even points of the square stay even on a parallelogram, which they do not on two triangles.
    let skew = (a + c) - (b + d);
    if skew.abs().max_element() <= PARALLELOGRAM * (c - a).abs().max_element() {
        return a + u * (b - a) + v * (d - a);
    }
    let (first, second) = (parallel_length((b - a).cross(c - a)), parallel_length((c - a).cross(d - a)));
    let share = first / (first + second);
    if u < share {
        on_triangle([a, b, c], u / share, v)
    } else {
        on_triangle([a, c, d], ((u - share) / (1.0 - share)).min(1.0), v)
    }
}

/// Compares parallel vectors as their lengths do. The sum of absolute coordinates needs no squares: the vectors are areas, and
/// squares of areas overflow 32 bits in large scenes.
pub fn parallel_length(v: Vec3) -> f32 {
    v.abs().element_sum()
}

/// The point of a triangle for `(u, v)` in the unit square. Equal areas of the square give equal areas of the triangle.
pub fn on_triangle([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    // Equal steps of u are bands of equal area parallel to the edge bc; v is uniform along a band.
    let root = u.sqrt();
    a + root * ((1.0 - v) * (b - a) + v * (c - a))
}

/// A direction about a unit normal with the density cos/π, for a point of the unit square. The concentric map of Shirley and
/// Chiu (1997) keeps neighbours of the square neighbours on the hemisphere.
pub fn cosine_direction(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (radius, angle) = if a.abs() > b.abs() {
        (a, std::f32::consts::FRAC_PI_4 * b / a)
    } else {
        (b, std::f32::consts::FRAC_PI_2 - std::f32::consts::FRAC_PI_4 * if b == 0.0 { 0.0 } else { a / b })
    };
    let (x, y) = normal.any_orthonormal_pair();
    let (sin, cos) = angle.sin_cos();
    (radius * cos * x + radius * sin * y + (1.0 - radius * radius).max(0.0).sqrt() * normal).normalize()
}

/// The point of the unit square for which [`cosine_direction`] about +z gives a unit direction above the horizon.
pub fn square_of_direction(direction: Vec3) -> [f32; 2] {
    let [x, y, _] = direction.to_array();
    let radius = x.hypot(y);
    let share = |a: f32, b: f32| if b == 0.0 { 0.0 } else { (a / b).atan() / std::f32::consts::FRAC_PI_4 };
    let (a, b) = if x.abs() > y.abs() {
        let a = radius.copysign(x);
        (a, a * share(y, x))
    } else {
        let b = radius.copysign(y);
        (b * share(x, y), b)
    };
    [a, b].map(|v| (0.5 * v + 0.5).clamp(0.0, 1.0f32.next_down()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four places around one lie in the four quarters of the square.
    #[test]
    fn shifted_places_are_spread() {
        let quarters = (0..4).map(|m| shifted([0.01, 0.02], m).map(|v| u32::from(v >= 0.5)));
        let mut quarters: Vec<[u32; 2]> = quarters.collect();
        quarters.sort_unstable();
        assert_eq!(quarters, [[0, 0], [0, 1], [1, 0], [1, 1]]);
        assert_eq!(shifted([0.3, 0.7], 0), [0.3, 0.7]);
    }

    #[test]
    fn directions_have_their_place_in_the_square() {
        for k in 0..1000 {
            let [u, v, ..] = numbers(3, k);
            let [a, b] = square_of_direction(cosine_direction(Vec3::Z, u, v));
            assert!((a - u).abs() < 1e-4 && (b - v).abs() < 1e-4, "{u} {v}: {a} {b}");
        }
    }
}
