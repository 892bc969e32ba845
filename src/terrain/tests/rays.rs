use super::*;
use glam::DVec3;

/// Smallest multiple of `d` from `o` to a triangle; Möller and Trumbore's test. Also how near the ray passes an edge, 0..1.
fn triangle(o: DVec3, d: DVec3, [a, b, c]: [DVec3; 3]) -> Option<(f64, f64)> {
    let (e, f) = (b - a, c - a);
    let p = d.cross(f);
    let det = e.dot(p);
    let s = o - a;
    let u = s.dot(p) / det;
    let q = s.cross(e);
    let (v, t) = (d.dot(q) / det, f.dot(q) / det);
    let inside = u.min(v).min(1.0 - u - v);
    (inside.is_finite() && inside > -1e-9).then_some((t, inside))
}

/// The first hit of all triangles, and whether it is far from any doubt: not at an end of the ray.
fn brute(grid: &Grid, o: DVec3, d: DVec3, max: f64) -> Option<f64> {
    let mut first: Option<f64> = None;
    for r in 0..grid.rows() - 1 {
        for c in 0..grid.columns() - 1 {
            let at = |i: usize, j: usize| grid.position(c + i, r + j);
            for t in [[at(0, 1), at(1, 1), at(1, 0)], [at(0, 1), at(1, 0), at(0, 0)]] {
                if let Some((t, _)) = triangle(o, d, t).filter(|(t, _)| *t > 0.0 && *t <= max) {
                    first = Some(first.map_or(t, |f| f.min(t)));
                }
            }
        }
    }
    first
}

fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

#[test]
fn rays_agree_with_all_triangles() {
    let mut state = 1;
    for (columns, rows, holes) in [(2, 2, false), (9, 14, false), (40, 33, false), (25, 25, true)] {
        let rough = fractal(columns.max(8), rows.max(8), 2.0, 30.0, 0.7, 11).expect("a grid");
        let heights = (0..columns * rows).map(|i| match holes && i % 17 == 3 {
            true => f32::NAN,
            false => rough.height(i % columns, i / columns),
        });
        let grid = Grid::new(columns, rows, [2.0, 3.0], heights.collect()).expect("a grid");
        let pyramid = Pyramid::new(&grid);
        let (mut hits, mut misses) = (0, 0);
        for _ in 0..4000 {
            let size = DVec3::new(2.0 * columns as f64, 3.0 * rows as f64, 60.0);
            let mut point = || {
                (DVec3::new(random(&mut state), random(&mut state), random(&mut state)) * 1.4 - 0.2) * size
                    - DVec3::Z * 30.0
            };
            let (o, to) = (point(), point());
            let found = pyramid.first_hit(o, to - o, 1.0).expect("a ray");
            let expected = brute(&grid, o, to - o, 1.0);
            match (found, expected) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-6, "{o} to {to}: {a} instead of {b}"),
                (None, None) => misses += 1,
                other => panic!("{o} to {to}: {other:?}"),
            }
            hits += usize::from(found.is_some());
        }
        assert!(hits > 100 && misses > 100, "{hits} hits, {misses} misses");
    }
}

/// Rays along columns, rows and diagonals, and vertical ones, meet edges and samples exactly.
#[test]
fn rays_along_edges_are_not_lost() {
    let grid = fractal(33, 33, 1.0, 12.0, 0.6, 2).expect("a grid");
    let pyramid = Pyramid::new(&grid);
    for c in 0..33usize {
        for r in 0..33usize {
            let p = grid.position(c, r);
            let down = pyramid.first_hit(p + DVec3::Z * 50.0, -DVec3::Z, f64::INFINITY).expect("a ray");
            assert!(down.is_some_and(|t| (t - 50.0).abs() < 1e-6), "{c} {r}: {down:?}");
            assert!(!pyramid.occluded(p, DVec3::Z, f64::INFINITY).expect("a ray"));
            let below = DVec3::new(p.x, p.y, -40.0);
            for direction in [DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 0.0)] {
                // Below the terrain nothing is met; from below to above something is.
                assert!(!pyramid.occluded(below, direction, f64::INFINITY).expect("a ray"));
                let inside = c > 2 && r > 2 && c < 30 && r < 30;
                let steep = direction + DVec3::Z * 40.0;
                assert!(!inside || pyramid.occluded(below, steep, f64::INFINITY).expect("a ray"), "{c} {r}");
            }
        }
    }
}

#[test]
fn bad_rays_are_refused() {
    let grid = plane(5, 1.0, 0.3, 0.0).expect("a grid");
    let pyramid = Pyramid::new(&grid);
    for (o, d, max) in [
        (DVec3::NAN, DVec3::Z, 1.0),
        (DVec3::ZERO, DVec3::ZERO, 1.0),
        (DVec3::ZERO, DVec3::Z, -1.0),
        (DVec3::ZERO, DVec3::Z, f64::NAN),
    ] {
        assert!(pyramid.occluded(o, d, max).is_err());
    }
}
