//! Descriptions of sky and sun: options and `sky.toml`.

use super::parse::{SkyModel, SkyText, SunChoice, numbers, positive};
use super::position::{Moment, Place};
use super::sun::SUN_DIAMETER;
use crate::error::{in_words, quote};
use crate::files::input::{self, MAX_SMALL_FILE};
use crate::options::Values;
use crate::{Error, Result};
use serde::de::{Deserialize, Deserializer, Error as _};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// An irradiance or a reflectance: one number for all channels, or one for each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Amount {
    /// For all channels; of a sky with colours: its luminance.
    Grey(f64),
    /// Red, green, blue.
    Rgb([f64; 3]),
}

impl Amount {
    /// By channel.
    pub fn rgb(self) -> [f64; 3] {
        match self {
            Amount::Grey(value) => [value; 3],
            Amount::Rgb(values) => values,
        }
    }
}

options! {
    /// Sky and sun as a user describes them. All fields of `sky.toml` have the names of the fields here.
    #[derive(Clone, Debug, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    #[non_exhaustive]
    pub struct SkyOptions {
        /// The radiance of the sky.
        #[serde(deserialize_with = "sky")]
        pub sky: (SkyModel, Option<f64>) = (SkyModel::None, None);
        /// A map that multiplies the model.
        pub map: Option<PathBuf> = None;
        /// Azimuth of the centre column of a map, degrees; 0 is north.
        pub map_north: f64 = 0.0, in -360.0..=360.0, "an angle in degrees";
        /// The sun.
        #[serde(deserialize_with = "from_text")]
        pub sun: SunChoice = SunChoice::Auto;
        /// Angular diameter of the sun, degrees; 0.533 in the mean.
        pub sun_diameter: f64 = SUN_DIAMETER, above 0.0, at most 90.0, "an angle in degrees";
        /// The place for the sun's position.
        #[serde(deserialize_with = "place")]
        pub place: Option<Place> = None;
        /// The time for the sun's position.
        #[serde(deserialize_with = "time")]
        pub time: Option<Moment> = None;
        /// Normal irradiance of the sun, W/m² (lx if photometric).
        #[serde(deserialize_with = "amount")]
        pub direct_normal: Option<Amount> = None, in 0.0.., "an irradiance";
        /// Horizontal irradiance of the sky without `sun`, with the bright spots of a map, W/m² (lx if photometric). Without any level
        /// the skies `uniform`, `overcast` and `cie` have 1, so that irradiances are daylight factors, and a map alone has its own
        /// values. It replaces the irradiance of `perez` and `clear`, as three numbers for their colour.
        #[serde(deserialize_with = "amount")]
        pub diffuse_horizontal: Option<Amount> = None, in 0.0.., "an irradiance";
        /// Radiance at the zenith, W/(m² sr) (cd/m² if photometric), instead of `diffuse_horizontal`.
        pub zenith: Option<f64> = None, in 0.0.., "a radiance";
        /// Diffuse reflectance of the ground below the horizon; `None`: 0, black.
        #[serde(deserialize_with = "amount")]
        pub ground: Option<Amount> = None, in 0.0..=1.0, "a reflectance";
        /// Direction of north in scene coordinates, horizontal; default +y below +z, −z below +y.
        pub north: Option<[f64; 3]> = None;
        /// Dew point, °C, for the luminous efficacy; 11 are 2 cm of precipitable water, as in Radiance's gendaylit.
        pub dew_point: f64 = 11.0, in -60.0..=40.0, "a temperature in °C";
        /// Pressure of the air, hPa, for refraction; `None`: standard atmosphere at the altitude.
        pub pressure: Option<f64> = None, in 100.0..=1200.0, "a pressure in hPa";
        /// Temperature of the air, °C, for refraction.
        // The default of pvlib for annual means. 10 °C more lower a sun 10° above the horizon by 0.003°.
        pub temperature: f64 = 12.0, in -100.0..=70.0, "a temperature in °C";
        /// Whether light is in lx and cd/m² instead of W/m² and W/(m² sr). Irradiances of `perez` and `clear` then become illuminances by
        /// the luminous efficacies of Perez; all other values are in these units.
        pub photometric: bool = false;
        /// The file that this was read from.
        #[serde(skip)]
        pub(super) file: Option<PathBuf> = None;
    }
}

impl Values for Amount {
    type Number = f64;
    fn first_not(&self, allowed: &impl Fn(f64) -> bool) -> Option<String> {
        self.rgb().iter().find_map(|value| value.first_not(allowed))
    }
}

impl SkyOptions {
    /// Whether the sky is of a model in W/m² that would be in lux with `photometric`.
    #[doc(hidden)]
    #[must_use]
    pub fn is_radiometric(&self) -> bool {
        !self.photometric && matches!(self.sky.0, SkyModel::Perez { .. } | SkyModel::Clear { .. })
    }

    /// A sky from a short text: `none`, `uniform[:E]`, `overcast[:E]`, `cie:N[,E]`, `clear:TURBIDITY`, `perez:DNI,DHI`, the name of a map
    /// `.exr` or `.hdr`, or of a description `.toml`, which is read now. E is the diffuse horizontal irradiance.
    ///
    /// # Errors
    /// [`Error::Argument`] if the text is wrong; [`Error::Io`] or [`Error::File`] with file and line from a description.
    pub(crate) fn parse(text: &str) -> Result<SkyOptions> {
        match parsed("sky", text)? {
            SkyText::Model(model, level) => Ok(SkyOptions { sky: (model, level), ..SkyOptions::default() }),
            SkyText::File(path) => SkyOptions::read(&path),
        }
    }

    /// Reads a description in TOML. Names of maps are relative to its folder.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::File`] with the line if it is wrong.
    pub fn read(path: &Path) -> Result<SkyOptions> {
        let bytes = input::read(path, MAX_SMALL_FILE)?;
        let text = String::from_utf8(bytes).map_err(|_| Error::format(path, None, "not a text in UTF-8"))?;
        let mut options: SkyOptions = toml::from_str(&text).map_err(|e| {
            let line = e.span().map(|s| 1 + text[..s.start].matches('\n').count());
            Error::format(path, line, with_key(&in_words(e.message()).replace('\n', " "), line, &text))
        })?;
        let beside = |name: &mut PathBuf| *name = path.with_file_name("").join(&*name);
        options.map.iter_mut().for_each(beside);
        if let SkyModel::Map(name) = &mut options.sky.0 {
            beside(name);
        }
        options.file = Some(path.to_owned());
        Ok(options)
    }

    /// A sky, a sun, a place and a time by their short texts; those that are missing are as in [`SkyOptions::default`].
    ///
    /// Skies: `none`, `uniform[:E]`, `overcast[:E]`, `cie:N[,E]`, `clear:TURBIDITY`, `perez:DNI,DHI`, the name of a map `.exr` or `.hdr`,
    /// or of a description `.toml`, which is read now; E is the diffuse horizontal irradiance, W/m². Suns: `auto`, `none`,
    /// `AZIMUTH,ELEVATION` in degrees or `X,Y,Z`, the last two with `:E` for a normal irradiance. Places:
    /// `LATITUDE,LONGITUDE[,ALTITUDE]`, degrees north and east, metres. Times as `2026-06-21T12:00+02:00`.
    ///
    /// # Errors
    /// [`Error::Argument`] if a text is wrong; [`Error::Io`] or [`Error::File`] with file and line from a description.
    pub fn of_texts(
        sky: Option<&str>,
        sun: Option<&str>,
        place: Option<&str>,
        time: Option<&str>,
    ) -> Result<SkyOptions> {
        let mut options = SkyOptions::parse(sky.unwrap_or("none"))?;
        if let Some(sun) = sun {
            options = options.with_sun(sun)?;
        }
        if let Some(place) = place {
            options = options.with_place(place)?;
        }
        if let Some(time) = time {
            options = options.with_time(time)?;
        }
        Ok(options)
    }

    /// The sun from a short text: `auto`, `none`, `AZIMUTH,ELEVATION` in degrees or `X,Y,Z`, the last two with `:E` for a normal
    /// irradiance.
    pub(crate) fn with_sun(mut self, text: &str) -> Result<SkyOptions> {
        self.sun = parsed("sun", text)?;
        Ok(self)
    }

    /// The place as `LATITUDE,LONGITUDE` or `LATITUDE,LONGITUDE,ALTITUDE`: degrees north and east, metres.
    pub(crate) fn with_place(mut self, text: &str) -> Result<SkyOptions> {
        self.place = Some(parsed("place", text)?);
        Ok(self)
    }

    /// The time as in `2026-06-21T12:00+02:00` or `2026-06-21T10:00Z`.
    pub(crate) fn with_time(mut self, text: &str) -> Result<SkyOptions> {
        self.time = Some(parsed("time", text)?);
        Ok(self)
    }

    /// The files that it names: its description and maps.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let map = match &self.sky.0 {
            SkyModel::Map(path) => Some(path),
            _ => None,
        };
        self.file.iter().chain(&self.map).chain(map).cloned().collect()
    }

    /// Checks values that are wrong whatever the sky is.
    pub(super) fn check(&self) -> Result<()> {
        self.check_ranges()?;
        let levels = [self.diffuse_horizontal.is_some(), self.zenith.is_some(), self.sky.1.is_some()];
        if levels.iter().filter(|given| **given).count() > 1 {
            let what = "the level of the sky is stated twice: keep one of ⟨diffuse_horizontal⟩, ⟨zenith⟩ and the number in ⟨sky⟩";
            return Err(Error::arguments(what.into()));
        }
        Ok(())
    }
}

/// Error message about a line of a description, with the key of the line, if it has one, and the remedy for a table.
fn with_key(what: &str, line: Option<usize>, text: &str) -> String {
    let content = line.and_then(|line| text.lines().nth(line - 1)).unwrap_or_default();
    let key = content.split('=').next().unwrap_or_default().trim_matches(['[', ']', ' ', '\t']);
    let is_key = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    match is_key && what.starts_with("invalid type") {
        true if what.contains(": map") => {
            format!(
                "`{key}` is a table ({what}): write {key} = VALUE on one line, such as sky = \"overcast\""
            )
        }
        true => format!("`{key}`: {what}"),
        false => what.into(),
    }
}

/// A value of the option `name`.
fn parsed<T: FromStr<Err = String>>(name: &str, text: &str) -> Result<T> {
    text.parse().map_err(|what| Error::argument(name, quote(text), what))
}

fn from_text<'de, D: Deserializer<'de>, T: FromStr<Err: Display>>(source: D) -> Result<T, D::Error> {
    String::deserialize(source)?.parse().map_err(D::Error::custom)
}

fn sky<'de, D: Deserializer<'de>>(source: D) -> Result<(SkyModel, Option<f64>), D::Error> {
    match from_text(source)? {
        SkyText::Model(model, level) => Ok((model, level)),
        SkyText::File(_) => {
            Err(D::Error::custom("a description cannot name another one: give a model or a map"))
        }
    }
}

/// A text or a list of numbers.
#[derive(serde::Deserialize)]
#[serde(untagged)]
enum TextOrNumbers {
    Text(String),
    Number(f64),
    Numbers(Vec<f64>),
}

fn place<'de, D: Deserializer<'de>>(source: D) -> Result<Option<Place>, D::Error> {
    let place = match TextOrNumbers::deserialize(source)? {
        TextOrNumbers::Text(text) => numbers(&text).and_then(|v| Place::new(&v)),
        TextOrNumbers::Number(value) => Place::new(&[value]),
        TextOrNumbers::Numbers(values) => Place::new(&values),
    };
    place.map(Some).map_err(D::Error::custom)
}

fn time<'de, D: Deserializer<'de>>(source: D) -> Result<Option<Moment>, D::Error> {
    let moment = match toml::Value::deserialize(source)? {
        toml::Value::Datetime(written) => Moment::new(written),
        toml::Value::String(text) => text.parse(),
        _ => Err("a time is written as 2026-06-21T12:00+02:00".into()),
    };
    moment.map(Some).map_err(D::Error::custom)
}

fn amount<'de, D: Deserializer<'de>>(source: D) -> Result<Option<Amount>, D::Error> {
    let bad = || D::Error::custom("expected a number or three of at least 0, [red, green, blue]");
    let check = |v: f64| positive(v, "value").map_err(D::Error::custom);
    match TextOrNumbers::deserialize(source).map_err(|_| bad())? {
        TextOrNumbers::Number(value) => Ok(Some(Amount::Grey(check(value)?))),
        TextOrNumbers::Numbers(values) => match values[..] {
            [r, g, b] => Ok(Some(Amount::Rgb([check(r)?, check(g)?, check(b)?]))),
            _ => Err(bad()),
        },
        TextOrNumbers::Text(_) => Err(bad()),
    }
}
