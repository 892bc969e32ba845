//! Writing a soup as OBJ and MTL.

use super::Soup;
use crate::{Error, Result};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};
use tempfile::NamedTempFile;

/// The material library that belongs to an OBJ file: the same name with the extension `mtl`.
pub fn mtl_path(obj: &Path) -> PathBuf {
    obj.with_extension("mtl")
}

/// Writes `soup` to the OBJ file `path` and its materials to [`mtl_path`], each line of `comments` on top of
/// both. Textures are not written. Both files appear whole or not at all.
///
/// # Errors
/// The files cannot be written.
pub fn write_obj(path: &Path, soup: &Soup, comments: &[&str]) -> Result<()> {
    if path.file_name().is_none() || path.extension().is_some_and(|e| e == "mtl") {
        return Err(Error::Argument(format!("{}: the name of an .obj file is needed", path.display())));
    }
    let library = mtl_path(path);
    let (mut mtl, mut obj) = (Draft::beside(&library)?, Draft::beside(path)?);
    materials(&mut mtl.out, soup, comments).map_err(|e| Error::io(&library, e))?;
    let name = library.file_name().unwrap_or_default().to_string_lossy();
    faces(&mut obj.out, soup, comments, &name).map_err(|e| Error::io(path, e))?;
    mtl.publish(&library)?;
    obj.publish(path)
}

/// A file being written beside its target.
struct Draft {
    out: BufWriter<NamedTempFile>,
}

impl Draft {
    fn beside(target: &Path) -> Result<Draft> {
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        builder.prefix(".mrvis-");
        // Temporary files are private by default; the result shall be like any other file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder).map_err(|e| Error::io(target, e))?;
        Ok(Draft { out: BufWriter::with_capacity(1 << 20, file) })
    }

    fn publish(self, target: &Path) -> Result<()> {
        let file = self.out.into_inner().map_err(|e| Error::io(target, e.into_error()))?;
        let _: File = file.persist(target).map_err(|e| Error::io(target, e.error))?;
        Ok(())
    }
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
        writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
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
