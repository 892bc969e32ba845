//! Transport along the rays of the local pass.

use super::operator::{Field, Transport};
use super::transport_matrix::TransportMatrix;

/// Rays as rows of the transport operator. Unknowns are what the rows send over their reflectance and row sum: their irradiance, corrected for the
/// covariance of its samples and those of the row sum.
pub struct RayTransport<'a> {
    /// Exchange between the rows.
    pub matrix: &'a TransportMatrix,
    /// What rows send of the light of emitters, suns and sky, W/m².
    pub direct: Field,
    /// By row, the part of the reflected light that it receives which it sends.
    pub returned: Vec<f64>,
}

impl Transport for RayTransport<'_> {
    fn direct(&self) -> Field {
        self.direct.clone()
    }

    fn reflected(&self, irradiance: &Field) -> Field {
        let mut sum = self.matrix.reflected(irradiance);
        sum.iter_mut().zip(&self.returned).for_each(|(sum, part)| sum.iter_mut().for_each(|s| *s *= part));
        sum
    }

    fn bounce(&self, irradiance: &Field) -> Field {
        let mut sum = self.reflected(irradiance);
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
