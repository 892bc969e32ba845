//! Readers of files, for tests with damaged files: those of the library, and that of feature sizes.

use mrvis::Result;
use mrvis::internals::readers;
use std::path::Path;

pub use mrvis::internals::readers::sample_cache;

/// Names of the readers.
pub const NAMES: [&str; 11] =
    ["obj", "mtl", "ply", "gltf", "glb", "cache", "csv", "toml", "ies", "ldt", "placements"];

/// Reads the content of a file with a reader of [`NAMES`]. Files that it names do not exist.
///
/// # Errors
/// Those of the reader.
pub fn read(reader: &str, bytes: &[u8]) -> Result<()> {
    match reader {
        "toml" => crate::cli::feature_sizes(Path::new("/nonexistent"), bytes).map(drop),
        other => readers::read(other, bytes),
    }
}
