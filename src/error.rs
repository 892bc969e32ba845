//! The error type of the crate.

use std::path::{Path, PathBuf};

/// Result of all fallible functions of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Errors of this crate. Each message is one line: what failed, where, and the remedy.
///
/// [`Error::category`] sorts them by what a caller can do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", shown(path))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        #[source]
        source: std::io::Error,
    },
    /// A file was read but its content cannot be used.
    #[error("{}{}: {what}", shown(path), line.map(|l| format!(":{l}")).unwrap_or_default())]
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
    /// The processor, the installed Embree or this version of the crate cannot do what was asked.
    #[error("{0}")]
    Unsupported(String),
    /// There is not enough memory.
    #[error("out of memory: {0}")]
    OutOfMemory(String),
    /// The caller stopped the computation before there was a result.
    #[error("{0}")]
    Cancelled(String),
    /// Embree failed.
    #[error("Embree: {0}")]
    Embree(String),
}

/// Errors by what a caller can do about them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorCategory {
    /// A scene, a file's content or an argument is wrong: change it.
    Input,
    /// This machine, the installed Embree or this version cannot do it.
    Unsupported,
    /// There is not enough memory: ask for less.
    OutOfMemory,
    /// The caller's [`Progress`](crate::Progress) stopped the computation.
    Cancelled,
    /// Embree failed.
    Device,
    /// A file or folder could not be read or written.
    Io,
}

impl Error {
    /// What kind of error it is.
    pub fn category(&self) -> ErrorCategory {
        match self {
            Error::Io { source, .. } if source.kind() == std::io::ErrorKind::OutOfMemory => {
                ErrorCategory::OutOfMemory
            }
            Error::Io { .. } => ErrorCategory::Io,
            Error::Format { .. } | Error::Scene(_) | Error::Argument(_) => ErrorCategory::Input,
            Error::Unsupported(_) => ErrorCategory::Unsupported,
            Error::OutOfMemory(_) => ErrorCategory::OutOfMemory,
            Error::Cancelled(_) => ErrorCategory::Cancelled,
            Error::Embree(_) => ErrorCategory::Device,
        }
    }

    /// An [`Error::Io`] at `path`.
    #[doc(hidden)]
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Error::Io { path: path.into(), source }
    }

    /// An [`Error::Format`] at `path`, optionally at a line counted from 1.
    #[doc(hidden)]
    pub fn format(path: impl Into<PathBuf>, line: Option<usize>, what: impl Into<String>) -> Self {
        Error::Format { path: path.into(), line, what: what.into() }
    }
}

/// Whether a terminal or a browser obeys a character instead of showing it: control characters, and the marks that turn the direction of the
/// text after them (Unicode Standard Annex 9), with which a name can look like another.
pub fn is_obeyed(c: char) -> bool {
    let turns =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns
}

/// A path for a message: without control characters; of one with more than [`MAX_QUOTED`] characters the end, which has the name of
/// the file.
pub fn shown(path: &Path) -> String {
    let text: Vec<char> = path.display().to_string().chars().filter(|c| !is_obeyed(*c)).collect();
    match text.len().checked_sub(MAX_QUOTED) {
        None | Some(0) => text.into_iter().collect(),
        Some(more) => std::iter::once('…').chain(text.into_iter().skip(more + 1)).collect(),
    }
}

/// Largest number of characters of a file's content, or of a name in it, that a message repeats.
pub(crate) const MAX_QUOTED: usize = 80;

/// Text of a file for a message: without control characters, at most [`MAX_QUOTED`] characters.
pub fn quote(text: &str) -> String {
    let mut shown = text.chars().filter(|c| !is_obeyed(*c));
    let mut short: String = shown.by_ref().take(MAX_QUOTED - 1).collect();
    match (shown.next(), shown.next()) {
        (Some(last), None) => short.push(last),
        (Some(_), Some(_)) => short.push('…'),
        _ => {}
    }
    short
}

/// A message of a reader of text or of options, without the names that the language has for numbers.
pub fn in_words(text: &str) -> String {
    let mut text = text.to_owned();
    for bits in ["8", "16", "32", "64", "128", "size"] {
        for kind in ["u", "i"] {
            text = text.replace(&format!("expected {kind}{bits}"), "expected a whole number");
        }
        text = text.replace(&format!("expected f{bits}"), "expected a number");
    }
    for (what, words) in [
        ("invalid float literal", "expected a number"),
        ("cannot parse float from empty string", "expected a number"),
        ("invalid digit found in string", "expected a whole number"),
        ("cannot parse integer from empty string", "expected a whole number"),
        ("number too large to fit in target type", "too large a number"),
    ] {
        text = text.replace(what, words);
    }
    text
}

/// A number of a file or an option for a message: with an exponent if it has more than 20 digits otherwise.
pub fn figure(value: f64) -> String {
    let text = value.to_string();
    if text.len() <= 20 { text } else { format!("{value:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    #[test]
    fn paths_are_short_and_printable() {
        let text = Error::io("a/\u{1b}[1mb".repeat(99), ErrorKind::NotFound.into()).to_string();
        let (path, _) = text.split_once(": ").expect("a path");
        assert!(path.chars().count() == MAX_QUOTED && path.starts_with('…') && !path.contains('\u{1b}'));
        assert_eq!(Error::io("a b.obj", ErrorKind::NotFound.into()).to_string(), "a b.obj: entity not found");
    }

    #[test]
    fn quotes_are_short_and_printable() {
        assert_eq!(quote("a\u{1b}[31m b"), "a[31m b");
        assert_eq!(quote(&"é".repeat(80)), "é".repeat(80));
        assert_eq!(quote(&"é".repeat(81)), "é".repeat(79) + "…");
    }

    #[test]
    fn numbers_have_no_types() {
        for (text, want) in [
            ("invalid type: string \"a\", expected f64", "invalid type: string \"a\", expected a number"),
            ("invalid value, expected usize", "invalid value, expected a whole number"),
            (
                "'x' for '--seed <N>': invalid digit found in string",
                "'x' for '--seed <N>': expected a whole number",
            ),
        ] {
            assert_eq!(in_words(text), want);
        }
    }

    #[test]
    fn figures_are_short() {
        assert_eq!(figure(-2.5), "-2.5");
        assert_eq!(figure(1e300), "1e300");
        assert_eq!(figure(1e-200), "1e-200");
    }

    #[test]
    fn categories_say_what_a_caller_can_do() {
        for (error, want) in [
            (Error::io("a", ErrorKind::NotFound.into()), ErrorCategory::Io),
            (Error::io("a", ErrorKind::OutOfMemory.into()), ErrorCategory::OutOfMemory),
            (Error::format("a.obj", Some(3), "no face"), ErrorCategory::Input),
            (Error::Argument("s 0".into()), ErrorCategory::Input),
            (Error::OutOfMemory("Embree".into()), ErrorCategory::OutOfMemory),
            (Error::Embree("unknown".into()), ErrorCategory::Device),
            (Error::Cancelled("stopped".into()), ErrorCategory::Cancelled),
        ] {
            assert_eq!(error.category(), want, "{error}");
        }
    }
}
