//! Luminaires: plane emitters with an intensity distribution, placed in a scene.

use super::load_options::{PlacedLuminaire, Placements};
use super::names::{UniqueNames, counted};
use super::photometry::WHITE_LUMENS_PER_WATT;
use super::profile::{Distribution, Profile, axes};
use super::read_luminaire::{Luminaire, read};
use super::{LoadOptions, MAX_COORDINATE, Soup, SoupMaterial, Strength, power::unit_in_metres, size::ends};
use crate::error::{in_words, quote};
use crate::files::input;
use crate::{Error, Result};
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;

/// Largest size of a placement file: 10,000 luminaires of about 100 bytes each.
const MAX_BYTES: u64 = 1 << 20;
/// Fraction of the flux below which the back of a luminaire is left out: the rounding of tables.
const DARK_HALF: f64 = 1e-6;
/// Largest flux, lm: that of the largest intensity of photometric files, 1e15 cd, in one steradian.
const MAX_LUMENS: f64 = 1e15;
/// Smallest distance of the luminaire's two plates relative to the longer side: real flat panels are about as thick.
const MIN_THICKNESS: f64 = 1e-2;
/// The same relative to the extent of the scene: five times the height up to which faces count as coplanar, 8 × 2⁻²³ = 1e-6 of
/// coordinates that are half of the extent, so that neither plate hides the other.
const MIN_SEPARATION: f64 = 2.5e-6;

/// 100 times full sunlight, lx: far above any lighting.
const MAX_ILLUMINANCE: f64 = 1e7;
/// Illuminance of a clear night with a quarter moon, lx.
const NIGHT_ILLUMINANCE: f64 = 0.01;
/// Illuminances of lit rooms and halls, lx, with room for a few lamps in the first and for spots in the second.
const MIN_LUX: f64 = 1.0;
const MAX_LUX: f64 = 1e5;

/// A table `[[luminaire]]`.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: Option<String>,
    /// Photometric file, relative to the placement file.
    file: Spanned<PathBuf>,
    at: Spanned<[f64; 3]>,
    /// Direction of γ = 0.
    aim: Spanned<[f64; 3]>,
    /// Direction of C = 0; by default the x axis, or y if the luminaire points along x.
    c0: Option<[f64; 3]>,
    /// Luminous flux that replaces that of the file, lm.
    flux: Option<Spanned<f64>>,
    /// Fraction of the flux to which the luminaire is dimmed.
    dimming: Option<Spanned<f64>>,
    /// Maintenance factor: fraction of the flux that is left before the next service.
    maintenance: Option<Spanned<f64>>,
}

impl Entry {
    /// Checks the values; an error has the place in the text and what is wrong.
    fn check(self, luminaire: Arc<Luminaire>) -> Result<PlacedLuminaire, (usize, &'static str)> {
        let [at, aim] = [&self.at, &self.aim].map(|v| DVec3::from(*v.get_ref()));
        if !at.is_finite() || at.abs().max_element() > MAX_COORDINATE {
            return Err((self.at.span().start, "`at` must be three numbers within ±1e12"));
        }
        let along_x = aim.normalize_or_zero().x.abs() > 0.999;
        let c0 = self.c0.map_or(if along_x { DVec3::Y } else { DVec3::X }, DVec3::from);
        let parallel = "`aim` must be a direction that is not parallel to `c0`";
        let axes = axes(aim, c0).ok_or((self.aim.span().start, parallel))?;
        let flux: f64 = luminaire.distribution.halves().iter().sum();
        if flux <= 0.0 {
            return Err((self.file.span().start, "the table of this file sums to no light"));
        }
        let is_part = |part: &Spanned<f64>| (0.0..=1.0).contains(part.get_ref()) && *part.get_ref() > 0.0;
        for (part, what) in [
            (&self.dimming, "`dimming` must be above 0 and at most 1"),
            (&self.maintenance, "`maintenance` must be above 0 and at most 1"),
        ] {
            if let Some(part) = part.as_ref().filter(|part| !is_part(part)) {
                return Err((part.span().start, what));
            }
        }
        let factors = [self.dimming, self.maintenance].map(|part| part.map_or(1.0, Spanned::into_inner));
        let scale = match self.flux {
            Some(lm) if (0.0..=MAX_LUMENS).contains(lm.get_ref()) && *lm.get_ref() > 0.0 => {
                lm.get_ref() / flux
            }
            Some(lm) => return Err((lm.span().start, "`flux` must be above 0 and at most 1e15")),
            None => 1.0,
        };
        let stem = || self.file.get_ref().file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = self.name.unwrap_or_else(stem);
        Ok(PlacedLuminaire { name, luminaire, at, axes, scale, factors })
    }
}

impl LoadOptions {
    /// Adds luminaires with IES LM-63 or EULUMDAT files: a placement file in TOML with tables `[[luminaire]]` of `file`, `at` and `aim`,
    /// which is read now.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) or [`Error::File`](crate::Error::File): it, or a file that it names, cannot be read or is wrong.
    pub fn with_luminaires(mut self, placements: impl AsRef<Path>) -> Result<LoadOptions> {
        self.luminaires = read_placements(placements.as_ref())?;
        Ok(self)
    }
}

/// Reads a placement file, TOML with a table `[[luminaire]]` for each, and the photometric files that it names.
pub fn read_placements(path: &Path) -> Result<Placements> {
    placements(path, input::read(path, MAX_BYTES)?, read)
}

/// The luminaires of a placement file called `path` with the content `bytes`; photometric files are read by `read`.
fn placements(path: &Path, bytes: Vec<u8>, read: impl Fn(&Path) -> Result<Luminaire>) -> Result<Placements> {
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        luminaire: Vec<Entry>,
    }
    let text = String::from_utf8(bytes).map_err(|_| Error::format(path, None, "not a text in UTF-8"))?;
    let line = |at: usize| Some(1 + text[..at].matches('\n').count());
    let file: File = toml::from_str(&text).map_err(|e| {
        let what =
            "write [[luminaire]] with file, at and aim; name, c0, flux, dimming and maintenance may be added";
        let message = e.message().split(", expected one of").next().unwrap_or_default();
        Error::format(
            path,
            e.span().and_then(|s| line(s.start)),
            format!("{}; {what}", quote(&in_words(message))),
        )
    })?;
    let mut known: HashMap<PathBuf, Arc<Luminaire>> = HashMap::new();
    let mut files = vec![path.to_owned()];
    let place = |entry: Entry| {
        let name = path.with_file_name("").join(entry.file.get_ref());
        let luminaire = match known.get(&name) {
            Some(luminaire) => luminaire.clone(),
            None => {
                files.push(name.clone());
                known.entry(name.clone()).or_insert(Arc::new(read(&name)?)).clone()
            }
        };
        entry.check(luminaire).map_err(|(at, what)| Error::format(path, line(at), what))
    };
    let list = file.luminaire.into_iter().map(place).collect::<Result<_>>()?;
    Ok(Placements { list, files })
}

/// A floor lit by a photometric file of the `format` `ies` or `ldt` with the content `bytes`; with another format by luminaires in the
/// places that `bytes` states as a placement file, whose photometric files are all the same.
///
/// # Errors
/// The file is wrong.
pub fn lit_from_memory(format: &str, bytes: &[u8]) -> Result<super::Scene> {
    const PLACE: &str = "[[luminaire]]\nfile = \"a\"\nat = [0, 0, 2]\naim = [0, 0, -1]\n";
    const LAMP: &str = "TILT=NONE\n1 -1 1 2 1 1 2 0.1 0.1 0\n1 1 20\n0 180\n0\n100 50\n";
    const FLOOR: &[u8] = b"v -3 -3 0\nv 3 -3 0\nv 3 3 0\nv -3 3 0\nf 1 2 3 4\n";
    let path = Path::new("/nonexistent/lights.toml");
    let luminaires = match format {
        "ies" | "ldt" => placements(path, PLACE.into(), |name| {
            super::read_luminaire::parse(&name.with_extension(format), || Ok(bytes.to_vec()))
        })?,
        _ => placements(path, bytes.to_vec(), |name| {
            super::read_luminaire::parse(&name.with_extension("ies"), || Ok(LAMP.into()))
        })?,
    };
    let options = LoadOptions { luminaires, max_memory: Some(1 << 30), ..LoadOptions::default() };
    super::read_from_memory(None, "obj", FLOOR, &options)
}

/// Largest distance of luminaires from the origin, relative to the size of the scene, that is questioned: rooms in centimetres have it if
/// it is stated in metres.
const MAX_IN_METRES: f64 = 0.02;

/// Adds the luminaires of the options to the scene's polygons.
pub(super) fn add_placed(soup: &mut Soup, options: &LoadOptions) {
    let metres = unit_in_metres(&options.unit).unwrap_or(1.0);
    let mut names = UniqueNames::beside(soup.objects.iter());
    let mut noted = HashSet::new();
    let places = soup.positions.iter().copied().chain(options.luminaires.list.iter().map(|placed| placed.at));
    let (low, high) = ends(places);
    let extent = (high - low).length();
    for placed in &options.luminaires.list {
        let PlacedLuminaire { name, luminaire, at, axes, scale, factors } = placed.clone();
        // Once for each file.
        if let Some(note) = luminaire.note.as_ref().filter(|_| noted.insert(Arc::as_ptr(&luminaire))) {
            soup.repairs.messages.push(format!("luminaire `{}`: {note}", quote(&name)));
        }
        let name = names.of(&name);
        let size = luminaire.opening.map(|v| v / metres);
        let distribution = luminaire.distribution.clone();
        Lamp { name, at, axes, size, distribution, scale, factors, colour: [1.0; 3] }
            .add(soup, extent, options);
    }
    soup.repairs.messages.extend(in_metres(&options.luminaires.list, [low, high], &options.unit));
}

/// A question if luminaires in a scene in a smaller unit than metres are all close to its origin, and would be in the scene, from `low` to
/// `high`, or above it if their positions were in metres.
fn in_metres(placed: &[PlacedLuminaire], [low, high]: [DVec3; 2], unit: &str) -> Option<String> {
    let metres = unit_in_metres(unit).filter(|metres| *metres < 1.0)?;
    let extent = (high - low).length();
    let fits = |placed: &PlacedLuminaire| {
        let at = placed.at / metres;
        at.clamp(low, high).distance(at) < extent
    };
    let farthest = placed.iter().map(|placed| placed.at.length()).fold(0.0, f64::max);
    (farthest > 0.0 && farthest < MAX_IN_METRES * extent && placed.iter().all(fits)).then(|| {
        let count = counted(placed.len(), "luminaire");
        format!(
            "{count} within {farthest:.3} {unit} of the origin, in a scene of {extent:.0} {unit}: positions are in {unit} as well; are they \
             stated in metres?"
        )
    })
}

/// Asks for the unit if all emitters whose flux is stated, in lumens or watts, light a scene in metres as if it were a thousand times too
/// large, or one in millimetres as if they were metres.
pub(super) fn question_unit(soup: &mut Soup, options: &LoadOptions) {
    if !["m", "mm"].contains(&options.unit.as_str()) {
        return;
    }
    let stated = options.emitters.iter().filter_map(|(_, strength)| match strength {
        Strength::Lumens(flux) => Some(*flux),
        Strength::Watts(power) => Some(WHITE_LUMENS_PER_WATT * *power),
        // The flux grows with the area.
        Strength::Luminance(_) => None,
    });
    let fluxes: Vec<f64> = soup.fluxes.iter().copied().chain(stated).filter(|flux| *flux > 0.0).collect();
    let (low, high) = ends(soup.positions.iter().copied());
    let (extents, flux) = (high - low, fluxes.iter().sum());
    let question = if options.unit == "m" { too_large } else { too_small };
    soup.repairs.messages.extend(question(extents, flux, fluxes.len()));
}

/// Width and length of a scene, and its height, the smallest of its extents.
fn sides(extents: DVec3) -> [f64; 3] {
    let mut sides = extents.to_array();
    sides.sort_by(f64::total_cmp);
    let [height, width, length] = sides;
    [width, length, height]
}

/// A question if emitters light a scene as nothing does, and would light a room well if the lengths were metres. `extents`: those of the
/// scene, mm; `flux`: that of its emitters, lm.
fn too_small(extents: DVec3, flux: f64, emitters: usize) -> Option<String> {
    let [width, length, _] = sides(extents);
    let (in_metres, lux) = (flux / (width * length), 1e6 * flux / (width * length));
    ((MIN_LUX..MAX_LUX).contains(&in_metres) && lux > MAX_ILLUMINANCE).then(|| {
        let some = counted(emitters, "emitter");
        format!(
            "{some} of {flux:.0} lm in total in a scene of {length:.1} mm x {width:.1} mm, {lux:.1e} lx: is the file in metres? leave \
             ⟨LoadOptions::unit⟩ out"
        )
    })
}

/// A question if emitters light less than a clear night does, and would light a room well if the lengths were millimetres. `extents`:
/// those of the scene, m; `flux`: that of its emitters, lm.
fn too_large(extents: DVec3, flux: f64, emitters: usize) -> Option<String> {
    let [width, length, height] = sides(extents);
    let lux = flux / (width * length);
    // Terrains are flatter than 1 km.
    let is_a_room = height > 1000.0 && (MIN_LUX..MAX_LUX).contains(&(1e6 * lux));
    (is_a_room && lux < NIGHT_ILLUMINANCE).then(|| {
        let some = counted(emitters, "emitter");
        format!(
            "{some} of {flux:.0} lm in total in a scene of {length:.0} m x {width:.0} m, {lux:.1e} lx: is the file in millimetres? set ⟨LoadOptions::unit⟩ to mm; positions of luminaires are then in millimetres too"
        )
    })
}

/// A small plane emitter with an intensity distribution.
pub(super) struct Lamp {
    pub name: String,
    /// Centre of the front plate.
    pub at: DVec3,
    /// Unit vectors towards γ = 0, C = 0 and C = 90°.
    pub axes: [DVec3; 3],
    /// Length along C = 0, width along C = 90° and height, scene units.
    pub size: [f64; 3],
    pub distribution: Distribution,
    /// Factor of all intensities, besides dimming and maintenance factor.
    pub scale: f64,
    pub factors: [f64; 2],
    /// Factors of the channels.
    pub colour: [f64; 3],
}

impl Lamp {
    /// Distance of its plates in a scene of this extent, scene units.
    pub fn thickness(&self, extent: f64) -> f64 {
        let [length, width, height] = self.size;
        height.max(MIN_THICKNESS * length.max(width)).max(MIN_SEPARATION * extent)
    }

    /// Adds its plates: the front emits the directions up to 90° from the axis, the back, one height behind it, the others. `extent`: that
    /// of the scene, scene units.
    pub fn add(self, soup: &mut Soup, extent: f64, options: &LoadOptions) {
        let metres = unit_in_metres(&options.unit).unwrap_or(1.0);
        let [length, width, _] = self.size;
        let behind = self.thickness(extent);
        let halves = self.distribution.halves();
        let total: f64 = halves.iter().sum();
        let distribution = Arc::new(self.distribution);
        let [axis, c0, c90] = self.axes;
        let object = soup.object(&self.name);
        let area = length * width * metres * metres;
        soup.fluxes.push(total * self.scale * self.factors[0] * self.factors[1]);
        for (half, flux) in halves.into_iter().enumerate().filter(|(_, f)| *f > DARK_HALF * total) {
            let [dimming, maintenance] = self.factors;
            let watts = flux * self.scale * dimming * maintenance / options.photometry().lumens_per_watt;
            let radiance = watts / (std::f64::consts::PI * area);
            let name = if half == 0 { self.name.clone() } else { format!("{} (back)", self.name) };
            let material = soup.material(SoupMaterial {
                profile: Some(Arc::new(Profile::new(distribution.clone(), self.axes, flux, self.factors))),
                ..SoupMaterial::light(name, self.colour.map(|c| (c * radiance) as f32))
            });
            let (centre, u, v) = match half {
                0 => (self.at, 0.5 * length * c0, 0.5 * width * c90),
                _ => (self.at - behind * axis, 0.5 * width * c90, 0.5 * length * c0),
            };
            // c90 = c0 × axis: corners turn counterclockwise about c90 × c0 = axis · |c0|².
            let corners = [centre - u - v, centre - u + v, centre + u + v, centre + u - v];
            soup.polygon(object, material, &corners);
            soup.fill_texcoords();
        }
    }
}
