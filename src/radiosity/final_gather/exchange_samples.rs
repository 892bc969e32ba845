//! The light of elements by the rays of their exchange, where these rays suffice.

use super::element_samples::{DIRECT, ElementLight, KINDS, REFLECTED};
use super::gatherer::FinalGather;
use super::local_noise::LocalResult;
use super::ray_counts::{NEEDED_SHARE, NEIGHBOURS};
use super::ray_rows::{RayRow, RayRows};
use crate::radiosity::elements::Elements;
use crate::radiosity::rgb::mean;
use glam::Vec3;
use rayon::prelude::*;

impl FinalGather<'_> {
    /// The light of leaves of the exchange by its rays, after the light that elements reflect is known; empty if the rays leave more noise than the error
    /// asked for allows, as estimated by [`FinalGather::needed_rays`]. Leaves that emitters may light, and those in partial shadow of suns, need rays of
    /// their own: these find the edges of shadows, along which elements are split.
    pub(super) fn exchange_samples(
        &self,
        rows: &RayRows,
        results: &[LocalResult],
    ) -> Vec<(u32, ElementLight)> {
        if !self.emitters.emitters.is_empty() || !self.exchange_suffices(rows, results) {
            return Vec::new();
        }
        let reflected: Vec<Vec3> =
            rows.rows.par_iter().map(|row| self.reflected_by(row.leaf, results)).collect();
        let first = |i: usize| if i == 0 { 0 } else { rows.rows[i - 1].end };
        let of_row = |(i, row): (usize, &RayRow)| {
            let met = &rows.met[first(i)..row.end];
            (!results[row.leaf as usize].sun_varies).then(|| (row.leaf, light_of_row(row, met, &reflected)))
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

/// The light of a leaf by its row: the rows that its rays have met, and the light that rows reflect, W/m².
fn light_of_row(row: &RayRow, met: &[u32], reflected: &[Vec3]) -> ElementLight {
    let (rays, half) = (row.rays as f32, row.rays as f32 / 2.0);
    let mut squares = row.squares_by_kind;
    let halves = [0, 1].map(|h| {
        let lit = row.halves[h].emitted + row.halves[h].sun;
        let mut others = row.halves[h].direct - lit;
        for &met in
            met[h * met.len() / 2..(h + 1) * met.len() / 2].iter().filter(|met| **met != Elements::NONE)
        {
            let light = reflected[met as usize];
            others += light;
            squares[REFLECTED] += (light.element_sum() / 3.0).powi(2);
        }
        [lit / half, others / half]
    });
    let halves: [[Vec3; 2]; KINDS] = [DIRECT, REFLECTED].map(|kind| [halves[0][kind], halves[1][kind]]);
    let mut light = ElementLight {
        rays: row.rays / 2,
        halves,
        sun: row.sun() / rays,
        sky: row.sky / rays,
        ..ElementLight::default()
    };
    for kind in [DIRECT, REFLECTED] {
        light.squares[kind] = (squares[kind] - rays * (light.mean(kind) as f32).powi(2)).max(0.0);
    }
    light
}
