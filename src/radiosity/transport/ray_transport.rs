//! Transport along the rays of the local pass.

use super::Field;
use super::transport_matrix::TransportMatrix;
use crate::radiosity::rgb::add;

/// Rays as rows of the transport operator, in two independent halves: light that a row receives along one half of the rays is sent along
/// the other half.
///
/// With one set of rays, light would return along the ray by which it was sent: two elements joined by few rays would each receive too
/// much light from the other, and too little from all others. In a lamp shade elements with four rays had 10 % too much light. Likewise,
/// the light that rays bring and the part of it that a row sends would be correlated.
///
/// Unknowns are the irradiances of all rows by the first half, `a = direct_a + K_a (direct_b + K_b a)`, where direct light includes what
/// paths bring.
pub struct RayTransport {
    /// Exchange between the rows, by half of the rays.
    halves: [TransportMatrix; 2],
    /// Light that paths bring by way of elements without rows, by half of the rays.
    paths: [Vec<Path>; 2],
    /// Irradiance by emitters, suns and sky, W/m², by half.
    own: [Field; 2],
    /// The same with the light that paths brought in the last pass.
    direct: [Field; 2],
    /// Weights of the rows in sums over the scene.
    weights: Vec<f64>,
}

/// A path that brings light from one row to another.
pub struct Path {
    /// Row at its start.
    pub row: u32,
    /// Row at its end.
    pub met: u32,
    /// Irradiance that it brings relative to that of the row where it ends, by channel.
    pub share: [f32; 3],
}

impl RayTransport {
    /// For the exchange, the paths and the direct irradiance of the rows by half. Rows count by their area.
    pub fn new(halves: [TransportMatrix; 2], paths: [Vec<Path>; 2], direct: [Field; 2]) -> RayTransport {
        let weights = halves[0].area.clone();
        RayTransport { halves, paths, own: direct.clone(), direct, weights }
    }

    /// With rows that count by their area times these importances: the light of a hut on a plain may be all that is asked for.
    pub fn with_importance(mut self, importance: impl Iterator<Item = f64>) -> RayTransport {
        self.weights.iter_mut().zip(importance).for_each(|(weight, factor)| *weight *= factor);
        self
    }

    /// Whether there are paths.
    pub fn has_paths(&self) -> bool {
        self.paths.iter().any(|paths| !paths.is_empty())
    }

    /// Replaces the light that paths bring by a share of `light`, given by half, at the ends of the paths: each half gets that of the
    /// other half.
    pub fn bring(&mut self, light: &[Field; 2]) {
        self.direct = self.own.clone();
        for (half, direct) in self.direct.iter_mut().enumerate() {
            for Path { row, met, share } in &self.paths[half] {
                let end = light[1 - half][*met as usize];
                add(&mut direct[*row as usize], 1.0, std::array::from_fn(|k| f64::from(share[k]) * end[k]));
            }
        }
    }

    /// The row sums of the form factors, by half.
    pub fn row_sums(&self) -> [Vec<f64>; 2] {
        [0, 1].map(|half: usize| self.halves[half].rows())
    }

    /// The rows at the other ends of i's rays, with the form factor that each ray contributes.
    pub fn form_factors(&self, i: usize) -> impl Iterator<Item = (u32, f64)> {
        self.halves.iter().flat_map(move |half| half.form_factors(i)).map(|(j, factor)| (j, 0.5 * factor))
    }

    /// The light by both halves, from that by the first one.
    pub fn both(&self, first: Field) -> [Field; 2] {
        let second = self.received(1, &first);
        [self.received(0, &second), second]
    }

    /// Irradiance that emitters cause directly, by the first half.
    pub fn direct(&self) -> Field {
        self.received(0, &self.direct[1])
    }

    /// Irradiance that the reflection of `irradiance` causes, by the first half.
    pub fn reflected(&self, irradiance: &Field) -> Field {
        self.halves[0].reflected(&self.halves[1].reflected(irradiance))
    }

    /// Weight of each unknown in sums over the scene.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Terms that one application of both halves, and what paths bring, add up.
    pub fn terms(&self) -> usize {
        let of_paths: usize = self.paths.iter().map(Vec::len).sum();
        of_paths + self.halves.iter().map(TransportMatrix::entries).sum::<usize>()
    }

    /// Light along the rays of one half, if rows reflect `other`, their light along the rays of the other half.
    fn received(&self, half: usize, other: &Field) -> Field {
        let mut sum = self.halves[half].reflected(other);
        sum.iter_mut().zip(&self.direct[half]).for_each(|(sum, direct)| add(sum, 1.0, *direct));
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::super::solve;
    use super::super::transport_matrix::MatrixRow;
    use super::*;
    use crate::math::sampling::numbers;
    use crate::radiosity::deadline::Deadline;
    use crate::ranks::Ranks;

    /// Rows of few rays of which some leave the scene and bring light: what they send is right on average, although rows with much light
    /// have few rays that stay. The rays of a half are stratified, and rows have different densities.
    #[test]
    fn light_of_rays_that_leave_is_sent_in_full() {
        let n = 8000u64;
        for (escape, rays) in
            [([0.1; 2], [2u64, 2]), ([0.5; 2], [2, 3]), ([0.8; 2], [2, 8]), ([0.2, 0.8], [2, 2])]
        {
            // Half of what stays of the kind of rows that loses more goes to the other kind, and as much comes back.
            let across = 0.5 * (1.0 - f64::max(escape[0], escape[1]));
            let of_half = |half: u64| {
                let (mut met, mut brought, mut rows) = (Vec::new(), Vec::new(), Vec::new());
                for i in 0..n {
                    let (rays, escapes) = (rays[(i % 2) as usize], escape[(i % 2) as usize]);
                    let crosses = across / (1.0 - escapes);
                    let mut gone = 0.0;
                    for k in 0..rays {
                        let [stays, which, kind, _] = numbers(2 * i + half, k);
                        let other = u64::from(f64::from(kind) < crosses);
                        let to = 2 * (which * (n / 2) as f32) as u64 + (i + other) % 2;
                        let leaves = (f64::from(stays) + k as f64) / (rays as f64) < escapes;
                        gone += if leaves { 1.0 / rays as f64 } else { 0.0 };
                        met.push(if leaves { u32::MAX } else { to as u32 });
                    }
                    brought.push([gone; 3]);
                    let (area, reflectance, end) = (1.0, [1.0; 3], met.len());
                    rows.push(MatrixRow { area, reflectance, end, closed: false, escapes, apart: 0 });
                }
                (TransportMatrix::new(&rows, &met, &Ranks::default()).balanced(&rows, &met), brought)
            };
            let [(a, from_a), (b, from_b)] = [0, 1].map(of_half);
            let direct = [from_a, from_b];
            let sum = |light: &Field, part: [f64; 2]| -> f64 {
                light.iter().enumerate().map(|(i, e)| part[i % 2] * e[0]).sum()
            };
            let received = sum(&a.reflected(&direct[1]), [1.0; 2]) + sum(&b.reflected(&direct[0]), [1.0; 2]);
            let want: f64 = direct.iter().map(|of| sum(of, escape.map(|escape| 1.0 - escape))).sum();
            assert!((received / want - 1.0).abs() < 0.012, "{escape:?} {rays:?}: {received} {want}");
        }
    }

    /// A row whose light comes by a path alone has that fraction of the light at its end, and sends it on along another.
    #[test]
    fn paths_bring_the_light_of_their_ends() {
        let row = |k: usize| MatrixRow {
            area: 1.0,
            reflectance: [0.5; 3],
            end: 2 * (k + 1),
            closed: false,
            escapes: 1.0,
            apart: 0,
        };
        let rows: Vec<MatrixRow> = (0..3).map(row).collect();
        let matrix = || TransportMatrix::new(&rows, &[u32::MAX; 6], &Ranks::default());
        let paths =
            || vec![Path { row: 0, met: 1, share: [0.5; 3] }, Path { row: 2, met: 0, share: [0.1; 3] }];
        let direct: Field = vec![[0.0; 3], [8.0; 3], [0.0; 3]];
        let mut transport =
            RayTransport::new([matrix(), matrix()], [paths(), paths()], [direct.clone(), direct]);
        let (first, _) = solve(&mut transport, None, &Deadline::start(&(), None));
        for light in transport.both(first) {
            let want = [4.0, 8.0, 0.4];
            assert!(light.iter().zip(want).all(|(e, want)| (e[0] - want).abs() < 1e-6), "{light:?}");
        }
    }
}
