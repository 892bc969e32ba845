//! Luminaires: plane emitters with an intensity distribution, placed in a scene.

use super::profile::{Distribution, Profile, axes};
use super::read_luminaire::read;
use super::{LoadOptions, Soup, SoupMaterial, power::unit_in_metres};
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Largest size of a placement file: 10,000 luminaires of about 100 bytes each.
const MAX_BYTES: u64 = 1 << 20;
/// Part of the flux below which the back of a luminaire is left out: the rounding of tables.
const DARK_HALF: f64 = 1e-6;
/// Distance of the luminaire's two plates relative to the longer side: the least that keeps the plates apart in f32
/// at a thousand sides from the origin of the scene, 2⁻²⁴ · 1000, with a margin of 160.
const MIN_THICKNESS: f64 = 1e-2;

/// A luminaire of a placement file.
#[derive(Clone, Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlacedLuminaire {
    /// Name of its object and material.
    name: Option<String>,
    /// Photometric file, relative to the placement file.
    file: std::path::PathBuf,
    /// Position, scene units in the coordinates of the scene's file.
    at: [f64; 3],
    /// Direction of γ = 0.
    aim: [f64; 3],
    /// Direction of C = 0; by default the x axis, or y if the luminaire points along x.
    c0: Option<[f64; 3]>,
    /// Luminous flux that replaces that of the file, lm.
    flux: Option<f64>,
}

/// Reads a placement file: TOML with a table `[[luminaire]]` for each.
pub fn read_placements(path: &Path) -> Result<Vec<PlacedLuminaire>> {
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        luminaire: Vec<PlacedLuminaire>,
    }
    let about = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if !about.is_file() || about.len() > MAX_BYTES {
        return Err(Error::format(
            path,
            None,
            format!("must be a regular file of at most {MAX_BYTES} bytes"),
        ));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    let file: File = toml::from_str(&text).map_err(|e| {
        let line = e.span().map(|s| 1 + text[..s.start].matches('\n').count());
        let what = "write [[luminaire]] with file, at and aim";
        Error::format(path, line, format!("{}; {what}", super::mtl::shorten(e.message(), 80)))
    })?;
    let mut placed = file.luminaire;
    let folder = path.with_file_name("");
    placed.iter_mut().for_each(|l| l.file = folder.join(&l.file));
    Ok(placed)
}

/// Adds the luminaires of the options to the scene's polygons.
pub(super) fn add_placed(soup: &mut Soup, options: &LoadOptions) -> Result<()> {
    let metres = unit_in_metres(&options.unit).unwrap_or(1.0);
    for (k, placed) in options.luminaires.iter().enumerate() {
        let luminaire = read(&placed.file)?;
        let wrong = |what: &str| Error::format(&placed.file, None, format!("luminaire {}: {what}", k + 1));
        let numbers = placed.at.iter().chain(&placed.aim).chain(placed.c0.iter().flatten());
        if numbers.chain(&placed.flux).any(|v| !v.is_finite()) || placed.flux.is_some_and(|f| f <= 0.0) {
            return Err(wrong("a position or flux is not a finite number, or the flux not above 0"));
        }
        let stem = placed.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = unique(soup, placed.name.clone().unwrap_or(stem));
        let file_flux: f64 = luminaire.distribution.halves().iter().sum();
        if file_flux <= 0.0 {
            return Err(wrong("its table sums to no light"));
        }
        soup.repairs.messages.extend(luminaire.note.map(|note| format!("luminaire `{name}`: {note}")));
        let aim = DVec3::from(placed.aim);
        let along_x = aim.normalize_or_zero().x.abs() > 0.999;
        let c0 = placed.c0.map_or(if along_x { DVec3::Y } else { DVec3::X }, DVec3::from);
        Lamp {
            name,
            at: DVec3::from(placed.at),
            axes: axes(aim, c0)?,
            size: luminaire.opening.map(|v| v / metres),
            distribution: luminaire.distribution,
            scale: placed.flux.map_or(1.0, |f| f / file_flux),
            colour: [1.0; 3],
        }
        .add(soup, options);
    }
    Ok(())
}

/// A name that no object of the soup has.
fn unique(soup: &Soup, name: String) -> String {
    let taken = |n: &String| soup.objects.contains(n);
    let numbered = (2..).map(|k| format!("{name} {k}"));
    std::iter::once(name.clone()).chain(numbered).find(|n| !taken(n)).unwrap_or(name)
}

/// A small plane emitter with an intensity distribution.
pub(super) struct Lamp {
    pub name: String,
    /// Centre of the front plate.
    pub at: DVec3,
    /// Unit vectors towards γ = 0, C = 0 and C = 90°.
    pub axes: [DVec3; 3],
    /// Length along C = 0, width along C = 90° and height, scene units; 0 for a plate of a thousandth of a metre.
    pub size: [f64; 3],
    pub distribution: Distribution,
    /// Factor of all intensities.
    pub scale: f64,
    /// Factors of the channels.
    pub colour: [f64; 3],
}

impl Lamp {
    /// Adds its plates: the front emits the directions up to 90° from the axis, the back, one height behind it, the others.
    pub fn add(self, soup: &mut Soup, options: &LoadOptions) {
        let metres = unit_in_metres(&options.unit).unwrap_or(1.0);
        let [length, width] = [0, 1].map(|k| if self.size[k] > 0.0 { self.size[k] } else { 1e-3 / metres });
        let behind = self.size[2].max(MIN_THICKNESS * length.max(width));
        let halves = self.distribution.halves();
        let total: f64 = halves.iter().sum();
        let distribution = Arc::new(self.distribution);
        let [axis, c0, c90] = self.axes;
        let object = soup.object(&self.name);
        let area = length * width * metres * metres;
        for (half, flux) in halves.into_iter().enumerate().filter(|(_, f)| *f > DARK_HALF * total) {
            let watts = flux * self.scale / options.photometry.lumens_per_watt;
            let radiance = watts / (std::f64::consts::PI * area);
            let name = if half == 0 { self.name.clone() } else { format!("{} (back)", self.name) };
            let material = soup.material(SoupMaterial {
                profile: Some(Arc::new(Profile::new(distribution.clone(), self.axes, flux))),
                ..SoupMaterial::light(name, self.colour.map(|c| (c * radiance) as f32))
            });
            let (centre, u, v) = match half {
                0 => (self.at, 0.5 * length * c0, 0.5 * width * c90),
                _ => (self.at - behind * axis, 0.5 * width * c90, 0.5 * length * c0),
            };
            // c90 = c0 × axis: corners turn counterclockwise about c90 × c0 = axis · |c0|².
            let corners = [centre - u - v, centre - u + v, centre + u + v, centre + u - v];
            soup.polygon(object, material, &corners);
            if !soup.corner_texcoords.is_empty() || !soup.texcoords.is_empty() {
                soup.corner_texcoords.extend([0; 4]);
            }
        }
    }
}
