//! Short texts for sky and sun, as on a command line.

use super::perez::SOLAR_CONSTANT;
use crate::error::{figure, quote};
use std::path::PathBuf;
use std::str::FromStr;

/// The radiance of the sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SkyModel {
    /// No sky.
    #[default]
    None,
    /// The same radiance everywhere.
    Uniform,
    /// A CIE general sky from 1 to 15, or the traditional overcast sky, 16.
    Cie(u8),
    /// The all-weather sky of Perez.
    Perez {
        /// Direct normal irradiance, W/m².
        direct: f64,
        /// Diffuse horizontal irradiance, W/m², above 0.
        diffuse: f64,
    },
    /// The CIE standard clear sky with irradiances by the Linke turbidity.
    Clear {
        /// Linke turbidity, 1 to 12.
        turbidity: f64,
    },
    /// An equirectangular map alone.
    Map(PathBuf),
}

/// A sky as a short text states it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SkyText {
    /// A model, and a diffuse horizontal irradiance for its level.
    Model(SkyModel, Option<f64>),
    /// A description in TOML.
    File(PathBuf),
}

/// Linke turbidities of the formulas: 1 for air without aerosol and water, 12 for a dust storm.
const TURBIDITIES: [f64; 2] = [1.0, 12.0];

impl FromStr for SkyText {
    type Err = String;

    /// `none`, `uniform[:E]`, `overcast[:E]`, `cie:N[,E]`, `clear:TURBIDITY`, `perez:DNI,DHI` or the name of a file.
    fn from_str(text: &str) -> Result<SkyText, String> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let values = || if text.contains(':') { numbers(rest) } else { Ok(Vec::new()) };
        let model = match name {
            "none" if rest.is_empty() => (SkyModel::None, None),
            "uniform" | "overcast" => {
                let model = if name == "uniform" {
                    SkyModel::Uniform
                } else {
                    SkyModel::Cie(super::gradation::TRADITIONAL_OVERCAST)
                };
                match values()?[..] {
                    [] => (model, None),
                    [level] => (model, Some(positive(level, "irradiance")?)),
                    _ => {
                        return Err(format!(
                            "write `{name}` or `{name}:E` with the diffuse horizontal irradiance"
                        ));
                    }
                }
            }
            "cie" => {
                let usage = "write `cie:N` or `cie:N,E` with a type from 1 to 16 and the diffuse horizontal irradiance";
                match values()?[..] {
                    [kind] => (SkyModel::Cie(cie_type(kind)?), None),
                    [kind, level] => (SkyModel::Cie(cie_type(kind)?), Some(positive(level, "irradiance")?)),
                    _ => return Err(usage.into()),
                }
            }
            "clear" => match values()?[..] {
                [turbidity] if (TURBIDITIES[0]..=TURBIDITIES[1]).contains(&turbidity) => {
                    (SkyModel::Clear { turbidity }, None)
                }
                [turbidity] => {
                    let turbidity = figure(turbidity);
                    return Err(format!(
                        "the Linke turbidity {turbidity} is not between 1 and 12: 3 is clean warm air"
                    ));
                }
                _ => return Err("write `clear:TURBIDITY` with a Linke turbidity from 1 to 12".into()),
            },
            "perez" => {
                match values()?[..] {
                    [direct, diffuse] => (perez(direct, diffuse)?, None),
                    _ => return Err(
                        "write `perez:DNI,DHI` with direct normal and diffuse horizontal irradiance, W/m²"
                            .into(),
                    ),
                }
            }
            _ => return file(text),
        };
        Ok(SkyText::Model(model.0, model.1))
    }
}

/// Largest irradiance outside the atmosphere, W/m²: where the earth is nearest to the sun, .9833 astronomical units.
const MAX_IRRADIANCE: f64 = SOLAR_CONSTANT / (0.9833 * 0.9833);

fn perez(direct: f64, diffuse: f64) -> Result<SkyModel, String> {
    if let Some(value) = [direct, diffuse].into_iter().find(|value| *value > MAX_IRRADIANCE) {
        let value = figure(value);
        return Err(format!(
            "{value} W/m² is more than outside the atmosphere: give at most {MAX_IRRADIANCE:.0}"
        ));
    }
    let (direct, diffuse) =
        (positive(direct, "direct normal irradiance")?, positive(diffuse, "diffuse horizontal irradiance")?);
    match diffuse > 0.0 {
        true => Ok(SkyModel::Perez { direct, diffuse }),
        false => Err("a diffuse horizontal irradiance of 0 gives a black sky: give one above 0, W/m²".into()),
    }
}

fn cie_type(value: f64) -> Result<u8, String> {
    match (1..=16).find(|k| f64::from(*k) == value) {
        Some(kind) => Ok(kind),
        None => Err(format!("{} is no type of CIE sky: give a whole number from 1 to 16", figure(value))),
    }
}

fn file(text: &str) -> Result<SkyText, String> {
    let path = PathBuf::from(text);
    let kind = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match kind.as_str() {
        "exr" | "hdr" => Ok(SkyText::Model(SkyModel::Map(path), None)),
        "toml" => Ok(SkyText::File(path)),
        _ => Err("give none, uniform, overcast, cie:N, clear:TURBIDITY, perez:DNI,DHI, or a file .exr, .hdr or .toml".into()),
    }
}

/// The sun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SunChoice {
    /// At the position given by place and time, if the sky has a sun.
    #[default]
    Auto,
    /// No disc; place and time still shape the sky.
    None,
    /// In a direction.
    At {
        /// Direction towards the sun.
        direction: SunDirection,
        /// Normal irradiance, W/m² (lx if photometric); none for that of the sky.
        irradiance: Option<f64>,
    },
}

/// A direction towards the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SunDirection {
    /// Azimuth clockwise from north and elevation, degrees.
    Angles([f64; 2]),
    /// In scene coordinates, of any length.
    Vector([f64; 3]),
}

impl FromStr for SunChoice {
    type Err = String;

    /// `auto`, `none`, `AZIMUTH,ELEVATION[:E]` or `X,Y,Z[:E]`.
    fn from_str(text: &str) -> Result<SunChoice, String> {
        let usage =
            "give auto, none, AZIMUTH,ELEVATION in degrees, or X,Y,Z; append :E for a normal irradiance";
        match text {
            "auto" => return Ok(SunChoice::Auto),
            "none" => return Ok(SunChoice::None),
            _ => {}
        }
        let (direction, irradiance) = match text.split_once(':') {
            Some((direction, value)) => {
                let value = numbers(value)?;
                let [value] = value[..] else { return Err(usage.into()) };
                (direction, Some(positive(value, "normal irradiance")?))
            }
            None => (text, None),
        };
        let direction = match numbers(direction).map_err(|e| format!("{e}; {usage}"))?[..] {
            [azimuth, elevation] => {
                if !(-360.0..=360.0).contains(&azimuth) || !(-90.0..=90.0).contains(&elevation) {
                    let (azimuth, elevation) = (figure(azimuth), figure(elevation));
                    return Err(format!(
                        "azimuth {azimuth} and elevation {elevation} are no direction: within ±360 and ±90 degrees"
                    ));
                }
                SunDirection::Angles([azimuth, elevation])
            }
            [x, y, z] => SunDirection::Vector([x, y, z]),
            _ => return Err(usage.into()),
        };
        Ok(SunChoice::At { direction, irradiance })
    }
}

/// Finite numbers with commas between them.
pub(super) fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |part: &str| {
        let value = part.trim().parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| format!("`{}` is not a finite number", quote(part)))
    };
    text.split(',').map(number).collect()
}

/// A number that is finite and at least 0.
pub(super) fn positive(value: f64, name: &str) -> Result<f64, String> {
    match value.is_finite() && value >= 0.0 {
        true => Ok(value),
        false => Err(format!("the {name} {} is not a number of at least 0", figure(value))),
    }
}
