//! The error type of the crate.

use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};

/// Result of all fallible functions of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Errors of this crate. Each message is one line: what failed, where, and the remedy.
///
/// [`Error::category`] sorts them by what a caller can do. Texts name options and arguments between `⟨` and `⟩`, which the message
/// replaces by backticks, and an interface of another language by the names that it has for them.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A file was read but its content cannot be used.
    File {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where the format has lines.
        line: Option<usize>,
        /// The character of the line, counted from 1, where it is known.
        column: Option<usize>,
        /// The defect and its remedy.
        what: String,
    },
    /// The scene was read but cannot be used for the request (empty, no emitter).
    Scene(String),
    /// An option or argument has a value that it cannot have.
    Argument {
        /// Its name: a field of the options, an argument of the function, or a part of one, such as `points[3].normal`. Empty if several
        /// do not fit together, which the problem then names.
        name: String,
        /// The value; empty if it is not shown.
        value: String,
        /// The defect of the value, or the values that are allowed.
        problem: String,
        /// The remedy; empty if the problem states it.
        cure: String,
    },
    /// The processor, the installed Embree or this version of the crate cannot do what was asked.
    Unsupported(String),
    /// There is not enough memory.
    OutOfMemory(String),
    /// The caller stopped the computation before there was a result.
    Cancelled(String),
    /// Embree failed.
    Embree(String),
}

impl Display for Error {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.worded(own_word))
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Io { source, .. } => Some(source),
            _ => None,
        }
    }
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
    /// Category of the error.
    pub fn category(&self) -> ErrorCategory {
        match self {
            Error::Io { source, .. } if source.kind() == std::io::ErrorKind::OutOfMemory => {
                ErrorCategory::OutOfMemory
            }
            Error::Io { .. } => ErrorCategory::Io,
            Error::File { .. } | Error::Scene(_) | Error::Argument { .. } => ErrorCategory::Input,
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

    /// An [`Error::File`] at `path`, optionally at a line counted from 1.
    #[doc(hidden)]
    pub fn format(path: impl Into<PathBuf>, line: Option<usize>, what: impl Into<String>) -> Self {
        Error::File { path: path.into(), line, column: None, what: what.into() }
    }

    /// An [`Error::Argument`] without a cure.
    #[doc(hidden)]
    pub fn argument(name: impl Into<String>, value: impl Display, problem: impl Into<String>) -> Self {
        let value = without_marks(&value.to_string());
        let cure = String::new();
        Error::Argument { name: name.into(), value, problem: problem.into(), cure }
    }

    /// An [`Error::Argument`] for several arguments that do not fit together, or for what has no name.
    #[doc(hidden)]
    pub fn arguments(problem: String) -> Self {
        Error::argument("", "", problem)
    }

    /// The error of an argument with this cure.
    #[doc(hidden)]
    pub fn with_cure(mut self, text: impl Into<String>) -> Self {
        if let Error::Argument { cure, .. } = &mut self {
            *cure = text.into();
        }
        self
    }

    /// The error of an argument, which is this one if it has no name yet.
    #[doc(hidden)]
    pub fn of(mut self, argument: &str) -> Self {
        if let Error::Argument { name, .. } = &mut self
            && name.is_empty()
        {
            *name = argument.into();
        }
        self
    }

    /// The error of a member of the entry `i` of an array.
    pub(crate) fn in_entry(mut self, array: &str, i: usize) -> Self {
        if let Error::Argument { name, .. } = &mut self {
            *name = format!("{array}[{i}].{name}");
        }
        self
    }

    /// The message, in which `word` names options and arguments.
    #[doc(hidden)]
    pub fn worded(&self, word: impl Fn(&str) -> String) -> String {
        let text = match self {
            Error::Io { path, source } => format!("{}: {source}", shown(path)),
            Error::File { path, line, column, what } => {
                let place = line.iter().chain(column).map(|n| format!(":{n}"));
                format!("{}{}: {what}", shown(path), place.collect::<String>())
            }
            Error::Argument { name, value, problem, cure } => {
                let after = |sign: &str, text: &str| match text {
                    "" => String::new(),
                    text => format!("{sign}{text}"),
                };
                let end = after("; ", cure);
                match name.as_str() {
                    "" => format!("{problem}{end}"),
                    name => format!("⟨{name}⟩{}: {problem}{end}", after(" ", value)),
                }
            }
            Error::Scene(text) | Error::Unsupported(text) | Error::Cancelled(text) => text.clone(),
            Error::OutOfMemory(what) => format!("out of memory: {what}"),
            Error::Embree(what) => format!("Embree: {what}"),
        };
        worded(&text, word)
    }
}

/// A message or note in which `word` names the options and arguments that stand between `⟨` and `⟩`. Other text between them stays.
pub fn worded(text: &str, word: impl Fn(&str) -> String) -> String {
    let mut parts = text.split('⟨');
    let mut out = parts.next().unwrap_or_default().to_owned();
    let is_part_of_name = |c: char| c.is_ascii_alphanumeric() || "_:.[]".contains(c);
    for part in parts {
        match part.split_once('⟩').filter(|(name, _)| name.chars().all(is_part_of_name)) {
            Some((name, rest)) => out += &format!("{}{rest}", word(name)),
            None => out += &format!("⟨{part}"),
        }
    }
    out
}

/// A character of a user's text as it stands in a message: the marks of names of options become similar ones.
fn unmarked(c: char) -> char {
    match c {
        '⟨' => '‹',
        '⟩' => '›',
        c => c,
    }
}

fn without_marks(text: &str) -> String {
    text.chars().map(unmarked).collect()
}

/// Name of an option or argument in the crate itself.
pub fn own_word(name: &str) -> String {
    let (name, entry) = parts_of(name);
    format!("`{name}`{entry}")
}

/// Serialises notes as the crate itself words them.
pub fn in_own_words<S: serde::Serializer>(notes: &[String], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(notes.iter().map(|note| worded(note, own_word)))
}

/// A name, and which entry or member of an entry of it is meant: `points` and `[3].normal`.
pub fn parts_of(name: &str) -> (&str, &str) {
    name.split_at(name.find('[').unwrap_or(name.len()))
}

/// Whether a terminal or a browser obeys a character instead of showing it: control characters, and the marks that turn the direction of
/// the text after them (Unicode Standard Annex 9), with which a name can look like another.
pub fn is_obeyed(c: char) -> bool {
    let turns =
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns
}

/// A path for a message: without control characters; of one with more than `MAX_QUOTED` characters the end, which has the name of
/// the file.
pub fn shown(path: &Path) -> String {
    let text: Vec<char> =
        path.display().to_string().chars().filter(|c| !is_obeyed(*c)).map(unmarked).collect();
    match text.len().checked_sub(MAX_QUOTED) {
        None | Some(0) => text.into_iter().collect(),
        Some(more) => std::iter::once('…').chain(text.into_iter().skip(more + 1)).collect(),
    }
}

/// Largest number of characters of a file's content, or of a name in it, that a message repeats: a line of a terminal.
pub(crate) const MAX_QUOTED: usize = 80;

/// Text of a file for a message: without control characters, at most `MAX_QUOTED` characters.
pub fn quote(text: &str) -> String {
    let mut shown = text.chars().filter(|c| !is_obeyed(*c)).map(unmarked);
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
    let mut text = without_marks(text);
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

/// Formats a number with three significant digits, without trailing zeros; as a power of ten if far from 1.
pub fn number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return if v == 0.0 { "0".into() } else { "–".into() };
    }
    let exponent = v.abs().log10().floor() as i32;
    let trimmed = |text: String| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    };
    match exponent {
        -4..=-1 => trimmed(format!("{v:.*}", (2 - exponent) as usize)),
        0..=2 => trimmed(format!("{v:.*}", (2 - exponent) as usize)),
        3..=5 => format!("{v:.0}"),
        _ => {
            let mantissa = trimmed(format!("{:.2}", v / 10f64.powi(exponent)));
            let digits: String = exponent.to_string().chars().map(superscript).collect();
            if mantissa == "1" { format!("10{digits}") } else { format!("{mantissa}·10{digits}") }
        }
    }
}

fn superscript(c: char) -> char {
    match c {
        '-' => '⁻',
        c => c.to_digit(10).map_or(c, |d| ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][d as usize]),
    }
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
    fn names_are_words_of_the_interface() {
        let error = Error::argument("points[3].normal", "0", "is too short").with_cure("raise ⟨max_bytes⟩");
        assert_eq!(error.to_string(), "`points`[3].normal 0: is too short; raise `max_bytes`");
        let shouted = error.in_entry("changes", 1).worded(str::to_uppercase);
        assert_eq!(shouted, "CHANGES[1].POINTS[3].NORMAL 0: is too short; raise MAX_BYTES");
        let named = |error: Error| error.of("image").to_string();
        assert_eq!(named(Error::arguments("no texels".into())), "`image`: no texels");
        assert_eq!(named(Error::argument("texel", "", "no length")), "`texel`: no length");
        // What a user called something is no name of an option.
        assert_eq!(
            Error::Scene(format!("no ⟨unit⟩ `{}`", quote("⟨unit⟩"))).to_string(),
            "no `unit` `‹unit›`"
        );
        assert_eq!(Error::argument("cell", "⟨up⟩", "is wrong").to_string(), "`cell` ‹up›: is wrong");
        assert_eq!(worded("a ⟨b and ⟨c d⟩ raise ⟨error⟩", own_word), "a ⟨b and ⟨c d⟩ raise `error`");
        let column = Error::File { path: "a.toml".into(), line: Some(3), column: Some(7), what: "x".into() };
        assert_eq!(column.to_string(), "a.toml:3:7: x");
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
    fn numbers_are_short() {
        let cases =
            [(0.0, "0"), (1.0, "1"), (0.5, "0.5"), (12.345, "12.3"), (0.001234, "0.00123"), (1234.6, "1235")];
        for (v, text) in
            cases.into_iter().chain([(1e-7, "10⁻⁷"), (2.5e9, "2.5·10⁹"), (-3.0, "-3"), (f64::NAN, "–")])
        {
            assert_eq!(number(v), text);
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
            (Error::argument("s", 0, "must be above 0"), ErrorCategory::Input),
            (Error::OutOfMemory("Embree".into()), ErrorCategory::OutOfMemory),
            (Error::Embree("unknown".into()), ErrorCategory::Device),
            (Error::Cancelled("stopped".into()), ErrorCategory::Cancelled),
        ] {
            assert_eq!(error.category(), want, "{error}");
        }
    }
}
