//! Emitters by name, with their power.

use super::Strength;
use super::{LoadOptions, Material, names::unknown};
use crate::error::{figure, quote};
use crate::math::MAX_RADIANCE;
use crate::{Error, Result};
use std::collections::HashMap;

/// Length of one unit in metres; `None` for unknown names (they count as metres).
pub fn unit_in_metres(unit: &str) -> Option<f64> {
    Some(match unit {
        "m" | "metre" | "meter" => 1.0,
        "km" => 1e3,
        "dm" => 0.1,
        "cm" => 0.01,
        "mm" => 0.001,
        "in" | "inch" => 0.0254,
        "ft" | "foot" => 0.3048,
        _ => return None,
    })
}

/// Makes a strength of a number in some unit.
type OfUnit = fn(f64) -> Strength;

/// Parses `NAME=60`, `NAME=60W`, `NAME=800lm` or `NAME=5000cd/m2`; the name may contain `=`.
pub fn parse_emitter(text: &str) -> Result<(String, Strength)> {
    let wrong = || {
        let units = "lamp=60W, lamp=800lm, lamp=5000cd/m2";
        let form = format!(
            "write NAME=W, with W >= 0 in watts (lamp=60; lamp=0 switches it off), or with a unit: {units}"
        );
        Error::argument("emitters", quote(text), form)
    };
    let (name, strength) = text.rsplit_once('=').ok_or_else(wrong)?;
    let strength = strength.trim();
    let units: [(&str, OfUnit); 5] = [
        ("cd/m2", Strength::Luminance),
        ("cd/m\u{b2}", Strength::Luminance),
        ("lm", Strength::Lumens),
        ("W", Strength::Watts),
        ("", Strength::Watts),
    ];
    let (number, unit) =
        units.iter().find_map(|(unit, of)| Some((strength.strip_suffix(unit)?, of))).ok_or_else(wrong)?;
    let value: f64 = number.trim().parse().map_err(|_| wrong())?;
    if name.is_empty() || !value.is_finite() || value < 0.0 {
        Err(wrong())
    } else {
        Ok((name.to_owned(), unit(value)))
    }
}

/// Faces and materials that emission by name changes.
pub(super) struct Surfaces<'a> {
    pub objects: &'a [String],
    pub materials: &'a mut Vec<Material>,
    pub triangle_object: &'a [u32],
    pub triangle_material: &'a mut [u32],
    /// Area of each triangle in scene units squared.
    pub triangle_area: &'a [f64],
}

/// Makes the named faces emit: a power W is distributed over the area A of its faces, with exitance M = W/A in each
/// of the three channels and radiance L = M/π.
///
/// The faces get copies of their materials, so that other faces of the same material emit as before. A power of 0 switches faces off.
pub(super) fn apply(s: Surfaces, options: &LoadOptions) -> Result<()> {
    let metres = unit_in_metres(&options.unit).unwrap_or(1.0);
    let sides = if options.two_sided_emission { 2.0 } else { 1.0 };
    for (name, strength) in &options.emitters {
        let (value, unit) = strength.parts();
        let wrong = |problem: String| {
            Error::argument("emitters", format!("{}={} {unit}", quote(name), figure(value)), problem)
        };
        // The limits of `parse_emitter`; options may be set without it.
        if !value.is_finite() || value < 0.0 {
            return Err(wrong("must be a number of at least 0".into()));
        }
        let faces: Vec<usize> = (0..s.triangle_object.len())
            .filter(|&t| {
                s.objects[s.triangle_object[t] as usize] == *name
                    || s.materials[s.triangle_material[t] as usize].name == *name
            })
            .collect();
        if faces.is_empty() {
            let materials = s.materials.iter().map(|m| m.name.as_str());
            return Err(unknown(name, s.objects.iter().map(String::as_str).chain(materials)).of("emitters"));
        }
        let area: f64 = faces.iter().map(|&t| s.triangle_area[t]).sum::<f64>() * metres * metres;
        let radiance = strength.radiance(area * sides, options.photometry().lumens_per_watt) as f32;
        if f64::from(radiance) > MAX_RADIANCE {
            return Err(wrong(format!(
                "on {} m² this is a radiance of {radiance:.3e} W/(m² sr), which must be at most {MAX_RADIANCE:e}",
                figure(area)
            )));
        }
        let mut lit = HashMap::new();
        for t in faces {
            let dark = s.triangle_material[t];
            s.triangle_material[t] = *lit.entry(dark).or_insert_with(|| {
                let material = s.materials[dark as usize].clone();
                s.materials.push(Material { emission: [radiance; 3], profile: None, ..material });
                s.materials.len() as u32 - 1
            });
        }
    }
    Ok(())
}
