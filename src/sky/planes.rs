//! Irradiance of unobstructed planes of many orientations, from a table.
//!
//! Irradiance E, continued to vectors of any length by E(λn) = λE(n), is the sum of the linear functions max(n·ω, 0) L(ω): it is linear but for
//! what the plane's horizon cuts. The table has its values on the octahedron |x| + |y| + |z| = 1, and is linear on triangles between them: all
//! light from above the horizons of all three corners is exact.

use super::patches::Patches;
use glam::DVec3;
use std::sync::OnceLock;

/// Places along an edge of the octahedron. Corners of a triangle are at most √2/32 · √3 = .077 apart as angles: interpolation adds at most an eighth
/// of its square, .07 %, of the irradiance of a uniform sphere, and a tenth of that near the vertical and horizontal planes.
const EDGE: usize = 32;
/// Largest error of one patch of the sky, as a part of the irradiance of a horizontal plane: about a hundred patches lie on a plane's horizon, and
/// each errs by less than a tenth of its bound, with either sign.
const DETAIL: f64 = 1e-4;

/// Values on the faces of an octahedron, which are found when they are asked for.
#[derive(Debug)]
pub struct Planes {
    values: Vec<OnceLock<[f64; 3]>>,
}

/// A quarter of the octahedron's surface, unfolded to a unit square: by the signs of x and y.
#[derive(Clone, Copy)]
struct Quarter([f64; 2]);

impl Quarter {
    /// The point of the octahedron at a place of the square. The half beyond the diagonal is the lower one.
    fn point(self, [a, b]: [f64; 2]) -> DVec3 {
        let [x, y] = if a + b <= 1.0 { [a, b] } else { [1.0 - b, 1.0 - a] };
        DVec3::new(self.0[0] * x, self.0[1] * y, 1.0 - a - b)
    }

    fn number(self) -> usize {
        usize::from(self.0[0] < 0.0) + 2 * usize::from(self.0[1] < 0.0)
    }
}

impl Planes {
    /// An empty table.
    pub fn new() -> Planes {
        Planes { values: (0..4 * (EDGE + 1) * (EDGE + 1)).map(|_| OnceLock::new()).collect() }
    }

    /// Irradiance of a plane with a unit normal in scene coordinates, W/m².
    pub fn irradiance(&self, patches: &Patches, normal: DVec3) -> [f64; 3] {
        let length = normal.abs().element_sum();
        let DVec3 { x, y, z } = normal / length;
        let quarter = Quarter([1f64.copysign(x), 1f64.copysign(y)]);
        let place = if z >= 0.0 { [x.abs(), y.abs()] } else { [1.0 - y.abs(), 1.0 - x.abs()] };
        let [(i, s), (j, t)] = place.map(|at| {
            let at = (at * EDGE as f64).clamp(0.0, EDGE as f64);
            let whole = (at as usize).min(EDGE - 1);
            (whole, at - whole as f64)
        });
        // Two triangles in each cell of the square.
        let corners = match s + t <= 1.0 {
            true => [([i, j], 1.0 - s - t), ([i + 1, j], s), ([i, j + 1], t)],
            false => [([i + 1, j + 1], s + t - 1.0), ([i + 1, j], 1.0 - t), ([i, j + 1], 1.0 - s)],
        };
        let mut sum = [0.0; 3];
        for (corner, weight) in corners.into_iter().filter(|(_, weight)| *weight > 0.0) {
            let value = self.value(patches, quarter, corner);
            (0..3).for_each(|c| sum[c] += length * weight * value[c]);
        }
        sum
    }

    fn value(&self, patches: &Patches, quarter: Quarter, [i, j]: [usize; 2]) -> [f64; 3] {
        let of = || {
            let point = quarter.point([i, j].map(|k| k as f64 / EDGE as f64));
            patches.irradiance_to(DETAIL, point.normalize()).map(|e| point.length() * e)
        };
        *self.values[(quarter.number() * (EDGE + 1) + i) * (EDGE + 1) + j].get_or_init(of)
    }
}
