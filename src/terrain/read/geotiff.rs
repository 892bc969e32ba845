//! Heights from GeoTIFF files.

use super::{Raw, ReadOptions, check_size};
use crate::terrain::grid::{GEOGRAPHIC, Georeference, LENGTHS, MODEL_TYPE};
use crate::{Error, Result, error::quote};
use std::io::Cursor;
use std::path::Path;
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Keys: units of geographic angles and of heights.
const ANGLES: u16 = 2054;
const HEIGHTS: u16 = 4099;
/// Values of one byte of a file at most. LZW's longest string of 4,094 values takes 9 bits or more; Deflate's rate is below.
const MAX_VALUES_OF_BYTE: usize = 4094;
/// Largest tag, bytes: offsets and lengths of a strip for each row or of as many tiles, 8 bytes each.
const MAX_TAG: usize = 8 * crate::terrain::grid::MAX_SIDE;
/// Largest strip or tile, bytes: a file of one strip with as many values as fit 2 GiB.
const MAX_STRIP: usize = 1 << 31;
/// Largest deviation of the length of a degree of longitude at the north and south ends from that in the middle. 2 % of a slope
/// of 30° change its sky view factor by .2 %.
const MAX_STRETCH: f64 = 0.02;

type File = Decoder<Cursor<Vec<u8>>>;

/// Reads the first image of a file: one band of whole or floating-point numbers.
pub fn read(path: &Path, bytes: Vec<u8>, options: &ReadOptions) -> Result<Raw> {
    let fail = |what: String| Error::format(path, None, what);
    let broken = |e: TiffError| match e {
        TiffError::UnsupportedError(e) => {
            fail(format!("{e}: convert it (`gdal_translate -co COMPRESS=DEFLATE -ot Float32`)"))
        }
        e => fail(format!("cannot be read as TIFF, it may be cut off: {e}")),
    };
    let possible = bytes.len().saturating_mul(MAX_VALUES_OF_BYTE);
    let mut limits = Limits::default();
    (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (MAX_STRIP, MAX_STRIP);
    limits.ifd_value_size = MAX_TAG;
    let mut file = Decoder::new(Cursor::new(bytes)).map_err(broken)?.with_limits(limits);
    let (columns, rows) = file.dimensions().map_err(broken)?;
    let (columns, rows) = (columns as usize, rows as usize);
    check_size(path, columns, rows, possible)?;
    match file.colortype().map_err(broken)? {
        ColorType::Gray(_) => {}
        other => {
            let n = other.num_samples();
            return Err(fail(format!("has {n} bands; heights are one: cut it out (`gdal_translate -b 1`)")));
        }
    }
    let mut values = values(&mut file, columns, rows).map_err(broken)?;
    if let Some(text) = file.find_tag(Tag::GdalNodata).ok().flatten().and_then(|v| v.into_string().ok()) {
        let text = text.trim_matches(['\0', ' ']);
        let hole: f64 = text.parse().map_err(|_| {
            fail(format!("its value of samples without data, `{}`, is no number", quote(text)))
        })?;
        let hole = hole as f32;
        values.iter_mut().filter(|v| **v == hole).for_each(|v| *v = f32::NAN);
    }
    let mut raw = Raw { columns, rows, values, ..Raw::default() };
    if let Some(georeference) = georeference(&mut file).map_err(fail)? {
        units(&mut raw, &georeference, options).map_err(fail)?;
        raw.georeference = Some(georeference);
    }
    Ok(raw)
}

/// All values, row by row.
fn values(file: &mut File, columns: usize, rows: usize) -> Result<Vec<f32>, TiffError> {
    let (wide, high) = file.chunk_dimensions();
    let (wide, high) = (wide.max(1) as usize, high.max(1) as usize);
    let (count, across) = match file.get_chunk_type() {
        ChunkType::Strip => (file.strip_count()?, 1),
        ChunkType::Tile => (file.tile_count()?, columns.div_ceil(wide)),
    };
    let mut values = vec![f32::NAN; columns * rows];
    for chunk in 0..count {
        let (x, y) = (chunk as usize % across * wide, chunk as usize / across * high);
        let width = file.chunk_data_dimensions(chunk).0 as usize;
        let part = floats(file.read_chunk(chunk)?);
        for (r, line) in part.chunks_exact(width.max(1)).enumerate() {
            if y + r < rows && x + width <= columns {
                let start = (y + r) * columns + x;
                values[start..start + width].copy_from_slice(line);
            }
        }
    }
    Ok(values)
}

/// Values of any kind as f32.
fn floats(values: DecodingResult) -> Vec<f32> {
    match values {
        DecodingResult::F32(v) => v,
        DecodingResult::F64(v) => v.into_iter().map(|v| v as f32).collect(),
        DecodingResult::F16(v) => v.into_iter().map(|v| v.to_f32()).collect(),
        DecodingResult::U8(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::U16(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::U32(v) => v.into_iter().map(|v| v as f32).collect(),
        DecodingResult::U64(v) => v.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I8(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::I16(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::I32(v) => v.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I64(v) => v.into_iter().map(|v| v as f32).collect(),
    }
}

/// The position, scale and coordinate system of a file; `None` without position.
fn georeference(file: &mut File) -> Result<Option<Georeference>, String> {
    let mut numbers = |tag: Tag, count: usize| -> Result<Option<Vec<f64>>, String> {
        let Some(value) = file.find_tag(tag).map_err(|e| format!("a tag cannot be read: {e}"))? else {
            return Ok(None);
        };
        match value.into_f64_vec() {
            Ok(v) if v.len() >= count && v.iter().all(|v| v.is_finite()) => Ok(Some(v)),
            _ => Err(format!("the tag {tag:?} has other than {count} finite numbers")),
        }
    };
    let scale = numbers(Tag::ModelPixelScaleTag, 2)?;
    let tie = numbers(Tag::ModelTiepointTag, 6)?;
    let matrix = numbers(Tag::ModelTransformationTag, 16)?;
    let doubles = numbers(Tag::GeoDoubleParamsTag, 0)?.unwrap_or_default();
    let (scale, tie_point) = match (scale, tie, matrix) {
        (Some(scale), Some(tie), _) => ([scale[0], scale[1], 0.0], std::array::from_fn(|i| tie[i])),
        (_, _, Some(m)) => {
            if m[1] != 0.0 || m[4] != 0.0 {
                return Err("its rows do not lie from west to east: turn it (`gdalwarp`)".into());
            }
            ([m[0], -m[5], 0.0], [0.0, 0.0, 0.0, m[3], m[7], 0.0])
        }
        _ => return Ok(None),
    };
    if scale[0] <= 0.0 || scale[1] <= 0.0 {
        return Err(format!(
            "a column is {} and a row {} units of length: must be positive, rows from north to south (`gdalwarp`)",
            scale[0], scale[1]
        ));
    }
    let keys = file.find_tag(Tag::GeoKeyDirectoryTag).ok().flatten().and_then(|v| v.into_u16_vec().ok());
    let text = file.find_tag(Tag::GeoAsciiParamsTag).ok().flatten().and_then(|v| v.into_string().ok());
    Ok(Some(Georeference {
        tie_point,
        scale,
        keys: keys.unwrap_or_default(),
        doubles,
        text: text.unwrap_or_default(),
    }))
}

/// Distances of samples and the unit of heights in m, from the units of the coordinate system.
fn units(raw: &mut Raw, georeference: &Georeference, options: &ReadOptions) -> Result<(), String> {
    if let Some(code) = georeference.key(HEIGHTS) {
        let metres = metres_of_unit(code);
        if metres.is_none() && options.height_scale.is_none() {
            return Err(format!("its heights are in the unit EPSG:{code}: set ⟨height_scale⟩ to its metres"));
        }
        if let Some(metres) = metres.filter(|m| *m != 1.0 && options.height_scale.is_none()) {
            raw.notes.push(format!("heights are in a unit of {metres:.6} m (EPSG:{code}) and are converted"));
        }
        raw.unit = metres;
    }
    if options.cell.is_some() {
        return Ok(());
    }
    let [dx, dy, _] = georeference.scale;
    match georeference.key(MODEL_TYPE) {
        Some(GEOGRAPHIC) => raw.cell = Some(degrees(raw, georeference)?),
        Some(3) => return Err("is in geocentric coordinates: project it to metres (`gdalwarp`)".into()),
        _ => {
            let stated = georeference.key(LENGTHS);
            if stated.is_none() {
                raw.notes.push("the file states its unit of length at most by the code of its coordinate system: lengths are taken as metres".into());
            }
            let code = stated.unwrap_or(9001);
            let metres = metres_of_unit(code).ok_or_else(|| {
                format!(
                    "its lengths are in the unit EPSG:{code}: set ⟨cell⟩ to the distances of samples in m"
                )
            })?;
            if metres != 1.0 {
                raw.notes
                    .push(format!("lengths are in a unit of {metres:.6} m (EPSG:{code}) and are converted"));
                if raw.unit.is_none() && options.height_scale.is_none() {
                    raw.notes.push(format!("the file states no unit of heights: they are taken as metres; if they have that of lengths, set ⟨height_scale⟩ to {metres:.6}"));
                }
            }
            raw.cell = Some([dx * metres, dy * metres]);
        }
    }
    crate::terrain::grid::check_cell(raw.cell.unwrap_or([1.0; 2]))
}

/// Distances of samples of a grid in degrees, m, as they are in its middle.
fn degrees(raw: &mut Raw, georeference: &Georeference) -> Result<[f64; 2], String> {
    // Degrees of longitude and latitude.
    if georeference.key(ANGLES).is_some_and(|code| !matches!(code, 9102 | 9122)) {
        return Err("its angles are not in degrees: project it to metres (`gdalwarp`)".into());
    }
    let [dx, dy, _] = georeference.scale;
    let (north, south) = (georeference.position(0, 0)[1], georeference.position(0, raw.rows - 1)[1]);
    let middle = 0.5 * (north + south);
    let zone = ((georeference.position(raw.columns / 2, 0)[0] + 180.0) / 6.0).floor() as i64 + 1;
    let utm = if middle < 0.0 { 32700 } else { 32600 } + zone.clamp(1, 60);
    let cure = format!("project it to metres (`gdalwarp -t_srs EPSG:{utm}`)");
    if north.abs().max(south.abs()) > 90.0 {
        return Err(format!("is in degrees, but has the latitudes {south} to {north}: {cure}"));
    }
    let here = metres_of_degree(middle);
    let stretch = [north, south]
        .map(|l| (metres_of_degree(l)[0] / here[0] - 1.0).abs())
        .into_iter()
        .fold(0.0, f64::max);
    if stretch > MAX_STRETCH {
        return Err(format!(
            "is in degrees, and its columns are {:.0} % nearer at one end than in the middle: {cure}",
            100.0 * stretch
        ));
    }
    let cell = [dx * here[0], dy * here[1]];
    raw.notes.push(format!(
        "is in degrees: columns are taken {:.3} m apart and rows {:.3} m, as at latitude {middle:.4}°; at its ends columns are up to {:.2} % nearer or farther",
        cell[0],
        cell[1],
        100.0 * stretch
    ));
    Ok(cell)
}

/// Metres in a unit of length by its EPSG code; `None` if it is not known.
fn metres_of_unit(code: u16) -> Option<f64> {
    match code {
        9001 => Some(1.0),
        9002 => Some(0.3048),
        // Survey foot of the United States: 1200/3937 m.
        9003 => Some(1200.0 / 3937.0),
        9036 => Some(1000.0),
        _ => None,
    }
}

/// Lengths in m of one degree of longitude and of latitude at a latitude in degrees, on the ellipsoid WGS 84.
fn metres_of_degree(latitude: f64) -> [f64; 2] {
    // Semi-major axis in m and square of the eccentricity.
    let (a, e2) = (6_378_137.0, 6.694_379_990_14e-3);
    let (sin, cos) = latitude.to_radians().sin_cos();
    let w = 1.0 - e2 * sin * sin;
    let degree = 1f64.to_radians();
    [degree * a * cos / w.sqrt(), degree * a * (1.0 - e2) / w.powf(1.5)]
}
