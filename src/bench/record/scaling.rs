//! Growth of cost with the size of the scene: rows of `bench --scaling`.

use super::BytesPerTriangle;
use serde::{Deserialize, Serialize};

/// Record of a run that measures growth only; fields as in [`Record`](super::Record).
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

/// Results of both engines in one forest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScalingRow {
    /// Series of the forest: `wider` (more trees over more ground) or `finer` (more and smaller leaves on the same
    /// trees).
    pub series: String,
    /// Triangles.
    pub triangles: usize,
    /// Number of trees.
    pub trees: usize,
    /// Leaves per tree.
    pub leaves: usize,
    /// Feature size, metres; equal in all rows.
    pub feature_size: f64,
    /// Segments per bundle, for both engines.
    pub rays: usize,
    /// Number of bundles.
    pub bundles: usize,
    /// Time per bundle of MR, seconds.
    pub seconds_per_bundle_mr: f64,
    /// Time per bundle of exact rays, seconds.
    pub seconds_per_bundle_exact: f64,
    /// RMS error of MR.
    pub rms_mr: f64,
    /// RMS error of exact rays.
    pub rms_exact: f64,
    /// Mean number of visited clusters per segment.
    pub nodes_per_segment: f64,
    /// Part of the segments handed to Embree in whole bundles.
    pub handed_over: f64,
    /// Memory of scene, clusters, optics, traversal tree and Embree's scene, bytes.
    pub bytes: u64,
    /// Memory by part, bytes per triangle.
    pub bytes_per_triangle: BytesPerTriangle,
    /// Time of preparation, seconds: sum of the following three.
    pub build_s: f64,
    /// Building Embree's tree, seconds.
    pub embree_s: f64,
    /// Building the clusters, seconds.
    pub hierarchy_s: f64,
    /// Measuring cluster optics, seconds.
    pub characterise_s: f64,
}
