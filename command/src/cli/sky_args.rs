//! The sky and the sun on the command line.

use super::args::SceneArgs;
use mrvis::{Channels, Error, Result, Scene, SkyOptions};

/// The sky and the sun.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Sky and sun")]
pub struct SkyArgs {
    /// The sky: uniform[:E], overcast[:E], cie:N[,E] (types 1 to 16), clear:TURBIDITY, perez:DNI,DHI, an equirectangular map
    /// .exr or .hdr, or sky.toml for all of it; E is the diffuse horizontal irradiance, W/m2.
    #[arg(long, value_name = "SKY")]
    pub sky: Option<String>,
    /// The sun: AZIMUTH,ELEVATION in degrees (from north by east) or a vector X,Y,Z towards it, with :E for its normal
    /// irradiance; none; auto: by --place and --time [default: auto]
    #[arg(long, value_name = "SUN", allow_hyphen_values = true)]
    pub sun: Option<String>,
    /// Latitude and longitude, degrees north and east, and altitude, metres, for the position of the sun.
    #[arg(long, value_name = "LAT,LON[,ALT]", allow_hyphen_values = true)]
    place: Option<String>,
    /// Time for the position of the sun, such as 2026-06-21T12:00+02:00.
    #[arg(long, value_name = "TIME")]
    time: Option<String>,
}

impl SkyArgs {
    /// The first option that is given.
    pub fn first_given(&self) -> Option<&'static str> {
        let SkyArgs { sky, sun, place, time } = self;
        let named = [("--sky", sky), ("--sun", sun), ("--place", place), ("--time", time)];
        named.into_iter().find(|(_, text)| text.is_some()).map(|(name, _)| name)
    }

    /// The sky and the sun that are asked for; those of [`SkyOptions::default`] without any option.
    ///
    /// # Errors
    /// A value is wrong, or a file cannot be read.
    pub fn options(&self) -> Result<SkyOptions> {
        let [sky, sun, place, time] =
            [&self.sky, &self.sun, &self.place, &self.time].map(|text| text.as_deref());
        SkyOptions::of_texts(sky, sun, place, time)
    }
}

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
