//! Reading point and irradiance files.

use super::{Irradiance, Point};
use crate::{Error, Result, error::quote, files::input::Input, memory};
use csv::StringRecord;
use glam::DVec3;
use std::{io::Read, path::Path};

/// First columns of every point file, in order.
pub(super) const POINT: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
/// Columns that an irradiance file adds.
pub(super) const VALUE: [&str; 3] = ["Er", "Eg", "Eb"];
/// Columns that follow if standard errors are known.
pub(super) const STANDARD_ERROR: [&str; 3] = ["Er_se", "Eg_se", "Eb_se"];

/// Largest deviation of a normal's length from 1 (files with three digits); normals are then normalised.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Largest coordinate: the squares of larger ones, times 3, overflow f32 (3.4e38), in which rays are traced.
const MAX_COORDINATE: f64 = 1e18;

/// Reads a point file: at least one point, unit normals.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read. [`Error::Format`] with file and line if the header does not begin with
/// `x,y,z,nx,ny,nz`, there is no point, a field is not a finite number, or a normal has not unit length.
pub fn read_points(path: &Path) -> Result<Vec<Point>> {
    let mut points = Vec::new();
    rows(path, open(path)?, &POINT, |_, record, at| {
        points.push(point(path, record, at)?);
        Ok(())
    })?;
    Ok(points)
}

/// Reads an irradiance file. Values may be negative (noise of an estimator) but must be finite.
///
/// # Errors
/// As for [`read_points`], or if `Er,Eg,Eb` do not follow in the header.
pub fn read_irradiance(path: &Path) -> Result<Irradiance> {
    irradiance_of(path, open(path)?)
}

/// Reads the content of an irradiance file.
pub fn irradiance_of(path: &Path, file: impl Read) -> Result<Irradiance> {
    let mut out = Irradiance::default();
    let columns: Vec<&str> = POINT.into_iter().chain(VALUE).collect();
    rows(path, file, &columns, |header, record, at| {
        out.points.push(point(path, record, at)?);
        let three = |first: usize| -> Result<[f64; 3]> {
            Ok([
                number(path, record, at, first)?,
                number(path, record, at, first + 1)?,
                number(path, record, at, first + 2)?,
            ])
        };
        out.values.push(three(6)?);
        if STANDARD_ERROR.iter().enumerate().all(|(k, name)| header.get(9 + k) == Some(name)) {
            out.standard_errors.push(three(9)?);
        }
        Ok(())
    })?;
    Ok(out)
}

fn open(path: &Path) -> Result<Input> {
    Input::open(path, memory::usable().unwrap_or(u64::MAX >> 1))
}

/// Checks the header and passes each record with its line number, counted from 1, to `take`.
fn rows(
    path: &Path,
    file: impl Read,
    columns: &[&str],
    mut take: impl FnMut(&StringRecord, &StringRecord, usize) -> Result<()>,
) -> Result<()> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(file);
    let broken = |e: csv::Error| {
        let line = e.position().map(|p| p.line() as usize);
        match e.into_kind() {
            csv::ErrorKind::Io(e) => Error::io(path, e),
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                Error::format(path, line, format!("{len} fields where the header has {expected_len}"))
            }
            csv::ErrorKind::Utf8 { .. } => Error::format(path, line, "not text in UTF-8"),
            _ => Error::format(path, line, "not a CSV file"),
        }
    };
    let header = reader.headers().map_err(broken)?.clone();
    if columns.iter().enumerate().any(|(k, &name)| header.get(k) != Some(name)) {
        let what = format!("the header must begin with `{}`", columns.join(","));
        return Err(Error::format(path, Some(1), what));
    }
    let mut record = StringRecord::new();
    let mut any = false;
    while reader.read_record(&mut record).map_err(broken)? {
        let line = record.position().map_or(0, |p| p.line() as usize);
        take(&header, &record, line)?;
        any = true;
    }
    if any { Ok(()) } else { Err(Error::format(path, None, "holds no point")) }
}

fn point(path: &Path, record: &StringRecord, line: usize) -> Result<Point> {
    let mut v = [0.0; 6];
    for (k, v) in v.iter_mut().enumerate() {
        *v = number(path, record, line, k)?;
    }
    let [x, y, z, nx, ny, nz] = v;
    let (position, normal) = (DVec3::new(x, y, z), DVec3::new(nx, ny, nz));
    if position.abs().max_element() > MAX_COORDINATE {
        return Err(Error::format(path, Some(line), format!("a coordinate is beyond {MAX_COORDINATE:e}")));
    }
    let length = normal.length();
    if (length - 1.0).abs() > UNIT_TOLERANCE {
        let what = format!("the normal has the length {length:.6}, it must be 1");
        return Err(Error::format(path, Some(line), what));
    }
    Ok(Point { position, normal: normal / length })
}

fn number(path: &Path, record: &StringRecord, line: usize, column: usize) -> Result<f64> {
    let text = record.get(column).unwrap_or_default();
    text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
        let what = format!("column {}: `{}` is not a finite number", column + 1, quote(text));
        Error::format(path, Some(line), what)
    })
}
