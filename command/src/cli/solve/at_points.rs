//! Light at points in few numbers, as lighting standards state it.

use super::super::args::grouped;
use mrvis::internals::plot::number;
use mrvis::internals::scene::Photometry;
use serde::Serialize;
use std::fmt::Write as _;

/// Smallest, mean and largest light at points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtPoints {
    /// Number of points.
    pub count: usize,
    /// lx, or W/m² (mean of the channels).
    pub unit: &'static str,
    pub minimum: f64,
    pub mean: f64,
    pub maximum: f64,
    /// Points without any light, as those below furniture.
    pub dark: usize,
    /// Uniformity U0 of EN 12464: the minimum divided by the mean; `null` in the dark.
    pub uniformity: Option<f64>,
}

impl AtPoints {
    /// Of irradiances, W/m²; none without points.
    pub fn of(irradiance: &[[f64; 3]], photometry: Option<Photometry>) -> Option<AtPoints> {
        let values = || irradiance.iter().map(|e| AtPoints::value(*e, photometry));
        let mean = values().sum::<f64>() / irradiance.len() as f64;
        let minimum = values().reduce(f64::min)?;
        Some(AtPoints {
            count: irradiance.len(),
            unit: if photometry.is_some() { "lx" } else { "W/m\u{b2}" },
            minimum,
            mean,
            maximum: values().fold(minimum, f64::max),
            dark: values().filter(|&light| light == 0.0).count(),
            uniformity: (mean > 0.0).then_some(minimum / mean),
        })
    }

    /// What is stated of an irradiance, W/m².
    pub fn value(irradiance: [f64; 3], photometry: Option<Photometry>) -> f64 {
        photometry
            .map_or_else(|| irradiance.iter().sum::<f64>() / 3.0, |photometry| photometry.of(irradiance))
    }

    /// The numbers in words.
    pub fn words(&self) -> String {
        let AtPoints { count, unit, minimum, mean, maximum, dark, uniformity } = self;
        let mut line = format!(
            "{} point{}: minimum {}, mean {}, maximum {} {unit}",
            grouped(*count),
            if *count == 1 { "" } else { "s" },
            number(*minimum),
            number(*mean),
            number(*maximum),
        );
        // Writing to a string cannot fail.
        if let Some(uniformity) = uniformity {
            let _ = write!(line, ", uniformity U0 (minimum / mean) {uniformity:.2}");
            if *dark > 0 {
                let of = if *dark == 1 { "point that receives" } else { "points that receive" };
                let _ = write!(line, " with {} {of} no light (below or inside of things?)", grouped(*dark));
            }
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniformity_is_minimum_over_mean() {
        let found = AtPoints::of(&[[1.0, 2.0, 3.0], [6.0; 3]], None).expect("points");
        assert_eq!((found.count, found.minimum, found.mean, found.maximum), (2, 2.0, 4.0, 6.0));
        assert_eq!((found.uniformity, found.dark), (Some(0.5), 0));
        let found = AtPoints::of(&[[0.0; 3], [6.0; 3]], None).expect("points");
        assert!(
            found.words().ends_with("0.00 with 1 point that receives no light (below or inside of things?)")
        );
        assert_eq!(AtPoints::of(&[[0.0; 3]], None).expect("a point").uniformity, None);
        assert_eq!(AtPoints::of(&[], None), None);
    }
}
