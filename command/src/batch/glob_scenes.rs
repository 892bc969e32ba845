//! Scenes by patterns.

use super::toml_source::{Span, TomlSource};
use mrvis::Result;
use mrvis::internals::error::quote;

/// The scenes of a pattern relative to the job file, in alphabetic order. A path that exists, or without signs of a pattern, is that file; one that names outputs of a job is left as it is.
///
/// # Errors
/// No file matches, or the pattern is invalid.
pub fn scenes(source: &TomlSource, pattern: &str, span: &Span) -> Result<Vec<String>> {
    if pattern.contains("{out:") {
        return Ok(vec![pattern.into()]);
    }
    let folder = source.folder();
    if !pattern.contains(['*', '?', '[']) || folder.join(pattern).is_file() {
        return match std::fs::metadata(folder.join(pattern)) {
            Ok(about) if about.is_file() => Ok(vec![pattern.into()]),
            Ok(_) => Err(source.error(span, format!("`{}` is not a file", quote(pattern)))),
            Err(e) => Err(source.error(span, format!("the scene `{}` cannot be read ({e})", quote(pattern)))),
        };
    }
    let escaped = glob::Pattern::escape(&folder.to_string_lossy());
    let whole = std::path::Path::new(&escaped).join(pattern);
    let found = glob::glob(&whole.to_string_lossy()).map_err(|e| source.error(span, e.msg))?;
    let mut scenes = Vec::new();
    for path in found {
        let path = path.map_err(|e| source.error(span, e))?;
        let relative = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().into_owned();
        scenes.extend(path.is_file().then_some(relative));
    }
    if scenes.is_empty() {
        return Err(source.error(span, format!("no file matches `{}`", quote(pattern))));
    }
    Ok(scenes)
}
