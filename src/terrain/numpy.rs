//! NumPy arrays that are read: `.npy` files of version 1 to 3, and `.npz` archives of them.

use crate::{Error, Result, error::quote, memory};
use flate2::read::DeflateDecoder;
use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

/// Largest number of bytes of a header. NumPy's own limit (`max_header_size` of `numpy.load`) is 10,000.
const MAX_HEADER: usize = 10_000;

/// An array of numbers.
#[derive(Debug)]
pub struct Array {
    /// Numbers of entries in each dimension.
    pub shape: Vec<usize>,
    /// Entries, the last dimension fastest.
    pub values: Vec<f32>,
}

/// Reads a `.npy` file of real numbers.
pub fn read_npy(path: &Path, bytes: &[u8]) -> Result<Array> {
    let fail = |what: String| Error::format(path, None, what);
    let cut = || fail("is cut off, or no NumPy array".into());
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(cut)?;
    let (length, start) = match rest {
        [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 4),
        [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 6),
        [] | [_] => return Err(cut()),
        [version, ..] => {
            return Err(fail(format!("is of version {version} of NumPy's format; 1 to 3 are read")));
        }
    };
    if length > MAX_HEADER {
        return Err(fail(format!("its header has {length} bytes; at most {MAX_HEADER} are read")));
    }
    let text = rest.get(start..start + length).ok_or_else(cut)?;
    let text = String::from_utf8_lossy(text);
    let data = &rest[start + length..];
    let after = |name: &str| text.split_once(&format!("'{name}':")).map(|(_, value)| value.trim_start());
    let missing = |name: &str| fail(format!("its header has no `{name}`"));
    let kind = after("descr")
        .and_then(|v| v.strip_prefix('\'')?.split('\'').next())
        .ok_or_else(|| fail("its values are no plain numbers: save an array of float32".into()))?;
    let is_fortran = after("fortran_order").ok_or_else(|| missing("fortran_order"))?.starts_with("True");
    let shape = after("shape").and_then(|v| v.strip_prefix('(')?.split(')').next());
    let shape = shape.ok_or_else(|| missing("shape"))?.split(',').map(str::trim).filter(|s| !s.is_empty());
    let shape: Option<Vec<usize>> = shape.map(|s| s.parse().ok()).collect();
    let shape = shape.ok_or_else(|| fail("its shape is not of whole numbers".into()))?;
    let count = shape.iter().try_fold(1usize, |n, &side| n.checked_mul(side));
    let (size, decode) = decoder(kind).ok_or_else(|| {
        fail(format!("its values are of the kind `{}`: save an array of float32", quote(kind)))
    })?;
    match count.and_then(|n| n.checked_mul(size)) {
        Some(needed) if needed == data.len() => {}
        _ => {
            let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
            return Err(fail(format!(
                "an array of {} needs other than its {} bytes of data: the file is cut off or damaged",
                sides.join(" × "),
                data.len()
            )));
        }
    }
    let mut values: Vec<f32> = data.chunks_exact(size).map(decode).collect();
    if let (true, [rows, _]) = (is_fortran && !values.is_empty(), &shape[..]) {
        values = super::grid::transpose(&values, *rows);
    }
    Ok(Array { shape, values })
}

/// Makes a number of its bytes.
type Decode = fn(&[u8]) -> f32;

/// Bytes of a number and its decoder, by NumPy's name of its kind.
fn decoder(kind: &str) -> Option<(usize, Decode)> {
    macro_rules! number {
        ($type:ty, $from:ident) => {
            (size_of::<$type>(), |b: &[u8]| {
                let mut bytes = [0; size_of::<$type>()];
                bytes.copy_from_slice(b);
                <$type>::$from(bytes) as f32
            })
        };
    }
    Some(match kind {
        "<f4" => number!(f32, from_le_bytes),
        ">f4" => number!(f32, from_be_bytes),
        "<f8" => number!(f64, from_le_bytes),
        ">f8" => number!(f64, from_be_bytes),
        "<i2" => number!(i16, from_le_bytes),
        ">i2" => number!(i16, from_be_bytes),
        "<u2" => number!(u16, from_le_bytes),
        "<i4" => number!(i32, from_le_bytes),
        "|u1" => number!(u8, from_le_bytes),
        _ => return None,
    })
}

/// Reads the only array of two dimensions of an archive, or the one named `heights`, `elevation`, `dem` or `z`.
pub fn read_npz(path: &Path, bytes: &[u8]) -> Result<Array> {
    let broken = |e: rawzip::Error| Error::format(path, None, format!("cannot be read as an archive: {e}"));
    let archive = rawzip::ZipArchive::from_slice(bytes).map_err(broken)?;
    let mut found: Vec<(String, Array)> = Vec::new();
    let mut entries = archive.entries();
    while let Some(entry) = entries.next_entry().map_err(broken)? {
        let name = String::from_utf8_lossy(entry.file_path().as_bytes()).trim_end_matches(".npy").to_owned();
        let file = archive.get_entry(entry.wayfinder()).map_err(broken)?;
        let unreadable = |e: std::io::Error| {
            Error::format(
                path,
                None,
                format!("`{}` cannot be read, the archive is damaged: {e}", quote(&name)),
            )
        };
        let content = match entry.compression_method() {
            rawzip::CompressionMethod::STORE => {
                let mut whole = file.verifying_reader(file.data());
                std::io::copy(&mut whole, &mut std::io::sink()).map_err(unreadable)?;
                Cow::Borrowed(file.data())
            }
            // `numpy.savez_compressed`. One byte more than stated shows a wrong size.
            rawzip::CompressionMethod::DEFLATE => {
                let bytes = entry.uncompressed_size_hint();
                memory::check_room(bytes, || format!("the array `{}`", quote(&name)))?;
                let mut content = Vec::new();
                let whole = file.verifying_reader(DeflateDecoder::new(file.data()));
                whole.take(bytes.saturating_add(1)).read_to_end(&mut content).map_err(unreadable)?;
                Cow::Owned(content)
            }
            _ => {
                let what = "is compressed in a way that NumPy does not write: save it by numpy.savez";
                return Err(Error::format(path, None, what));
            }
        };
        // Arrays of text and others that are no numbers are passed over.
        if let Some(array) = read_npy(path, &content).ok().filter(|a| a.shape.len() == 2) {
            found.push((name, array));
        }
    }
    let usual = ["heights", "elevation", "dem", "z"];
    if let Some(i) = found.iter().position(|(name, _)| usual.contains(&name.as_str())) {
        return Ok(found.swap_remove(i).1);
    }
    match found.len() {
        1 => Ok(found.remove(0).1),
        n => Err(Error::format(
            path,
            None,
            format!("holds {n} arrays of two dimensions: name the heights `heights`, one of them suffices"),
        )),
    }
}
