//! Output of a soup as OBJ and MTL.

use super::Soup;
use crate::{Error, Result, error::shown, files::WholeFile};
use std::{
    io::Write,
    path::{Path, PathBuf},
};

/// The material library that belongs to an OBJ file: the same name with the extension `mtl`.
pub fn mtl_path(obj: &Path) -> PathBuf {
    obj.with_extension("mtl")
}

/// Writes `soup` to the OBJ file `path` and its materials to [`mtl_path`], with `comments` at the top of both.
/// Textures are not written. Both files are written completely or not at all.
///
/// # Errors
/// The files cannot be written.
pub fn write_obj(path: &Path, soup: &Soup, comments: &[&str]) -> Result<()> {
    if path.file_name().is_none() || path.extension().is_some_and(|e| e == "mtl") {
        return Err(Error::argument("path", shown(path), "the name of an .obj file is needed"));
    }
    let library = mtl_path(path);
    let (mut mtl, mut obj) = (WholeFile::create(&library)?, WholeFile::create(path)?);
    materials(&mut mtl, soup, comments).map_err(|e| Error::io(&library, e))?;
    let name = library.file_name().unwrap_or_default().to_string_lossy();
    faces(&mut obj, soup, comments, &name).map_err(|e| Error::io(path, e))?;
    mtl.commit()?;
    obj.commit()
}

fn head(out: &mut impl Write, comments: &[&str]) -> std::io::Result<()> {
    comments.iter().flat_map(|c| c.lines()).try_for_each(|line| writeln!(out, "# {line}"))
}

fn materials(out: &mut impl Write, soup: &Soup, comments: &[&str]) -> std::io::Result<()> {
    head(out, comments)?;
    for m in &soup.materials {
        writeln!(out, "\nnewmtl {}", m.name)?;
        let [r, g, b] = m.reflectance;
        writeln!(out, "Kd {r} {g} {b}")?;
        if m.emission != [0.0; 3] {
            let [r, g, b] = m.emission;
            writeln!(out, "Ke {r} {g} {b}")?;
        }
        if m.opacity < 1.0 {
            writeln!(out, "d {}", m.opacity)?;
        }
    }
    Ok(())
}

fn faces(out: &mut impl Write, soup: &Soup, comments: &[&str], library: &str) -> std::io::Result<()> {
    head(out, comments)?;
    writeln!(out, "mtllib {library}")?;
    for p in &soup.positions {
        // The shortest decimal number that parses to the same f32.
        let single = p.as_vec3();
        if single.as_dvec3() == *p {
            writeln!(out, "v {} {} {}", single.x, single.y, single.z)?;
        } else {
            writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
        }
    }
    let (mut object, mut material) = (u32::MAX, u32::MAX);
    for i in 0..soup.polygons() {
        if soup.polygon_object[i] != object {
            object = soup.polygon_object[i];
            writeln!(out, "o {}", soup.objects[object as usize])?;
        }
        if soup.polygon_material[i] != material {
            material = soup.polygon_material[i];
            writeln!(out, "usemtl {}", soup.materials[material as usize].name)?;
        }
        out.write_all(b"f")?;
        for &v in &soup.corners[soup.span(i)] {
            write!(out, " {}", v + 1)?;
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}
