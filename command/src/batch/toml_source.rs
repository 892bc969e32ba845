//! The text of a job file, and errors that name a place in it.

use mrvis::internals::files::input;
use mrvis::{Error, Result};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A range of bytes of the job file.
pub type Span = Range<usize>;

/// A job file as it was read.
pub struct TomlSource {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub text: String,
}

impl TomlSource {
    /// Reads a job file.
    ///
    /// # Errors
    /// The file cannot be read or is not text in UTF-8.
    pub fn read(path: &Path) -> Result<TomlSource> {
        let bytes = input::read(path, input::MAX_SMALL_FILE)?;
        let text = String::from_utf8(bytes).map_err(|_| Error::format(path, None, "not text in UTF-8"))?;
        Ok(TomlSource { path: path.into(), text })
    }

    /// The folder that paths of the job file are relative to; empty for the working folder.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// An error at a place: `jobs.toml:3:7: …`.
    pub fn error(&self, span: &Span, what: impl std::fmt::Display) -> Error {
        let before = &self.text[..span.start.min(self.text.len())];
        let line = 1 + before.matches('\n').count();
        let column = 1 + before.rsplit('\n').next().unwrap_or_default().chars().count();
        let (path, line, column) = (self.path.clone(), Some(line), Some(column));
        Error::Format { path, line, column, what: what.to_string() }
    }
}
