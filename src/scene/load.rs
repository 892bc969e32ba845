//! Loading of scene files.

use super::{
    LoadOptions, Scene, UpAxis, read_gltf, read_grid, read_obj, read_ply, resolve, sources::Sources,
    unit_in_metres,
};
use crate::files::input::{guarded, is_standard_input};
use crate::threads::Threads;
use crate::{Error, Result, error::quote};
use std::{
    io::{BufReader, Read},
    path::Path,
};

/// Number of bytes from which the format of a scene without an extension is found: it may begin with as many blanks.
const FORMAT_PROBE_BYTES: u64 = 1 << 16;

impl Scene {
    /// Reads a scene with default options: metres, emission as the file has it; see [`Scene::load_with`].
    ///
    /// # Errors
    /// As for [`Scene::load_with`].
    pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
        Scene::load_with(path, &LoadOptions::default())
    }

    /// Loads a scene; the extension of `path` selects the format: `obj`, `gltf`, `glb` or `ply`, or of a height field `asc`
    /// (ESRI ASCII grid), `tif` (GeoTIFF, with the feature `geotiff` of the crate), `png`, `npy` or `npz`.
    ///
    /// Nodes of a glTF file that place the same mesh share it, unless the mesh emits or a
    /// node's transform is more than 1 % off a similarity. A glTF file may have at most 2,097,152 nodes.
    ///
    /// # Errors
    /// The file cannot be read, has a wrong format, contains a value that is not finite or out of range, or has no
    /// face with an area; an emitter of the options does not exist; an option is out of range. Repairable defects are repaired and
    /// listed by [`Scene::repairs`].
    pub fn load_with(path: impl AsRef<Path>, options: &LoadOptions) -> Result<Scene> {
        let path = path.as_ref();
        if let Some(sides) = options.sides.filter(|sides| !(1..=2).contains(sides)) {
            return Err(Error::argument("sides", sides, "must be 1 or 2"));
        }
        Threads::new(options.threads)?.run(|| guarded(path, || read(path, options)))?
    }

    /// Reads a scene from the bytes of a file. `format` is `obj`, `gltf`, `glb` or `ply`. Files that it names (material libraries,
    /// textures, buffers) are looked for from `folder`, as for a file that lies there.
    ///
    /// # Errors
    /// As for [`Scene::load_with`]; [`Error::Argument`] for another format, or if the scene names a file and there is no `folder`.
    pub fn from_memory(
        data: &[u8],
        format: &str,
        folder: Option<&Path>,
        options: &LoadOptions,
    ) -> Result<Scene> {
        if !["obj", "gltf", "glb", "ply"].contains(&format) {
            return Err(Error::argument("format", quote(format), "must be obj, gltf, glb or ply"));
        }
        Threads::new(options.threads)?.run(|| read_from_memory(folder, format, data, options))?
    }
}

/// Reads a scene on the threads of the caller.
fn read(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let mut sources = Sources::new(options.max_memory);
    let stem = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_grid = read_grid::EXTENSIONS.contains(&stem.as_str());
    let upright = LoadOptions { up: Some(UpAxis::Z), ..options.clone() };
    let options = if is_grid || options.added.has_grid {
        check_grid(options)?;
        &upright
    } else {
        options
    };
    let mut scene = if is_standard_input(path) {
        let stream = sources.open(path)?;
        read_stream(path, stream, &mut sources, options)?
    } else {
        match stem.as_str() {
            "obj" => {
                let file = BufReader::with_capacity(1 << 20, sources.open(path)?);
                resolve(read_obj::read(path, file, &mut sources)?, options)?
            }
            "gltf" | "glb" | "ply" => {
                if stem != "ply" {
                    check_gltf(path, options)?;
                }
                let bytes = sources.bytes(path)?;
                read_bytes(path, &stem, &bytes, &mut sources, options)?
            }
            _ if is_grid => {
                sources.read.insert(path.to_owned());
                resolve(read_grid::read(path, &options.grid)?, options)?
            }
            _ => {
                let what = "unknown kind of scene; the extension must be .obj, .gltf, .glb, .ply, or for a height field .asc, .tif, .png, \
                            .npy or .npz";
                // A wrong path is more likely than an unknown format.
                std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
                return Err(Error::format(path, None, what));
            }
        }
    };
    (scene.files, scene.unread_files) = sources.lists();
    scene.files.extend(options.luminaires.files.iter().chain(&options.added.files).cloned());
    Ok(scene)
}

/// Refuses another unit and another upward axis than those of height fields.
fn check_grid(options: &LoadOptions) -> Result<()> {
    let what = match () {
        () if options.up == Some(UpAxis::Y) => {
            "height fields have the upward axis z: leave ⟨up⟩ out, and turn other files"
        }
        () if unit_in_metres(&options.unit).is_some_and(|metres| metres != 1.0) => {
            "height fields are in metres: leave ⟨unit⟩ out, and convert other files to metres"
        }
        () => return Ok(()),
    };
    Err(Error::arguments(what.into()))
}

/// Refuses what glTF files have no place for.
fn check_gltf(path: &Path, options: &LoadOptions) -> Result<()> {
    match options.curvature {
        Some(_) => {
            let what = "the earth does not curve below glTF files: convert it to .obj";
            Err(Error::format(path, None, what))
        }
        None => Ok(()),
    }
}

/// Reads a scene without an extension, of which `path` is the name. OBJ is checked while it is read, so that what is no scene is not
/// read to its end.
fn read_stream(
    path: &Path,
    mut stream: impl Read,
    sources: &mut Sources,
    options: &LoadOptions,
) -> Result<Scene> {
    let wrong = |e| Error::io(path, e);
    let mut start = Vec::new();
    stream.by_ref().take(FORMAT_PROBE_BYTES).read_to_end(&mut start).map_err(wrong)?;
    let format = format_of(&start);
    if format == "obj" {
        let file = BufReader::with_capacity(1 << 20, start.as_slice().chain(stream));
        return resolve(read_obj::read(path, file, sources)?, options);
    }
    stream.read_to_end(&mut start).map_err(wrong)?;
    read_bytes(path, format, &start, sources, options)
}

/// Reads a scene from memory; `path` is its name, from which other files are found.
fn read_bytes(
    path: &Path,
    format: &str,
    bytes: &[u8],
    sources: &mut Sources,
    options: &LoadOptions,
) -> Result<Scene> {
    match format {
        "gltf" | "glb" => read_gltf::read(path, bytes, sources, options),
        "ply" => resolve(read_ply::read(path, bytes)?, options),
        _ => resolve(read_obj::read(path, bytes, sources)?, options),
    }
}

/// [`Scene::from_memory`] on the threads of the caller, for a format that is known.
///
/// # Errors
/// As for [`Scene::from_memory`].
pub fn read_from_memory(
    folder: Option<&Path>,
    format: &str,
    bytes: &[u8],
    options: &LoadOptions,
) -> Result<Scene> {
    let mut sources = Sources::new(options.max_memory);
    sources.is_closed = folder.is_none();
    // Beside an empty path the name `-` would be standard input.
    let folder = folder.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
    let path = folder.unwrap_or(Path::new("")).join("memory").with_extension(format);
    let mut scene = guarded(&path, || read_bytes(&path, format, bytes, &mut sources, options))?;
    (scene.files, scene.unread_files) = sources.lists();
    scene.files.extend(options.luminaires.files.iter().cloned());
    Ok(scene)
}

/// Format of a scene without a name, by its first characters.
fn format_of(bytes: &[u8]) -> &'static str {
    let start = bytes.trim_ascii_start();
    match start {
        _ if bytes.starts_with(b"glTF") => "glb",
        _ if start.starts_with(b"{") => "gltf",
        _ if start.starts_with(b"ply") => "ply",
        _ => "obj",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream that fails after `left` zeros.
    struct FailingZeros {
        left: usize,
    }

    impl Read for FailingZeros {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            self.left = self.left.checked_sub(buffer.len()).ok_or(std::io::Error::other("read too far"))?;
            buffer.fill(0);
            Ok(buffer.len())
        }
    }

    #[test]
    fn streams_without_lines_are_not_read_to_their_end() {
        // A line may have 256 MiB.
        let stream = FailingZeros { left: (256 << 20) + (2 << 20) };
        let error = read_stream(Path::new("-"), stream, &mut Sources::new(None), &LoadOptions::default());
        let message = error.expect_err("no scene").to_string();
        assert!(message.contains("line of more than 268435456 bytes"), "{message}");
    }

    #[test]
    fn streams_of_all_formats_are_read() {
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let long = format!("{}{obj}", "\n".repeat(3 << 16));
        for text in [obj, ply, &long] {
            let mut sources = Sources::new(None);
            let scene = read_stream(Path::new("-"), text.as_bytes(), &mut sources, &LoadOptions::default());
            assert_eq!(scene.expect("a scene").triangle_count(), 1);
        }
    }
}
