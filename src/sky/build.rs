//! Builds the environment from its description.

use super::environment::{Environment, OF_FILE, notes_of_suns};
use super::frame::Frame;
use super::gradation::Shape;
use super::map::SkyMap;
use super::options::{Amount, SkyOptions};
use super::parse::{SkyModel, SunChoice, SunDirection};
use super::perez::{Atmosphere, SOLAR_CONSTANT};
use super::position::{Air, sun_position};
use super::radiance::{Level, Sky};
use super::sun::Sun;
use super::{gradation, position};
use crate::error::shown;
use crate::math::MAX_RADIANCE;
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// The sun's place in the sky.
struct Position {
    /// Local unit vector.
    local: DVec3,
    /// Normal irradiance outside the atmosphere, W/m².
    outside: f64,
}

impl Position {
    fn zenith_angle(&self) -> f64 {
        self.local.z.clamp(-1.0, 1.0).acos()
    }

    fn elevation(&self) -> f64 {
        90.0 - self.zenith_angle().to_degrees()
    }

    /// Part of an error message: the position of a sun that is not above the horizon.
    fn below_horizon(&self) -> String {
        match -self.elevation() {
            down if down < 0.005 => "on the horizon".into(),
            down => format!("{down:.2} degrees below the horizon"),
        }
    }
}

/// A sky before its level is applied.
struct Model {
    shape: Shape,
    /// Diffuse horizontal irradiance that the model states.
    diffuse: Option<f64>,
    /// Normal irradiance of the sun that the model states.
    direct: Option<f64>,
    note: String,
}

impl SkyOptions {
    /// The sky, sun and ground that this describes, in a scene with this upward axis.
    ///
    /// # Errors
    /// [`Error::Argument`], or [`Error::File`] with the name of the description: a sky that needs the sun has none or one below the
    /// horizon; values contradict each other or cannot be. [`Error::Io`] or [`Error::File`] of a map.
    #[doc(hidden)]
    pub fn environment(&self, up: DVec3) -> Result<Environment> {
        self.environment_with(up, &[])
    }

    /// The same with the suns of a file, if the description neither has a sun nor excludes one.
    pub(crate) fn environment_with(&self, up: DVec3, suns: &[Sun]) -> Result<Environment> {
        let at = |what: String| self.wrong(Error::arguments(what));
        self.check().map_err(|error| self.wrong(error))?;
        let frame = match self.north {
            Some(north) => Frame::new(up, DVec3::from(north)),
            None => Frame::upright(up),
        };
        let frame = frame.map_err(|error| self.wrong(error))?;
        let position = self.position(&frame).map_err(at)?;
        let model = self.model(position.as_ref()).map_err(at)?;
        let mut notes = vec![frame.note()];
        notes.push(model.note.clone());
        let map = match (&self.sky.0, &self.map) {
            (SkyModel::Map(_), Some(_)) => return Err(at("⟨sky⟩ is a map already: remove ⟨map⟩".into())),
            (SkyModel::None, Some(_)) => {
                return Err(at("⟨map⟩ has no sky to multiply: state ⟨sky⟩, or the map as ⟨sky⟩".into()));
            }
            (SkyModel::Map(path), None) | (_, Some(path)) => Some(self.read_map(path, &mut notes)?),
            _ => None,
        };
        let is_alone = matches!(self.sky.0, SkyModel::Map(_)) && self.ground.is_none();
        let mut sky = match self.sky.0 {
            SkyModel::None => None,
            _ => Some(
                Sky::new(model.shape, map, is_alone, self.level(&model))
                    .map_err(|error| self.wrong(error))?,
            ),
        };
        let spots = sky.as_mut().map_or(Vec::new(), |sky| sky.take_spots(&frame));
        if let Some(sky) = &sky {
            let without = if spots.is_empty() { "" } else { ", without the bright spots of the map" };
            let of = self.irradiance_text(sky.horizontal_irradiance());
            notes.push(format!("diffuse horizontal irradiance {of}{without}"));
        }
        let sun = self.disc(&frame, position.as_ref(), &model).map_err(at)?;
        let has_others = sun.is_none() && !suns.is_empty() && matches!(self.sun, SunChoice::Auto);
        notes.push(match has_others {
            true => notes_of_suns(&frame, OF_FILE, suns),
            false => self.sun_note(&frame, position.as_ref(), sun.as_ref()),
        });
        let mut suns = if has_others { suns.to_vec() } else { sun.into_iter().collect() };
        if !spots.is_empty() {
            notes.push(notes_of_suns(&frame, "bright spots of the map, as suns", &spots));
        }
        suns.extend(spots);
        let ground = self.ground.map_or([0.0; 3], Amount::rgb);
        let mut environment = Environment::new(frame, sky, suns, ground);
        environment.notes = notes;
        Ok(environment)
    }

    /// The same at another minute of its day; `None` while the sun is below the horizon.
    ///
    /// # Errors
    /// As [`SkyOptions::environment`], where place and time are not stated, or the direction of the sun is.
    #[doc(hidden)]
    pub fn at_minute(&self, minute: u32) -> Result<Option<SkyOptions>> {
        let wrong = |what: String| self.wrong(Error::arguments(what));
        if let SunChoice::At { .. } = self.sun {
            let what = "a sun in one direction has no day: leave ⟨sun⟩ out, so that it moves by ⟨place⟩ and ⟨time⟩, or leave ⟨day⟩ out";
            return Err(wrong(what.into()));
        }
        let (Some(_), Some(time)) = (&self.place, &self.time) else {
            let what = "the light of a day needs ⟨place⟩ and ⟨time⟩, such as 2026-06-21T12:00+02:00";
            return Err(wrong(what.into()));
        };
        let options = SkyOptions { time: Some(time.at_minute(minute).map_err(wrong)?), ..self.clone() };
        let position = options.position(&Frame::upright(DVec3::Z)?).map_err(wrong)?;
        Ok(position.filter(|sun| sun.local.z > 0.0).map(|_| options))
    }

    /// The same where only the directions of suns matter: one whose irradiance is unknown has 1.
    #[doc(hidden)]
    #[must_use]
    pub fn with_any_sun(&self) -> SkyOptions {
        let is_placed = self.sun != SunChoice::Auto || self.place.is_some() || self.time.is_some();
        let any = is_placed.then_some(Amount::Grey(1.0));
        SkyOptions { direct_normal: self.direct_normal.or(any), ..self.clone() }
    }

    fn wrong(&self, error: Error) -> Error {
        match &self.file {
            Some(file) => Error::format(file, None, error.to_string()),
            None => error,
        }
    }

    fn irradiance_text(&self, [r, g, b]: [f64; 3]) -> String {
        let value = if r == g && g == b { format!("{r:.4}") } else { format!("{r:.4} {g:.4} {b:.4}") };
        format!("{value} {}", if self.photometric { "lx" } else { "W/m²" })
    }

    fn sun_note(&self, frame: &Frame, position: Option<&Position>, sun: Option<&Sun>) -> String {
        let Some(position) = position else { return "no sun".into() };
        let [azimuth, elevation] = frame.angles(frame.world(position.local));
        let place = format!("sun at azimuth {azimuth:.4}, elevation {elevation:.4} degrees");
        match sun {
            None => format!("{place}, without its disc: its irradiance is 0 or not stated"),
            Some(sun) => format!("{place}, normal irradiance {}", self.irradiance_text(sun.irradiance)),
        }
    }

    fn read_map(&self, path: &Path, notes: &mut Vec<String>) -> Result<Arc<SkyMap>> {
        let map = SkyMap::read(path, self.map_north)?;
        if map.repaired > 0 {
            let what =
                "texels of the sky map that were negative or not finite are the mean of their neighbours";
            notes.push(format!("{}: {} {what}", shown(path), map.repaired));
        }
        Ok(Arc::new(map))
    }

    /// The position of the sun, if the description determines it.
    fn position(&self, frame: &Frame) -> Result<Option<Position>, String> {
        if let SunChoice::At { direction, .. } = self.sun {
            let direction = match direction {
                SunDirection::Angles([azimuth, elevation]) => frame.direction(azimuth, elevation),
                SunDirection::Vector(v) => DVec3::from(v)
                    .try_normalize()
                    .ok_or("⟨sun⟩ 0,0,0 is no direction: give a vector towards the sun")?,
            };
            return Ok(Some(Position { local: frame.local(direction), outside: SOLAR_CONSTANT }));
        }
        let (place, time) = match (&self.place, &self.time) {
            (Some(place), Some(time)) => (place, time),
            (None, None) => return Ok(None),
            (Some(_), None) => {
                return Err("⟨place⟩ without ⟨time⟩: state both, the sun's position follows from them".into());
            }
            (None, Some(_)) => {
                return Err("⟨time⟩ without ⟨place⟩: state both, the sun's position follows from them".into());
            }
        };
        let air = Air { pressure: self.pressure, temperature: self.temperature };
        let sun = sun_position(place, time, &air)?;
        let local = frame.local(frame.direction(sun.azimuth, sun.elevation));
        Ok(Some(Position { local, outside: SOLAR_CONSTANT / (sun.distance * sun.distance) }))
    }

    /// The position of the sun for a sky model that requires it; an error without it.
    fn needed<'a>(&self, position: Option<&'a Position>, name: &str) -> Result<&'a Position, String> {
        let position = position.ok_or_else(|| {
            format!("the {name} sky needs the sun: state ⟨place⟩ and ⟨time⟩, or ⟨sun⟩ as AZIMUTH,ELEVATION")
        })?;
        match position.local.z > 0.0 {
            true => Ok(position),
            false => Err(format!(
                "the sun is {}, and the {name} sky needs it above: change ⟨time⟩, ⟨place⟩ or ⟨sun⟩, or take another sky",
                position.below_horizon()
            )),
        }
    }

    fn model(&self, position: Option<&Position>) -> Result<Model, String> {
        let plain = |shape, note: String| Model { shape, diffuse: None, direct: None, note };
        let efficacy = |atmosphere: &Atmosphere| match self.photometric {
            true => atmosphere.efficacy(self.dew_point),
            false => [1.0; 2],
        };
        Ok(match self.sky.0 {
            SkyModel::None => plain(Shape::Uniform, "no sky".into()),
            SkyModel::Uniform => plain(Shape::Uniform, "uniform sky".into()),
            SkyModel::Map(ref path) => plain(Shape::Uniform, format!("sky of the map {}", shown(path))),
            SkyModel::Cie(kind) => {
                let name = format!("CIE type {kind}");
                let sun = match gradation::cie_needs_sun(kind) {
                    true => self.needed(position, &name)?.local,
                    false => DVec3::Z,
                };
                plain(gradation::cie_shape(kind, sun), format!("CIE general sky, type {kind}"))
            }
            SkyModel::Perez { direct, diffuse } => {
                let sun = self.needed(position, "Perez")?;
                let atmosphere = Atmosphere::new(direct, diffuse, sun.outside, sun.zenith_angle());
                let [of_diffuse, of_direct] = efficacy(&atmosphere);
                let note = format!(
                    "Perez sky, clearness {:.3}, brightness {:.3}",
                    atmosphere.clearness, atmosphere.brightness
                );
                Model {
                    shape: atmosphere.shape(sun.local),
                    diffuse: Some(diffuse * of_diffuse),
                    direct: Some(direct * of_direct),
                    note,
                }
            }
            SkyModel::Clear { turbidity } => {
                let sun = self.needed(position, "clear")?;
                let altitude = self.place.map_or(0.0, |p| p.altitude);
                let [direct, diffuse] =
                    position::clear_irradiances(turbidity, sun.zenith_angle(), altitude, sun.outside);
                let atmosphere = Atmosphere::new(direct, diffuse, sun.outside, sun.zenith_angle());
                let [of_diffuse, of_direct] = efficacy(&atmosphere);
                Model {
                    shape: gradation::cie_shape(gradation::CIE_CLEAR, sun.local),
                    diffuse: Some(diffuse * of_diffuse),
                    direct: Some(direct * of_direct),
                    note: format!("CIE standard clear sky, Linke turbidity {turbidity}"),
                }
            }
        })
    }

    fn level(&self, model: &Model) -> Level {
        let is_map = matches!(self.sky.0, SkyModel::Map(_));
        match (self.diffuse_horizontal, self.zenith, self.sky.1.or(model.diffuse)) {
            (Some(Amount::Grey(value)), ..) => Level::Horizontal(value),
            (Some(Amount::Rgb(values)), ..) => Level::HorizontalRgb(values),
            (_, Some(value), _) => Level::Zenith(value),
            (.., Some(value)) => Level::Horizontal(value),
            _ if is_map => Level::Times(1.0),
            _ => Level::Horizontal(1.0),
        }
    }

    /// The sun's disc, if it is requested and has light.
    fn disc(&self, frame: &Frame, position: Option<&Position>, model: &Model) -> Result<Option<Sun>, String> {
        if self.sun == SunChoice::None {
            return Ok(None);
        }
        let stated = match self.sun {
            SunChoice::At { irradiance, .. } => irradiance.map(|e| [e; 3]),
            _ => None,
        };
        let irradiance = stated.or(self.direct_normal.map(Amount::rgb)).or(model.direct.map(|e| [e; 3]));
        let Some(position) = position else {
            return match self.direct_normal {
                Some(_) => Err(
                    "⟨direct_normal⟩ without a sun: state ⟨place⟩ and ⟨time⟩, or ⟨sun⟩ as AZIMUTH,ELEVATION"
                        .into(),
                ),
                None => Ok(None),
            };
        };
        let is_asked = matches!(self.sun, SunChoice::At { .. });
        let is_below = |position: &Position| {
            let cure = "change ⟨time⟩, ⟨place⟩ or ⟨sun⟩, or state ⟨sun⟩ as none";
            format!("the sun is {}: {cure}", position.below_horizon())
        };
        let Some(irradiance) = irradiance else {
            if is_asked && position.local.z <= 0.0 {
                return Err(is_below(position));
            }
            // A given direction may apply to the sky model alone.
            let shapes_sky = matches!(self.sky.0, SkyModel::Cie(_));
            return match is_asked && !shapes_sky {
                true => Err("the irradiance of the sun is unknown: state ⟨direct_normal⟩, or ⟨sun⟩ as AZIMUTH,ELEVATION:E".into()),
                false => Ok(None),
            };
        };
        if irradiance.iter().all(|e| *e == 0.0) {
            return Ok(None);
        }
        if let Some(bad) = irradiance.iter().find(|e| **e > MAX_RADIANCE) {
            return Err(format!("the irradiance {bad:.3e} W/m² of the sun must be at most {MAX_RADIANCE:e}"));
        }
        if position.local.z <= 0.0 {
            return Err(is_below(position));
        }
        let direction = frame.world(position.local);
        Ok(Some(Sun { direction, diameter: self.sun_diameter.to_radians(), irradiance }))
    }
}
