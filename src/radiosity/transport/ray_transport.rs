//! Transport along the rays of the local pass.

use super::operator::{Field, Transport};
use super::transport_matrix::TransportMatrix;

/// Rays as rows of the transport operator. Unknowns are the irradiances of the rows.
pub struct RayTransport<'a> {
    /// Exchange between the rows.
    pub matrix: &'a TransportMatrix,
    /// Irradiance that emitters cause at the rows directly, W/m².
    pub direct: Field,
}

impl Transport for RayTransport<'_> {
    fn direct(&self) -> Field {
        self.direct.clone()
    }

    fn reflected(&self, irradiance: &Field) -> Field {
        self.matrix.reflected(irradiance)
    }

    fn bounce(&self, irradiance: &Field) -> Field {
        let mut sum = self.matrix.reflected(irradiance);
        sum.iter_mut().zip(&self.direct).for_each(|(s, d)| (0..3).for_each(|k| s[k] += d[k]));
        sum
    }

    fn weights(&self) -> &[f64] {
        &self.matrix.area
    }

    fn terms(&self) -> usize {
        self.matrix.entries()
    }
}
