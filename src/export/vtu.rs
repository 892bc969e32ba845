//! VTK's unstructured grid, for ParaView.

use crate::radiosity::mesh::RadiosityMesh;
use crate::scene::Photometry;
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

/// Writes the elements as cells of a `.vtu` file with the fields `irradiance`, `radiosity`, `error` (standard error
/// of the irradiance), all W/m² RGB; `level` (number of splits), `links`, `area`, `object`, `material`, `triangle`,
/// `front`; in scenes with placed meshes `instance` and `id` as well; with photometry `illuminance` (lx) and `luminance`
/// (cd/m²). Coordinates are those of the scene's file.
///
/// # Errors
/// The file cannot be written.
pub fn write_vtu(path: &Path, solution: &RadiosityMesh, photometry: Option<Photometry>) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    write(&mut file, solution, photometry).map_err(|e| Error::io(path, e))?;
    file.commit()
}

fn write(out: &mut impl Write, s: &RadiosityMesh, photometry: Option<Photometry>) -> std::io::Result<()> {
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
    ];
    if let Some(photometry) = photometry {
        let lit = |of: fn(&crate::radiosity::mesh::Element) -> [f64; 3], divisor: f64| -> Vec<f32> {
            s.elements.iter().map(|e| (photometry.of(of(e)) / divisor) as f32).collect()
        };
        fields.push(array("illuminance", "Float32", 1, &lit(|e| e.irradiance, 1.0)));
        fields.push(array("luminance", "Float32", 1, &lit(|e| e.radiosity, std::f64::consts::PI)));
    }
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
    writeln!(out, "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">", points.len(), s.elements.len())?;
    let mut at = 0;
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
