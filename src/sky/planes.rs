//! Irradiance of unobstructed planes of many orientations, from a table.
//!
//! Irradiance E, continued to vectors of any length by E(λn) = λE(n), is the sum of the linear functions max(n·ω, 0) L(ω): it is linear
//! except for sources that the plane's horizon cuts. The table has its values on the octahedron |x| + |y| + |z| = 1, and is quadratic on
//! triangles there: all light from above the horizons of the six places of a triangle is exact. Linear interpolation would err by the
//! second derivative, the light on the plane's horizon itself, four times as much under a sky that is bright around a low sun as under a
//! uniform one.

use super::patches::Patches;
use glam::DVec3;
use std::sync::OnceLock;

/// Triangles along an edge of the octahedron. With those of [`MAX_ERROR`] the largest error found is 6.4e-4 of the irradiance of a
/// horizontal plane: close to horizontal planes under a sky of CIE type 15 with the sun at 2°, as the second derivative jumps where the
/// sky ends.
const TRIANGLES: usize = 15;
/// Places along an edge: corners of triangles and middles between them.
const PLACES: usize = 2 * TRIANGLES + 1;
/// Detail of values, see [`Patches::irradiance_to`]: they err by at most 2.5e-4 of the irradiance of a horizontal plane, and all of them
/// take 13 ms.
const MAX_ERROR: f64 = 1.5e-4;

/// Values on the faces of an octahedron, computed at their first use.
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
        Planes { values: (0..4 * PLACES * PLACES).map(|_| OnceLock::new()).collect() }
    }

    /// Irradiance of a plane with a unit normal in scene coordinates, W/m².
    pub fn irradiance(&self, patches: &Patches, normal: DVec3) -> [f64; 3] {
        let length = normal.abs().element_sum();
        let DVec3 { x, y, z } = normal / length;
        let quarter = Quarter([1f64.copysign(x), 1f64.copysign(y)]);
        let place = if z >= 0.0 { [x.abs(), y.abs()] } else { [1.0 - y.abs(), 1.0 - x.abs()] };
        let [(i, s), (j, t)] = place.map(|at| {
            let at = (at * TRIANGLES as f64).clamp(0.0, TRIANGLES as f64);
            let whole = (at as usize).min(TRIANGLES - 1);
            (whole, at - whole as f64)
        });
        // Two triangles in each cell of the square, with their right angles at its first and at its last corner.
        let is_last = s + t > 1.0;
        let [s, t] = if is_last { [1.0 - s, 1.0 - t] } else { [s, t] };
        let r = 1.0 - s - t;
        let corner = |part: f64| part * (2.0 * part - 1.0);
        let places = [
            ([0, 0], corner(r)),
            ([2, 0], corner(s)),
            ([0, 2], corner(t)),
            ([1, 0], 4.0 * r * s),
            ([0, 1], 4.0 * r * t),
            ([1, 1], 4.0 * s * t),
        ];
        let mut sum = [0.0; 3];
        for ([a, b], weight) in places {
            let at = |cell: usize, step: usize| 2 * cell + if is_last { 2 - step } else { step };
            let value = self.value(patches, quarter, [at(i, a), at(j, b)]);
            (0..3).for_each(|c| sum[c] += length * weight * value[c]);
        }
        // If all light comes from below, cancelling terms may leave a negative sum.
        sum.map(|e| e.max(0.0))
    }

    fn value(&self, patches: &Patches, quarter: Quarter, [i, j]: [usize; 2]) -> [f64; 3] {
        let of = || {
            let point = quarter.point([i, j].map(|k| k as f64 / (PLACES - 1) as f64));
            patches.irradiance_to(MAX_ERROR, point.normalize()).map(|e| point.length() * e)
        };
        *self.values[(quarter.number() * PLACES + i) * PLACES + j].get_or_init(of)
    }
}
