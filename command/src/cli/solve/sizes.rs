//! Files of feature sizes.

use mrvis::internals::error::{in_words, quote};
use mrvis::internals::files::input;
use mrvis::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads feature sizes by name.
///
/// # Errors
/// The file cannot be read or is no such file.
pub fn read(path: &Path) -> Result<Vec<(String, f32)>> {
    parse(path, &input::read(path, input::MAX_SMALL_FILE)?)
}

/// Feature sizes by name from the content of a file.
///
/// # Errors
/// It is no TOML, or has something else than numbers.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<(String, f32)>> {
    let text = str::from_utf8(bytes).map_err(|_| Error::format(path, None, "not text in UTF-8"))?;
    let sizes: BTreeMap<String, f32> = toml::from_str(text).map_err(|e| {
        let line = e.span().map(|s| 1 + text[..s.start].matches('\n').count());
        Error::format(
            path,
            line,
            format!("{}; write lines like `sofa = 0.05`", quote(&in_words(e.message()))),
        )
    })?;
    Ok(sizes.into_iter().collect())
}
