//! Validation of optics that were read from a file.

use super::ClusterOptics;

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
