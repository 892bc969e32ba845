//! PLY files.

use super::{Mesh, Tone, write_file};
use crate::{Result, progress::Progress};
use glam::DVec3;
use std::io::Write;
use std::path::Path;

/// Writes a mesh as binary PLY: vertices with normals, 8-bit colours by `tone`, radiosity and irradiance in W/m²;
/// triangles with their element, the number of the cell in the `.vtu` file. Coordinates are those of the scene's file.
///
/// # Errors
/// The file cannot be written, or `progress` has stopped.
pub fn write_ply(path: &Path, mesh: &Mesh, origin: DVec3, tone: Tone, progress: &dyn Progress) -> Result<()> {
    write_file(path, progress, |out| write(out, mesh, origin, tone))
}

fn write(out: &mut impl Write, mesh: &Mesh, origin: DVec3, tone: Tone) -> std::io::Result<()> {
    // Single precision suffices unless the scene is far from the origin.
    let place = if origin == DVec3::ZERO { "float" } else { "double" };
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment mrvis {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    ["x", "y", "z"].iter().try_for_each(|p| writeln!(out, "property {place} {p}"))?;
    ["nx", "ny", "nz"].iter().try_for_each(|p| writeln!(out, "property float {p}"))?;
    ["red", "green", "blue"].iter().try_for_each(|p| writeln!(out, "property uchar {p}"))?;
    for name in ["radiosity", "irradiance"] {
        ["r", "g", "b"].iter().try_for_each(|c| writeln!(out, "property float {name}_{c}"))?;
    }
    writeln!(
        out,
        "element face {}\nproperty list uchar int vertex_indices\nproperty uint element\nend_header",
        mesh.triangles.len()
    )?;
    for (i, p) in mesh.positions.iter().enumerate() {
        if origin == DVec3::ZERO {
            floats(out, p.to_array())?;
        } else {
            (origin + p.as_dvec3()).to_array().iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        floats(out, mesh.normals[i].to_array())?;
        out.write_all(&tone.srgb(mesh.radiosity[i]))?;
        floats(out, mesh.radiosity[i])?;
        floats(out, mesh.irradiance[i])?;
    }
    for (t, element) in mesh.triangles.iter().zip(&mesh.element) {
        out.write_all(&[3])?;
        t.iter().chain([element]).try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
    }
    Ok(())
}

fn floats(out: &mut impl Write, values: [f32; 3]) -> std::io::Result<()> {
    values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
