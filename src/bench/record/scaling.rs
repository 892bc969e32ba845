//! How cost grows with the scene: the rows of `bench --scaling`.

use super::BytesPerTriangle;
use serde::{Deserialize, Serialize};

/// The record of a run that measures nothing but how cost grows; fields as in [`Record`](super::Record).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScalingRecord {
    /// Version of mrvis.
    pub mrvis: String,
    /// Version of the Embree library in use.
    pub embree: String,
    /// Threads of the timed sections.
    pub threads: usize,
    /// Instruction set of the multi-resolution engine.
    pub isa: String,
    /// Unit of length.
    pub unit: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// The rows.
    pub scaling: Vec<ScalingRow>,
}

/// Both engines in one forest of a series of growing ones.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScalingRow {
    /// How the forest grows along its series: `wider` (more trees over more ground) or `finer` (more and smaller
    /// leaves on the same trees).
    pub series: String,
    /// Triangles.
    pub triangles: usize,
    /// Trees of the forest.
    pub trees: usize,
    /// Leaves of each.
    pub leaves: usize,
    /// Feature size; the same in all rows.
    pub feature_size: f64,
    /// Segments of a bundle, for both engines.
    pub rays: usize,
    /// Bundles that were asked.
    pub bundles: usize,
    /// Time of a bundle by the multi-resolution engine, seconds.
    pub seconds_per_bundle_mr: f64,
    /// Time of a bundle by exact rays, seconds.
    pub seconds_per_bundle_exact: f64,
    /// Root mean square error of the multi-resolution engine.
    pub rms_mr: f64,
    /// Root mean square error of exact rays.
    pub rms_exact: f64,
    /// Clusters visited for a segment, on average.
    pub nodes_per_segment: f64,
    /// Part of the segments that were handed to Embree whole.
    pub handed_over: f64,
    /// Memory of scene, clusters, measures, traversal tree and Embree's scene, bytes.
    pub bytes: u64,
    /// The same by part, for each triangle.
    pub bytes_per_triangle: BytesPerTriangle,
    /// Time of preparation: the three that follow, seconds.
    pub build_s: f64,
    /// Embree's tree, seconds.
    pub embree_s: f64,
    /// The clusters, seconds.
    pub hierarchy_s: f64,
    /// Measuring them, seconds.
    pub characterise_s: f64,
}
