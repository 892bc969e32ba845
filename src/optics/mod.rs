//! Optical properties of clusters by direction: extinction, blocker size, gap size, averaging width, connected size.
//!
//! [`measure`] makes one [`ClusterOptics`] per cluster of a tree, in the tree's order. The result does not depend on
//! feature sizes or radiosities. See docs/method.md, Extinction, and Sizes of a cluster.

mod averaging_width;
mod axes;
mod frame;
pub mod groups;
mod silhouette;
#[cfg(test)]
mod tests;

use crate::clusters::Tree;
use crate::math::parallel;
use crate::math::{Aabb, triangle_area};
use crate::scene::Scene;
pub use axes::{AXES, AXIS_COUNT, AxisMix, axes_around};
use axes::{PROBES, view};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use silhouette::{Measure, Silhouettes};

/// Optical depth of a solid surface: transmits e^-7, less than 0.1 %.
pub(crate) const SOLID_DEPTH: f32 = 7.0;

/// Source of the extinction of clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Extinction {
    /// κ = Σ sides·A / (4V) [SD95 sec 3.1], the same in all directions (docs/method.md, Extinction).
    Analytic,
    /// Fitted per axis, so that the mean transmittance of the projected box equals the free fraction of the silhouette
    /// (docs/method.md, Extinction).
    #[default]
    Measured,
}

options! {
    /// Options of `measure`.
    #[derive(Clone, Copy, Debug)]
    pub struct Options {
        /// Source of the extinction.
        pub extinction: Extinction = Extinction::default();
        /// Root mean square error of a cluster's transmittance that the averaging width allows, dimensionless. At 1
        /// the averaging width rarely exceeds the blocker size.
        // Clusters of larger error need wider beams. The forest of `scenes/constants.py bench`, at a feature size of
        // 0.25 m and 64 segments, has errors of 0.026 at 0.05 and 0.036 at 0.1; at 0.02 no cluster is averaged.
        pub tolerance: f32 = 0.05, above 0.0, at most 1.0, "an error of the transmission";
    }
}

/// Optical properties of one cluster along each of the [`AXES`]. Lengths in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClusterOptics {
    /// Extinction at the centre of the box, 1/length, at least 0; see [`Extinction`].
    pub extinction: [f32; AXIS_COUNT],
    /// Relative gradient of the extinction across the box, 1/length: at offset x from the centre the extinction is
    /// `max(0, 1 + slope · x)` times [`ClusterOptics::extinction`]. Zero for [`Extinction::Analytic`].
    pub slope: Vec3,
    /// Diameter of the largest disc inside the silhouette (the paper counts erosions [SD95 sec 3.3]); length.
    pub blocker_size: [f32; AXIS_COUNT],
    /// Diameter of the largest disc inside the free part of the projected box; length. 0 where `coverage` is at most
    /// 1/2.
    pub gap_size: [f32; AXIS_COUNT],
    /// Fraction of the projected box that the contents cover, in `[0, 1]`.
    pub coverage: [f32; AXIS_COUNT],
    /// Width over which silhouette and extinction agree within [`Options::tolerance`]; length.
    pub averaging_width: [f32; AXIS_COUNT],
    /// For a cluster that is mostly cut out of surfaces that reach beyond it: the blocker size of the smallest ancestor
    /// that is not; else 0; length. Pieces of one surface cast one shadow (docs/method.md, Sizes of a cluster).
    pub connected_size: [f32; AXIS_COUNT],
    /// Root mean square error of the mean transmittance in the probe directions, which are measured but not fitted, in
    /// `[0, 1]`; 1 if no probe could be measured.
    pub error: f32,
}

impl ClusterOptics {
    /// Size compared with the threshold b* of the umbra criterion, along axis `axis`; length.
    ///
    /// [SD95 sec 3.3] takes the maximum of blocker and gap sizes. Here gaps count only where the contents cover more
    /// than half of the projected box: gaps are features where shadow is the background. Averaging width and connected
    /// size are additions of ours (docs/method.md, Sizes of a cluster).
    #[inline]
    pub fn feature_size(&self, axis: usize) -> f32 {
        let paper = if self.coverage[axis] > 0.5 { self.gap_size[axis] } else { 0.0 };
        self.blocker_size[axis].max(paper).max(self.averaging_width[axis]).max(self.connected_size[axis])
    }
}

/// Measures every cluster of `tree`, a tree over triangles of `scene`; the result is in the order of `tree.clusters`.
///
/// Parallel; the result does not depend on the number of threads.
pub fn measure(scene: &Scene, tree: &Tree, options: &Options) -> Vec<ClusterOptics> {
    measure_unless(scene, tree, options, &|| false).expect("nothing stops it")
}

/// Like [`measure`]; none soon after `stopped` returns true, which must not change back.
pub fn measure_unless(
    scene: &Scene,
    tree: &Tree,
    options: &Options,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<ClusterOptics>> {
    let sums = moments(scene, tree);
    let boxes: Vec<Aabb> = parallel::map(&tree.clusters, |c| c.bounds.thickened());
    let average = |c: usize| {
        let Moments { area, first } = sums[c];
        let slope = match options.extinction {
            Extinction::Analytic => Vec3::ZERO,
            Extinction::Measured => slope((first / area).as_vec3(), boxes[c]),
        };
        (extinction(area, boxes[c]), slope)
    };
    let is_direct = |c: usize| tree.clusters[c].triangles <= MAX_RASTERISED_TRIANGLES;
    // Clusters of few triangles are rasterised from triangles. The topmost of them keep their silhouettes, from which
    // those of larger clusters are composed, children before parents.
    let drawn: Vec<(Option<ClusterOptics>, Option<Box<Silhouettes>>)> =
        parallel::map_with(0..tree.clusters.len(), Scratch::default, |scratch, c| {
            if !is_direct(c) || stopped() {
                return (None, None);
            }
            for (k, silhouette) in scratch.silhouettes.iter_mut().enumerate() {
                silhouette.draw(scene, tree.triangles_of(c), boxes[c], view(k));
            }
            let (extinction, slope) = average(c);
            let optics = scratch.measure(extinction, slope, options);
            let keep = c > 0 && !is_direct(tree.clusters[c].parent as usize);
            (Some(optics), keep.then(|| Box::new(scratch.silhouettes.clone())))
        });
    let (mut optics, mut pictures): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
    for level in levels_from_below(tree, is_direct) {
        let made = parallel::try_map_with(&level, Scratch::default, |scratch, &c| {
            if stopped() {
                return Err(());
            }
            for (k, silhouette) in scratch.silhouettes.iter_mut().enumerate() {
                let parts = pictures[tree.clusters[c].child_range()].iter().flatten();
                silhouette.compose(parts.map(|p| &p[k]), boxes[c], view(k));
            }
            let (extinction, slope) = average(c);
            Ok((scratch.measure(extinction, slope, options), Box::new(scratch.silhouettes.clone())))
        });
        for (c, (t, p)) in level.into_iter().zip(made.ok()?) {
            (optics[c], pictures[c]) = (Some(t), Some(p));
            pictures[tree.clusters[c].child_range()].fill(None);
        }
    }
    // Every cluster is drawn or composed, unless it was stopped.
    let mut optics: Vec<ClusterOptics> = optics.into_iter().collect::<Option<_>>()?;
    // In tree order, parents come before their children.
    for (c, part) in fragments(scene, tree).into_iter().enumerate().skip(1) {
        if part > CONNECTED_FRACTION {
            let parent = &optics[tree.clusters[c].parent as usize];
            optics[c].connected_size =
                std::array::from_fn(|axis| parent.blocker_size[axis].max(parent.connected_size[axis]));
        }
    }
    Some(optics)
}

/// Clusters of at most this many triangles are rasterised triangle by triangle; larger ones are composed of their
/// children's silhouettes. Limits the work per cluster to 2,048 triangles in each of 13 views; 512 or 8,192
/// instead change the error of a forest by less than 0.1 % of itself (`constants.py bench`).
const MAX_RASTERISED_TRIANGLES: u32 = 2048;

/// The clusters that are not rasterised directly, grouped by height: children come before parents.
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

/// Working memory of a thread.
#[derive(Default)]
struct Scratch {
    silhouettes: Silhouettes,
    measure: Measure,
}

impl Scratch {
    /// Optics of the cluster whose silhouettes are in `self.silhouettes`, for its analytic extinction and density
    /// slope.
    fn measure(&mut self, analytic: f32, slope: Vec3, options: &Options) -> ClusterOptics {
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
            let m = self.measure.take(silhouette, analytic, slope, options);
            (optics.blocker_size[axis], optics.gap_size[axis], optics.coverage[axis]) =
                (m.blocker_size, m.gap_size, m.coverage);
            (optics.extinction[axis], optics.averaging_width[axis]) = (m.extinction, m.averaging_width);
        }
        // A beam of this width passes enough free space beside the cluster to dilute its error to the tolerance.
        let (mut square, mut largest, mut count) = (0.0f32, 0.0f32, 0.0f32);
        for (silhouette, probe) in probes.iter().zip(PROBES) {
            let kappa = AxisMix::around(probe).mix(|axis| optics.extinction[axis]);
            if let Some((error, area)) = self.measure.probe(silhouette, kappa, slope) {
                (square, largest, count) = (square + error * error, largest.max(area), count + 1.0);
            }
        }
        // Without a measured probe the error is unknown: state the largest.
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

/// Clusters with more than this fraction of their area in surfaces that reach beyond them get a connected size:
/// clusters that are mostly parts of larger surfaces. No value from 0.25 to 0.75 changes the errors of a forest
/// (`constants.py bench`).
const CONNECTED_FRACTION: f32 = 0.5;

/// Fraction of each cluster's area that belongs to connected surfaces that reach beyond the cluster, in `[0, 1]`.
fn fragments(scene: &Scene, tree: &Tree) -> Vec<f32> {
    // First and last position of each surface in the tree's order: a cluster holds the whole surface if it holds both.
    let surfaces = scene.triangle_component.iter().max().map_or(0, |&m| m as usize + 1);
    let mut places = vec![(u32::MAX, 0); surfaces];
    for (place, &t) in (0u32..).zip(&tree.order) {
        let (first, last) = &mut places[scene.triangle_component[t as usize] as usize];
        (*first, *last) = ((*first).min(place), (*last).max(place));
    }
    parallel::map(&tree.clusters, |cluster| {
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
}

/// Area weighted by sides, and its first moment, of a set of triangles.
#[derive(Clone, Copy, Default)]
struct Moments {
    /// Σ sides·A, length².
    area: f64,
    /// Σ sides·A·centroid, length³.
    first: DVec3,
}

/// Boxes thinner than this fraction of their longest extent get no density slope across them: one pixel of the raster
/// of 64 pixels, which does not resolve where the contents are.
const SHEET_THICKNESS: f32 = 1.0 / 64.0;

/// Moments of each cluster, summed from children to parents: differences of prefix sums would lose the moments of small
/// clusters in large scenes.
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

/// Relative density gradient (1/length) that reproduces the centroid of the contents.
///
/// The density 1 + slope · x, x the offset from the centre of a box of half extent h, has its centroid at slope h² / 3.
/// The result is limited so that the density stays non-negative inside the box. Uniform extinction would darken rays
/// that pass beside contents concentrated on one side of the box (docs/method.md, Traps: empty space).
fn slope(centroid: Vec3, bounds: Aabb) -> Vec3 {
    let half = 0.5 * bounds.extent();
    // The offset of a thin box's centroid is only rounding error.
    let thick = half.cmpgt(Vec3::splat(SHEET_THICKNESS * half.max_element()));
    let steep = 3.0 * Vec3::select(thick, (centroid - bounds.center()) / half, Vec3::ZERO);
    steep / steep.abs().element_sum().max(1.0) / half
}

/// Analytic extinction κ = Σ sides·A / (4V), 1/length, with V the volume of `thickened`, the box that path lengths are
/// measured in. Source: [SD95 sec 3.1]; docs/method.md, Extinction.
pub fn extinction(sides_times_area: f64, thickened: Aabb) -> f32 {
    (sides_times_area / (4.0 * thickened.volume()).max(f64::MIN_POSITIVE)) as f32
}

impl ClusterOptics {
    /// Whether every value lies in its range; `longest`: largest length that can occur, scene units.
    pub fn is_in_range(&self, longest: f32) -> bool {
        // All fields are named, so that a new field does not compile before it is considered here.
        let ClusterOptics {
            extinction,
            slope,
            blocker_size,
            gap_size,
            coverage,
            averaging_width,
            connected_size,
            error,
        } = self;
        let lengths = [blocker_size, gap_size, averaging_width, connected_size];
        let part = |v: &f32| (0.0..=1.0).contains(v);
        extinction.iter().all(|k| k.is_finite() && *k >= 0.0)
            && slope.is_finite()
            && lengths.into_iter().flatten().all(|l| (0.0..=longest).contains(l))
            && coverage.iter().all(part)
            && part(error)
    }
}
