//! One link.

use super::BlockerCertificate;

/// The exchange of light between two elements, or between the parts of one cluster.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Link {
    /// One end.
    pub a: u32,
    /// The other end; equal to `a` for the inside of a cluster.
    pub b: u32,
    /// Exchange area `A_a F(a→b) T`, scene units squared.
    pub exchange_area: f32,
    /// Visible part of the unoccluded exchange, in `[0, 1]`.
    pub transmittance: f32,
    /// Standard deviation of the exchange area over points (for clusters, also directions) of each end, scene units squared.
    pub variation: [f32; 2],
    /// Standard error of the exchange area from sampling, scene units squared.
    pub noise: f32,
    /// Segments traced.
    pub rays: u32,
    /// What geometry alone proves about the space between the ends.
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
