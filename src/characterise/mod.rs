//! What each cluster does to light: extinction and the sizes of its blocked and free regions, per direction.
//!
//! A side table beside the hierarchy, indexed by cluster, computed once and immutable. Knows no thresholds, no
//! feature size and no energy.

mod axes;
mod silhouette;
#[cfg(test)]
mod tests;

pub use axes::{AXES, AXIS_COUNT, nearest_axis};

use crate::hierarchy::Tree;
use crate::math::triangle_area;
use crate::raster::Morphology;
use crate::scene::Scene;
use rayon::prelude::*;
use silhouette::Silhouettes;

/// How clusters are measured.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How blocked and free sizes are measured: the exact inscribed disc, or the paper's erosion counts.
    pub morphology: Morphology,
    /// One value for all directions (the mean over the axes) as in [SD95 sec 3.3], instead of one an axis.
    pub isotropic: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { morphology: Morphology::Euclid, isotropic: false }
    }
}

/// What one cluster does to light along each of the [`AXES`].
#[derive(Clone, Copy, Debug)]
pub struct Traits {
    /// Extinction κ = Σ sides·A / 4V [SD95 sec 3.1], method A.5; 1/length.
    pub extinction: [f32; AXIS_COUNT],
    /// Diameter of the largest disc inside the projected contents (number of erosions, [SD95 sec 3.3]); length.
    pub blocked: [f32; AXIS_COUNT],
    /// Diameter of the largest disc of free space inside the projected box; length.
    pub free: [f32; AXIS_COUNT],
    /// Part of the projected box that the contents cover, in `[0, 1]`.
    pub coverage: [f32; AXIS_COUNT],
}

impl Traits {
    /// The size that decides whether the cluster may be aggregated, along an axis.
    ///
    /// The paper takes the maximum of blocked and free sizes. Free regions are features only where shadow is the
    /// background, that is where the contents cover more than half (method A.7: only one of the two is relevant
    /// per situation); a sparse cluster's gaps are no features.
    #[inline]
    pub fn feature_size(&self, axis: usize) -> f32 {
        if self.coverage[axis] > 0.5 { self.blocked[axis].max(self.free[axis]) } else { self.blocked[axis] }
    }
}

/// Measures every cluster of a tree. Parallel and deterministic.
pub fn characterise(scene: &Scene, tree: &Tree, options: &Options) -> Vec<Traits> {
    // Prefix sums of sides·A in the tree's order: any cluster's sum is one difference.
    let mut sums = Vec::with_capacity(tree.order.len() + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for &t in &tree.order {
        let [a, b, c] = scene.corners(t);
        sum += f64::from(scene.triangle_sides[t as usize]) * triangle_area(a, b, c);
        sums.push(sum);
    }
    (0..tree.clusters.len())
        .into_par_iter()
        .map_init(Silhouettes::default, |silhouettes, c| {
            let cluster = &tree.clusters[c];
            let range = cluster.triangle_range();
            let kappa = extinction(sums[range.end] - sums[range.start], cluster.bounds);
            let mut traits = Traits {
                extinction: [kappa; AXIS_COUNT],
                blocked: [0.0; AXIS_COUNT],
                free: [0.0; AXIS_COUNT],
                coverage: [0.0; AXIS_COUNT],
            };
            for axis in 0..AXIS_COUNT {
                let m = silhouettes.measure(scene, &tree.order[range.clone()], cluster.bounds, axis, options);
                (traits.blocked[axis], traits.free[axis], traits.coverage[axis]) = (m.blocked, m.free, m.coverage);
            }
            if options.isotropic {
                for values in [&mut traits.blocked, &mut traits.free, &mut traits.coverage] {
                    *values = [values.iter().sum::<f32>() / AXIS_COUNT as f32; AXIS_COUNT];
                }
            }
            traits
        })
        .collect()
}

/// κ = Σ sides·A / 4V with V the box that path lengths are measured in, flat boxes a thousandth of their
/// diagonal thick (method A.5).
pub fn extinction(sides_times_area: f64, bounds: crate::math::Aabb) -> f32 {
    let e = bounds.extent().as_dvec3();
    let e = e.max(glam::DVec3::splat(1e-3 * e.length()));
    (sides_times_area / (4.0 * e.x * e.y * e.z)) as f32
}
