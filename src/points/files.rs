//! Reading, writing and comparing files of points and irradiance.

use super::{Comparison, Irradiance, Point};
use crate::files::WholeFile;
use crate::files::input::Input;
use crate::{Error, Result, error::quote, memory};
use csv::StringRecord;
use glam::DVec3;
use std::io::Read;
use std::path::Path;

/// First columns of every point file, in order.
const POINT: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
/// Columns that an irradiance file adds.
const VALUE: [&str; 3] = ["Er", "Eg", "Eb"];
/// Columns that follow if standard errors are known.
const STANDARD_ERROR: [&str; 3] = ["Er_se", "Eg_se", "Eb_se"];

/// Largest deviation of a normal's length from 1 (files with three digits); normals are then normalised.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Largest coordinate: the squares of larger ones, times 3, overflow f32 (3.4e38), in which rays are traced.
const MAX_COORDINATE: f64 = 1e18;

/// Reads a point file: at least one point, unit normals.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read. [`Error::File`] with file and line if the header does not begin with
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

/// Writes an irradiance file, completely or not at all. Numbers have the fewest digits that read back as the same f64.
/// `illuminance` gives the value of a last column, `E_lx`, from RGB.
///
/// # Panics
/// If the entries of `irradiance` differ in length.
pub fn write_irradiance(
    path: &Path,
    irradiance: &Irradiance,
    illuminance: Option<&dyn Fn([f64; 3]) -> f64>,
) -> Result<()> {
    let Irradiance { points, values, standard_errors } = irradiance;
    let with_errors = !standard_errors.is_empty();
    assert!(values.len() == points.len() && (!with_errors || standard_errors.len() == points.len()));
    let mut file = WholeFile::create(path)?;
    let broken = |e: csv::Error| match e.into_kind() {
        csv::ErrorKind::Io(e) => Error::io(path, e),
        other => Error::format(path, None, format!("{other:?}")),
    };
    let mut out = csv::Writer::from_writer(&mut file);
    let names = POINT.into_iter().chain(VALUE);
    let names = names.chain(STANDARD_ERROR.into_iter().filter(|_| with_errors));
    let names = names.chain(illuminance.map(|_| "E_lx"));
    out.write_record(names).map_err(broken)?;
    for (i, Point { position: p, normal: n }) in points.iter().enumerate() {
        let row = p.to_array().into_iter().chain(n.to_array()).chain(values[i]);
        let row = row.chain(standard_errors.get(i).copied().into_iter().flatten());
        let row = row.chain(illuminance.map(|of| of(values[i])));
        out.write_record(row.map(|x| x.to_string())).map_err(broken)?;
    }
    out.flush().map_err(|e| Error::io(path, e))?;
    drop(out);
    file.commit()
}

impl Comparison {
    /// Percentages that [`Comparison::percentiles`] belong to.
    pub const SHARES: [f64; 4] = [50.0, 90.0, 99.0, 100.0];
}

/// Compares `test` with `reference`, point by point.
///
/// If the reference is black everywhere, its mean is 0: equal files give zeros, others infinities.
///
/// # Errors
/// [`Error::Argument`] unless both hold the same points in the same order; positions may differ by 1e-5 of the points'
/// extent (rounded digits).
pub fn compare(reference: &Irradiance, test: &Irradiance) -> Result<Comparison> {
    let (a, b) = (&reference.points, &test.points);
    if a.len() != b.len() {
        return Err(Error::arguments(format!(
            "the reference has {} points, the test {}: compare irradiance at the same points",
            a.len(),
            b.len()
        )));
    }
    let low = a.iter().fold(glam::DVec3::INFINITY, |m, p| m.min(p.position));
    let high = a.iter().fold(glam::DVec3::NEG_INFINITY, |m, p| m.max(p.position));
    let close = 1e-5 * (high - low).length().max(high.abs().max_element()).max(f64::MIN_POSITIVE);
    if let Some(i) = (0..a.len()).find(|&i| a[i].position.distance(b[i].position) > close) {
        return Err(Error::arguments(format!(
            "point {} is at {} in the reference and at {} in the test: compare irradiance at the same points",
            i + 1,
            a[i].position,
            b[i].position
        )));
    }
    let count = (3 * a.len()).max(1) as f64;
    let mean = reference.values.iter().flatten().sum::<f64>() / count;
    let pairs = || reference.values.iter().flatten().zip(test.values.iter().flatten());
    let relative = |x: f64, mean: f64| if x == 0.0 { 0.0 } else { x / mean.abs() };
    let mut sizes: Vec<f64> = pairs().map(|(r, t)| (t - r).abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let percentile = |share: f64| {
        let rank = (share / 100.0 * sizes.len() as f64).ceil() as usize;
        sizes.get(rank.clamp(1, sizes.len().max(1)) - 1).copied().unwrap_or(0.0)
    };
    let mean_square = |values: &mut dyn Iterator<Item = f64>, n: f64| values.map(|v| v * v).sum::<f64>() / n;
    let channel = |c: usize| {
        let (r, t) = (reference.values.iter().map(|v| v[c]), test.values.iter().map(|v| v[c]));
        let n = a.len().max(1) as f64;
        relative(mean_square(&mut r.clone().zip(t).map(|(r, t)| t - r), n).sqrt(), r.sum::<f64>() / n)
    };
    Ok(Comparison {
        points: a.len(),
        mean,
        rms: relative(mean_square(&mut pairs().map(|(r, t)| t - r), count).sqrt(), mean),
        reference_noise: relative(
            mean_square(&mut reference.standard_errors.iter().flatten().copied(), count).sqrt(),
            mean,
        ),
        bias: relative(pairs().map(|(r, t)| t - r).sum::<f64>() / count, mean),
        percentiles: Comparison::SHARES.map(|share| relative(percentile(share), mean)),
        rms_by_channel: std::array::from_fn(channel),
    })
}
