//! The sky and the sun on the command line.

use super::args::SceneArgs;
use mrvis::{Channels, Error, Result, Scene, SkyOptions};

impl SceneArgs {
    /// Refuses a sky and a sun, for commands whose results do not depend on light.
    ///
    /// # Errors
    /// [`Error::Argument`] if one is asked for.
    pub(super) fn without_sky(&self) -> Result<()> {
        match self.sky.first_given() {
            Some(name) => {
                let what = "has no effect here: what this command computes does not depend on light";
                Err(Error::arguments(format!("{name} {what}; omit it")))
            }
            None => Ok(()),
        }
    }

    /// The sky and the sun that are asked for, if any.
    fn sky_options(&self) -> Result<Option<SkyOptions>> {
        self.sky.first_given().map(|_| self.sky.options()).transpose()
    }

    /// These arguments; refuses a sky in lux without channels that hold lumens, for commands that state light.
    ///
    /// # Errors
    /// [`Error::Argument`] for such a sky.
    pub(super) fn with_light(&self) -> Result<&SceneArgs> {
        match self.photometric {
            None | Some(Channels::Rgb) if self.sky_options()?.is_some_and(|sky| sky.photometric) => {
                let what = "the sky has `photometric = true`, so that all channels hold lux: give --photometric=red, with all other light \
                            in lumens and lux too, or remove that line";
                Err(Error::arguments(what.into()))
            }
            _ => Ok(self),
        }
    }

    /// Lights the scene by the sky and the sun that are asked for.
    ///
    /// # Errors
    /// A value is wrong, or the values do not fit together.
    pub(super) fn add_sky(&self, scene: &mut Scene) -> Result<()> {
        let Some(options) = self.sky_options()? else { return Ok(()) };
        if self.photometric.is_some_and(|channels| channels != Channels::Rgb) && options.is_radiometric() {
            let what = "--photometric of one channel takes light in lumens and lux, and the skies `perez` and `clear` are in W/m²: set \
                        `photometric = true` in a sky.toml, or give --photometric alone";
            return Err(Error::arguments(what.into()));
        }
        scene.set_sky(&options)
    }
}
