//! Partial shadows of suns on elements.

use super::gatherer::FinalGather;
use super::local_noise::LocalResult;
use super::ray_rows::{RayRow, RayRows};
use crate::radiosity::elements::Elements;
use crate::radiosity::rgb::mean;
use glam::Vec3;

/// Visible fraction of the suns' light up to which leaves with one parent count as shaded, and hidden fraction up to which they count as
/// sunlit: half a ray of sixteen, so that one ray that disagrees with up to thirty others puts these leaves in partial shadow.
const SHADED: f64 = 1.0 / 32.0;

impl FinalGather<'_> {
    /// Marks leaves in partial shadow.
    pub(super) fn mark_shadows(&self, rows: &[&RayRows], results: &mut [LocalResult]) {
        let is_partly_lit = self.partly_sunlit(rows, |row| (row.sun(), row.rays));
        let elements = &self.linked.elements.elements;
        for row in rows.iter().flat_map(|rows| &rows.rows) {
            let parent = elements[row.leaf as usize].parent as usize;
            results[row.leaf as usize].sun_varies = is_partly_lit.get(parent).copied().unwrap_or(false);
        }
    }

    /// Whether rays to suns, from all leaves with the same parent, find some of the light, neither none nor all; by parent, empty without
    /// suns. `found` returns the sum of the irradiance of suns by some rays of a leaf, W/m², and the number of these rays.
    pub(super) fn partly_sunlit(
        &self,
        rows: &[&RayRows],
        found: impl Fn(&RayRow) -> (Vec3, u32),
    ) -> Vec<bool> {
        let Elements { elements, sides, .. } = &self.linked.elements;
        if self.suns().is_empty() {
            return Vec::new();
        }
        let mut sums = vec![[0.0f64; 2]; elements.len()];
        for row in rows.iter().flat_map(|rows| &rows.rows) {
            let normal = sides[self.side_of(row.leaf) as usize].normal.as_dvec3();
            let free: f64 = self.suns().iter().map(|sun| mean(sun.irradiance_on(normal))).sum();
            let (sun, rays) = found(row);
            let found = [f64::from(sun.element_sum()) / 3.0, f64::from(rays) * free];
            let parent = elements[row.leaf as usize].parent as usize;
            sums[parent].iter_mut().zip(found).for_each(|(sum, v)| *sum += v);
        }
        sums.into_iter().map(|[seen, free]| seen > SHADED * free && seen < (1.0 - SHADED) * free).collect()
    }
}
