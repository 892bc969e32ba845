//! ESRI ASCII grids: a header of names and numbers, then heights row by row from the north.

use super::{Raw, check_size};
use crate::terrain::Georeference;
use crate::terrain::grid::check_cell;
use crate::{Error, Result, error::quote};
use std::path::Path;

/// Value of samples without data where a header states none: the default of ESRI.
const NO_DATA: f64 = -9999.0;

/// The contents of a header.
#[derive(Default)]
struct Header {
    columns: Option<f64>,
    rows: Option<f64>,
    /// x and y of the lower left corner or sample.
    corner: [Option<f64>; 2],
    /// Whether x and y are those of the sample.
    is_middle: [bool; 2],
    cell: [Option<f64>; 2],
    no_data: Option<f64>,
}

impl Header {
    /// Stores a value; returns whether the name is known.
    fn set(&mut self, name: &str, value: f64) -> bool {
        match name.to_ascii_lowercase().as_str() {
            "ncols" => self.columns = Some(value),
            "nrows" => self.rows = Some(value),
            "xllcorner" => self.corner[0] = Some(value),
            "yllcorner" => self.corner[1] = Some(value),
            "xllcenter" => (self.corner[0], self.is_middle[0]) = (Some(value), true),
            "yllcenter" => (self.corner[1], self.is_middle[1]) = (Some(value), true),
            "cellsize" => self.cell = [Some(value); 2],
            "dx" => self.cell[0] = Some(value),
            "dy" => self.cell[1] = Some(value),
            "nodata_value" => self.no_data = Some(value),
            _ => return false,
        }
        true
    }
}

/// Reads a grid.
pub fn read(path: &Path, bytes: &[u8]) -> Result<Raw> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes)
        .map_err(|_| Error::format(path, None, "is not text: an ESRI ASCII grid begins with `ncols`"))?;
    // Words with the numbers of their lines, counted from 1.
    let mut words = (1..)
        .zip(text.lines())
        .flat_map(|(line, text)| text.split_ascii_whitespace().map(move |word| (line, word)));
    let mut header = Header::default();
    let first = loop {
        let Some((line, name)) = words.next() else { break None };
        if !name.starts_with(|c: char| c.is_ascii_alphabetic()) || name.eq_ignore_ascii_case("nan") {
            break Some((line, name));
        }
        let Some((line, value)) = words.next() else {
            return Err(Error::format(path, Some(line), format!("`{}` has no value", quote(name))));
        };
        if !header.set(name, number(path, line, value)?) {
            let what = format!(
                "`{}` is not a name of an ESRI ASCII grid: ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize or dx and dy, NODATA_value",
                quote(name)
            );
            return Err(Error::format(path, Some(line), what));
        }
    };
    let (columns, rows) = (side(path, "ncols", header.columns)?, side(path, "nrows", header.rows)?);
    // A value is a digit and a separator or more.
    check_size(path, columns, rows, text.len().div_ceil(2))?;
    let no_data = header.no_data.unwrap_or(NO_DATA);
    let mut values = Vec::with_capacity(columns * rows);
    for (line, word) in first.into_iter().chain(words) {
        if values.len() == columns * rows {
            let what = format!("more than the {} values of {columns} columns and {rows} rows", values.len());
            return Err(Error::format(path, Some(line), what));
        }
        // Some programs write holes as `nan`.
        let value = if word.eq_ignore_ascii_case("nan") { f64::NAN } else { number(path, line, word)? };
        values.push(if value == no_data { f32::NAN } else { value as f32 });
    }
    if values.len() < columns * rows {
        let what = format!(
            "ends after {} of {} values: the file is cut off, or `ncols` and `nrows` are wrong",
            values.len(),
            columns * rows
        );
        return Err(Error::format(path, Some(text.lines().count()), what));
    }
    place(path, &header, columns, rows, values)
}

/// Adds the distances of samples and their place.
fn place(path: &Path, header: &Header, columns: usize, rows: usize, values: Vec<f32>) -> Result<Raw> {
    let mut raw = Raw { columns, rows, values, ..Raw::default() };
    let [Some(dx), Some(dy)] = header.cell else {
        // The caller refuses the file unless an option states the distances.
        return Ok(raw);
    };
    check_cell([dx, dy]).map_err(|e| Error::format(path, None, format!("`cellsize`: {e}")))?;
    let corner = header.corner.map(Option::unwrap_or_default);
    let low = [0, 1].map(|k| corner[k] + if header.is_middle[k] { 0.0 } else { 0.5 * [dx, dy][k] });
    raw.georeference = Some(Georeference::of_samples([low[0], low[1] + (rows - 1) as f64 * dy], [dx, dy]));
    raw.cell = Some([dx, dy]);
    raw.notes.push("the file states no unit: lengths and heights are taken as metres".into());
    Ok(raw)
}

fn number(path: &Path, line: usize, word: &str) -> Result<f64> {
    word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
        let cure = if word.contains(',') { ": write decimal points, not commas" } else { "" };
        Error::format(path, Some(line), format!("`{}` is not a finite number{cure}", quote(word)))
    })
}

fn side(path: &Path, name: &str, value: Option<f64>) -> Result<usize> {
    match value {
        Some(v) if v >= 1.0 && v.fract() == 0.0 && v < 1e9 => Ok(v as usize),
        Some(v) => Err(Error::format(path, None, format!("`{name}` {v}: must be a positive whole number"))),
        None => {
            Err(Error::format(path, None, format!("the header has no `{name}`: is it an ESRI ASCII grid?")))
        }
    }
}
