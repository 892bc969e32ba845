//! Matrices in files.

use super::{FormFactors, Labels};
use crate::error::{is_obeyed, shown};
use crate::files::{NpzWriter, WholeFile, csv_text};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// File formats of matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NumPy archive as written by `scipy.sparse.save_npz` (compressed sparse rows), with additional arrays `area`,
    /// `escaped` and `lost`, one number per row; groups also have `names`, facets `object` and `material`, indices into
    /// `object_names` and `material_names`.
    Npz,
    /// Lines `from,to,factor`; rows by index from 0, or by name. Facets have the columns `from_object,to_object` as well.
    Csv,
    /// Matrix Market coordinate format, indices from 1; comments name the rows, facets by their objects.
    Mtx,
}

impl Format {
    /// The format of a file name extension.
    pub fn of(path: &Path) -> Result<Format> {
        match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
            "npz" => Ok(Format::Npz),
            "csv" => Ok(Format::Csv),
            "mtx" => Ok(Format::Mtx),
            _ => Err(Error::argument("path", shown(path), "the extension must be .npz, .csv or .mtx")),
        }
    }
}

impl Labels {
    fn object(&self, facet: usize) -> &str {
        &self.object_names[self.objects[facet] as usize]
    }
}

/// Writes a matrix, completely or not at all. `labels`: those of the facets, if the rows are facets.
pub fn write(path: &Path, matrix: &FormFactors, format: Format, labels: Option<&Labels>) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    let written = match format {
        Format::Npz => npz(&mut file, matrix, labels),
        Format::Csv => csv(&mut file, matrix, labels),
        Format::Mtx => mtx(&mut file, matrix, labels),
    };
    written.map_err(|e| Error::io(path, e))?;
    file.commit()
}

fn csv(out: &mut impl Write, m: &FormFactors, labels: Option<&Labels>) -> std::io::Result<()> {
    let mut out = csv::Writer::from_writer(out);
    let of_facets = labels.map(|_| ["from_object", "to_object"]).into_iter().flatten();
    out.write_record(["from", "to", "factor"].into_iter().chain(of_facets))?;
    let name = |i: usize| m.names.get(i).map_or_else(|| i.to_string(), |name| csv_text(name).into_owned());
    for i in 0..m.len() {
        let from = name(i);
        for (j, f) in m.entries(i) {
            let (to, factor) = (name(j), (f as f32).to_string());
            let objects = labels.map(|l| [l.object(i), l.object(j)].map(csv_text));
            let objects = objects.iter().flatten().map(AsRef::as_ref);
            out.write_record([&from, &to, &factor].map(String::as_str).into_iter().chain(objects))?;
        }
    }
    out.flush()
}

fn mtx(out: &mut impl Write, m: &FormFactors, labels: Option<&Labels>) -> std::io::Result<()> {
    writeln!(out, "%%MatrixMarket matrix coordinate real general")?;
    // A line break in a name would end the comment.
    let printable = |name: &str| -> String { name.chars().filter(|c| !is_obeyed(*c)).collect() };
    for i in 0..m.len() {
        let name = labels.map(|l| l.object(i)).or(m.names.get(i).map(String::as_str)).unwrap_or_default();
        writeln!(out, "% {} {}", i + 1, printable(name))?;
    }
    writeln!(out, "{} {} {}", m.len(), m.len(), m.columns.len())?;
    for i in 0..m.len() {
        for (j, f) in m.entries(i) {
            writeln!(out, "{} {} {}", i + 1, j + 1, f as f32)?;
        }
    }
    Ok(())
}

fn npz(out: &mut impl Write, m: &FormFactors, labels: Option<&Labels>) -> std::io::Result<()> {
    let mut archive = NpzWriter::new(out);
    let n = m.len();
    archive.array("data", "<f4", &[m.factors.len()], bytemuck::cast_slice(&m.factors))?;
    archive.array("indices", "<i4", &[m.columns.len()], bytemuck::cast_slice(&m.columns))?;
    archive.array("indptr", "<i8", &[n + 1], bytemuck::cast_slice(&m.offsets))?;
    archive.array("shape", "<i8", &[2], bytemuck::cast_slice(&[n as u64; 2]))?;
    archive.array("format", "|S3", &[], b"csr")?;
    archive.array("area", "<f8", &[n], bytemuck::cast_slice(&m.areas))?;
    archive.array("escaped", "<f4", &[n], bytemuck::cast_slice(&m.escaped))?;
    archive.array("lost", "<f4", &[n], bytemuck::cast_slice(&m.lost))?;
    let mut texts = |name: &str, list: &[String]| {
        let longest = list.iter().map(|s| s.chars().count()).max().unwrap_or(0).max(1);
        // NumPy strings are UTF-32, padded with zeros.
        let letters = |s: &String| -> Vec<u32> {
            s.chars().map(u32::from).chain(std::iter::repeat(0)).take(longest).collect()
        };
        let text: Vec<u32> = list.iter().flat_map(letters).collect();
        archive.array(name, &format!("<U{longest}"), &[list.len()], bytemuck::cast_slice(&text))
    };
    if !m.names.is_empty() {
        texts("names", &m.names)?;
    }
    if let Some(labels) = labels {
        texts("object_names", &labels.object_names)?;
        texts("material_names", &labels.material_names)?;
        archive.array("object", "<u4", &[n], bytemuck::cast_slice(&labels.objects))?;
        archive.array("material", "<u4", &[n], bytemuck::cast_slice(&labels.materials))?;
    }
    archive.finish()
}
