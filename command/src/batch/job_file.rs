//! What a job file holds.

use super::job::{CommandKind, Limits, Opt, Value};
use super::toml_source::Span;

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
    /// How often a job is run again after a failure.
    pub retry: u32,
    /// Lists that are combined with each other, those of `each` among them.
    pub sweep: Vec<Axis>,
    /// Lists of one length that are read side by side.
    pub zip: Vec<Axis>,
    /// Where the table begins.
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
    /// Where the axis is stated.
    pub span: Span,
}
