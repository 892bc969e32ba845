//! The sky and the suns among the emitters of a benchmark.

use serde::Serialize;

/// Sources of light at infinity.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SkySources {
    /// Patches of the sky, and of the ground below the horizon if that is not black.
    pub patches: usize,
    /// Largest angle across a patch, degrees.
    pub largest_angle: f64,
    /// Most patches that a point asks, drawn in proportion to its irradiance by them.
    pub patches_per_point: usize,
    /// Suns.
    pub suns: usize,
    /// Emitters of the shadow images and maps: `lamps` (emissive surfaces and suns), or `patch`, the one with the largest
    /// irradiance of a horizontal plane, if there are none.
    pub shown: String,
}

impl SkySources {
    /// What the sources are, in one or two sentences.
    pub fn sentence(&self) -> String {
        let mut sources = Vec::new();
        if self.patches > 0 {
            sources.push(format!(
                "{} patches of the sky up to {:.1}° wide, of which a point asks up to {}, drawn in proportion to its irradiance by them",
                self.patches, self.largest_angle, self.patches_per_point
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
            (_, 1..) => " Shadow images show the light of suns and emissive surfaces, without the sky.",
            _ => "",
        };
        format!("Emitters at infinity: {}.{shown}", sources.join("; and "))
    }
}
