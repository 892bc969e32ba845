//! What matters where: feature sizes of surfaces and importance (method A.13).

use super::Solver;
use super::cut::{Cut, sent};
use super::field::{Arriving, Outgoing, Rgb, gather};
use crate::Result;
use crate::element::Shape;
use crate::scene::Scene;

/// Bounces that importance is followed for.
const BOUNCES: usize = 4;
/// What errors count at least, relative to the most important element.
const LEAST: f64 = 0.02;

impl Solver<'_> {
    /// Feature sizes and important surfaces by name.
    ///
    /// # Errors
    /// Nothing in the scene has a name.
    pub(super) fn name(
        &mut self,
        scene: &Scene,
        sizes: &[(String, f32)],
        important: &[String],
    ) -> Result<()> {
        let mut painted = vec![0.0f32; scene.triangles.len()];
        for (name, size) in sizes {
            scene.faces_named(name)?.into_iter().for_each(|t| painted[t as usize] = *size);
        }
        if !sizes.is_empty() {
            let fixed = self.fixed_size.then(|| self.feature_sizes[0]);
            self.size(fixed, &painted);
        }
        if !important.is_empty() {
            let mut chosen = vec![false; scene.triangles.len()];
            for name in important {
                scene.faces_named(name)?.into_iter().for_each(|t| chosen[t as usize] = true);
            }
            self.important = self.elements.sides.iter().map(|s| chosen[s.triangles[0] as usize]).collect();
        }
        Ok(())
    }

    /// The feature size of every element: painted on its face (above 0), given for all, or its diameter; the smallest of
    /// the painted ones in a cluster.
    pub(super) fn size(&mut self, fixed: Option<f32>, painted: &[f32]) {
        let elements = &self.elements.elements;
        let mut sizes = vec![f32::INFINITY; elements.len()];
        for e in (0..elements.len()).rev() {
            if let Shape::Surface { side, .. } = elements[e].shape {
                let t = self.elements.sides[side as usize].triangles[0] as usize;
                sizes[e] = painted.get(t).copied().filter(|&s| s > 0.0).unwrap_or(f32::INFINITY);
            }
            let parent = elements[e].parent as usize;
            sizes[parent] = sizes[parent].min(sizes[e]);
        }
        let own = |e: usize| fixed.unwrap_or(2.0 * elements[e].radius);
        self.feature_sizes =
            (0..elements.len()).map(|e| if sizes[e].is_finite() { sizes[e] } else { own(e) }).collect();
    }

    /// Follows importance, which spreads like light from the important surfaces [Smits, Arvo and Salesin 1992].
    pub(super) fn spread_importance(&mut self, cut: &Cut) {
        if self.important.is_empty() {
            return;
        }
        let own = |side: u32| -> Rgb { [f64::from(u8::from(self.important[side as usize])); 3] };
        let emitted: Vec<_> =
            cut.sealed().map(|place| sent(&self.elements, cut.elements[place], own)).collect();
        let mut clusters = vec![Arriving::default(); cut.clusters];
        let mut surfaces = vec![[0.0; 3]; cut.elements.len() - cut.clusters];
        for _ in 0..BOUNCES {
            let sends: Vec<Rgb> = (0..surfaces.len())
                .map(|i| {
                    let e = cut.elements[cut.clusters + i] as usize;
                    let Shape::Surface { side, .. } = self.elements.elements[e].shape else {
                        return [0.0; 3];
                    };
                    let reflectance = self.elements.sides[side as usize].reflectance;
                    std::array::from_fn(|k| own(side)[k] + f64::from(reflectance[k]) * surfaces[i][k])
                })
                .collect();
            let outgoing = Outgoing::pull(&self.elements, cut, &sends, |p, r| {
                cut.responses[r].answer(&clusters[p], emitted[r])
            });
            let next = gather(&self.elements, cut, &outgoing);
            (clusters, surfaces) = (next.clusters, next.surfaces);
        }
        let arriving = cut.expand(&self.elements, &clusters, &surfaces);
        let mut importance = vec![0.0; self.elements.len()];
        for e in (0..self.elements.len()).rev() {
            let element = &self.elements.elements[e];
            if let (Shape::Surface { side, .. }, true) = (&element.shape, element.is_leaf()) {
                importance[e] = super::mean(own(*side)) + super::mean(arriving[e]);
            } else if element.area > 0.0 {
                let sum: f64 =
                    element.child_range().map(|c| self.elements.elements[c].area * importance[c]).sum();
                importance[e] = sum / element.area;
            }
        }
        let most = importance.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        self.importance = importance.into_iter().map(|i| (i / most).clamp(LEAST, 1.0) as f32).collect();
    }
}
