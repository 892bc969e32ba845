//! What each cluster does to light: extinction and the sizes of its blocked and free regions, per direction.
//!
//! A side table beside the hierarchy, indexed by cluster, computed once and immutable. Knows no thresholds, no
//! feature size and no energy.

mod averaging_width;
mod axes;
mod silhouette;
#[cfg(test)]
mod tests;

pub use axes::{AXES, AXIS_COUNT, AxisMix};
use axes::{PROBES, view};

use crate::clusters::Tree;
use crate::math::{Aabb, triangle_area};
use crate::raster::Morphology;
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use silhouette::{Measure, Silhouettes};

/// Where extinction comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Extinction {
    /// κ = Σ sides·A / 4V [SD95 sec 3.1], method A.5: the same in all directions.
    Analytic,
    /// Per axis, so that the mean transmission of the projected box is that of the silhouette (method D.1).
    #[default]
    Measured,
}

/// How clusters are measured.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How blocked and free sizes are measured: the exact inscribed disc, or the paper's erosion counts.
    pub morphology: Morphology,
    /// One value for all directions (the mean over the axes) as in [SD95 sec 3.3], instead of one an axis.
    pub isotropic: bool,
    /// Where extinction comes from.
    pub extinction: Extinction,
    /// Root mean square error of a cluster's transmission that the grain allows, above 0; at 1 little more than the
    /// paper's BSIZE is left.
    pub tolerance: f32,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            morphology: Morphology::Euclid,
            isotropic: false,
            extinction: Extinction::default(),
            tolerance: 0.05,
        }
    }
}

/// What one cluster does to light along each of the [`AXES`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClusterOptics {
    /// Extinction in the middle of the box, 1/length; see [`Extinction`].
    pub extinction: [f32; AXIS_COUNT],
    /// How extinction changes across the box, 1/length: at an offset x from its middle it is
    /// `max(0, 1 + slope · x)` times [`ClusterOptics::extinction`]. Zero for [`Extinction::Analytic`].
    pub slope: Vec3,
    /// Diameter of the largest disc inside the projected contents (number of erosions, [SD95 sec 3.3]); length.
    pub blocker_size: [f32; AXIS_COUNT],
    /// Diameter of the largest disc of free space inside the projected box; length.
    pub gap_size: [f32; AXIS_COUNT],
    /// Part of the projected box that the contents cover, in `[0, 1]`.
    pub coverage: [f32; AXIS_COUNT],
    /// Width over which silhouette and extinction agree within the tolerance; length.
    pub averaging_width: [f32; AXIS_COUNT],
    /// For a cluster that is mostly cut out of larger connected surfaces the blocked size of the smallest ancestor
    /// that is not, else 0; length. Pieces of one thing cast one shadow, however small each is (method D.6).
    pub connected_size: [f32; AXIS_COUNT],
    /// Root mean square error of the mean transmission in directions between the axes, which were measured but not
    /// fitted: the cluster's certificate (method E.2), in `[0, 1]`.
    pub error: f32,
}

impl ClusterOptics {
    /// The size that decides whether the cluster may be aggregated, along an axis.
    ///
    /// The paper takes the maximum of blocked and free sizes. Free regions are features only where shadow is the
    /// background, that is where the contents cover more than half (method A.7: only one of the two is relevant
    /// per situation); a sparse cluster's gaps are no features.
    #[inline]
    pub fn feature_size(&self, axis: usize) -> f32 {
        let paper = if self.coverage[axis] > 0.5 { self.gap_size[axis] } else { 0.0 };
        self.blocker_size[axis].max(paper).max(self.averaging_width[axis]).max(self.connected_size[axis])
    }
}

/// Measures every cluster of a tree. Parallel and deterministic.
pub fn measure(scene: &Scene, tree: &Tree, options: &Options) -> Vec<ClusterOptics> {
    let sums = moments(scene, tree);
    let boxes: Vec<Aabb> = tree.clusters.par_iter().map(|c| c.bounds.thickened()).collect();
    let average = |c: usize| {
        let Moments { area, first } = sums[c];
        let slope = match options.extinction {
            Extinction::Analytic => Vec3::ZERO,
            Extinction::Measured => slope((first / area).as_vec3(), boxes[c]),
        };
        (extinction(area, boxes[c]), slope)
    };
    let is_direct = |c: usize| tree.clusters[c].triangles <= DIRECT;
    // Clusters of few triangles are drawn; the topmost of them keep their pictures, from which the larger ones
    // are put together, children first.
    let drawn: Vec<(Option<ClusterOptics>, Option<Box<Silhouettes>>)> = (0..tree.clusters.len())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, c| {
            if !is_direct(c) {
                return (None, None);
            }
            for (k, silhouette) in scratch.silhouettes.iter_mut().enumerate() {
                silhouette.draw(scene, tree.triangles_of(c), boxes[c], view(k));
            }
            let optics = scratch.measure(average(c), options);
            let keep = c > 0 && !is_direct(tree.clusters[c].parent as usize);
            (Some(optics), keep.then(|| Box::new(scratch.silhouettes.clone())))
        })
        .collect();
    let (mut optics, mut pictures): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
    for level in levels_from_below(tree, is_direct) {
        let made: Vec<(ClusterOptics, Box<Silhouettes>)> = level
            .par_iter()
            .map_init(Scratch::default, |scratch, &c| {
                for (k, silhouette) in scratch.silhouettes.iter_mut().enumerate() {
                    let parts = pictures[tree.clusters[c].child_range()].iter().flatten();
                    silhouette.compose(parts.map(|p| &p[k]), boxes[c], view(k));
                }
                (scratch.measure(average(c), options), Box::new(scratch.silhouettes.clone()))
            })
            .collect();
        for (c, (t, p)) in level.into_iter().zip(made) {
            (optics[c], pictures[c]) = (Some(t), Some(p));
            pictures[tree.clusters[c].child_range()].fill(None);
        }
    }
    let mut optics: Vec<ClusterOptics> =
        optics.into_iter().map(|t| t.expect("every cluster is drawn or composed")).collect();
    // Parents come before their children.
    for (c, part) in fragments(scene, tree).into_iter().enumerate().skip(1) {
        if part > FRAGMENT {
            let parent = &optics[tree.clusters[c].parent as usize];
            optics[c].connected_size =
                std::array::from_fn(|axis| parent.blocker_size[axis].max(parent.connected_size[axis]));
        }
    }
    optics
}

/// Clusters with at most this many triangles are drawn triangle by triangle.
const DIRECT: u32 = 2048;

/// The clusters that are not direct, grouped so that children come before parents.
fn levels_from_below(tree: &Tree, is_direct: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let mut height = vec![0usize; tree.clusters.len()];
    let mut levels: Vec<Vec<usize>> = Vec::new();
    for c in (0..tree.clusters.len()).rev().filter(|&c| !is_direct(c)) {
        let h = tree.clusters[c].child_range().map(|k| height[k]).max().unwrap_or(0) + 1;
        height[c] = h;
        levels.resize(levels.len().max(h), Vec::new());
        levels[h - 1].push(c);
    }
    levels
}

/// Buffers of a thread.
#[derive(Default)]
struct Scratch {
    silhouettes: Silhouettes,
    measure: Measure,
}

impl Scratch {
    /// ClusterOptics of the cluster that the silhouettes show.
    fn measure(&mut self, (analytic, slope): (f32, Vec3), options: &Options) -> ClusterOptics {
        let mut optics = ClusterOptics {
            extinction: [0.0; AXIS_COUNT],
            slope,
            blocker_size: [0.0; AXIS_COUNT],
            gap_size: [0.0; AXIS_COUNT],
            coverage: [0.0; AXIS_COUNT],
            averaging_width: [0.0; AXIS_COUNT],
            connected_size: [0.0; AXIS_COUNT],
            error: 0.0,
        };
        let (axes, probes) = self.silhouettes.split_at(AXIS_COUNT);
        for (axis, silhouette) in axes.iter().enumerate() {
            let m = self.measure.take(silhouette, (analytic, slope), options);
            (optics.blocker_size[axis], optics.gap_size[axis], optics.coverage[axis]) =
                (m.blocker_size, m.gap_size, m.coverage);
            (optics.extinction[axis], optics.averaging_width[axis]) = (m.extinction, m.averaging_width);
        }
        if options.isotropic {
            let ClusterOptics {
                blocker_size,
                gap_size,
                coverage,
                averaging_width,
                extinction,
                slope: _,
                connected_size: _,
                error: _,
            } = &mut optics;
            for values in [blocker_size, gap_size, coverage, averaging_width, extinction] {
                *values = [values.iter().sum::<f32>() / AXIS_COUNT as f32; AXIS_COUNT];
            }
        }
        // The tolerance holds for beams so wide that what they pass beside the cluster dilutes its error.
        let (mut square, mut largest, mut count) = (0.0f32, 0.0f32, 0.0f32);
        for (silhouette, probe) in probes.iter().zip(PROBES) {
            let kappa = AxisMix::around(probe).mix(|axis| optics.extinction[axis]);
            if let Some((error, area)) = self.measure.probe(silhouette, kappa, slope) {
                (square, largest, count) = (square + error * error, largest.max(area), count + 1.0);
            }
        }
        // Nothing measured is nothing certified.
        optics.error = if count > 0.0 { (square / count).sqrt() } else { 1.0 };
        if optics.error > options.tolerance {
            let width = (largest * optics.error / options.tolerance).sqrt();
            optics
                .averaging_width
                .iter_mut()
                .for_each(|averaging_width| *averaging_width = averaging_width.max(width));
        }
        optics
    }
}

/// Clusters of which more than this part is cut out of larger surfaces count as pieces of them.
const FRAGMENT: f32 = 0.5;

/// Part of each cluster's area that belongs to connected surfaces that reach beyond it.
fn fragments(scene: &Scene, tree: &Tree) -> Vec<f32> {
    // First and last place of each surface in the tree's order: a cluster holds all of it if it holds both.
    let surfaces = scene.triangle_component.iter().max().map_or(0, |&m| m as usize + 1);
    let mut places = vec![(u32::MAX, 0); surfaces];
    for (place, &t) in (0u32..).zip(&tree.order) {
        let (first, last) = &mut places[scene.triangle_component[t as usize] as usize];
        (*first, *last) = ((*first).min(place), (*last).max(place));
    }
    tree.clusters
        .par_iter()
        .map(|cluster| {
            let range = cluster.triangle_range();
            let (mut beyond, mut all) = (0.0, 0.0);
            for &t in &tree.order[range.clone()] {
                let [a, b, c] = scene.corners(t);
                let area = triangle_area(a, b, c);
                let (first, last) = places[scene.triangle_component[t as usize] as usize];
                all += area;
                if !range.contains(&(first as usize)) || !range.contains(&(last as usize)) {
                    beyond += area;
                }
            }
            (beyond / all) as f32
        })
        .collect()
}

/// Area of a run of triangles, and area times place.
#[derive(Clone, Copy, Default)]
struct Moments {
    area: f64,
    first: DVec3,
}

/// Boxes thinner than this part of their longest extent are sheets.
const THIN: f32 = 1.0 / 64.0;

/// Moments of each cluster, children first: differences of large sums would lose the small clusters of large scenes.
fn moments(scene: &Scene, tree: &Tree) -> Vec<Moments> {
    let mut sums = vec![Moments::default(); tree.clusters.len()];
    for (c, cluster) in tree.clusters.iter().enumerate().rev() {
        let mut sum = Moments::default();
        if cluster.is_leaf() {
            for &t in tree.triangles_of(c) {
                let [a, b, c] = scene.corners(t);
                let area = f64::from(scene.triangle_sides[t as usize]) * triangle_area(a, b, c);
                sum.area += area;
                sum.first += area * (a.as_dvec3() + b.as_dvec3() + c.as_dvec3()) / 3.0;
            }
        }
        for child in cluster.child_range() {
            sum.area += sums[child].area;
            sum.first += sums[child].first;
        }
        sums[c] = sum;
    }
    sums
}

/// The density 1 + slope · x over a box, linear in the offset x from its middle, whose first moment is that of the
/// contents: the mean of x over a box of half extent h weighted so is slope h² / 3. Kept above zero inside the box.
///
/// Clusters at the rim of a crown fill their boxes on one side only. With even extinction the boxes behind each other
/// darken rays that pass all of them by (method D.12); this takes most of that away for three numbers.
fn slope(centroid: Vec3, bounds: Aabb) -> Vec3 {
    let half = 0.5 * bounds.extent();
    // Across a box as thin as a sheet there is nothing to tell apart but rounding.
    let thick = half.cmpgt(Vec3::splat(THIN * half.max_element()));
    let steep = 3.0 * Vec3::select(thick, (centroid - bounds.center()) / half, Vec3::ZERO);
    steep / steep.abs().element_sum().max(1.0) / half
}

/// κ = Σ sides·A / 4V with V the volume of the box that path lengths are measured in (method A.5).
pub fn extinction(sides_times_area: f64, thickened: Aabb) -> f32 {
    (sides_times_area / (4.0 * thickened.volume()).max(f64::MIN_POSITIVE)) as f32
}
