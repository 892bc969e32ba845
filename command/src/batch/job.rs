//! One job of a batch.

use super::toml_source::Span;
use serde::Serialize;

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
    /// Where the job file states it.
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

/// What a command reads by position, and where its results go.
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

/// What a command reads by position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// One scene: key `scene`.
    Scene,
    /// So many files or names: key `inputs`.
    Inputs(usize),
}

/// What `out` of a command is.
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
    /// What the command reads by position. Paths are relative to the job file unless they name outputs of jobs.
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
    /// How often it is run again after a failure.
    pub retry: u32,
    /// Where its table begins in the job file.
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
