//! Measured or stated distributions of luminous intensity, and plane faces that emit by them.

use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// Largest difference of the intensities that planes state at the nadir or the zenith, relative to the largest of the table: the
/// rounding of tables in whole candelas with a peak of 100 cd.
const AXIS_TOLERANCE: f64 = 0.01;

/// Luminous intensity by direction: angle γ from the axis of the luminaire (0 to 180°) and angle C about it. Between
/// the tabulated directions intensity is linear in both angles; beyond the tabulated γ it is 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Distribution {
    /// Half-planes, radians in `[0, 2π)`, ascending; the last and the first are neighbours.
    planes: Vec<f64>,
    /// Angles from the axis, radians in `[0, π]`, ascending.
    gammas: Vec<f64>,
    /// Candelas of each plane in turn.
    candelas: Vec<f64>,
}

/// Symmetry of a table of half-planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// All planes are listed.
    None,
    /// One plane stands for all.
    Axis,
    /// C and −C are alike: planes from 0 to 180°.
    C0C180,
    /// C and 180° − C are alike: planes on one side of C = 90° and 270°.
    C90C270,
    /// Both: planes from 0 to 90°.
    Both,
}

impl Distribution {
    /// From a table in degrees; `rows` has the candelas of each plane. Angles ascend, at least two γ lie in 0 to 180°, and
    /// candelas are finite and not negative.
    pub fn new(planes: &[f64], gammas: &[f64], rows: &[Vec<f64>], symmetry: Symmetry) -> Distribution {
        let mut all: Vec<(f64, usize)> = Vec::new();
        for (row, &c) in planes.iter().enumerate() {
            let images: &[f64] = match symmetry {
                Symmetry::Axis => &[0.0],
                Symmetry::None => &[c],
                Symmetry::C0C180 => &[c, -c],
                Symmetry::C90C270 => &[c, 180.0 - c],
                Symmetry::Both => &[c, -c, 180.0 - c, 180.0 + c],
            };
            all.extend(images.iter().map(|a| (a.rem_euclid(360.0), row)));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.dedup_by(|b, a| (b.0 - a.0).abs() < 1e-6);
        Distribution {
            planes: all.iter().map(|a| a.0.to_radians()).collect(),
            gammas: gammas.iter().map(|g| g.to_radians()).collect(),
            candelas: all.iter().flat_map(|a| rows[a.1].iter().copied()).collect(),
        }
    }

    /// The same intensity at every C, from pairs of γ in degrees and candelas.
    pub fn about_axis(pairs: &[(f64, f64)]) -> Distribution {
        let (gammas, row): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
        Distribution::new(&[0.0], &gammas, &[row], Symmetry::Axis)
    }

    /// Candelas in a direction, radians.
    pub fn intensity(&self, gamma: f64, c: f64) -> f64 {
        let n = self.planes.len();
        let c = c.rem_euclid(TAU);
        let after = self.planes.partition_point(|&p| p <= c);
        let (a, b) = ((after + n - 1) % n, after % n);
        let gap = (self.planes[b] - self.planes[a]).rem_euclid(TAU);
        let share = if gap == 0.0 { 0.0 } else { (c - self.planes[a]).rem_euclid(TAU) / gap };
        (1.0 - share) * self.in_plane(a, gamma) + share * self.in_plane(b, gamma)
    }

    /// The error message if the planes state different intensities at the nadir or the zenith, the directions that they share.
    pub fn contradiction(&self) -> Option<String> {
        let peak = self.candelas.iter().copied().fold(0.0, f64::max);
        let differs = |(name, gamma)| {
            let all = (0..self.planes.len()).map(|plane| self.in_plane(plane, gamma));
            let (low, high) = all.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), v| (a.min(v), b.max(v)));
            // As f32, without the digits that factors of the table add by rounding.
            (high - low > AXIS_TOLERANCE * peak)
                .then(|| format!("{} to {} cd at the {name}", low as f32, high as f32))
        };
        let ends = [("nadir (γ = 0)", 0.0), ("zenith (γ = 180°)", PI)];
        let found: Vec<String> = ends.into_iter().filter_map(differs).collect();
        let why = "depending on the C plane, but all planes are one direction there: results of different methods differ \
                   near it; make these values equal in the file";
        (!found.is_empty()).then(|| format!("its table states {} {why}", found.join(" and ")))
    }

    fn in_plane(&self, plane: usize, gamma: f64) -> f64 {
        let g = &self.gammas;
        // Rounding of angles at the ends of the table.
        let gamma = if (gamma - g[0]).abs() < 1e-6 { g[0] } else { gamma };
        let last = g.len() - 1;
        let gamma = if (gamma - g[last]).abs() < 1e-6 { g[last] } else { gamma };
        if gamma < g[0] || gamma > g[last] {
            return 0.0;
        }
        let i = g.partition_point(|&x| x <= gamma).clamp(1, last);
        let row = &self.candelas[plane * g.len()..][..g.len()];
        row[i - 1] + (row[i] - row[i - 1]) * (gamma - g[i - 1]) / (g[i] - g[i - 1])
    }

    /// Lumens between two angles from the axis (radians), the exact integral of the interpolated intensity.
    pub fn flux(&self, low: f64, high: f64) -> f64 {
        let n = self.planes.len();
        let zone = |plane: usize| -> f64 {
            self.gammas
                .windows(2)
                .map(|w| {
                    let (a, b) = (w[0].max(low), w[1].min(high));
                    if a >= b {
                        return 0.0;
                    }
                    let (ia, ib) = (self.in_plane(plane, a), self.in_plane(plane, b));
                    let slope = (ib - ia) / (b - a);
                    // ∫ (ia + slope (γ − a)) sin γ dγ
                    ia * a.cos() - ib * b.cos() + slope * (b.sin() - a.sin())
                })
                .sum()
        };
        let zones: Vec<f64> = (0..n).map(zone).collect();
        if n == 1 {
            return TAU * zones[0];
        }
        (0..n)
            .map(|i| {
                let next = (i + 1) % n;
                (self.planes[next] - self.planes[i]).rem_euclid(TAU) * 0.5 * (zones[i] + zones[next])
            })
            .sum()
    }

    /// Lumens below and above the plane through the luminaire.
    pub fn halves(&self) -> [f64; 2] {
        [self.flux(0.0, FRAC_PI_2), self.flux(FRAC_PI_2, PI)]
    }
}

/// A luminaire's distribution with its axes in the scene.
#[derive(Clone, Debug)]
pub struct Profile {
    distribution: Arc<Distribution>,
    /// Unit vectors towards γ = 0, towards C = 0 and towards C = 90°.
    axes: [DVec3; 3],
    /// Flux of the half of the distribution that the face emits, lm.
    flux: f64,
    /// Dimming and maintenance factor, which the emission of the face contains.
    pub factors: [f64; 2],
}

impl Profile {
    /// The emission of a plane face whose half of the distribution has `flux` lumens.
    pub fn new(distribution: Arc<Distribution>, axes: [DVec3; 3], flux: f64, factors: [f64; 2]) -> Profile {
        Profile { distribution, axes, flux, factors }
    }

    /// Radiance towards `direction` (a unit vector away from the face) relative to that of a diffuse face of the same flux,
    /// times the cosine between the direction and the normal: π I / Φ. For a diffuse face this is the cosine.
    pub fn projected(&self, direction: Vec3) -> f32 {
        let d = direction.as_dvec3();
        let [axis, c0, c90] = self.axes.map(|a| a.dot(d));
        let gamma = axis.clamp(-1.0, 1.0).acos();
        (PI * self.distribution.intensity(gamma, c90.atan2(c0)) / self.flux) as f32
    }

    /// Radiance towards `direction` relative to that of a diffuse face of the same flux; `cosine` is that of the direction and
    /// the normal, above 0.
    pub fn gain(&self, direction: Vec3, cosine: f32) -> f32 {
        // At 1e-6 the face is seen edge on: its projected area is below the rounding of f32.
        self.projected(direction) / cosine.max(1e-6)
    }
}

/// The axes of a luminaire that points along `aim` with C = 0 near `towards`: seen from behind, C turns counterclockwise
/// (LM-63 type C, EULUMDAT). None if a vector is zero or both are parallel.
pub fn axes(aim: DVec3, towards: DVec3) -> Option<[DVec3; 3]> {
    let (axis, towards) = (aim.try_normalize()?, towards.try_normalize()?);
    let across = towards - axis * towards.dot(axis);
    // Below the rounding of the coordinates of a file with six digits the direction is not known.
    let c0 = across.try_normalize().filter(|_| across.length() > 1e-6)?;
    Some([axis, c0, c0.cross(axis)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flux_of_known_distributions() {
        let even = Distribution::about_axis(&[(0.0, 100.0), (180.0, 100.0)]);
        assert!((even.flux(0.0, PI) / (400.0 * PI) - 1.0).abs() < 1e-12);
        let rows: Vec<(f64, f64)> =
            (0..=90).map(|g| (f64::from(g), 100.0 * f64::from(g).to_radians().cos())).collect();
        // A diffuse plate: π I(0); linear interpolation of a cosine in steps of 1 degree loses 2.5e-5.
        let diffuse = Distribution::about_axis(&rows);
        assert!((diffuse.halves()[0] / (100.0 * PI) - 1.0).abs() < 5e-5);
        assert!(diffuse.halves()[1].abs() < 1e-9);
    }

    #[test]
    fn flux_is_the_sum_over_directions_and_symmetries_unfold() {
        let gammas = [0.0, 30.0, 60.0, 120.0];
        let rows = vec![vec![9.0, 5.0, 4.0, 1.0], vec![9.0, 7.0, 2.0, 0.0], vec![9.0, 1.0, 1.0, 3.0]];
        let planes = [0.0, 40.0, 90.0];
        let d = Distribution::new(&planes, &gammas, &rows, Symmetry::Both);
        let (n, mut sum) = (400, 0.0);
        for i in 0..n {
            for k in 0..n {
                let (g, c) =
                    (PI * (f64::from(i) + 0.5) / f64::from(n), TAU * (f64::from(k) + 0.5) / f64::from(n));
                sum += d.intensity(g, c) * g.sin() * PI * TAU / f64::from(n * n);
            }
        }
        assert!((d.flux(0.0, PI) / sum - 1.0).abs() < 1e-3);
        let at = |g: f64, c: f64| d.intensity(g.to_radians(), c.to_radians());
        for c in [40.0, -40.0, 140.0, 220.0] {
            assert!((at(30.0, c) - 7.0).abs() < 1e-9, "{c}");
        }
        assert_eq!(at(150.0, 0.0), 0.0);
        let half = Distribution::new(&[90.0, 180.0, 270.0], &gammas, &rows, Symmetry::C90C270);
        assert!((half.intensity(0.5, 0.0) - half.intensity(0.5, PI)).abs() < 1e-12);
    }
}
