//! Maps: shadow images of whole surfaces, with time, set-up and interpolation of both engines.

use super::compared::EMBREE;
use serde::Serialize;

/// A map of one receiver. `rms` and `bias` are errors of the fraction of the unoccluded light at each texel, in [0, 1].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MapRecord {
    /// Object, group or material.
    pub receiver: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a texel; length.
    pub texel: f64,
    /// Rays from a texel to an emitter in the reference.
    pub reference_rays: usize,
    /// RMS noise of the reference, estimated from its two halves; it is subtracted from errors.
    pub reference_rms: f64,
    /// Exact rows, with and without interpolation.
    pub exact: Vec<MapExactRow>,
    /// Multi-resolution rows, with and without interpolation.
    pub mr: Vec<MapMrRow>,
}

/// A map by exact rays.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MapExactRow {
    /// Rays from a point to an emitter.
    pub rays: usize,
    /// Distance of columns and rows at which light is computed, texels; it is interpolated linearly between them.
    pub spacing: usize,
    /// Whether texels are interpolated: `spacing` is above 1.
    pub interpolated: bool,
    /// Time of queries and interpolation, seconds.
    pub seconds: f64,
    /// Time to choose Embree's ray call, seconds; not part of `seconds` and of ratios.
    pub setup_s: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
}

/// A map by MR. Each ratio refers to the fastest exact row of the same map with that error, interpolated or not.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MapMrRow {
    /// Feature size; length.
    pub feature_size: f64,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// As [`MapExactRow::spacing`].
    pub spacing: usize,
    /// As [`MapExactRow::interpolated`].
    pub interpolated: bool,
    /// Engine: `bundle` (walks), `cut` (the distance cut), `cache` (the far-field cache: `spacing` is the largest distance between
    /// probes, `rays` the number of segments of a texel that is not interpolated), `certified` (exact rays with certificates) or `embree`
    /// (exact rays, because they are expected to be faster; the row is then that of `exact`).
    pub route: String,
    /// Time of queries and interpolation, seconds.
    pub seconds: f64,
    /// Preparation of this map: the decision on a sample, or the probes of the cache and what they see, seconds; not part of `seconds`.
    pub setup_s: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
    /// Feature-based error at `feature_size`.
    pub fbem: f64,
    /// Fraction of the segments, in [0, 1], that met at least one averaged cluster.
    pub aggregated_fraction: f64,
    /// Time of exact rays for the same RMS error, divided by `seconds`; `null` if undefined.
    pub speedup_at_same_rms: Option<f64>,
    /// The same with `setup_s` in the time of MR. Exact rays need no preparation: the choice of their call is not counted.
    pub speedup_with_setup: Option<f64>,
    /// As `speedup_with_setup`, over exact rays at every texel: what a program gains that does not interpolate its exact light. `null` for
    /// rows by plain exact rays, whose gain is that of interpolation.
    pub speedup_over_texels: Option<f64>,
    /// As `extrapolated`, of `speedup_over_texels`: interpolation averages noise, so that maps may have smaller errors than any row of
    /// texels.
    pub texels_extrapolated: bool,
    /// The same with the preparation of the scene as well: Embree's tree in both times; clusters and optics, which the cache saves in
    /// later runs, in that of MR.
    pub speedup_with_preparation: Option<f64>,
    /// As `speedup_at_same_rms`, at the same feature-based error.
    pub speedup_at_same_fbem: Option<f64>,
    /// Whether `speedup_at_same_rms` is extrapolated beyond the most accurate exact row, with error ∝ time^(−1/2).
    pub extrapolated: bool,
}

impl MapMrRow {
    /// Whether it was answered by plain exact rays.
    pub fn is_exact(&self) -> bool {
        self.route == EMBREE
    }
}

impl MapRecord {
    /// The MR row of each feature size with the largest `speedup_with_setup`.
    pub fn best_by_size(&self) -> Vec<&MapMrRow> {
        let speed = |row: &MapMrRow| row.speedup_with_setup.unwrap_or(0.0);
        let mut best: Vec<&MapMrRow> = Vec::new();
        for row in &self.mr {
            match best.iter_mut().find(|other| other.feature_size == row.feature_size) {
                Some(other) if speed(row) > speed(other) => *other = row,
                Some(_) => {}
                None => best.push(row),
            }
        }
        best
    }

    /// The exact rows that no other exact row surpasses in both time and error, by ascending time.
    pub fn best_exact(&self) -> Vec<&MapExactRow> {
        let mut rows: Vec<&MapExactRow> = self.exact.iter().collect();
        rows.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let mut error = f64::INFINITY;
        rows.retain(|row| {
            let better = row.rms < error;
            error = error.min(row.rms);
            better
        });
        rows
    }
}
