//! Position of the sun by place and time: NREL's solar position algorithm (I. Reda and A. Andreas, NREL/TP-560-34302) of the crate
//! `solar-positioning`.

use crate::error::{figure, quote};
use solar_positioning::time::JulianDate;
use solar_positioning::{Location, RefractionCorrection, SolarPositions, delta_t};
use std::str::FromStr;
use toml::value::{Datetime, Offset, Time};

/// A place on the earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Degrees, north positive, within ±90.
    pub latitude: f64,
    /// Degrees, east positive, within ±180.
    pub longitude: f64,
    /// Metres above the sea.
    pub altitude: f64,
}

/// Lowest and highest altitude, m: below the Dead Sea, above the highest mountain, within the standard atmosphere's lowest layer.
const ALTITUDES: [f64; 2] = [-500.0, 11_000.0];

impl Place {
    /// A place from latitude, longitude and, as an option, the altitude.
    pub(super) fn new(values: &[f64]) -> Result<Place, String> {
        let (latitude, longitude, altitude) =
            match *values {
                [latitude, longitude] => (latitude, longitude, 0.0),
                [latitude, longitude, altitude] => (latitude, longitude, altitude),
                _ => return Err(
                    "a place is LATITUDE,LONGITUDE in degrees, or LATITUDE,LONGITUDE,ALTITUDE with metres"
                        .into(),
                ),
            };
        for (value, name, [low, high], unit) in [
            (latitude, "latitude", [-90.0, 90.0], "degrees north"),
            (longitude, "longitude", [-180.0, 180.0], "degrees east"),
            (altitude, "altitude", ALTITUDES, "metres"),
        ] {
            if !(low..=high).contains(&value) {
                let value = figure(value);
                return Err(format!(
                    "the {name} {value} is not between {low} and {high} {unit}; the latitude is first"
                ));
            }
        }
        Ok(Place { latitude, longitude, altitude })
    }
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Place, String> {
        Place::new(&super::parse::numbers(text)?)
    }
}

/// A moment: date, time and offset from UTC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    written: Datetime,
    /// Julian date, universal time.
    julian: f64,
    /// Terrestrial minus universal time, s.
    delta_t: f64,
}

impl std::fmt::Display for Moment {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.written.fmt(f)
    }
}

impl FromStr for Moment {
    type Err = String;

    fn from_str(text: &str) -> Result<Moment, String> {
        let written = Datetime::from_str(text.trim()).map_err(|e| {
            let why = quote(&e.to_string().replace('\n', " "));
            format!(
                "`{}` is no time ({why}): write it as 2026-06-21T12:00+02:00 or 2026-06-21T10:00Z",
                quote(text)
            )
        })?;
        Moment::new(written)
    }
}

impl Moment {
    /// A moment from a date and time with an offset.
    pub(super) fn new(written: Datetime) -> Result<Moment, String> {
        let what = |lacks| {
            format!("`{written}` has no {lacks}: write it as 2026-06-21T12:00+02:00 or 2026-06-21T10:00Z")
        };
        let date = written.date.ok_or_else(|| what("date"))?;
        let time = written.time.ok_or_else(|| what("time"))?;
        let minutes = match written.offset.ok_or_else(|| what("offset from UTC"))? {
            Offset::Z => 0,
            Offset::Custom { minutes } => minutes,
        };
        let outside = || {
            format!(
                "the year of `{written}` is outside of those for which the earth's rotation is known, 1 to 3000"
            )
        };
        if date.year == 0 {
            return Err(outside());
        }
        let (year, month) = (i32::from(date.year), u32::from(date.month));
        let delta_t = delta_t::estimate_from_date(year, month).map_err(|_| outside())?;
        // A leap second counts as the second before it: the sun moves by 0.004 degrees in a second.
        let second =
            f64::from(time.second.unwrap_or(0).min(59)) + f64::from(time.nanosecond.unwrap_or(0)) * 1e-9;
        let (hour, minute) = (u32::from(time.hour), u32::from(time.minute));
        let local = JulianDate::from_utc(year, month, u32::from(date.day), hour, minute, second, delta_t);
        let local = local.map_err(|e| format!("`{written}` is no time ({e}): correct it"))?;
        Ok(Moment { written, julian: local.julian_date() - f64::from(minutes) / 1440.0, delta_t })
    }
}

impl Moment {
    /// Another minute of the same day.
    pub(super) fn at_minute(&self, minute: u32) -> Result<Moment, String> {
        let [hour, minute] = [minute / 60 % 24, minute % 60].map(|n| n as u8);
        let time = Time { hour, minute, second: None, nanosecond: None };
        Moment::new(Datetime { time: Some(time), ..self.written })
    }
}

/// The air that refracts the sun's light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Pressure, hPa; none for the standard atmosphere at the place's altitude.
    pub pressure: Option<f64>,
    /// Temperature, °C.
    pub temperature: f64,
}

/// Position of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Clockwise from north, degrees.
    pub azimuth: f64,
    /// Above the horizon with refraction, degrees.
    pub elevation: f64,
    /// Distance from the earth, astronomical units.
    pub distance: f64,
}

/// The sun's position, with an error of 3e-4 degrees besides that of refraction.
pub(super) fn sun_position(place: &Place, moment: &Moment, air: &Air) -> Result<SunPosition, String> {
    let refraction =
        RefractionCorrection::new(air.pressure.unwrap_or_else(|| pressure(place.altitude)), air.temperature);
    let refraction = refraction
        .map_err(|e| format!("⟨pressure⟩ or ⟨temperature⟩ of the air cannot be ({e}): correct it"))?;
    let location = Location { latitude: place.latitude, longitude: place.longitude };
    let position = || {
        let prepared =
            SolarPositions::new().for_time_from_julian(JulianDate::new(moment.julian, moment.delta_t)?)?;
        let at = prepared.at(location, place.altitude, Some(refraction))?;
        Ok((at, prepared.earth_radius_vector().unwrap_or(1.0)))
    };
    let (at, distance) = position().map_err(|e: solar_positioning::Error| {
        format!("the sun's position at {moment} is unknown ({e}): correct place or time")
    })?;
    Ok(SunPosition { azimuth: at.azimuth(), elevation: at.elevation_angle(), distance })
}

// Irradiances of a cloudless sky by turbidity (P. Ineichen and R. Perez, *A new airmass independent formulation for the Linke turbidity
// coefficient*, Solar Energy 73, 2002). The radiance then has the distribution of the CIE standard clear sky.

/// Normal irradiance of the sun and diffuse horizontal irradiance of the sky, W/m², for a Linke turbidity (2 for very clean cold air, 3
/// clean warm air, 4 to 6 moist or polluted air), the angle of the sun to the zenith in radians below π/2, the altitude in m and the
/// normal irradiance outside the atmosphere in W/m².
pub(super) fn clear_irradiances(turbidity: f64, zenith_angle: f64, altitude: f64, outside: f64) -> [f64; 2] {
    let cosine = zenith_angle.cos();
    let mass = air_mass(zenith_angle) * pressure(altitude) / pressure(0.0);
    let (f1, f2) = ((-altitude / 8000.0).exp(), (-altitude / 1250.0).exp());
    let (g1, g2) = (5.09e-5 * altitude + 0.868, 3.92e-5 * altitude + 0.0387);
    let global = g1 * outside * cosine * (-g2 * mass * (f1 + f2 * (turbidity - 1.0))).exp();
    let beam = outside * (0.664 + 0.163 / f1) * (-0.09 * mass * (turbidity - 1.0)).exp();
    // Upper limit of the beam from the smallest fraction that is diffuse.
    let part = 1.0 - (0.1 - 0.2 * (-turbidity).exp()) / (0.1 + 0.882 / f1);
    let direct = beam.min(global * part.max(0.0) / cosine);
    [direct, (global - direct * cosine).max(0.0)]
}

/// Relative optical air mass (F. Kasten and A. Young 1989).
fn air_mass(zenith_angle: f64) -> f64 {
    let degrees = zenith_angle.to_degrees();
    1.0 / (zenith_angle.cos() + 0.50572 * (96.07995 - degrees).powf(-1.6364))
}

/// Pressure of the standard atmosphere at an altitude in m, hPa (as in pvlib's `alt2pres`).
pub(super) fn pressure(altitude: f64) -> f64 {
    ((44331.514 - altitude) / 11880.516).powf(1.0 / 0.190_263_2)
}
