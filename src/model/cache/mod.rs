//! Cache files of clusters and cluster optics.
//!
//! The name of a file is the hash of geometry, options and source code, so that one folder serves all scenes. A file is
//! used only if it is a regular file, its key and checksum are correct, and every number lies in its range; otherwise it
//! is replaced. That protects against damage. Somebody who may write into the folder can still change answers: cache
//! files are trusted as programs are. Files are written completely or not at all, so that concurrent runs do not disturb
//! each other; the oldest are removed when all together exceed [`MAX_FOLDER`].
//!
//! Layout: `MAGIC`, key, [`PreparedClusters`] in the `postcard` format, BLAKE3 hash of all these bytes. The key contains a hash of the
//! source code that measures clusters (see `build.rs`), so that no version number has to be maintained.

#[cfg(test)]
mod tests;

use crate::clusters::{self, Hierarchy};
use crate::files::{WholeFile, input::Input};
use crate::optics::{self, ClusterOptics};
use crate::scene::Scene;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// First bytes of a cache file.
const MAGIC: &[u8; 16] = b"mrvis side table";
/// Bytes of a hash.
const HASH: usize = blake3::OUT_LEN;
/// File name extension of cache files.
const EXTENSION: &str = "mrvis-cache";
/// Size of all cache files of a folder beyond which the oldest are removed, bytes. A forest of 10 million triangles takes
/// 0.6 GB.
const MAX_FOLDER: u64 = 4 << 30;
/// Version of the crate and hash of the code that measures clusters.
const CODE: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("MRVIS_TABLE_CODE"));

/// Location of cache files.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CacheLocation {
    /// No cache.
    #[default]
    Off,
    /// This folder, created if missing.
    Folder(PathBuf),
}

impl CacheLocation {
    /// The folder, if there is one.
    pub fn folder(&self) -> Option<PathBuf> {
        match self {
            CacheLocation::Off => None,
            CacheLocation::Folder(folder) => Some(folder.clone()),
        }
    }
}

/// Options that the prepared clusters depend on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Options of clustering.
    pub clusters: clusters::Options,
    /// Options of cluster optics.
    pub optics: optics::Options,
}

/// Clusters of a scene and their optics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PreparedClusters {
    /// The clusters.
    pub hierarchy: Hierarchy,
    /// One entry per cluster of `hierarchy.micro`.
    pub optics: Vec<ClusterOptics>,
}

/// Origin of prepared clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// Made, not cached.
    #[default]
    Off,
    /// Made and cached.
    Made,
    /// Read from a cache file.
    Hit,
}

impl Origin {
    /// Name in reports: `off`, `made` or `hit`.
    pub fn name(self) -> &'static str {
        match self {
            Origin::Off => "off",
            Origin::Made => "made",
            Origin::Hit => "hit",
        }
    }
}

/// Prepared clusters of a scene, from the cache file if it is valid; otherwise from `make`, which are then cached. None if `make` makes
/// none.
///
/// Also returns the origin, and a note for the user if a file was replaced or could not be written. Neither is an
/// error, because the clusters are correct in any case.
pub fn load_or_make(
    scene: &Scene,
    place: &CacheLocation,
    options: &Options,
    make: impl FnOnce() -> Option<PreparedClusters>,
) -> Option<(PreparedClusters, Origin, Option<String>)> {
    let settings = format!("{options:?}");
    let CacheLocation::Folder(folder) = place else { return Some((make()?, Origin::Off, None)) };
    let key = key(scene, &settings, CODE);
    let path = path(folder, &key);
    let mut note = match load(&path, &key, scene) {
        Ok(table) => return Some((table, Origin::Hit, None)),
        Err(Unusable::Missing) => None,
        Err(Unusable::Other) => Some(format!("{}: not the file of this scene; made again", path.display())),
        Err(Unusable::Damaged) => Some(format!("{}: damaged; made again", path.display())),
    };
    let table = make()?;
    let origin = match save(&path, &key, &table) {
        Ok(()) => Origin::Made,
        Err(error) => {
            note = Some(format!(
                "the clusters could not be kept in the cache, so that the next run makes them again: {error}"
            ));
            Origin::Off
        }
    };
    Some((table, origin, note))
}

/// Prepared clusters of a scene if a valid cache file exists.
pub fn find(scene: &Scene, place: &CacheLocation, options: &Options) -> Option<PreparedClusters> {
    let settings = format!("{options:?}");
    let CacheLocation::Folder(folder) = place else { return None };
    let key = key(scene, &settings, CODE);
    load(&path(folder, &key), &key, scene).ok()
}

/// Path of the cache file with this key.
fn path(folder: &Path, key: &blake3::Hash) -> PathBuf {
    folder.join(format!("{}.{EXTENSION}", &key.to_hex()[..32]))
}

/// Hash of geometry, options and code.
fn key(scene: &Scene, settings: &str, code: &str) -> blake3::Hash {
    // All fields are named, so that a new field does not compile before it is considered here.
    let Scene {
        positions,
        triangles,
        triangle_object,
        triangle_sides,
        triangle_component,
        // Follows from `positions`.
        bounds: _,
        stack_moves: _,
        wound_parts: _,
        // Clusters do not depend on materials; `tests/suite/tidy.rs` checks this.
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
        up: _,
        path: _,
        unit: _,
        origin: _,
        closed_parts: _,
        sheet_parts: _,
        repairs: _,
        files: _,
        unread_files: _,
        curved: _,
        fine_ground: _,
        // Each shared mesh has a cache file of its own.
        shared: _,
        placements: _,
        environment: _,
        suns: _,
        instances: _,
        contacts: _,
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

/// Reason why a cache file is not used.
enum Unusable {
    /// The file does not exist.
    Missing,
    /// The file belongs to another scene, other options or other code, or is none.
    Other,
    /// The key matches, but the content is invalid.
    Damaged,
}

fn load(path: &Path, key: &blake3::Hash, scene: &Scene) -> std::result::Result<PreparedClusters, Unusable> {
    // Reading a pipe or device could block, and a link may lead anywhere.
    let about = std::fs::symlink_metadata(path).map_err(|_| Unusable::Missing)?;
    if !about.is_file() {
        return Err(Unusable::Other);
    }
    let mut file = Input::open(path, u64::MAX >> 1).map_err(|_| Unusable::Missing)?;
    let mut head = [0; MAGIC.len() + HASH];
    file.read_exact(&mut head).map_err(|_| Unusable::Damaged)?;
    if head[..MAGIC.len()] != MAGIC[..] || head[MAGIC.len()..] != key.as_bytes()[..] {
        return Err(Unusable::Other);
    }
    // A tree has fewer than twice as many clusters as leaves; numbers of four bytes take at most five in `postcard`.
    let cluster = size_of::<clusters::Cluster>() + size_of::<ClusterOptics>() + size_of::<u32>();
    let limit = (scene.triangles.len() as u64 + 1) * (2 * cluster as u64 * 5 / 4) + 4096;
    if about.len() > limit {
        return Err(Unusable::Damaged);
    }
    let mut body = Vec::with_capacity(about.len() as usize);
    file.take(limit).read_to_end(&mut body).map_err(|_| Unusable::Damaged)?;
    let (payload, sum) = body.split_last_chunk::<HASH>().ok_or(Unusable::Damaged)?;
    let mut hash = blake3::Hasher::new();
    hash.update(&head).update_rayon(payload);
    if hash.finalize() != *sum {
        return Err(Unusable::Damaged);
    }
    decode(payload, scene).ok_or(Unusable::Damaged)
}

/// The clusters of a scene from the content of a file, if every number of them can be right.
pub fn decode(payload: &[u8], scene: &Scene) -> Option<PreparedClusters> {
    let (table, rest) = postcard::take_from_bytes::<PreparedClusters>(payload).ok()?;
    // A correct checksum does not prove a correct content; later rooms do not check the hierarchy again.
    let whole = rest.is_empty() && table.optics.len() == table.hierarchy.micro.clusters.len();
    // No projection of a cluster is longer than four times the diagonal of the scene.
    let longest = 4.0 * scene.bounds.diagonal();
    let in_range = table.optics.iter().all(|optics| optics.is_in_range(longest));
    (whole && in_range && table.hierarchy.check(scene).is_ok()).then_some(table)
}

/// The content of a file.
pub fn encode(table: &PreparedClusters) -> Option<Vec<u8>> {
    postcard::to_stdvec(table).ok()
}

fn save(path: &Path, key: &blake3::Hash, table: &PreparedClusters) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    if std::fs::symlink_metadata(path).is_ok_and(|about| !about.is_file() && !about.is_symlink()) {
        return Err(Error::io(path, io::Error::other("there is something else of this name")));
    }
    remove_oldest(folder, MAX_FOLDER);
    let at = |e| Error::io(path, e);
    let summed = HashingWriter { out: WholeFile::create(path)?, hash: blake3::Hasher::new() };
    let mut out = BufWriter::with_capacity(1 << 20, summed);
    out.write_all(MAGIC).and_then(|()| out.write_all(key.as_bytes())).map_err(at)?;
    postcard::to_io(table, &mut out).map_err(|e| at(io::Error::other(e)))?;
    let HashingWriter { mut out, hash } = out.into_inner().map_err(|e| at(e.into_error()))?;
    out.write_all(hash.finalize().as_bytes()).map_err(at)?;
    out.commit()
}

/// Removes the oldest cache files of a folder until the others take at most `most` bytes. Files that cannot be removed stay.
fn remove_oldest(folder: &Path, limit: u64) {
    let about = |entry: std::fs::DirEntry| {
        let (path, about) = (entry.path(), entry.metadata().ok()?);
        let ours = about.is_file() && path.extension().is_some_and(|e| e == EXTENSION);
        ours.then_some((about.modified().ok()?, about.len(), path))
    };
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut files: Vec<_> = entries.flatten().filter_map(about).collect();
    files.sort();
    let mut all: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
    for (_, bytes, path) in files {
        if all <= limit {
            break;
        }
        all -= bytes;
        let _ = std::fs::remove_file(path);
    }
}

/// Writer that hashes all bytes.
struct HashingWriter {
    out: WholeFile,
    hash: blake3::Hasher,
}

impl Write for HashingWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.out.write(bytes)?;
        self.hash.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
