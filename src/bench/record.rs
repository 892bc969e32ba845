//! Results of a benchmark: the JSON of `bench --json`, and the interpolation behind its speed-ups.
//!
//! Names and nesting are a contract (docs/report.md, The JSON): fields may be added, never renamed or removed. The
//! record contains no date. Equal runs give equal records except for times and numbers of runs, values derived from
//! times (speed-ups, Embree's fastest ray call). Lengths are in
//! the scene's unit, times in seconds of wall clock. `rms` and `bias` are errors of the visible fraction of each
//! emitter at each point, in [0, 1], relative to the reference, whose noise is subtracted.

mod compared;
mod maps;

use serde::Serialize;

pub use crate::model::summary::SceneSummary;
pub use compared::{EQUAL_SPEED_RANGE, ratio, speedup};
pub use maps::{MapExactRow, MapMrRow, MapRecord};

/// Results of one run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// Version of mrvis.
    pub mrvis: String,
    /// Version of the Embree library in use.
    pub embree: String,
    /// Threads of the timed sections; default 1.
    pub threads: usize,
    /// Instruction set of the MR engine, such as `avx2`. Embree selects its own.
    pub isa: String,
    /// The scene's unit of length, such as `m`.
    pub unit: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Summary of the scene.
    pub scene: SceneSummary,
    /// Counts of repairs of the scene, by name.
    pub scene_repairs: serde_json::Value,
    /// Notes, one sentence each.
    pub warnings: Vec<String>,
    /// Settings of cluster optics.
    pub clusters: Clusters,
    /// Times and memory of the preparation, which is not part of the timed sections.
    pub build: Build,
    /// The queries that both engines answer.
    pub workload: Workload,
    /// Time of the run by stage.
    pub spent: RunSeconds,
    /// Exact visibility, by number of rays.
    pub exact: Vec<ExactRow>,
    /// Exact visibility with certificates. Speed-ups refer to the fastest rows of `exact` and `certified` together.
    pub certified: Vec<ExactRow>,
    /// MR visibility, by number of segments and feature size; one row if nothing is averaged at the default sizes.
    pub mr: Vec<MrRow>,
    /// Rows by what lies around the receiver points; classes of fewer than 50 points are left out.
    pub classes: Vec<ClassRecord>,
    /// If no row averages anything: one sentence that says so.
    pub nothing_averaged: Option<String>,
    /// Errors of shadow images.
    pub receivers: Vec<ReceiverErrors>,
    /// Maps of the receivers: images of whole surfaces, with set-up and interpolation.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub maps: Vec<MapRecord>,
}

/// Settings of cluster optics.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Clusters {
    /// Extinction: `measured` or `analytic`.
    pub extinction: String,
    /// Tolerated RMS error of a cluster's transmittance, in `(0, 1]`.
    pub tolerance: f64,
}

/// Times and memory of the preparation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Build {
    /// Reading and repairing the scene, seconds.
    pub load_s: f64,
    /// Building Embree's tree, seconds.
    pub embree_s: f64,
    /// Algorithm that built the clusters.
    pub builder: String,
    /// Building the cluster hierarchy, seconds.
    pub hierarchy_s: f64,
    /// Measuring cluster optics, seconds.
    pub characterise_s: f64,
    /// Origin of the clusters: read from a cache file (`hit`; their times are then 0), made and cached (`made`), or made only (`off`).
    pub cache: String,
    /// Finding, reading and writing the cache file, seconds.
    pub cache_s: f64,
    /// Note about the cache file: damaged, not writable.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cache_note: Option<String>,
    /// Estimating the cost of exact rays on a sample and choosing Embree's ray call for bundles that are handed over, seconds.
    pub budget_s: f64,
    /// Preparation of exact visibility: Embree's tree and the choice of its ray calls, seconds.
    pub exact_setup_s: f64,
    /// Preparation of MR besides Embree's tree: clusters, optics, cache, budget and the decisions of all rows, seconds.
    pub mr_setup_s: f64,
    /// Memory of hierarchy and optics, bytes.
    pub hierarchy_bytes: u64,
    /// Memory of Embree's scene, bytes.
    pub embree_bytes: u64,
    /// Memory by part, bytes per triangle of the scene.
    pub bytes_per_triangle: BytesPerTriangle,
}

impl Build {
    /// Preparation of MR besides Embree's tree, without decisions, seconds.
    pub fn mr_preparation(&self) -> f64 {
        self.hierarchy_s + self.characterise_s + self.cache_s + self.budget_s
    }
}

/// Memory during queries, bytes per triangle of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BytesPerTriangle {
    /// Vertices, triangles and their attributes.
    pub scene: f64,
    /// Clusters.
    pub hierarchy: f64,
    /// Cluster optics; the JSON keeps the name that outside programs read.
    #[serde(rename = "traits")]
    pub optics: f64,
    /// Clusters and optics in the layout for traversal.
    pub wide: f64,
    /// Embree's scene.
    pub embree: f64,
    /// Total.
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

/// The queries that both engines answer.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Workload {
    /// Receiver points.
    pub points: usize,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Segments of all pairs.
    pub segments: u64,
    /// Rays from a point to an emitter in the reference.
    pub reference_rays: usize,
    /// RMS noise of the reference, estimated from its two halves.
    pub reference_rms: f64,
    /// Number of runs of each row; the minimum time of each section counts.
    pub rounds: usize,
    /// The sky and the suns among the emitters; absent without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<SkySources>,
}

/// Exact visibility with one number of rays.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ExactRow {
    /// Rays from a point to an emitter.
    pub rays: usize,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// Embree's fastest ray call: `occluded1`, `occluded4`, `occluded8` or `occluded16`; `certified` with certificates.
    pub mode: String,
    /// Whether Embree's flag for coherent rays was set.
    pub coherent: bool,
    /// Time to choose the ray call on a sample, seconds; not part of `seconds`.
    pub setup_s: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
}

/// MR visibility with one feature size and number of segments.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MrRow {
    /// Feature size; a length on the receiver.
    pub feature_size: f64,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Engine: `bundle` (walks), `cut` (the distance cut), `certified` (exact rays with certificates) or `embree` (exact rays, because they
    /// are expected to be faster).
    pub route: String,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
    /// Fraction of the stated 95 % intervals, in [0, 1], that the reference confirms, as in [`IntervalAudit::coverage`].
    pub interval_coverage: f64,
    /// Audit of the stated intervals; `null` without an audit.
    pub audit: Option<IntervalAudit>,
    /// Fraction of the segments, in [0, 1], that met at least one averaged cluster.
    pub aggregated_fraction: f64,
    /// Fraction of the segments, in [0, 1], in bundles with a certificate: nothing lies between point and emitter, or one
    /// triangle covers the emitter.
    pub certified_fraction: f64,
    /// Segments of bundles for which triangles were tested, by this engine or by Embree.
    pub exact_rays: u64,
    /// Fraction of the segments, in [0, 1], handed to Embree in whole bundles. At 1 the row takes the answers of the
    /// exact row with as many rays, and the smaller time of that row and the one with certificates.
    pub handed_over: f64,
    /// Time to decide on a sample whether MR is faster, seconds; not part of `seconds`.
    pub decide_s: f64,
    /// Mean number of visited clusters per segment.
    pub nodes_per_segment: f64,
    /// Best exact time for the same number of segments, with or without certificates, divided by this time.
    pub speedup_per_segment: f64,
    /// Time of the fastest exact rays for the same RMS error, with or without certificates, divided by this time; see
    /// [`interpolate_log_log`]. `null` if undefined, for example without any error.
    pub speedup_at_same_rms: Option<f64>,
    /// Exact rows that `speedup_at_same_rms` refers to: `exact`, or `certified` if certificates make exact rays faster at this error.
    pub compared_with: String,
    /// `speedup_at_same_rms` over exact rays without certificates.
    pub speedup_over_plain_exact: Option<f64>,
    /// The same with the feature-based error of the shadow images at this feature size instead of `rms`.
    pub speedup_at_same_fbem: Option<f64>,
    /// Whether `speedup_at_same_rms` is extrapolated beyond the last exact row, with error ∝ rays^(−1/2).
    pub extrapolated: bool,
}

/// Errors of the shadow images of one receiver, as visible fraction in [0, 1].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReceiverErrors {
    /// Object, group or material.
    pub name: String,
    /// Columns of the images.
    pub width: usize,
    /// Rows of the images.
    pub height: usize,
    /// Side of a texel; length.
    pub texel: f64,
    /// Sides of the surface that the image is a window of; length.
    pub surface: [f64; 2],
    /// RMS error of the exact image with 16 rays per texel.
    pub l2: f64,
    /// Feature-based errors, by feature size.
    pub fbem: Vec<ReceiverFbem>,
}

/// Errors of one receiver's images at one feature size.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReceiverFbem {
    /// Feature size; length.
    pub feature_size: f64,
    /// Feature-based error of the exact image with 16 rays.
    pub exact16: f64,
    /// Feature-based error of the MR image for this feature size.
    pub mr: f64,
    /// RMS error of the exact image with 16 rays (equal at all sizes).
    pub l2_exact16: f64,
    /// RMS error of the MR image.
    pub l2_mr: f64,
    /// Number of connected shadows and lit regions of the reference larger than the feature size, at two levels.
    pub features: usize,
    /// Number of these that the MR image lacks; see [`missing_features`](crate::metrics::missing_features).
    pub missing_features: usize,
}

impl Record {
    /// The MR row with the largest `speedup_at_same_rms`.
    pub fn best(&self) -> Option<&MrRow> {
        best_of(&self.mr)
    }

    /// The MR row that is fastest at the same feature-based error, if it is faster than exact rays, and how much.
    pub fn faster_at_same_fbem(&self) -> Option<(&MrRow, f64)> {
        let rows = self.shown_rows().iter().filter_map(|row| Some((row, row.speedup_at_same_fbem?)));
        rows.filter(|(_, speed)| *speed >= EQUAL_SPEED_RANGE[1]).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// The row with the largest `speedup_at_same_rms`.
fn best_of(rows: &[MrRow]) -> Option<&MrRow> {
    let speed = |row: &MrRow| row.speedup_at_same_rms.filter(|s| s.is_finite());
    let rows = rows.iter().filter(|row| speed(row).is_some());
    rows.max_by(|a, b| speed(a).partial_cmp(&speed(b)).unwrap_or(std::cmp::Ordering::Equal))
}

/// Result of [`interpolate_log_log`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interpolated {
    /// Time to reach the error, seconds.
    pub seconds: f64,
    /// Whether no measured row reaches the error, so that the time follows from error ∝ time^(−1/2).
    pub extrapolated: bool,
}

/// Time that a method needs to reach `error`, from measured (seconds, error) rows in any order.
///
/// Rows count only if they are more accurate than every faster row. Between two rows, log time is linear in log
/// error. Beyond the last row, time ∝ error⁻² (the noise of n rays is ∝ n^(−1/2)). If the fastest row has a smaller
/// error, its time is returned. A row without error reaches every error in its time. Rows without a positive finite
/// time and an error of at least 0 are ignored. `None` if no row remains or `error` is not a positive number.
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

/// Class of a receiver point by its surroundings; the rule is in docs/report.md, Receiver classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ReceiverClass {
    /// Nothing small lies near.
    #[default]
    Open,
    /// Something small lies near.
    Near,
    /// The point lies on something small.
    Inside,
    /// Large surfaces enclose the point.
    Interior,
}

impl ReceiverClass {
    /// All classes, in the order of records.
    pub const ALL: [ReceiverClass; 4] =
        [ReceiverClass::Open, ReceiverClass::Near, ReceiverClass::Inside, ReceiverClass::Interior];

    /// The name in records.
    pub fn name(self) -> &'static str {
        match self {
            ReceiverClass::Open => "open",
            ReceiverClass::Near => "near",
            ReceiverClass::Inside => "inside",
            ReceiverClass::Interior => "interior",
        }
    }
}

/// Rows over the receiver points of one class.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClassRecord {
    /// The class.
    pub class: ReceiverClass,
    /// Receiver points of this class that face an emitter.
    pub points: usize,
    /// Number of these that the rows are measured on.
    pub measured: usize,
    /// RMS noise of the reference, estimated from its two halves; it is subtracted from errors.
    pub reference_rms: f64,
    /// As [`Record::exact`](Record::exact).
    pub exact: Vec<ExactRow>,
    /// As [`Record::certified`](Record::certified).
    pub certified: Vec<ExactRow>,
    /// As [`Record::mr`](Record::mr); `speedup_at_same_fbem` is `null`. The route of each row is decided for this class.
    pub mr: Vec<MrRow>,
}

impl ClassRecord {
    /// The row that table and page show: that with the largest `speedup_at_same_rms`, or the first if none is defined.
    pub fn shown_row(&self) -> Option<&MrRow> {
        best_of(&self.mr).or(self.mr.first())
    }

    /// The smallest `speedup_at_same_rms` of a row.
    pub fn smallest_speedup(&self) -> Option<f64> {
        self.mr.iter().filter_map(|row| row.speedup_at_same_rms).min_by(f64::total_cmp)
    }
}

/// Sources of light around the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SkySources {
    /// Patches of the sky, of the ground below the horizon if that is not black, and of luminous domes.
    pub patches: usize,
    /// Largest angle across a patch, degrees.
    pub largest_angle: f64,
    /// Largest number of patches per point, drawn in proportion to its irradiance by them.
    pub patches_per_point: usize,
    /// Emissive surfaces around the scene that are divided into patches.
    pub domes: usize,
    /// Suns.
    pub suns: usize,
    /// Emitters of the shadow images and maps: `lamps` (emissive surfaces and suns), or `patch`, the one with the largest
    /// irradiance of a horizontal plane, if there are none.
    pub shown: String,
}

impl SkySources {
    /// Description of the sources, in one or two sentences.
    pub fn sentence(&self) -> String {
        let mut sources = Vec::new();
        if self.patches > 0 {
            sources.push(format!(
                "{} patches of {} up to {:.1}° wide, of which a point asks up to {}, drawn in proportion to its irradiance by them",
                self.patches,
                if self.domes > 0 { "the sky or a luminous dome" } else { "the sky" },
                self.largest_angle,
                self.patches_per_point
            ));
        }
        match self.suns {
            0 => {}
            1 => sources.push("the sun".into()),
            suns => sources.push(format!("{suns} suns")),
        }
        let shown = match (self.shown.as_str(), self.patches) {
            ("patch", 1..) => {
                " Shadow images show the light of the patch with the largest irradiance of a horizontal plane."
            }
            (_, 1..) => " Shadow images show the light of suns and whole emissive surfaces, without the sky.",
            _ => "",
        };
        format!("Emitters around the scene: {}.{shown}", sources.join("; and "))
    }
}

/// Time of a run by stage, seconds: most of it are references, and several runs of each row.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunSeconds {
    /// Choice of points, receivers and ray calls.
    pub choice_s: f64,
    /// Rows over all points.
    pub points_s: f64,
    /// Rows by class of receiver.
    pub classes_s: f64,
    /// Shadow images.
    pub images_s: f64,
    /// Maps.
    pub maps_s: f64,
}

impl RunSeconds {
    /// Names and seconds of the parts.
    pub fn parts(&self) -> [(&'static str, f64); 5] {
        [
            ("choices", self.choice_s),
            ("rows over all points", self.points_s),
            ("classes of receivers", self.classes_s),
            ("shadow images", self.images_s),
            ("maps", self.maps_s),
        ]
    }
}

/// Comparison of the stated intervals of a row with independent exact rays on a random sample of the bundles.
///
/// A 95 % interval claims a standard error of its width / (2 · 1.96). The noise of the audit's rays is subtracted from the observed error.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct IntervalAudit {
    /// Requested fraction of the bundles, in `(0, 1]`.
    pub fraction: f64,
    /// Number of audited bundles.
    pub bundles: usize,
    /// Exact rays per bundle.
    pub rays: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed_rms: f64,
    /// Observed RMS error.
    pub observed_rms: f64,
    /// 95 % interval of `observed_rms`, lower end.
    pub observed_lo: f64,
    /// 95 % interval of `observed_rms`, upper end.
    pub observed_hi: f64,
    /// Fraction of the stated intervals, in `[0, 1]`, that the audit confirms: mean p of the rays and answer x satisfy |p
    /// − x| ≤ √(h² + 1.96² q (1 − q) / rays), with h the half width of the interval on p's side and q = p clamped to
    /// the interval. Correct intervals have 0.95, for any number of rays.
    pub coverage: f64,
    /// 95 % interval (Wilson) of `coverage`, lower end.
    pub coverage_lo: f64,
    /// 95 % interval (Wilson) of `coverage`, upper end.
    pub coverage_hi: f64,
    /// Groups of bundles with similar claims, by ascending claim.
    pub bins: Vec<CalibrationBin>,
}

/// Bundles with similar claimed errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationBin {
    /// Number of bundles.
    pub count: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed: f64,
    /// Observed RMS error.
    pub observed: f64,
    /// 95 % interval of `observed`, lower end.
    pub observed_lo: f64,
    /// 95 % interval of `observed`, upper end.
    pub observed_hi: f64,
}

#[cfg(test)]
mod tests;
