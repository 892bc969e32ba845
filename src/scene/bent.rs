//! Triangulation of non-planar polygons with the least total area.
//!
//! Models of plants contain many non-planar quads and hexagons. Projected along their mean normal they may intersect
//! themselves, although they are good surfaces. The triangulation of least area follows Barequet and Sharir 1995
//! (filling gaps in the boundary of a polyhedron).

use glam::DVec3;

/// Largest distance from the plane of a planar polygon, relative to its size: half a unit in the third digit of a
/// coordinate, above the rounding of files with four digits.
const MAX_FLAT_DISTANCE: f64 = 1e-3;
/// Largest number of corners. The time is cubic: limits a polygon to 64³/6 = 44,000 triangle areas.
const MAX_CORNERS: usize = 64;

/// Triangles as corner numbers, with the orientation of the polygon; `None` if it is planar or too large.
pub(super) fn triangulate(p: &[DVec3]) -> Option<Vec<[u32; 3]>> {
    let n = p.len();
    if n > MAX_CORNERS || is_flat(p) {
        return None;
    }
    let area = |i: usize, k: usize, j: usize| (p[k] - p[i]).cross(p[j] - p[i]).length();
    // Smallest doubled area of the chain from corner i to corner j, and the third corner of its triangle.
    let mut best = vec![(0.0f64, 0); n * n];
    for length in 2..n {
        for i in 0..n - length {
            let j = i + length;
            let cost = |k: usize| best[i * n + k].0 + best[k * n + j].0 + area(i, k, j);
            let choices = (i + 1..j).map(|k| (cost(k), k));
            if let Some(best_choice) = choices.min_by(|a, b| a.0.total_cmp(&b.0)) {
                best[i * n + j] = best_choice;
            }
        }
    }
    let (mut triangles, mut chains) = (Vec::with_capacity(n - 2), vec![(0, n - 1)]);
    while let Some((i, j)) = chains.pop() {
        if j - i >= 2 {
            let k = best[i * n + j].1;
            triangles.push([i, k, j].map(|v| v as u32));
            chains.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}

/// Whether all corners lie in the plane of the largest triangle of the fan.
fn is_flat(p: &[DVec3]) -> bool {
    let normals = p.windows(2).map(|e| (e[0] - p[0]).cross(e[1] - p[0]));
    let normal =
        normals.fold(DVec3::ZERO, |a, b| if b.length_squared() > a.length_squared() { b } else { a });
    let unit = normal.normalize_or_zero();
    let size = p.iter().map(|q| q.distance(p[0])).fold(0.0, f64::max);
    p.iter().all(|q| (q - p[0]).dot(unit).abs() <= MAX_FLAT_DISTANCE * size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bent_polygons_get_the_least_area() {
        // A square with a raised corner: split along 0-2 its area is 0.995, along 1-3 only 0.860.
        let bent = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.5, 0.5, 0.7)];
        assert_eq!(triangulate(&bent), Some(vec![[0, 1, 3], [1, 2, 3]]));
        let bow_tie = [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::X, DVec3::Y];
        assert_eq!(triangulate(&bow_tie), None, "flat");
        let spiral: Vec<DVec3> = (0..64)
            .map(|i| DVec3::new((0.3 * f64::from(i)).sin(), (0.3 * f64::from(i)).cos(), 0.1 * f64::from(i)))
            .collect();
        assert_eq!(triangulate(&spiral).map(|t| t.len()), Some(62));
    }
}
