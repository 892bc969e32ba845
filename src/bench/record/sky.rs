//! The sky and the suns among the emitters of a benchmark.

use serde::Serialize;

/// Sources of light around the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SkySources {
    /// Patches of the sky, of the ground below the horizon if that is not black, and of luminous domes.
    pub patches: usize,
    /// Largest angle across a patch, degrees.
    pub largest_angle: f64,
    /// Most patches that a point asks, drawn in proportion to its irradiance by them.
    pub patches_per_point: usize,
    /// Emissive surfaces around the scene that are divided into patches.
    pub domes: usize,
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
                "{} patches of {} up to {:.1}° wide, of which a point asks up to {}, drawn in proportion to its irradiance by them",
                self.patches,
                if self.domes > 0 { "the sky or a luminous dome" } else { "the sky" },
                self.largest_angle,
                self.patches_per_point
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
            (_, 1..) => " Shadow images show the light of suns and whole emissive surfaces, without the sky.",
            _ => "",
        };
        format!("Emitters around the scene: {}.{shown}", sources.join("; and "))
    }
}
