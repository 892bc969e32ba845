//! The side table of a scene, kept in a file so that the next run need not measure the clusters again.
//!
//! A file is believed only if its key says that it was made from this geometry, with these options, by this code, and
//! only if its checksum is right. Anything else (of another version, cut off, damaged, somebody else's) is made again
//! and replaced. It is written whole or not at all, so that runs at the same time do not disturb each other.
//!
//! Layout: `MAGIC`, the key, the table by `postcard`, the BLAKE3 hash of all that. The key holds a fingerprint of the
//! source code that measures (see `build.rs`), so that nobody has to count up a version when a field or a formula
//! changes.

#[cfg(test)]
mod tests;

use crate::clusters::{self, Hierarchy};
use crate::files::WholeFile;
use crate::optics::{self, ClusterOptics};
use crate::scene::Scene;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 16] = b"mrvis side table";
const HASH: usize = blake3::OUT_LEN;
/// The extension of the files.
const EXTENSION: &str = "mrvis-cache";
/// This version, and what the table is made by.
const CODE: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("MRVIS_TABLE_CODE"));

/// Where tables are kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CacheLocation {
    /// Nowhere: the table is made anew.
    #[default]
    Off,
    /// In the scene's folder.
    Beside,
    /// In this folder, which is made if it is missing.
    Folder(PathBuf),
}

/// What the table depends on besides the scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// How clusters are made.
    pub clusters: clusters::Options,
    /// How they are measured.
    pub optics: optics::Options,
}

/// The clusters of a scene and what they do to light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PreparedClusters {
    /// The clusters.
    pub hierarchy: Hierarchy,
    /// One entry a cluster of `hierarchy.micro`.
    pub optics: Vec<ClusterOptics>,
}

/// Where a table came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// Made, and not kept.
    #[default]
    Off,
    /// Made, and kept for the next run.
    Made,
    /// Read from a file.
    Hit,
}

impl Origin {
    /// The word in reports: `off`, `made` or `hit`.
    pub fn name(self) -> &'static str {
        match self {
            Origin::Off => "off",
            Origin::Made => "made",
            Origin::Hit => "hit",
        }
    }
}

/// The table of a scene: from its cache file if that can be believed, else from `make`, and then kept.
///
/// Beside the table and where it came from there is a sentence where the user should know something: a file was
/// replaced, or could not be written. None of that is an error: the table is right in any case.
pub fn load_or_make(
    scene: &Scene,
    place: &CacheLocation,
    options: &Options,
    make: impl FnOnce() -> PreparedClusters,
) -> (PreparedClusters, Origin, Option<String>) {
    let settings = format!("{options:?}");
    let Some(path) = path(&scene.path, place, &settings) else { return (make(), Origin::Off, None) };
    let key = key(scene, &settings, CODE);
    let mut note = match load(&path, &key, scene) {
        Ok(table) => return (table, Origin::Hit, None),
        Err(Unusable::Missing) => None,
        Err(Unusable::Other) => Some(format!(
            "{}: made for another state of the scene or by another version; made again",
            path.display()
        )),
        Err(Unusable::Damaged) => Some(format!("{}: damaged; made again", path.display())),
    };
    let table = make();
    let origin = match save(&path, &key, &table) {
        Ok(()) => Origin::Made,
        Err(error) => {
            note = Some(format!("the clusters could not be kept for the next run: {error}"));
            Origin::Off
        }
    };
    (table, origin, note)
}

/// The table of a scene if it is kept and can be believed.
pub fn find(scene: &Scene, place: &CacheLocation, options: &Options) -> Option<PreparedClusters> {
    let settings = format!("{options:?}");
    load(&path(&scene.path, place, &settings)?, &key(scene, &settings, CODE), scene).ok()
}

/// The file of a scene: one for each set of options, so that files do not pile up while a scene is edited.
fn path(scene: &Path, place: &CacheLocation, settings: &str) -> Option<PathBuf> {
    let mut name = scene.file_name()?.to_os_string();
    let mut digest = blake3::Hasher::new();
    digest.update(settings.as_bytes());
    if let CacheLocation::Folder(_) = place {
        // Scenes of the same name from different folders.
        let full = scene.canonicalize().unwrap_or_else(|_| scene.to_owned());
        digest.update(full.as_os_str().as_encoded_bytes());
    }
    name.push(format!(".{}.{EXTENSION}", &digest.finalize().to_hex()[..8]));
    match place {
        CacheLocation::Off => None,
        CacheLocation::Beside => Some(scene.with_file_name(name)),
        CacheLocation::Folder(folder) => Some(folder.join(name)),
    }
}

/// What a table is made from: geometry, options, code.
fn key(scene: &Scene, settings: &str, code: &str) -> blake3::Hash {
    // All fields are named, so that a new one has to be thought about here.
    let Scene {
        positions,
        triangles,
        triangle_object,
        triangle_sides,
        triangle_component,
        // Follows from the positions.
        bounds: _,
        // Clusters do not know what their faces look like; `tests/suite/tidy.rs` makes sure of it.
        triangle_material: _,
        triangle_polygon: _,
        cameras: _,
        triangle_reflectance: _,
        triangle_emitter: _,
        triangle_texcoords: _,
        materials: _,
        emitters: _,
        objects: _,
        two_sided_emission: _,
        path: _,
        unit: _,
        origin: _,
        closed_parts: _,
        sheet_parts: _,
        repairs: _,
        // Each shared mesh has a table and a key of its own.
        shared: _,
        placements: _,
    } = scene;
    let mut hash = blake3::Hasher::new();
    let parts: [&[u8]; 7] = [
        code.as_bytes(),
        settings.as_bytes(),
        bytemuck::cast_slice(positions),
        bytemuck::cast_slice(triangles),
        bytemuck::cast_slice(triangle_object),
        bytemuck::cast_slice(triangle_component),
        triangle_sides,
    ];
    for part in parts {
        hash.update(&(part.len() as u64).to_le_bytes()).update_rayon(part);
    }
    hash.finalize()
}

/// Why a file is of no use.
enum Unusable {
    /// There is none.
    Missing,
    /// It is no table of this scene, these options and this code.
    Other,
    /// It says that it is, and is not whole.
    Damaged,
}

fn load(path: &Path, key: &blake3::Hash, scene: &Scene) -> std::result::Result<PreparedClusters, Unusable> {
    // Pipes and devices are not waited for.
    let about = std::fs::metadata(path).map_err(|_| Unusable::Missing)?;
    if !about.is_file() {
        return Err(Unusable::Other);
    }
    let mut file = std::fs::File::open(path).map_err(|_| Unusable::Missing)?;
    let mut head = [0; MAGIC.len() + HASH];
    file.read_exact(&mut head).map_err(|_| Unusable::Damaged)?;
    if head[..MAGIC.len()] != MAGIC[..] || head[MAGIC.len()..] != key.as_bytes()[..] {
        return Err(Unusable::Other);
    }
    // A tree has fewer than twice as many clusters as leaves; numbers take five bytes at most where they have four.
    let cluster = size_of::<clusters::Cluster>() + size_of::<ClusterOptics>() + size_of::<u32>();
    let most = (scene.triangles.len() as u64 + 1) * (2 * cluster as u64 * 5 / 4) + 4096;
    if about.len() > most {
        return Err(Unusable::Damaged);
    }
    let mut body = Vec::with_capacity(about.len() as usize);
    file.take(most).read_to_end(&mut body).map_err(|_| Unusable::Damaged)?;
    let (payload, sum) = body.split_last_chunk::<HASH>().ok_or(Unusable::Damaged)?;
    let mut hash = blake3::Hasher::new();
    hash.update(&head).update_rayon(payload);
    if hash.finalize() != *sum {
        return Err(Unusable::Damaged);
    }
    let (table, rest) =
        postcard::take_from_bytes::<PreparedClusters>(payload).map_err(|_| Unusable::Damaged)?;
    // The checksum is right, but anybody can compute one: later rooms do not check again.
    let whole = rest.is_empty() && table.optics.len() == table.hierarchy.micro.clusters.len();
    match whole && table.hierarchy.check(scene).is_ok() {
        true => Ok(table),
        false => Err(Unusable::Damaged),
    }
}

fn save(path: &Path, key: &blake3::Hash, table: &PreparedClusters) -> Result<()> {
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    }
    if std::fs::metadata(path).is_ok_and(|about| !about.is_file()) {
        return Err(Error::io(path, io::Error::other("there is something else of this name")));
    }
    let at = |e| Error::io(path, e);
    let summed = Summed { out: WholeFile::create(path)?, hash: blake3::Hasher::new() };
    let mut out = BufWriter::with_capacity(1 << 20, summed);
    out.write_all(MAGIC).and_then(|()| out.write_all(key.as_bytes())).map_err(at)?;
    postcard::to_io(table, &mut out).map_err(|e| at(io::Error::other(e)))?;
    let Summed { mut out, hash } = out.into_inner().map_err(|e| at(e.into_error()))?;
    out.write_all(hash.finalize().as_bytes()).map_err(at)?;
    out.commit()
}

/// Hashes what is written.
struct Summed {
    out: WholeFile,
    hash: blake3::Hasher,
}

impl Write for Summed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.out.write(bytes)?;
        self.hash.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
