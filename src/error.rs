//! The one error type of the crate: what went wrong, where, and the cure.

use std::path::PathBuf;

/// Result of every fallible call of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong. Each message is one line that names what, where and the cure.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A file was read but its content is not usable.
    #[error("{}{}: {what}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Format {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where the format has lines.
        line: Option<usize>,
        /// What is wrong and how to mend it.
        what: String,
    },
    /// The scene is readable but cannot be used for what was asked (empty, no emitter, unknown name).
    #[error("{0}")]
    Scene(String),
    /// An option or argument is out of its range.
    #[error("{0}")]
    Argument(String),
    /// The caller stopped the computation before there was a result.
    #[error("{0}")]
    Cancelled(String),
    /// Embree refused a call, is missing or has the wrong version.
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
