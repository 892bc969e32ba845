//! The light of elements by the rays of their exchange, where these rays suffice.

use super::element_light::MIN_HALF;
use super::element_samples::{DIRECT, ElementLight, REFLECTED};
use super::gatherer::FinalGather;
use super::local_noise::LocalResult;
use super::ray_counts::{NEEDED_SHARE, NEIGHBOURS};
use super::ray_rows::{RayRow, RayRows};
use crate::radiosity::elements::Elements;
use crate::radiosity::rgb::mean;
use glam::Vec3;
use rayon::prelude::*;

impl FinalGather<'_> {
    /// The light of leaves of the exchange by its rays, after the light that elements reflect is known; empty if these rays leave more noise than the error
    /// asked for allows. Left out are leaves in partial shadow of suns, which need rays of their own to find the edges of shadows, along which elements are
    /// split. The first half of the rays tells which these are, and the second half, divided again, tells the light of suns: if the same rays did both, the leaves below
    /// small gaps that are not left out would have too little light.
    ///
    /// Scenes in which more light is reflected than the error asked for are left out as well: the light of an element and the part of it that leaves the
    /// scene would be known by the same rays, and their product has a bias. Where surfaces of a town reflect 0.9, absorbed and escaped power
    /// would exceed the emitted power by 1 %.
    ///
    /// Where only so many further rays are `possible` in time that leaves could not have the smallest number of them, all leaves keep the rays of the
    /// exchange.
    pub(super) fn exchange_samples(
        &self,
        rows: &RayRows,
        results: &[LocalResult],
        possible: f64,
    ) -> Vec<(u32, ElementLight)> {
        let all = possible < f64::from(2 * MIN_HALF) * rows.rows.len() as f64;
        let suffices = || {
            let has_emitters = !self.emitters.emitters.is_empty();
            !has_emitters
                && self.reflected_everywhere() <= self.error
                && self.exchange_suffices(rows, results)
        };
        if !all && !suffices() {
            return Vec::new();
        }
        let reflected: Vec<Vec3> =
            rows.rows.par_iter().map(|row| self.reflected_by(row.leaf, results)).collect();
        let first_half = |row: &RayRow| (row.halves[0].sun.into_iter().sum(), row.rays / 2);
        let is_partly_lit = self.partly_sunlit(&[rows], first_half);
        let first = |i: usize| if i == 0 { 0 } else { rows.rows[i - 1].end };
        let of_row = |(i, row): (usize, &RayRow)| {
            let parent = self.linked.elements.elements[row.leaf as usize].parent as usize;
            let is_kept = all || !is_partly_lit.get(parent).copied().unwrap_or(false);
            let suns = if all { suns_of_halves(row) } else { suns_of_second_half(row) };
            is_kept.then(|| (row.leaf, light_of_row(row, suns, &rows.met[first(i)..row.end], &reflected)))
        };
        rows.rows.par_iter().enumerate().filter_map(of_row).collect()
    }

    /// Whether the rays of the exchange bring the noise of elements, shared between neighbours, to [`NEEDED_SHARE`] of the error asked for: the error of all
    /// elements together is √(Σ A σ² / n / Σ A) for areas A, deviations σ of one ray and numbers n of rays.
    fn exchange_suffices(&self, rows: &RayRows, results: &[LocalResult]) -> bool {
        let elements = &self.linked.elements.elements;
        let (mut noise, mut area, mut light) = (0.0, 0.0, 0.0);
        for row in &rows.rows {
            let (own, result) = (elements[row.leaf as usize].area, &results[row.leaf as usize]);
            noise += own * f64::from(result.deviation).powi(2) / f64::from(row.rays);
            area += own;
            light += own * mean(result.irradiance);
        }
        noise / (NEIGHBOURS * area) <= (NEEDED_SHARE * self.error * light / area).powi(2)
    }
}

/// Irradiance of a leaf by suns, W/m², by each half of its rays.
fn suns_of_halves(row: &RayRow) -> [Vec3; 2] {
    row.halves.map(|half| (half.sun[0] + half.sun[1]) / (row.rays / 2) as f32)
}

/// The same by the two parts of the second half of its rays.
fn suns_of_second_half(row: &RayRow) -> [Vec3; 2] {
    let half = row.rays / 2;
    let parts = [half / 2, half - half / 2].map(|count| count as f32);
    [0, 1].map(|k| row.halves[1].sun[k] / parts[k])
}

/// The light of a leaf by its row: two estimates of the light of suns, the rows that its rays have met, and the light that rows reflect, W/m².
fn light_of_row(row: &RayRow, suns: [Vec3; 2], met: &[u32], reflected: &[Vec3]) -> ElementLight {
    let half = row.rays / 2;
    let mut light = ElementLight { rays: half, sky: row.sky / row.rays as f32, ..ElementLight::default() };
    // The variance of the mean of two values is (a - b)² / 4.
    light.halves[DIRECT] = suns;
    light.sun = 0.5 * (light.halves[DIRECT][0] + light.halves[DIRECT][1]);
    let [a, b] = light.halves[DIRECT].map(|light| light.element_sum() / 3.0);
    light.squares[DIRECT] = (half as f32 * (a - b)).powi(2);
    light.squares[REFLECTED] = row.squares_beside_suns;
    for (h, of_half) in row.halves.iter().enumerate() {
        let mut sum = of_half.direct - of_half.sun[0] - of_half.sun[1];
        let met = &met[h * half as usize..][..half as usize];
        for &met in met.iter().filter(|met| **met != Elements::NONE) {
            let of_ray = reflected[met as usize];
            sum += of_ray;
            light.squares[REFLECTED] += (of_ray.element_sum() / 3.0).powi(2);
        }
        light.halves[REFLECTED][h] = sum / half as f32;
    }
    let square = (light.mean(REFLECTED) as f32).powi(2);
    light.squares[REFLECTED] = (light.squares[REFLECTED] - row.rays as f32 * square).max(0.0);
    light
}
