//! Grids from files: ESRI ASCII grid, GeoTIFF, PNG with 8 or 16 bits, NumPy arrays.

mod ascii;
#[cfg(feature = "geotiff")]
mod geotiff;
mod picture;

use super::grid::{Georeference, MAX_HEIGHT, MODEL_TYPE, check_cell, check_sides};
use super::{Grid, numpy};
use crate::{Error, Result, files::input, memory};
use std::path::Path;

/// Properties of a grid that its file does not state or states wrongly.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Distances of neighbouring columns and rows, m, instead of those in the file; PNG and NumPy arrays have none.
    pub cell: Option<[f64; 2]>,
    /// Metres of one unit of height, instead of the unit that the file states; for PNG metres of one step of grey.
    pub height_scale: Option<f64>,
    /// Height of the value 0, m.
    pub height_offset: f64,
    /// Value of samples without data, besides the one that the file states.
    pub no_data: Option<f64>,
}

/// A grid with notes on assumptions and omissions, each in a sentence.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The grid.
    pub grid: Grid,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Values of a file before they are heights in m.
#[derive(Default)]
struct Raw {
    columns: usize,
    rows: usize,
    /// Row by row from the north; not finite without data.
    values: Vec<f32>,
    /// Distances of columns and rows, m.
    cell: Option<[f64; 2]>,
    georeference: Option<Georeference>,
    /// Metres of a unit of height, if the file states its unit.
    unit: Option<f64>,
    notes: Vec<String>,
}

/// Reads a grid; the extension determines the format: `asc`, `tif`, `tiff`, `png`, `npy` or `npz`.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::File`] with the file, where it has lines the line, and the cure, if its
/// content is no grid; [`Error::Argument`] for options out of range; [`Error::OutOfMemory`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Loaded> {
    check(options)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let bytes = || input::read(path, memory::usable().unwrap_or(u64::MAX >> 1));
    let raw = input::guarded(path, || match extension.as_str() {
        "asc" => ascii::read(path, &bytes()?),
        #[cfg(feature = "geotiff")]
        "tif" | "tiff" => geotiff::read(path, bytes()?, options),
        #[cfg(not(feature = "geotiff"))]
        "tif" | "tiff" => {
            Err(Error::format(path, None, "GeoTIFF is read if the crate mrvis has its feature `geotiff`"))
        }
        "png" => picture::read(path, bytes()?, options),
        "npy" => from_numpy(path, numpy::read_npy(path, &bytes()?)?),
        "npz" => from_numpy(path, numpy::read_npz(path, &bytes()?)?),
        _ => Err(Error::format(
            path,
            None,
            "a terrain is read from .asc (ESRI ASCII grid), .tif (GeoTIFF), .png, .npy or .npz",
        )),
    })?;
    finish(path, raw, options)
}

fn check(options: &ReadOptions) -> Result<()> {
    if let Some(cell) = options.cell {
        check_cell(cell).map_err(|e| Error::argument("cell", "", e))?;
    }
    if let Some(scale) = options.height_scale.filter(|s| !s.is_finite() || *s == 0.0) {
        return Err(Error::argument("height_scale", scale, "must be finite and not 0"));
    }
    match options.height_offset.abs() <= f64::from(MAX_HEIGHT) {
        true => Ok(()),
        false => {
            let offset = options.height_offset;
            let problem = format!("at most {MAX_HEIGHT:e} m up or down");
            Err(Error::argument("height_offset", format!("{offset} m"), problem))
        }
    }
}

/// Refuses sides that a file cannot hold, before anything is allocated. `possible`: number of values that its bytes can hold.
fn check_size(path: &Path, columns: usize, rows: usize, possible: usize) -> Result<()> {
    check_sides(columns, rows).map_err(|e| Error::format(path, None, e))?;
    // At most MAX_SIDE², which fits.
    let samples = columns * rows;
    if samples > possible {
        let what = format!(
            "{columns} columns and {rows} rows are {samples} values, more than the file can hold: it is cut off, or its header is damaged"
        );
        return Err(Error::format(path, None, what));
    }
    memory::check_room(8 * samples as u64, || format!("{samples} heights"))
}

fn from_numpy(path: &Path, array: numpy::Array) -> Result<Raw> {
    let [rows, columns] = array.shape[..] else {
        let what = format!("an array of {} dimensions; heights need 2: rows and columns", array.shape.len());
        return Err(Error::format(path, None, what));
    };
    let notes = vec!["the first row of the array is taken as the north".into()];
    Ok(Raw { columns, rows, values: array.values, notes, ..Raw::default() })
}

/// Largest value that may stand for a sample without data, such as -999, -9999, -32768 and -99999.
const MAX_NO_DATA: f32 = -999.0;

/// Values of samples that are no holes.
fn known(values: &[f32]) -> impl Iterator<Item = f32> + '_ {
    values.iter().copied().filter(|v| v.is_finite())
}

/// The smallest and the largest of these values; infinite without any.
fn range(values: &[f32]) -> [f32; 2] {
    known(values).fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// A note on the lowest value if it seems to stand for samples without data: it is farther below the others than these are apart.
fn note_of_lowest(values: &[f32]) -> Option<String> {
    let [low, high] = range(values);
    let next = known(values).filter(|v| *v > low).fold(f32::INFINITY, f32::min);
    (low <= MAX_NO_DATA && next.is_finite() && next - low > high - next).then(|| {
        let count = known(values).filter(|v| *v == low).count();
        format!(
            "{count} samples have the value {low}, far below all others: if they have no data, state that in the file (`gdal_translate -a_nodata {low}`)"
        )
    })
}

/// Lowest and highest heights on land and sea floors of the Earth, m, rounded away from 0.
const HEIGHTS_ON_EARTH: [f32; 2] = [-11_000.0, 9_000.0];

/// A note on heights, m, that are not found on the Earth.
fn note_of_range(values: &[f32]) -> Option<String> {
    let ([low, high], [lowest, highest]) = (range(values), HEIGHTS_ON_EARTH);
    (low < lowest || high > highest).then(|| {
        format!(
            "heights from {low} to {high} m: no ground of the Earth is there; the right unit is set by ⟨height_scale⟩, such as 0.001 for millimetres"
        )
    })
}

/// Whether a grid without a coordinate system is at a place on a globe in degrees, and higher than it is wide: the range of heights on
/// land exceeds 1 m within a degree nearly everywhere.
fn is_in_degrees(raw: &Raw) -> bool {
    let Some(georeference) = raw.georeference.as_ref().filter(|g| g.key(MODEL_TYPE).is_none()) else {
        return false;
    };
    let ([west, south], [east, north]) =
        (georeference.position(0, raw.rows - 1), georeference.position(raw.columns - 1, 0));
    let is_on_globe = west >= -180.0 && east <= 360.0 && south >= -90.0 && north <= 90.0;
    // Grids without a place begin at 0, 0 with the corner or the middle of a sample.
    let is_local = west.abs() <= georeference.scale[0] && south.abs() <= georeference.scale[1];
    let [low, high] = range(&raw.values);
    is_on_globe && !is_local && f64::from(high - low) > (east - west).max(north - south)
}

/// Makes heights in m of values.
fn finish(path: &Path, raw: Raw, options: &ReadOptions) -> Result<Loaded> {
    if options.cell.is_none() && is_in_degrees(&raw) {
        let what = "its cells seem to be in degrees and its heights in metres: project it to metres (`gdalwarp -t_srs EPSG:326ZZ`, ZZ the UTM zone), or set ⟨cell⟩ to the distances of columns and rows in m";
        return Err(Error::format(path, None, what));
    }
    let Raw { columns, rows, mut values, cell, georeference, unit, mut notes } = raw;
    check_sides(columns, rows).map_err(|e| Error::format(path, None, e))?;
    let Some(cell) = options.cell.or(cell) else {
        let what = "does not say how far its samples are apart: set ⟨cell⟩ to the distances of columns and rows in m";
        return Err(Error::format(path, None, what));
    };
    notes.extend(note_of_lowest(&values));
    let scale = options.height_scale.or(unit).unwrap_or(1.0);
    let (no_data, offset) = (options.no_data.map(|v| v as f32), options.height_offset);
    if scale != 1.0 || offset != 0.0 || no_data.is_some() {
        for value in &mut values {
            *value = match Some(*value) == no_data {
                true => f32::NAN,
                false => (f64::from(*value) * scale + offset) as f32,
            };
        }
    }
    notes.extend(note_of_range(&values));
    let grid = Grid::new(columns, rows, cell, values).map_err(|e| match e {
        Error::Argument { problem, .. } => Error::format(path, None, problem),
        other => other,
    })?;
    match grid.holes() {
        0 => {}
        n => notes.push(format!(
            "{n} of {} samples have no height: they block nothing and get no value",
            columns * rows
        )),
    }
    let grid = match georeference {
        Some(georeference) => grid.with_georeference(georeference),
        None => grid,
    };
    let grid = if options.cell.is_some() { grid.with_given_cell() } else { grid };
    Ok(Loaded { grid, notes })
}
