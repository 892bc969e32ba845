//! Job files and the jobs that they hold.

use mrvis::internals::files::input;
use mrvis::{Error, Result};
use serde::Serialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A value of an option.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A flag that is set (`true`) or omitted (`false`).
    Flag(bool),
    /// A number as it is written, or text.
    Text(String),
    /// Several values of one option.
    List(Vec<String>),
}

impl Value {
    /// The value in a name or a table.
    pub fn shown(&self) -> String {
        match self {
            Value::Flag(set) => set.to_string(),
            Value::Text(text) => text.clone(),
            Value::List(list) => list.join(","),
        }
    }

    /// The value in a table: a number where it is one.
    fn json(&self) -> serde_json::Value {
        if let Value::Flag(set) = self {
            return (*set).into();
        }
        let text = self.shown();
        if let Ok(whole) = text.parse::<i64>() {
            return whole.into();
        }
        let number = text.parse::<f64>().ok().and_then(serde_json::Number::from_f64);
        number.map_or(text.into(), serde_json::Value::Number)
    }

    /// All texts of the value.
    pub fn texts(&self) -> &[String] {
        match self {
            Value::Flag(_) => &[],
            Value::Text(text) => std::slice::from_ref(text),
            Value::List(list) => list,
        }
    }

    /// The value with each text replaced.
    pub fn try_map<E>(&self, replace: impl Fn(&str) -> Result<String, E>) -> Result<Value, E> {
        Ok(match self {
            Value::Flag(set) => Value::Flag(*set),
            Value::Text(text) => Value::Text(replace(text)?),
            Value::List(list) => Value::List(list.iter().map(|t| replace(t)).collect::<Result<_, _>>()?),
        })
    }
}

/// An option by its long name.
#[derive(Clone, Debug)]
pub struct Opt {
    /// Long name without hyphens in front.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Its place in the job file.
    pub span: Span,
    /// Whether `[defaults]` states it: it then applies only to commands that have it.
    pub is_default: bool,
}

/// Limits of a job; a job that has any runs as a process of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Longest time, seconds.
    pub seconds: Option<f64>,
    /// Largest address space, bytes.
    pub memory: Option<u64>,
}

/// Positional inputs of a command, and the files of its results.
#[derive(Clone, Copy, Debug)]
pub struct CommandKind {
    /// Name of the command.
    pub name: &'static str,
    /// Whether it reads a scene; otherwise as many files as stated.
    pub reads: Reads,
    /// File of `out` in the folder of the job if the job does not name one; `None`: `out` is the folder itself, or is missing.
    pub out: Out,
    /// File of `json` in the folder of the job; `None` if the command writes a record anyway.
    pub json: Option<&'static str>,
    /// The record of the results in the folder of the job.
    pub record: &'static str,
}

/// Positional inputs of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// One scene: key `scene`.
    Scene,
    /// This number of files or names: key `inputs`.
    Inputs(usize),
}

/// Meaning of the option `out` of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Out {
    /// The folder of the job.
    Folder,
    /// A file in it, with this name unless the job states one.
    File(&'static str),
    /// The command has no such option.
    Missing,
}

/// The commands of jobs.
pub const COMMANDS: [CommandKind; 9] = {
    const fn kind(name: &'static str, reads: Reads, out: Out, json: &'static str) -> CommandKind {
        CommandKind { name, reads, out, json: Some(json), record: json }
    }
    [
        kind("info", Reads::Scene, Out::Missing, "info.json"),
        CommandKind {
            name: "solve",
            reads: Reads::Scene,
            out: Out::Folder,
            json: None,
            record: "solution.json",
        },
        kind("bench", Reads::Scene, Out::Folder, "bench.json"),
        kind("terrain", Reads::Scene, Out::Folder, "terrain.json"),
        kind("form-factors", Reads::Scene, Out::File("matrix.npz"), "form-factors.json"),
        kind("reference", Reads::Scene, Out::File("irradiance.csv"), "reference.json"),
        kind("compare", Reads::Inputs(2), Out::Missing, "comparison.json"),
        kind("fbem", Reads::Inputs(2), Out::Folder, "fbem.json"),
        kind("generate", Reads::Inputs(1), Out::File("scene.obj"), "generate.json"),
    ]
};

/// One job.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its name, and that of its folder below the output folder.
    pub name: String,
    /// Its command.
    pub command: &'static CommandKind,
    /// Positional inputs of the command. Paths are relative to the job file unless they name outputs of jobs.
    pub inputs: Vec<String>,
    /// Options in the order of the job file, swept ones last.
    pub options: Vec<Opt>,
    /// Tags.
    pub tags: Vec<String>,
    /// Names or tags of jobs that must be done before, as the file states them.
    pub after: Vec<(String, Span)>,
    /// Indices of jobs that must be done before; see [`super::check`].
    pub needs: Vec<usize>,
    /// Limits.
    pub limits: Limits,
    /// Number of times that it is run again after a failure.
    pub retry: u32,
    /// Start of its table in the job file.
    pub span: Span,
}

impl Job {
    /// Columns of the table of results that say what the job is: its command, what it reads, tags and options.
    pub fn about(&self) -> serde_json::Map<String, serde_json::Value> {
        let mut about = serde_json::Map::new();
        let mut add = |name: &str, value: serde_json::Value| drop(about.insert(name.into(), value));
        add("command", self.command.name.into());
        match self.command.reads {
            Reads::Scene => add("scene", self.inputs.first().map(String::as_str).into()),
            Reads::Inputs(_) => add("inputs", self.inputs.clone().into()),
        }
        add("tags", self.tags.join(" ").into());
        self.options.iter().for_each(|option| add(&format!("option.{}", option.name), option.value.json()));
        about
    }

    /// The last value of an option.
    #[cfg(test)]
    pub fn option(&self, name: &str) -> Option<&Value> {
        self.options.iter().rev().find(|o| o.name == name).map(|o| &o.value)
    }

    /// All texts that may name outputs of other jobs, with their places.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &Span)> {
        let inputs = self.inputs.iter().map(|text| (text.as_str(), &self.span));
        let options = self.options.iter().flat_map(|o| o.value.texts().iter().map(|t| (t.as_str(), &o.span)));
        inputs.chain(options)
    }
}

/// Keys of the file.
pub const FILE_KEYS: [&str; 2] = ["defaults", "job"];
/// Keys of `[defaults]`.
pub const DEFAULT_KEYS: [&str; 4] = ["options", "limits", "retry", "tags"];
/// Keys of `[[job]]`.
pub const JOB_KEYS: [&str; 12] = [
    "name", "command", "scene", "inputs", "tags", "after", "options", "limits", "retry", "sweep", "zip",
    "each",
];
/// Keys of `limits`.
pub const LIMIT_KEYS: [&str; 2] = ["seconds", "memory"];
/// Keys of a range of a sweep.
pub const AXIS_KEYS: [&str; 5] = ["from", "to", "steps", "by", "scale"];

/// A job file.
#[derive(Debug, Default)]
pub struct JobFile {
    /// Its tables `[[job]]`, with the defaults filled in.
    pub entries: Vec<JobEntry>,
}

/// A table `[[job]]`: one job or a sweep of them.
#[derive(Clone, Debug)]
pub struct JobEntry {
    /// Template of the name.
    pub name: Option<(String, Span)>,
    /// The command.
    pub command: &'static CommandKind,
    /// Patterns of the scenes; each scene is a job.
    pub scenes: Vec<(String, Span)>,
    /// Files that the command reads by position.
    pub inputs: Vec<String>,
    /// Tags.
    pub tags: Vec<String>,
    /// Templates of names or tags of jobs that must be done before.
    pub after: Vec<(String, Span)>,
    /// Options.
    pub options: Vec<Opt>,
    /// Limits.
    pub limits: Limits,
    /// Number of times that a job is run again after a failure.
    pub retry: u32,
    /// Lists that are combined with each other, those of `each` among them.
    pub sweep: Vec<Axis>,
    /// Lists of one length that are read side by side.
    pub zip: Vec<Axis>,
    /// Start of the table.
    pub span: Span,
}

/// The values that an option, or a key of templates, takes in a sweep.
#[derive(Clone, Debug)]
pub struct Axis {
    /// The option or key.
    pub name: String,
    /// Whether it is an option of the command, not only a key of templates.
    pub is_option: bool,
    /// Its values.
    pub values: Vec<Value>,
    /// Place of the axis in the job file.
    pub span: Span,
}

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
        Error::File { path, line, column, what: what.to_string() }
    }
}
