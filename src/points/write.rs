//! Writing irradiance files.

use super::read::{POINT, STANDARD_ERROR, VALUE};
use super::{Irradiance, Point};
use crate::{Error, Result, files::WholeFile};
use std::path::Path;

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
