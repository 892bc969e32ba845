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
mod link;
mod sky_draft;
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
pub use link::Link;
pub use sky_draft::{Last, SkyPair};
pub use sky_estimator::SkyEstimator;
pub use sky_link::{SkyLink, SkySource, sky_link_error};
pub use visibility_engine::{Scratch, Tally, VisibilityEngine, VisibilityQuery, sample_bundles};
