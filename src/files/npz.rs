//! NumPy archives that are written.

use rawzip::ZipArchiveWriter;
use rawzip::time::UtcDateTime;
use std::io::{self, Write};

/// An archive of arrays, not compressed. All have the date of [`NO_DATE`].
pub struct NpzWriter<W: Write>(ZipArchiveWriter<W>);

/// The first date that archives can state.
const NO_DATE: UtcDateTime = UtcDateTime::from_components(1980, 1, 1, 0, 0, 0, 0).expect("a date");

impl<W: Write> NpzWriter<W> {
    pub fn new(out: W) -> NpzWriter<W> {
        NpzWriter(ZipArchiveWriter::new(out))
    }

    /// Adds an array; `kind` such as `<f4`. `<` is little endian, as are all machines that Embree supports.
    pub fn array(&mut self, name: &str, kind: &str, shape: &[usize], bytes: &[u8]) -> io::Result<()> {
        let file = self.0.new_file(format!("{name}.npy")).last_modified(NO_DATE).unix_permissions(0o644);
        let (mut entry, sums) = file.start().map_err(io::Error::other)?;
        let mut out = sums.wrap(&mut entry);
        out.write_all(&header(kind, shape))?;
        out.write_all(bytes)?;
        let (_, sums) = out.finish().map_err(io::Error::other)?;
        entry.finish(sums).map_err(io::Error::other)?;
        Ok(())
    }

    pub fn finish(self) -> io::Result<()> {
        self.0.finish().map_err(io::Error::other)?.flush()
    }
}

/// Beginning of a file of version 1.0 of NumPy's format: magic, version, length of the rest of the header, and a Python literal, padded to
/// a multiple of 64 bytes.
pub fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let sides: String = shape.iter().map(|n| format!("{n},")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}");
    let length = (text.len() + 11).next_multiple_of(64) - 10;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((length as u16).to_le_bytes());
    header.extend(text.as_bytes());
    header.push(b'\n');
    header
}
