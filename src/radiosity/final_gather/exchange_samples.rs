//! The light of elements by the rays of their exchange, where these rays suffice.

use super::element_samples::{DIRECT, ElementLight, REFLECTED};
use super::gatherer::FinalGather;
use super::local_noise::LocalResult;
use super::ray_counts::{AVERAGED_ELEMENTS, NEEDED_SHARE};
use super::ray_rows::{RayRow, RayRows};
use crate::math::parallel;
use crate::radiosity::elements::Elements;
use crate::radiosity::rgb::mean;
use glam::Vec3;

impl FinalGather<'_> {
    /// The light of leaves of the exchange by its rays, after the light that elements reflect is known; empty if these rays leave more
    /// noise than the error asked for allows. Left out are leaves in partial shadow of suns, which need rays of their own to find the
    /// edges of shadows, along which elements are split. The first half of the rays selects these leaves, and the second half, divided
    /// again, gives the light of suns: with the same rays for both, the leaves below small gaps that are not left out would have too
    /// little light.
    ///
    /// Scenes in which more light is reflected than the error asked for are left out as well: the light of an element and the fraction of
    /// it that leaves the scene would be known by the same rays, and their product has a bias. Where surfaces of a town reflect 0.9,
    /// absorbed and escaped power would exceed the emitted power by 1 %.
    pub(super) fn exchange_samples(
        &self,
        rows: &RayRows,
        results: &[LocalResult],
    ) -> Vec<(u32, ElementLight)> {
        let has_emitters = !self.emitters.emitters.is_empty();
        if has_emitters || self.reflected_everywhere() > self.error || !self.exchange_suffices(rows, results)
        {
            return Vec::new();
        }
        let reflected: Vec<Vec3> = parallel::map(&rows.rows, |row| self.reflected_by(row.leaf, results));
        let first_half = |row: &RayRow| (row.halves[0].sun.into_iter().sum(), row.rays / 2);
        let is_partly_lit = self.partly_sunlit(&[rows], first_half);
        let first = |i: usize| if i == 0 { 0 } else { rows.rows[i - 1].end };
        let of_row = |i: usize| {
            let row = &rows.rows[i];
            let parent = self.linked.elements.elements[row.leaf as usize].parent as usize;
            let is_kept = !is_partly_lit.get(parent).copied().unwrap_or(false);
            is_kept.then(|| (row.leaf, light_of_row(row, &rows.met[first(i)..row.end], &reflected)))
        };
        parallel::flat_map(0..rows.rows.len(), of_row)
    }

    /// Whether the rays of the exchange bring the noise of elements, shared between neighbours, to [`NEEDED_SHARE`] of the error asked
    /// for: the error of all elements together is √(Σ A σ² / n / Σ A) for areas A, deviations σ of one ray and numbers n of rays.
    fn exchange_suffices(&self, rows: &RayRows, results: &[LocalResult]) -> bool {
        let elements = &self.linked.elements.elements;
        let (mut noise, mut area, mut light) = (0.0, 0.0, 0.0);
        for row in &rows.rows {
            let (own, result) = (elements[row.leaf as usize].area, &results[row.leaf as usize]);
            noise += own * f64::from(result.deviation).powi(2) / f64::from(row.rays);
            area += own;
            light += own * mean(result.irradiance);
        }
        noise / (AVERAGED_ELEMENTS * area) <= (NEEDED_SHARE * self.error * light / area).powi(2)
    }
}

/// The light of a leaf by its row: the rows that its rays have met, and the light that rows reflect, W/m².
fn light_of_row(row: &RayRow, met: &[u32], reflected: &[Vec3]) -> ElementLight {
    let half = row.rays / 2;
    let mut light = ElementLight { rays: half, sky: row.sky / row.rays as f32, ..ElementLight::default() };
    // Suns, by the second half of the rays: the variance of the mean is (a - b)² / 4.
    let parts = [half / 2, half - half / 2].map(|count| count as f32);
    light.halves[DIRECT] = [0, 1].map(|k| row.halves[1].sun[k] / parts[k]);
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
