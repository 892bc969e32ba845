//! PLY files, text and binary, by `ply-rs-bw`: `vertex` (x, y, z) and `face` (`vertex_indices`); other elements are
//! ignored.

use super::{MAX_COORDINATE, Soup, SoupMaterial};
use crate::{Error, Result, error::quote};
use glam::DVec3;
use ply_rs_bw::{
    parser::{ParseError, Parser, Reader},
    ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult},
};
use std::path::Path;

/// Reads a PLY file, of which `path` is the name: one object, named after the file.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Soup> {
    let mut file = File { path, reader: Reader::new(bytes) };
    let header = Parser::<Skipped>::new().read_header(&mut file.reader).map_err(|e| file.wrong(&e))?;
    check_counts(path, &header, bytes.len())?;
    let mut soup = Soup::new(path);
    soup.object(path.file_stem().unwrap_or_default().to_string_lossy());
    soup.material(SoupMaterial::missing("(none)"));
    let mut first_face = None;
    for (name, element) in &header.elements {
        let text = header.encoding == Encoding::Ascii;
        let line = file.reader.line();
        match name.as_str() {
            "vertex" => {
                let vertices: Vec<Vertex> = file.read(element, &header)?;
                for (i, v) in vertices.iter().enumerate() {
                    if !v.0.is_finite() || v.0.abs().max_element() > MAX_COORDINATE {
                        let what =
                            format!("a coordinate of vertex {i} is not finite or beyond ±{MAX_COORDINATE:e}");
                        return Err(Error::format(path, text.then_some(line.max(1) + i), what));
                    }
                }
                soup.positions = vertices.into_iter().map(|v| v.0).collect();
            }
            "face" => {
                first_face = text.then_some(line.max(1));
                let faces: Vec<Face> = file.read(element, &header)?;
                // Vertices may follow faces; indices are checked below.
                faces.into_iter().for_each(|f| soup.indexed_polygon(0, 0, f.0));
            }
            _ => drop(file.read::<Skipped>(element, &header)?),
        }
    }
    let count = soup.positions.len();
    if let Some(corner) = soup.corners.iter().position(|&v| v as usize >= count) {
        let (face, bad) = (soup.ends.partition_point(|&end| end as usize <= corner), soup.corners[corner]);
        let what =
            format!("face {face} uses vertex {bad}, the file has {count} vertices (numbers start at 0)");
        return Err(Error::format(path, first_face.map(|line| line + face), what));
    }
    Ok(soup)
}

struct File<'a> {
    path: &'a Path,
    reader: Reader<&'a [u8]>,
}

impl File<'_> {
    fn read<E: PropertyAccess>(&mut self, element: &ElementDef, header: &Header) -> Result<Vec<E>> {
        let read = Parser::<E>::new().read_payload_for_element(&mut self.reader, element, header);
        read.map_err(|e| self.wrong(&e))
    }

    fn wrong(&self, error: &ParseError) -> Error {
        // The message of the parser quotes the line, which may be long and contain any bytes.
        let text = error.to_string();
        let what = quote(&text.split_whitespace().collect::<Vec<_>>().join(" "));
        Error::format(self.path, error.line(), format!("not a usable PLY file: {what}"))
    }
}

/// An element takes at least one byte: a larger count than the size of the file is invalid and would take long.
fn check_counts(path: &Path, header: &Header, bytes: usize) -> Result<()> {
    for (name, element) in &header.elements {
        if element.count > bytes {
            let what = format!(
                "{} `{}` cannot fit into {bytes} bytes: the file is damaged",
                element.count,
                quote(name)
            );
            return Err(Error::format(path, None, what));
        }
    }
    Ok(())
}

struct Vertex(DVec3);
struct Face(Vec<u32>);
struct Skipped;

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex(DVec3::ZERO)
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => &mut self.0.x,
            "y" => &mut self.0.y,
            "z" => &mut self.0.z,
            _ => return PropertyAccessResult::Ignored,
        };
        *axis = match property {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            // A list is not a coordinate; the check for finite values reports it.
            _ => f64::NAN,
        };
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Face(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        // A negative or fractional index becomes an invalid one.
        let of = |v: i64| u32::try_from(v).unwrap_or(u32::MAX);
        self.0 = match property {
            Property::ListChar(v) => v.into_iter().map(|v| of(v.into())).collect(),
            Property::ListUChar(v) => v.into_iter().map(u32::from).collect(),
            Property::ListShort(v) => v.into_iter().map(|v| of(v.into())).collect(),
            Property::ListUShort(v) => v.into_iter().map(u32::from).collect(),
            Property::ListInt(v) => v.into_iter().map(|v| of(v.into())).collect(),
            Property::ListUInt(v) => v,
            _ => vec![u32::MAX],
        };
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Skipped
    }

    fn set_property(&mut self, _: &str, _: Property) -> PropertyAccessResult {
        PropertyAccessResult::Ignored
    }
}
