//! The sky and the sun on the command line.

use super::args::SceneArgs;
use mrvis::{Result, Scene, SkyOptions};

impl SceneArgs {
    /// Lights the scene by the sky and the sun that are asked for.
    ///
    /// # Errors
    /// A value is wrong, or the values do not fit together.
    pub(super) fn add_sky(&self, scene: &mut Scene) -> Result<()> {
        let SceneArgs { sky, sun, place, time, .. } = self;
        if [sky, sun, place, time].into_iter().all(Option::is_none) {
            return Ok(());
        }
        let [sky, sun, place, time] = [sky, sun, place, time].map(|text| text.as_deref());
        scene.set_sky(&SkyOptions::of_texts(sky, sun, place, time)?)
    }
}
