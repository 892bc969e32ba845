//! Comparison of two irradiance files.

#[cfg(feature = "internals")]
use super::Irradiance;
#[cfg(feature = "internals")]
use crate::{Error, Result};

/// Differences between two irradiance files over all points and channels.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Comparison {
    /// Number of points.
    pub points: usize,
    /// Mean irradiance of the reference over points and channels, W/m².
    pub mean: f64,
    /// Root mean square difference, relative to `mean`.
    pub rms: f64,
    /// Root mean square standard error of the reference, relative to `mean`; 0 if standard errors are unknown.
    pub reference_noise: f64,
    /// Mean difference, relative to `mean`: positive if the test is brighter.
    pub bias: f64,
    /// 50th, 90th, 99th and 100th percentile of the absolute differences, relative to `mean`.
    pub percentiles: [f64; 4],
    /// Root mean square difference per channel, relative to the channel's mean; 0 if the channel is black in both
    /// files.
    pub rms_by_channel: [f64; 3],
}

impl Comparison {
    /// Percentages that [`Comparison::percentiles`] belong to.
    #[cfg(feature = "internals")]
    pub const SHARES: [f64; 4] = [50.0, 90.0, 99.0, 100.0];
}

/// Compares `test` with `reference`, point by point.
///
/// If the reference is black everywhere, its mean is 0: equal files give zeros, others infinities.
///
/// # Errors
/// [`Error::Argument`] unless both hold the same points in the same order; positions may differ by 1e-5 of the points'
/// extent (rounded digits).
#[cfg(feature = "internals")]
pub fn compare(reference: &Irradiance, test: &Irradiance) -> Result<Comparison> {
    let (a, b) = (&reference.points, &test.points);
    if a.len() != b.len() {
        return Err(Error::arguments(format!(
            "the reference has {} points, the test {}: compare irradiance at the same points",
            a.len(),
            b.len()
        )));
    }
    let low = a.iter().fold(glam::DVec3::INFINITY, |m, p| m.min(p.position));
    let high = a.iter().fold(glam::DVec3::NEG_INFINITY, |m, p| m.max(p.position));
    let close = 1e-5 * (high - low).length().max(high.abs().max_element()).max(f64::MIN_POSITIVE);
    if let Some(i) = (0..a.len()).find(|&i| a[i].position.distance(b[i].position) > close) {
        return Err(Error::arguments(format!(
            "point {} is at {} in the reference and at {} in the test: compare irradiance at the same points",
            i + 1,
            a[i].position,
            b[i].position
        )));
    }
    let count = (3 * a.len()).max(1) as f64;
    let mean = reference.values.iter().flatten().sum::<f64>() / count;
    let pairs = || reference.values.iter().flatten().zip(test.values.iter().flatten());
    let relative = |x: f64, mean: f64| if x == 0.0 { 0.0 } else { x / mean.abs() };
    let mut sizes: Vec<f64> = pairs().map(|(r, t)| (t - r).abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let percentile = |share: f64| {
        let rank = (share / 100.0 * sizes.len() as f64).ceil() as usize;
        sizes.get(rank.clamp(1, sizes.len().max(1)) - 1).copied().unwrap_or(0.0)
    };
    let mean_square = |values: &mut dyn Iterator<Item = f64>, n: f64| values.map(|v| v * v).sum::<f64>() / n;
    let channel = |c: usize| {
        let (r, t) = (reference.values.iter().map(|v| v[c]), test.values.iter().map(|v| v[c]));
        let n = a.len().max(1) as f64;
        relative(mean_square(&mut r.clone().zip(t).map(|(r, t)| t - r), n).sqrt(), r.sum::<f64>() / n)
    };
    Ok(Comparison {
        points: a.len(),
        mean,
        rms: relative(mean_square(&mut pairs().map(|(r, t)| t - r), count).sqrt(), mean),
        reference_noise: relative(
            mean_square(&mut reference.standard_errors.iter().flatten().copied(), count).sqrt(),
            mean,
        ),
        bias: relative(pairs().map(|(r, t)| t - r).sum::<f64>() / count, mean),
        percentiles: Comparison::SHARES.map(|share| relative(percentile(share), mean)),
        rms_by_channel: std::array::from_fn(channel),
    })
}
