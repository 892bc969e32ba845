//! VTK's unstructured grid, for ParaView.

use super::write_file;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::scene::{Photometry, Scene};
use crate::{Result, progress::Progress};
use std::io::Write;
use std::path::Path;

/// Cell types of VTK.
const TRIANGLE: u8 = 5;
const QUAD: u8 = 9;

/// A named array: type, components, bytes.
struct Array {
    name: &'static str,
    kind: &'static str,
    components: usize,
    bytes: Vec<u8>,
}

fn array<T: bytemuck::NoUninit>(
    name: &'static str,
    kind: &'static str,
    components: usize,
    values: &[T],
) -> Array {
    Array { name, kind, components, bytes: bytemuck::cast_slice(values).to_vec() }
}

/// A text in an attribute of XML, without characters that XML cannot hold.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars().filter(|c| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}')) {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
    }
    out
}

/// Writes the elements as cells of a `.vtu` file with the fields `irradiance`, `radiosity`, `error` (standard error
/// of the irradiance), all W/m² RGB; `level` (number of splits), `links`, `area`, `object`, `material`, `triangle`,
/// `front`; in scenes with placed meshes `instance` and `id` as well. The components of the fields `object_names` and
/// `material_names` of the whole file have the names that the indices `object` and `material` stand for. With photometry the
/// fields `illuminance` (lx) and `luminance` (cd/m²) as well. Coordinates are those of the scene's file.
///
/// # Errors
/// The file cannot be written, or `progress` has stopped.
pub fn write_vtu(
    path: &Path,
    solution: &RadiosityMesh,
    scene: &Scene,
    photometry: Option<Photometry>,
    progress: &dyn Progress,
) -> Result<()> {
    write_file(path, progress, |out| write(out, solution, scene, photometry))
}

/// The names of objects and materials, as fields of the whole file.
fn write_names(out: &mut impl Write, scene: &Scene) -> std::io::Result<()> {
    // Lists of texts are not known to all programs; names of components are, or are ignored.
    let names: [(&str, Vec<&String>); 2] = [
        ("object_names", scene.objects.iter().map(|o| &o.name).collect()),
        ("material_names", scene.materials.iter().map(|m| &m.name).collect()),
    ];
    writeln!(out, "<FieldData>")?;
    for (name, list) in names {
        write!(
            out,
            "<DataArray type=\"UInt32\" Name=\"{name}\" NumberOfTuples=\"1\" NumberOfComponents=\"{}\"",
            list.len()
        )?;
        for (i, text) in list.iter().enumerate() {
            write!(out, " ComponentName{i}=\"{}\"", escaped(text))?;
        }
        writeln!(out, " format=\"ascii\">")?;
        let numbers: Vec<String> = (0..list.len()).map(|i| i.to_string()).collect();
        writeln!(out, "{}\n</DataArray>", numbers.join(" "))?;
    }
    writeln!(out, "</FieldData>")
}

/// Illuminance (lx) and luminance (cd/m²) of the elements.
fn photometric_fields(s: &RadiosityMesh, photometry: &Photometry) -> [Array; 2] {
    let of = |light: fn(&Element) -> [f64; 3], divisor: f64| -> Vec<f32> {
        s.elements.iter().map(|e| (photometry.of(light(e)) / divisor) as f32).collect()
    };
    [
        array("illuminance", "Float32", 1, &of(|e| e.irradiance, 1.0)),
        array("luminance", "Float32", 1, &of(|e| e.radiosity, std::f64::consts::PI)),
    ]
}

fn write(
    out: &mut impl Write,
    s: &RadiosityMesh,
    scene: &Scene,
    photometry: Option<Photometry>,
) -> std::io::Result<()> {
    let points: Vec<[f64; 3]> = s.vertices.iter().map(|p| (s.origin + p.as_dvec3()).to_array()).collect();
    let connectivity: Vec<u32> = s.elements.iter().flat_map(Element::outline).copied().collect();
    let mut end = 0u64;
    let mut end_of = |e: &Element| {
        end += e.outline().len() as u64;
        end
    };
    let offsets: Vec<u64> = s.elements.iter().map(&mut end_of).collect();
    let types: Vec<u8> = s.elements.iter().map(|e| if e.is_triangle() { TRIANGLE } else { QUAD }).collect();
    let light = |name, of: fn(&Element) -> [f64; 3]| {
        let values: Vec<[f32; 3]> = s.elements.iter().map(|e| of(e).map(|x| x as f32)).collect();
        array(name, "Float32", 3, &values)
    };
    let count = |name, of: fn(&Element) -> u32| {
        array(name, "UInt32", 1, &s.elements.iter().map(of).collect::<Vec<_>>())
    };
    let lit: Vec<u8> = (0..s.elements.len()).map(|e| u8::from(e < s.lit())).collect();
    let places = [array("points", "Float64", 3, &points)];
    let cells = [
        array("connectivity", "UInt32", 1, &connectivity),
        array("offsets", "UInt64", 1, &offsets),
        array("types", "UInt8", 1, &types),
    ];
    let mut fields = vec![
        light("irradiance", |e| e.irradiance),
        light("radiosity", |e| e.radiosity),
        light("error", |e| e.error),
        count("level", |e| e.level.into()),
        count("links", |e| e.links),
        array("area", "Float64", 1, &s.elements.iter().map(|e| e.area).collect::<Vec<_>>()),
        count("object", |e| e.object),
        count("material", |e| e.material),
        count("triangle", |e| e.triangle),
        count("front", |e| e.front.into()),
        array("lit", "UInt8", 1, &lit),
    ];
    fields.extend(photometry.iter().flat_map(|photometry| photometric_fields(s, photometry)));
    if !s.instances.is_empty() {
        let instances: Vec<u32> = s.instances.iter().map(|e| e.instance).collect();
        let ids: Vec<u64> = s.instances.iter().map(|e| e.id).collect();
        fields.extend([array("instance", "UInt32", 1, &instances), array("id", "UInt64", 1, &ids)]);
    }
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(
        out,
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">"
    )?;
    writeln!(out, "<UnstructuredGrid>")?;
    let mut at = 0;
    write_names(out, scene)?;
    writeln!(out, "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">", points.len(), s.elements.len())?;
    for (section, arrays) in [("Points", &places[..]), ("Cells", &cells), ("CellData", &fields)] {
        writeln!(out, "<{section}>")?;
        for a in arrays {
            writeln!(
                out,
                "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"{at}\"/>",
                a.kind, a.name, a.components
            )?;
            at += 8 + a.bytes.len();
        }
        writeln!(out, "</{section}>")?;
    }
    write!(out, "</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_")?;
    for a in places.iter().chain(&cells).chain(&fields) {
        out.write_all(&(a.bytes.len() as u64).to_le_bytes())?;
        out.write_all(&a.bytes)?;
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")
}
