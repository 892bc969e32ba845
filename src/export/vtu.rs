//! VTK's unstructured grid, for ParaView.

use crate::radiosity::mesh::RadiosityMesh;
use crate::scene::Scene;
use crate::{Error, Result, files::WholeFile};
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

/// A list of texts, each ended by a zero byte; `components` is their number.
fn names<'a>(name: &'static str, texts: impl Iterator<Item = &'a String>) -> Array {
    let (mut bytes, mut count) = (Vec::new(), 0);
    for text in texts {
        bytes.extend(text.bytes().filter(|&b| b != 0).chain([0]));
        count += 1;
    }
    Array { name, kind: "String", components: count, bytes }
}

/// Writes the elements as cells of a `.vtu` file with the fields `irradiance`, `radiosity`, `error` (standard error
/// of the irradiance), all W/m² RGB; `level` (number of splits), `links`, `area`, `object`, `material`, `triangle`,
/// `front`. `object` and `material` are indices into the lists `object_names` and `material_names` of the file.
/// Coordinates are those of the scene's file.
///
/// # Errors
/// The file cannot be written.
pub fn write_vtu(path: &Path, solution: &RadiosityMesh, scene: &Scene) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    write(&mut file, solution, scene).map_err(|e| Error::io(path, e))?;
    file.commit()
}

fn write(out: &mut impl Write, s: &RadiosityMesh, scene: &Scene) -> std::io::Result<()> {
    let points: Vec<[f64; 3]> = s.vertices.iter().map(|p| (s.origin + p.as_dvec3()).to_array()).collect();
    let size = |e: &crate::radiosity::mesh::Element| if e.is_triangle() { 3 } else { 4 };
    let connectivity: Vec<u32> = s.elements.iter().flat_map(|e| e.corners[..size(e)].to_vec()).collect();
    let mut end = 0u64;
    let offsets: Vec<u64> = s
        .elements
        .iter()
        .map(|e| {
            end += size(e) as u64;
            end
        })
        .collect();
    let types: Vec<u8> = s.elements.iter().map(|e| if e.is_triangle() { TRIANGLE } else { QUAD }).collect();
    let light = |name, of: fn(&crate::radiosity::mesh::Element) -> [f64; 3]| {
        let values: Vec<[f32; 3]> = s.elements.iter().map(|e| of(e).map(|x| x as f32)).collect();
        array(name, "Float32", 3, &values)
    };
    let count = |name, of: fn(&crate::radiosity::mesh::Element) -> u32| {
        array(name, "UInt32", 1, &s.elements.iter().map(of).collect::<Vec<_>>())
    };
    let places = [array("points", "Float64", 3, &points)];
    let cells = [
        array("connectivity", "UInt32", 1, &connectivity),
        array("offsets", "UInt64", 1, &offsets),
        array("types", "UInt8", 1, &types),
    ];
    let fields = [
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
    ];
    let names = [
        names("object_names", scene.objects.iter().map(|o| &o.name)),
        names("material_names", scene.materials.iter().map(|m| &m.name)),
    ];
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(
        out,
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">"
    )?;
    writeln!(out, "<UnstructuredGrid>")?;
    let mut at = 0;
    writeln!(out, "<FieldData>")?;
    for a in &names {
        writeln!(
            out,
            "<DataArray type=\"{}\" Name=\"{}\" NumberOfTuples=\"{}\" format=\"appended\" offset=\"{at}\"/>",
            a.kind, a.name, a.components
        )?;
        at += 8 + a.bytes.len();
    }
    writeln!(out, "</FieldData>")?;
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
    for a in names.iter().chain(&places).chain(&cells).chain(&fields) {
        out.write_all(&(a.bytes.len() as u64).to_le_bytes())?;
        out.write_all(&a.bytes)?;
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")
}
