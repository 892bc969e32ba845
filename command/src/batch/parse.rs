//! Reads a job file.

use super::job::{
    AXIS_KEYS, Axis, COMMANDS, CommandKind, DEFAULT_KEYS, FILE_KEYS, JOB_KEYS, JobEntry, JobFile, LIMIT_KEYS,
    Limits, Opt, Reads, Span, TomlSource, Value,
};
use super::names::suggestion;
use mrvis::internals::error::quote;
use mrvis::{Error, Result};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest number of values of a range, and of runs after a failure: more are most likely a mistake, and two ranges already exceed the
/// largest number of jobs.
const MAX_STEPS: u64 = 10_000;

/// A value of the file with its place.
type TomlNode<'a> = Spanned<DeValue<'a>>;

/// The content of a job file.
///
/// # Errors
/// [`Error::Argument`] with file, line and column.
pub fn parse(source: &TomlSource) -> Result<JobFile> {
    let table = DeTable::parse(&source.text)
        .map_err(|e| source.error(&e.span().unwrap_or(0..0), quote(e.message())))?;
    let reader = Reader { source };
    let table = table.get_ref();
    reader.check_keys(table, &FILE_KEYS)?;
    let defaults = match table.get("defaults") {
        Some(node) => reader.defaults(node)?,
        None => Defaults::default(),
    };
    let Some(jobs) = table.get("job") else {
        return Err(source.error(&(0..0), "there are no jobs: write a table `[[job]]`"));
    };
    let DeValue::Array(jobs) = jobs.get_ref() else {
        return Err(source.error(&jobs.span(), "`job` is a list of tables: write `[[job]]`"));
    };
    let entries = jobs.iter().map(|job| reader.entry(job, &defaults)).collect::<Result<_>>()?;
    Ok(JobFile { entries })
}

/// Contents of `[defaults]`.
#[derive(Default)]
struct Defaults {
    options: Vec<Opt>,
    limits: Limits,
    retry: u32,
    tags: Vec<String>,
}

struct Reader<'a> {
    source: &'a TomlSource,
}

impl Reader<'_> {
    fn error(&self, node: &TomlNode, what: impl std::fmt::Display) -> Error {
        self.source.error(&node.span(), what)
    }

    fn check_keys(&self, table: &DeTable, known: &[&str]) -> Result<()> {
        let mut keys: Vec<_> = table.keys().collect();
        keys.sort_by_key(|key| key.span().start);
        match keys.iter().find(|key| !known.contains(&key.get_ref().as_ref())) {
            None => Ok(()),
            Some(key) => {
                let name = key.get_ref();
                let similar = suggestion(name, known.iter().copied());
                Err(self.source.error(&key.span(), format!("unknown key `{}`{similar}", quote(name))))
            }
        }
    }

    fn table<'t, 'a>(&self, node: &'t TomlNode<'a>) -> Result<&'t DeTable<'a>> {
        match node.get_ref() {
            DeValue::Table(table) => Ok(table),
            _ => Err(self.error(node, "must be a table")),
        }
    }

    /// Keys and values of a table in the order of the file.
    fn ordered<'t, 'a>(&self, node: &'t TomlNode<'a>) -> Result<Vec<(String, Span, &'t TomlNode<'a>)>> {
        let table = self.table(node)?;
        let mut pairs: Vec<_> =
            table.iter().map(|(key, value)| (key.get_ref().to_string(), key.span(), value)).collect();
        pairs.sort_by_key(|(_, span, _)| span.start);
        Ok(pairs)
    }

    fn defaults(&self, node: &TomlNode) -> Result<Defaults> {
        let table = self.table(node)?;
        self.check_keys(table, &DEFAULT_KEYS)?;
        Ok(Defaults {
            options: table.get("options").map_or(Ok(Vec::new()), |n| self.options(n, true))?,
            limits: table.get("limits").map_or(Ok(Limits::default()), |n| self.limits(n))?,
            retry: table.get("retry").map_or(Ok(0), |n| self.count(n))? as u32,
            tags: self.texts(table, "tags")?.into_iter().map(|(text, _)| text).collect(),
        })
    }

    fn entry(&self, node: &TomlNode, defaults: &Defaults) -> Result<JobEntry> {
        let table = self.table(node)?;
        self.check_keys(table, &JOB_KEYS)?;
        let command = self.command(table.get("command"), &node.span())?;
        let own = table.get("limits").map_or(Ok(Limits::default()), |n| self.limits(n))?;
        let mut options = table.get("options").map_or(Ok(Vec::new()), |n| self.options(n, false))?;
        let inherited = defaults.options.iter().filter(|d| options.iter().all(|o| o.name != d.name));
        let inherited: Vec<Opt> = inherited.cloned().collect();
        options.splice(0..0, inherited);
        let mut tags = defaults.tags.clone();
        tags.extend(self.texts(table, "tags")?.into_iter().map(|(text, _)| text));
        let name = table.get("name").map(|n| Ok::<_, Error>((self.text(n)?, n.span()))).transpose()?;
        let entry = JobEntry {
            name,
            command,
            scenes: self.texts(table, "scene")?,
            inputs: self.texts(table, "inputs")?.into_iter().map(|(text, _)| text).collect(),
            tags,
            after: self.texts(table, "after")?,
            options,
            limits: Limits {
                seconds: own.seconds.or(defaults.limits.seconds),
                memory: own.memory.or(defaults.limits.memory),
            },
            retry: table.get("retry").map_or(Ok(defaults.retry.into()), |n| self.count(n))? as u32,
            sweep: [self.axes(table, "each")?, self.axes(table, "sweep")?].concat(),
            zip: self.axes(table, "zip")?,
            span: node.span(),
        };
        self.check_entry(&entry)?;
        Ok(entry)
    }

    fn check_entry(&self, entry: &JobEntry) -> Result<()> {
        let fault = |what: String| Err(self.source.error(&entry.span, what));
        let name = entry.command.name;
        match entry.command.reads {
            Reads::Scene if entry.scenes.is_empty() => fault(format!("`{name}` needs `scene`")),
            Reads::Scene if !entry.inputs.is_empty() => {
                fault(format!("`{name}` reads `scene`, not `inputs`"))
            }
            Reads::Inputs(_) if !entry.scenes.is_empty() => {
                fault(format!("`{name}` reads `inputs`, not `scene`"))
            }
            Reads::Inputs(n) if entry.inputs.len() != n => {
                fault(format!("`{name}` needs {n} in `inputs`, {} are given", entry.inputs.len()))
            }
            _ => {
                let length = |axis: &Axis| axis.values.len();
                match entry.zip.iter().find(|axis| length(axis) != length(&entry.zip[0])) {
                    Some(axis) => Err(self.source.error(
                        &axis.span,
                        format!(
                            "lists of `zip` have one length: `{}` has {}, `{}` has {}",
                            entry.zip[0].name,
                            length(&entry.zip[0]),
                            axis.name,
                            length(axis)
                        ),
                    )),
                    None => Ok(()),
                }
            }
        }
    }

    fn command(&self, node: Option<&TomlNode>, job: &Span) -> Result<&'static CommandKind> {
        let names = COMMANDS.iter().map(|c| c.name);
        let Some(node) = node else {
            let all: Vec<_> = names.collect();
            return Err(self.source.error(job, format!("the job has no `command` ({})", all.join(", "))));
        };
        let text = self.text(node)?;
        COMMANDS.iter().find(|c| c.name == text).ok_or_else(|| {
            let all: Vec<_> = names.clone().collect();
            let similar = suggestion(&text, names);
            self.error(
                node,
                format!("unknown command `{}` (there are {}){similar}", quote(&text), all.join(", ")),
            )
        })
    }

    fn limits(&self, node: &TomlNode) -> Result<Limits> {
        let table = self.table(node)?;
        self.check_keys(table, &LIMIT_KEYS)?;
        let seconds = table.get("seconds").map(|n| self.number(n)).transpose()?;
        if let (Some(s), Some(n)) = (seconds, table.get("seconds"))
            && !(s > 0.0 && s <= 1e9)
        {
            return Err(self.error(n, "must be a number of seconds above 0"));
        }
        Ok(Limits { seconds, memory: table.get("memory").map(|n| self.bytes(n)).transpose()? })
    }

    /// Bytes: `"4G"`, `"500M"`, `"1.5GiB"`.
    fn bytes(&self, node: &TomlNode) -> Result<u64> {
        let wanted = || self.error(node, "must be text such as \"4G\" or \"500M\" (multiples of 1024)");
        let DeValue::String(text) = node.get_ref() else { return Err(wanted()) };
        let digits = text.trim_end_matches("iB").trim_end_matches('B');
        let unit = digits.chars().last().filter(char::is_ascii_alphabetic).ok_or_else(wanted)?;
        let power = "KMGT".find(unit.to_ascii_uppercase()).ok_or_else(wanted)? as i32 + 1;
        let number: f64 = digits[..digits.len() - 1].trim().parse().map_err(|_| wanted())?;
        let bytes = number * 1024f64.powi(power);
        if (1.0..1e18).contains(&bytes) { Ok(bytes as u64) } else { Err(wanted()) }
    }

    fn options(&self, node: &TomlNode, is_default: bool) -> Result<Vec<Opt>> {
        let pairs = self.ordered(node)?.into_iter();
        pairs
            .map(|(name, span, value)| Ok(Opt { name, value: self.value(value)?, span, is_default }))
            .collect()
    }

    fn value(&self, node: &TomlNode) -> Result<Value> {
        Ok(match node.get_ref() {
            DeValue::Boolean(set) => Value::Flag(*set),
            DeValue::Array(list) => Value::List(list.iter().map(|n| self.text(n)).collect::<Result<_>>()?),
            _ => Value::Text(self.text(node)?),
        })
    }

    /// Text, or a number or a time as it is written.
    fn text(&self, node: &TomlNode) -> Result<String> {
        match node.get_ref() {
            DeValue::String(text) => Ok(text.to_string()),
            DeValue::Integer(n) if n.radix() == 10 => Ok(n.as_str().to_owned()),
            DeValue::Float(x) => Ok(x.as_str().to_owned()),
            DeValue::Datetime(time) => Ok(time.to_string()),
            other => {
                Err(self.error(node, format!("must be text, a number or a time, not {}", other.type_str())))
            }
        }
    }

    fn number(&self, node: &TomlNode) -> Result<f64> {
        let text = match node.get_ref() {
            DeValue::Integer(n) if n.radix() == 10 => n.as_str(),
            DeValue::Float(x) => x.as_str(),
            _ => "",
        };
        text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| self.error(node, "must be a number"))
    }

    fn count(&self, node: &TomlNode) -> Result<u64> {
        let text = node.get_ref().as_integer().map_or("", |n| n.as_str());
        let number = text.parse().ok().filter(|n| *n <= MAX_STEPS);
        number.ok_or_else(|| self.error(node, format!("must be a whole number of 0 to {MAX_STEPS}")))
    }

    /// One text or a list of them.
    fn texts(&self, table: &DeTable, key: &str) -> Result<Vec<(String, Span)>> {
        match table.get(key) {
            None => Ok(Vec::new()),
            Some(node) => match node.get_ref() {
                DeValue::Array(list) => list.iter().map(|n| Ok((self.text(n)?, n.span()))).collect(),
                _ => Ok(vec![(self.text(node)?, node.span())]),
            },
        }
    }

    fn axes(&self, table: &DeTable, key: &str) -> Result<Vec<Axis>> {
        let Some(node) = table.get(key) else { return Ok(Vec::new()) };
        let pairs = self.ordered(node)?.into_iter();
        pairs
            .map(|(name, span, node)| {
                let values = match node.get_ref() {
                    DeValue::Array(list) => list.iter().map(|n| self.value(n)).collect::<Result<_>>()?,
                    DeValue::Table(table) => self.range(node, table)?,
                    _ => return Err(self.error(node, "must be a list, or a range { from, to, steps }")),
                };
                let axis = Axis { name, is_option: key != "each", values, span };
                if axis.values.is_empty() {
                    return Err(self.error(node, format!("`{}` has no values", axis.name)));
                }
                Ok(axis)
            })
            .collect()
    }

    /// Values of `{ from, to, steps }`, evenly spaced or by equal factors, or of `{ from, to, by }`.
    fn range(&self, node: &TomlNode, table: &DeTable) -> Result<Vec<Value>> {
        self.check_keys(table, &AXIS_KEYS)?;
        let need =
            |key: &str| table.get(key).ok_or_else(|| self.error(node, format!("the range lacks `{key}`")));
        let (from, to) = (self.number(need("from")?)?, self.number(need("to")?)?);
        let scale = table.get("scale").map_or(Ok("linear".into()), |n| self.text(n))?;
        if !["linear", "log"].contains(&scale.as_str()) {
            return Err(self.error(&table["scale"], "must be \"linear\" or \"log\""));
        }
        let log = scale == "log";
        if log && !(from > 0.0 && to > 0.0) {
            return Err(self.error(node, "a range of scale \"log\" lies above 0"));
        }
        let steps = match (table.get("steps"), table.get("by")) {
            (Some(n), None) => self.count(n)?,
            (None, Some(n)) if !log => {
                let by = self.number(n)?;
                // The addition keeps rounding from omitting the last value.
                let count = ((to - from) / by + 1e-9).floor();
                if !(count >= 0.0 && count < MAX_STEPS as f64) {
                    return Err(
                        self.error(n, format!("does not lead from {from} to {to} in {MAX_STEPS} steps"))
                    );
                }
                let at = |k: u64| Value::Text(rounded(from + k as f64 * by));
                return Ok((0..=count as u64).map(at).collect());
            }
            _ => return Err(self.error(node, "the range needs `steps`, or `by` with scale \"linear\"")),
        };
        if steps < 2 {
            return Err(self.error(node, "a range has at least 2 steps"));
        }
        let at = |k: u64| {
            let t = k as f64 / (steps - 1) as f64;
            Value::Text(rounded(if log { from * (to / from).powf(t) } else { from + t * (to - from) }))
        };
        Ok((0..steps).map(at).collect())
    }
}

/// A number to 12 digits, which hides rounding errors of sums.
fn rounded(x: f64) -> String {
    let short: f64 = format!("{x:.11e}").parse().unwrap_or(x);
    short.to_string()
}
