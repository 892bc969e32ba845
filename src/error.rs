//! The error type of the crate.

use std::path::PathBuf;

/// Result of all fallible functions of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Errors of this crate. Each message is one line: what failed, where, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        #[source]
        source: std::io::Error,
    },
    /// A file was read but its content cannot be used.
    #[error("{}{}: {what}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Format {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where the format has lines.
        line: Option<usize>,
        /// The defect and its remedy.
        what: String,
    },
    /// The scene was read but cannot be used for the request (empty, no emitter, unknown name).
    #[error("{0}")]
    Scene(String),
    /// An option or argument is out of its range.
    #[error("{0}")]
    Argument(String),
    /// The caller stopped the computation before there was a result.
    #[error("{0}")]
    Cancelled(String),
    /// Embree is missing, has the wrong version or failed.
    #[error("Embree: {0}")]
    Embree(String),
}

impl Error {
    /// An [`Error::Io`] at `path`.
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Error::Io { path: path.into(), source }
    }

    /// An [`Error::Format`] at `path`, optionally at a line counted from 1.
    pub fn format(path: impl Into<PathBuf>, line: Option<usize>, what: impl Into<String>) -> Self {
        Error::Format { path: path.into(), line, what: what.into() }
    }
}
