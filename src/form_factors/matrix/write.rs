//! Matrices in files.

use super::Matrix;
use crate::{Error, Result, files::WholeFile};
use std::io::Write;
use std::path::Path;

/// File formats of matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NumPy archive as written by `scipy.sparse.save_npz` (compressed sparse rows), with additional arrays `area`,
    /// `escaped` and `lost`, one number per row; groups also have `names`.
    Npz,
    /// Lines `from,to,factor`; rows by index from 0, or by name.
    Csv,
    /// Matrix Market coordinate format, indices from 1.
    Mtx,
}

impl Format {
    /// The format of a file name extension.
    ///
    /// # Errors
    /// [`Error::Argument`] if the extension is not `npz`, `csv` or `mtx`.
    pub fn of(path: &Path) -> Result<Format> {
        match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
            "npz" => Ok(Format::Npz),
            "csv" => Ok(Format::Csv),
            "mtx" => Ok(Format::Mtx),
            _ => {
                Err(Error::Argument(format!("{}: the extension must be .npz, .csv or .mtx", path.display())))
            }
        }
    }
}

/// Writes a matrix, completely or not at all.
///
/// # Errors
/// [`Error::Io`] if the file cannot be written.
pub fn write(path: &Path, matrix: &Matrix, format: Format) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    let written = match format {
        Format::Npz => npz(&mut file, matrix),
        Format::Csv => csv(&mut file, matrix),
        Format::Mtx => mtx(&mut file, matrix),
    };
    written.map_err(|e| Error::io(path, e))?;
    file.commit()
}

fn csv(out: &mut impl Write, m: &Matrix) -> std::io::Result<()> {
    let mut out = csv::Writer::from_writer(out);
    out.write_record(["from", "to", "factor"])?;
    let name = |i: usize| m.names.get(i).cloned().unwrap_or_else(|| i.to_string());
    for i in 0..m.len() {
        let from = name(i);
        for (j, f) in m.row(i) {
            out.write_record([&from, &name(j), &(f as f32).to_string()])?;
        }
    }
    out.flush()
}

fn mtx(out: &mut impl Write, m: &Matrix) -> std::io::Result<()> {
    writeln!(out, "%%MatrixMarket matrix coordinate real general")?;
    for (i, name) in m.names.iter().enumerate() {
        writeln!(out, "% {} {name}", i + 1)?;
    }
    writeln!(out, "{} {} {}", m.len(), m.len(), m.columns.len())?;
    for i in 0..m.len() {
        for (j, f) in m.row(i) {
            writeln!(out, "{} {} {}", i + 1, j + 1, f as f32)?;
        }
    }
    Ok(())
}

fn npz(out: &mut impl Write, m: &Matrix) -> std::io::Result<()> {
    let mut zip = zip::ZipWriter::new_stream(out);
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .large_file(true);
    let mut array = |name: &str, kind: &str, shape: String, bytes: &[u8]| -> std::io::Result<()> {
        zip.start_file(format!("{name}.npy"), options)?;
        zip.write_all(&npy_header(kind, &shape))?;
        zip.write_all(bytes)
    };
    let vector = |n: usize| format!("({n},)");
    let n = m.len();
    // Native byte order: `<` is little endian, as are all machines that Embree supports.
    array("data", "<f4", vector(m.factors.len()), bytemuck::cast_slice(&m.factors))?;
    array("indices", "<i4", vector(m.columns.len()), bytemuck::cast_slice(&m.columns))?;
    array("indptr", "<i8", vector(n + 1), bytemuck::cast_slice(&m.offsets))?;
    array("shape", "<i8", vector(2), bytemuck::cast_slice(&[n as u64; 2]))?;
    array("format", "|S3", "()".into(), b"csr")?;
    array("area", "<f8", vector(n), bytemuck::cast_slice(&m.areas))?;
    array("escaped", "<f4", vector(n), bytemuck::cast_slice(&m.escaped))?;
    array("lost", "<f4", vector(n), bytemuck::cast_slice(&m.lost))?;
    if !m.names.is_empty() {
        let longest = m.names.iter().map(|s| s.chars().count()).max().unwrap_or(0).max(1);
        // NumPy strings are UTF-32, padded with zeros.
        let letters = |s: &String| -> Vec<u32> {
            s.chars().map(u32::from).chain(std::iter::repeat(0)).take(longest).collect()
        };
        let text: Vec<u32> = m.names.iter().flat_map(letters).collect();
        array("names", &format!("<U{longest}"), vector(n), bytemuck::cast_slice(&text))?;
    }
    zip.finish()?.flush()
}

/// Header of version 1.0 of NumPy's array format: magic, length, and a Python literal, padded to a multiple of 64
/// bytes.
fn npy_header(kind: &str, shape: &str) -> Vec<u8> {
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    let length = (text.len() + 11).next_multiple_of(64) - 10;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((length as u16).to_le_bytes());
    header.extend(text.as_bytes());
    header.push(b'\n');
    header
}
