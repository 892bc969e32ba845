//! What a run of `mrvis bench` measured: the JSON of `bench --json`, and the arithmetic of its speed-ups.
//!
//! Names and nesting are a contract with programs that nobody here sees (architecture section 6.1): fields may be
//! added, never renamed or removed. The record holds no date. The same run gives the same record but for its times, how
//! often they were taken, what is derived from them (speed-ups, Embree's fastest call), and what is planned by them: the choice of a target and its
//! answers, and the levels and figures of the rows without bias. Lengths are in the scene's unit, times in seconds of wall clock. `rms` and `bias` are of the visible
//! fraction of each emitter at each point, in [0, 1], against the reference, whose own noise is subtracted.

mod scaling;
mod trust;

pub use crate::model::summary::SceneSummary;
pub use scaling::{ScalingRecord, ScalingRow};
pub use trust::{Audit, CalibrationBin, Target, TargetAsked, TargetChoice, UnbiasedLevel, UnbiasedRow};

use serde::{Deserialize, Serialize};

/// One run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Version of mrvis.
    pub mrvis: String,
    /// Version of the Embree library in use.
    pub embree: String,
    /// Threads of the timed sections; 1 unless asked otherwise.
    pub threads: usize,
    /// Instruction set that the multi-resolution engine uses, such as `avx2`; Embree picks its own, the best there is.
    pub isa: String,
    /// The scene's unit of length, such as `m`.
    pub unit: String,
    /// Seed of every random choice.
    #[serde(default)]
    pub seed: u64,
    /// What was read.
    pub scene: SceneSummary,
    /// What was mended while reading: the counts of the scene's repairs, by name.
    #[serde(default)]
    pub scene_repairs: serde_json::Value,
    /// What the reader of the figures should know, a sentence each.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// How clusters were measured.
    #[serde(default)]
    pub clusters: Clusters,
    /// Preparation, not part of the timed sections.
    pub build: Build,
    /// What was asked of the engines.
    pub workload: Workload,
    /// Exact visibility, by number of rays.
    pub exact: Vec<ExactRow>,
    /// Exact visibility where pairs that are certainly clear or blocked are recognised without rays. Speed-ups are
    /// measured against the rows of `exact`.
    #[serde(default)]
    pub certified: Vec<ExactRow>,
    /// Multi-resolution visibility, by feature size.
    pub mr: Vec<MrRow>,
    /// Estimates without bias, if they were asked for.
    #[serde(default)]
    pub unbiased: Vec<UnbiasedRow>,
    /// What came of a target, if there was one.
    #[serde(default)]
    pub target: Option<Target>,
    /// Shadow images.
    pub receivers: Vec<Receiver>,
    /// How cost grows with the scene, when it was asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scaling: Vec<ScalingRow>,
}

/// How clusters were measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Clusters {
    /// `measured` or `analytic`.
    pub extinction: String,
    /// Error of a cluster's transmission that is let pass, in `(0, 1]`.
    pub tolerance: f64,
}

/// Times and sizes of the preparation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Build {
    /// Reading and mending the scene, seconds.
    pub load_s: f64,
    /// Building Embree's own tree, seconds.
    pub embree_s: f64,
    /// Building the cluster hierarchy, seconds.
    pub hierarchy_s: f64,
    /// Measuring the clusters' extinction and feature sizes, seconds.
    pub characterise_s: f64,
    /// Whether hierarchy and measures came from a file (`hit`; their times are then 0), were kept in one for the next
    /// run (`made`), or neither (`off`).
    #[serde(default)]
    pub cache: String,
    /// Looking for that file, reading or writing it, seconds.
    #[serde(default)]
    pub cache_s: f64,
    /// What the user should know about the file: it was damaged, could not be written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cache_note: Option<String>,
    /// Estimating the cost of exact rays on a sample, and finding Embree's fastest call for bundles that are handed
    /// over, seconds.
    #[serde(default)]
    pub budget_s: f64,
    /// All that exact visibility needs before it can be asked: Embree's tree and its fastest calls for the rows, seconds.
    #[serde(default)]
    pub exact_setup_s: f64,
    /// All that the multi-resolution engine needs beside Embree's tree: clusters, their measures, their cache, budget
    /// and the decisions of all rows, seconds. What targets and rows without bias are planned by, `pilot_s`, comes on
    /// top.
    #[serde(default)]
    pub mr_setup_s: f64,
    /// Memory of hierarchy and cluster properties, bytes.
    pub hierarchy_bytes: u64,
    /// Memory of Embree's scene, bytes.
    pub embree_bytes: u64,
    /// Memory by part, for each triangle of the scene.
    #[serde(default)]
    pub bytes_per_triangle: BytesPerTriangle,
}

/// Memory while the engines are asked, bytes for each triangle of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BytesPerTriangle {
    /// Vertices, faces, and what is known of each face.
    pub scene: f64,
    /// The clusters.
    pub hierarchy: f64,
    /// Their measures.
    pub optics: f64,
    /// Both laid out for traversal.
    pub wide: f64,
    /// Embree's scene.
    pub embree: f64,
    /// All of it.
    pub total: f64,
}

impl BytesPerTriangle {
    /// From bytes of scene, hierarchy, optics, wide tree and Embree's scene.
    pub fn of(triangles: usize, [scene, hierarchy, optics, wide, embree]: [usize; 5]) -> BytesPerTriangle {
        let per = |bytes: usize| bytes as f64 / triangles.max(1) as f64;
        BytesPerTriangle {
            scene: per(scene),
            hierarchy: per(hierarchy),
            optics: per(optics),
            wide: per(wide),
            embree: per(embree),
            total: per(scene + hierarchy + optics + wide + embree),
        }
    }
}

/// The question that all engines answer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Workload {
    /// Receiver points.
    pub points: usize,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Segments in all.
    pub segments: u64,
    /// Rays from a point to an emitter in the reference.
    pub reference_rays: usize,
    /// Noise of the reference itself: its root mean square error, estimated from its rays.
    pub reference_rms: f64,
    /// How often each row was run, in turns; the least time of each section counts.
    #[serde(default)]
    pub rounds: usize,
}

/// Exact visibility with a number of rays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExactRow {
    /// Rays from a point to an emitter.
    pub rays: usize,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// The fastest of Embree's ways of asking: `occluded1`, `occluded4`, `occluded8` or `occluded16`; with
    /// certificates `certified`.
    pub mode: String,
    /// Whether Embree was told that the rays of a call stay together.
    #[serde(default)]
    pub coherent: bool,
    /// Time of finding the fastest way on a sample, seconds; not part of `seconds`.
    #[serde(default)]
    pub setup_s: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
}

/// Multi-resolution visibility with a feature size.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MrRow {
    /// Shadows smaller than this may be averaged; length on the receiver.
    pub feature_size: f64,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
    /// Part of the answers, in [0, 1], whose stated 95 % interval the reference bears out, its own noise allowed for
    /// as in [`Audit::coverage`].
    pub interval_coverage: f64,
    /// What a few exact rays of its own say of the stated intervals; absent (null) without an audit.
    #[serde(default)]
    pub audit: Option<Audit>,
    /// Part of the segments, in [0, 1], that met at least one averaged cluster.
    pub aggregated_fraction: f64,
    /// Part of the segments, in [0, 1], of bundles whose answer is certain without a ray: the whole light is visible, or
    /// one triangle covers it.
    #[serde(default)]
    pub certified_fraction: f64,
    /// Segments of bundles for which triangles were tested, by this engine or by Embree.
    pub exact_rays: u64,
    /// Part of the segments, in [0, 1], that were handed to Embree whole. At 1 the row was decided to be the exact row of
    /// as many rays before anything was walked, and has its answers and its time; what the decision took is `decide_s`.
    #[serde(default)]
    pub handed_over: f64,
    /// Time of deciding on a sample whether the engine pays, seconds; not part of `seconds`.
    #[serde(default)]
    pub decide_s: f64,
    /// Clusters visited for a segment, on average.
    pub nodes_per_segment: f64,
    /// Best exact time for the same number of segments / this time.
    pub speedup_per_segment: f64,
    /// Time that exact needs to reach this rms / this time; see [`interpolate_log_log`]. Absent (null) when it cannot
    /// be told, for instance without any error.
    pub speedup_at_same_rms: Option<f64>,
    /// The same with the feature-based error of the shadow images at this feature size in place of rms.
    pub speedup_at_same_fbem: Option<f64>,
    /// Whether `speedup_at_same_rms` rests on a time beyond the last exact row, extrapolated by rays^-1/2.
    #[serde(default)]
    pub extrapolated: bool,
}

/// Errors of the shadow images on one receiver, in the unit of visibility, [0, 1].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Receiver {
    /// Object, group or material.
    pub name: String,
    /// Columns of its images.
    pub width: usize,
    /// Rows of its images.
    pub height: usize,
    /// Side of a texel; length.
    pub texel: f64,
    /// Root mean square error of the exact image of 16 rays a texel.
    pub l2: f64,
    /// Feature-based errors, by feature size.
    pub fbem: Vec<ReceiverFbem>,
}

/// Errors of one receiver's images at one feature size.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReceiverFbem {
    /// Feature size; length.
    pub feature_size: f64,
    /// Feature-based error of the exact image of 16 rays.
    pub exact16: f64,
    /// Feature-based error of the multi-resolution image made for this feature size.
    pub mr: f64,
    /// Root mean square error of the exact image of 16 rays (the same at every size).
    #[serde(default)]
    pub l2_exact16: f64,
    /// Root mean square error of the multi-resolution image.
    #[serde(default)]
    pub l2_mr: f64,
    /// Connected shadows and lit regions of the reference that are larger than the feature size, at two levels.
    #[serde(default)]
    pub features: usize,
    /// Of these, those that the multi-resolution image lacks: see [`missing_features`](crate::metrics::missing_features).
    #[serde(default)]
    pub missing_features: usize,
}

impl Record {
    /// The MR row with the greatest `speedup_at_same_rms`.
    pub fn best(&self) -> Option<&MrRow> {
        let speed = |row: &MrRow| row.speedup_at_same_rms.filter(|s| s.is_finite());
        let rows = self.mr.iter().filter(|row| speed(row).is_some());
        rows.max_by(|a, b| speed(a).partial_cmp(&speed(b)).unwrap_or(std::cmp::Ordering::Equal))
    }
}

/// The answer of [`interpolate_log_log`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interpolated {
    /// Time to reach the error, seconds.
    pub seconds: f64,
    /// Whether no measured row is as good, so that the time comes from the law of errors ~ 1/√time.
    pub extrapolated: bool,
}

/// The time that a method needs to reach `error`, from measured (seconds, error) rows in any order.
///
/// Only rows that are better than every faster one count. Between two of them the logarithm of time is linear in the
/// logarithm of error. Beyond the best the time grows as error⁻² (the noise of n rays falls as n^-1/2). An error
/// that the fastest row already undercuts takes the fastest row's time: nothing cheaper was measured.
/// A row without any error reaches every error in its time. Rows that are not positive finite times with an error of
/// at least 0 are ignored. `None` when no row is left or `error` is not a positive number.
pub fn interpolate_log_log(points: &[(f64, f64)], error: f64) -> Option<Interpolated> {
    if !(error.is_finite() && error > 0.0) {
        return None;
    }
    let usable = |&&(t, e): &&(f64, f64)| t.is_finite() && t > 0.0 && e.is_finite() && e >= 0.0;
    let mut rows: Vec<(f64, f64)> = points.iter().filter(usable).copied().collect();
    rows.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let mut best: Vec<(f64, f64)> = Vec::new();
    for row in rows {
        if best.last().is_none_or(|last| row.1 < last.1) {
            best.push(row);
        }
    }
    let measured = |seconds| Some(Interpolated { seconds, extrapolated: false });
    let &(last_time, last_error) = best.last()?;
    let Some(reached) = best.iter().position(|&(_, e)| e <= error) else {
        let seconds = last_time * (last_error / error).powi(2);
        return Some(Interpolated { seconds, extrapolated: true });
    };
    let (t1, e1) = best[reached];
    if reached == 0 || e1 == 0.0 {
        return measured(t1);
    }
    let (t0, e0) = best[reached - 1];
    let part = (e0 / error).ln() / (e0 / e1).ln();
    measured(t0 * (t1 / t0).powf(part))
}

#[cfg(test)]
mod tests;
