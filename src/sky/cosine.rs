//! Cosine-weighted solid angles of patches, clipped at a receiver's horizon.
//!
//! A patch is the set of local directions with heights (sines of the elevation) in `[z0, z1]` and azimuths in `[v0, v1]`, at most a
//! whole turn. The integral of n·ω over a part of the sphere is half the integral of n·(r × dr) along its boundary, counter-clockwise
//! as seen from outside. All parts of a clipped boundary have closed forms: great circles (meridians and the horizon of the receiver) and
//! circles of constant height.

use super::frame::{azimuth, spherical};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Rotation of the receiver's normal, radians, that keeps its horizon from coinciding with an edge of a patch, where rounding would decide
/// whether the edge counts once, twice or not at all. It changes results by as much, relative to a hemisphere's π.
const TILT: f64 = 1e-8;

/// Ranges of height and azimuth (radians) of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Heights, in `[-1, 1]`, increasing.
    pub z: [f64; 2],
    /// Azimuths, increasing.
    pub v: [f64; 2],
}

impl Extent {
    /// Solid angle, sr.
    pub fn solid_angle(&self) -> f64 {
        (self.z[1] - self.z[0]) * self.turn()
    }

    /// Range of azimuths, radians.
    pub fn turn(&self) -> f64 {
        self.v[1] - self.v[0]
    }

    /// Integral of the unit vector over the patch, sr, in local coordinates. Its product with a normal is the cosine-weighted solid angle
    /// if no part is below the receiver's horizon.
    pub fn moment(&self) -> DVec3 {
        let [z0, z1] = self.z;
        let ([s0, c0], [s1, c1]) = (sin_cos(self.v[0]), sin_cos(self.v[1]));
        // ∫ sqrt(1 − z²) dz
        let area = |z: f64| 0.5 * (z * horizontal(z) + z.clamp(-1.0, 1.0).asin());
        let area = area(z1) - area(z0);
        DVec3::new(area * (c0 - c1), area * (s1 - s0), 0.5 * self.turn() * (z1 - z0) * (z1 + z0))
    }

    /// Local direction at fractions `s` of the heights and `t` of the azimuths.
    pub fn at(&self, s: f64, t: f64) -> DVec3 {
        let mix = |[a, b]: [f64; 2], t: f64| a + t * (b - a);
        spherical(mix(self.z, s), mix(self.v, t))
    }

    /// Cosine-weighted solid angle, sr, of the part of the patch above the plane with the local unit normal `n`.
    pub fn projected(&self, n: DVec3) -> f64 {
        let Some(n) = tilted(n).try_normalize() else { return 0.0 };
        let nh = n.x.hypot(n.y);
        let vn = azimuth(n);
        let [z0, z1] = self.z;
        let mut sum = self.parallel(z0, n.z, nh, vn) - self.parallel(z1, n.z, nh, vn) + self.horizon(n, nh);
        // The two meridians of a whole turn cancel.
        if self.turn() < TAU {
            sum += self.meridian(self.v[1], n.z, nh, vn) - self.meridian(self.v[0], n.z, nh, vn);
        }
        (0.5 * sum).max(0.0)
    }

    /// Integral along the part of the edge of height `z` that is above the plane, in the sense of decreasing azimuth.
    fn parallel(&self, z: f64, nz: f64, nh: f64, vn: f64) -> f64 {
        let s = horizontal(z);
        if s == 0.0 {
            return 0.0;
        }
        let integral = |a: f64, b: f64| s * s * nz * (b - a) - z * s * nh * ((b - vn).sin() - (a - vn).sin());
        // Above the plane: nz z + nh s cos(v − vn) > 0, within `half` of the normal's azimuth.
        let half = (-nz * z / (nh * s)).clamp(-1.0, 1.0).acos();
        let mut sum = 0.0;
        for turn in -2..=2 {
            let centre = vn + TAU * f64::from(turn);
            let (a, b) = (self.v[0].max(centre - half), self.v[1].min(centre + half));
            if a < b {
                sum += integral(a, b);
            }
        }
        sum
    }

    /// Integral along the part of the edge of azimuth `v` that is above the plane, in the sense of decreasing height.
    fn meridian(&self, v: f64, nz: f64, nh: f64, vn: f64) -> f64 {
        let [e0, e1] = self.z.map(|z| z.clamp(-1.0, 1.0).asin());
        // Above the plane: nz sin e + nh cos(v − vn) cos e = r cos(e − peak) > 0.
        let peak = nz.atan2(nh * (v - vn).cos());
        let mut length = 0.0;
        for turn in -1..=1 {
            let centre = peak + TAU * f64::from(turn);
            length += (e1.min(centre + 0.5 * PI) - e0.max(centre - 0.5 * PI)).max(0.0);
        }
        nh * (v - vn).sin() * length
    }

    /// Length of the receiver's horizon inside the patch, radians.
    fn horizon(&self, n: DVec3, nh: f64) -> f64 {
        let e1 = DVec3::new(-n.y, n.x, 0.0) / nh;
        let e2 = n.cross(e1);
        // Angles along the horizon where it may enter or leave the patch.
        let mut cuts = [0.0; 8];
        let mut count = 1;
        for z in self.z {
            // The height of the horizon at the angle t is nh sin t.
            if z.abs() < nh {
                let t = (z / nh).asin();
                cuts[count] = t.rem_euclid(TAU);
                cuts[count + 1] = (PI - t).rem_euclid(TAU);
                count += 2;
            }
        }
        if self.turn() < TAU {
            for v in self.v {
                // Where the horizon crosses the half plane of the azimuth.
                let side = DVec3::new(v.cos(), -v.sin(), 0.0);
                let along = side.cross(n).normalize_or_zero();
                let outwards = DVec3::new(v.sin(), v.cos(), 0.0);
                let along = if along.dot(outwards) < 0.0 { -along } else { along };
                cuts[count] = along.dot(e2).atan2(along.dot(e1)).rem_euclid(TAU);
                count += 1;
            }
        }
        let cuts = &mut cuts[..count];
        cuts.sort_by(f64::total_cmp);
        let mut length = 0.0;
        for k in 0..cuts.len() {
            let end = if k + 1 < cuts.len() { cuts[k + 1] } else { TAU };
            let [sin, cos] = sin_cos(0.5 * (cuts[k] + end));
            if self.contains(cos * e1 + sin * e2) {
                length += end - cuts[k];
            }
        }
        length
    }

    /// Whether a local unit vector is in the patch.
    pub fn contains(&self, local: DVec3) -> bool {
        let from_start = (azimuth(local) - self.v[0]).rem_euclid(TAU);
        (self.z[0]..=self.z[1]).contains(&local.z.clamp(-1.0, 1.0))
            && (self.turn() >= TAU || from_start <= self.turn())
    }
}

fn horizontal(z: f64) -> f64 {
    ((1.0 - z) * (1.0 + z)).max(0.0).sqrt()
}

fn sin_cos(angle: f64) -> [f64; 2] {
    let (s, c) = angle.sin_cos();
    [s, c]
}

/// The normal, turned by [`TILT`] about axes that no patch is aligned with.
fn tilted(n: DVec3) -> DVec3 {
    n + TILT * n.cross(DVec3::new(0.612, -0.774, 0.161))
}
