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
        let mut options = SkyOptions::parse(sky.as_deref().unwrap_or("none"))?;
        if let Some(sun) = sun {
            options = options.with_sun(sun)?;
        }
        if let Some(place) = place {
            options = options.with_place(place)?;
        }
        if let Some(time) = time {
            options = options.with_time(time)?;
        }
        scene.set_sky(&options)
    }
}
