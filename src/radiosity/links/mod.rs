//! Links: the exchange of light between two elements, its measurement, and the estimate of its error.
//!
//! A link serves both directions. Its exchange area `C = ∫∫ K V` over both ends (`K = cos cos' / π r²`, V visibility) is
//! `A_a F(a→b) T = A_b F(b→a) T`: reciprocity holds exactly, and the power that reaches a from b is `C B_b`. Unoccluded exchange
//! and transmittance are stored separately. Links contain no light: radiosities are arguments. See `docs/method.md`, Links and
//! refinement. A [`SkyLink`] goes one way, from the sky or a sun to an element.

mod accuracy;
mod blocker_certificate;
mod cluster_pair;
mod end_samples;
mod error_oracle;
mod estimator;
mod sky_estimator;
mod sky_link;
mod surface_pair;
#[cfg(test)]
mod tests;
mod visibility_engine;

pub use accuracy::Accuracy;
pub use blocker_certificate::BlockerCertificate;
pub use error_oracle::{Split, link_error};
pub use estimator::LinkEstimator;
pub use sky_estimator::SkyEstimator;
pub use sky_link::{LastMeasurement, SkyLink, SkyPair, SkySource, sky_link_error};
pub use visibility_engine::{Scratch, Tally, VisibilityEngine, VisibilityQuery, sample_bundles};

/// The exchange of light between two elements, or between the parts of one cluster.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Link {
    /// One end.
    pub a: u32,
    /// The other end; equal to `a` for the inside of a cluster.
    pub b: u32,
    /// Exchange area `A_a F(a→b) T`, scene units squared.
    pub exchange_area: f32,
    /// Visible fraction of the unoccluded exchange, in `[0, 1]`.
    pub transmittance: f32,
    /// Standard deviation of the exchange area over points (for clusters, also directions) of each end, scene units squared.
    pub variation: [f32; 2],
    /// Standard error of the exchange area from sampling, scene units squared.
    pub noise: f32,
    /// Segments traced.
    pub rays: u32,
    /// Proof by geometry alone about the space between the ends.
    pub certificate: BlockerCertificate,
}

impl Link {
    /// Expected standard deviation of the transmittance of segments between parts of the ends: that of this link's segments,
    /// at most √(T (1 - T)), and no less than a finite number of equal answers allows.
    pub fn transmittance_deviation(&self) -> f32 {
        if self.certificate == BlockerCertificate::CLEAR {
            return 0.0;
        }
        // Two additional segments, one visible and one blocked (Agresti and Coull 1998).
        let n = self.rays as f32;
        let t = (n * self.transmittance + 1.0) / (n + 2.0);
        (t * (1.0 - t)).sqrt()
    }
}
