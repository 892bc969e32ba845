//! Expands the tables of a job file to jobs: patterns of scenes, and templates, in which `{key}` stands for a value of the job and
//! `{out:NAME}` for the output folder of another job.

use super::job::{Axis, Job, JobEntry, JobFile, Opt, Span, TomlSource, Value};
use super::names::{plain, suggestion};
use mrvis::Result;
use mrvis::internals::error::quote;
use std::collections::BTreeMap;
use std::path::Path;

/// Largest number of jobs: a journal of this many lines is read in a second.
const MAX_JOBS: usize = 1_000_000;

/// The jobs of a file, in its order; within a table scenes vary slowest, then rows of `zip`, and the last list of `sweep` fastest.
///
/// # Errors
/// [`mrvis::Error::Argument`] with file, line and column.
pub fn expand(source: &TomlSource, file: &JobFile) -> Result<Vec<Job>> {
    let mut jobs = Vec::new();
    for entry in &file.entries {
        let mut inputs: Vec<Vec<String>> = Vec::new();
        for (pattern, span) in &entry.scenes {
            inputs.extend(scenes(source, pattern, span)?.into_iter().map(|scene| vec![scene]));
        }
        if entry.scenes.is_empty() {
            inputs.push(entry.inputs.clone());
        }
        let points = points(entry);
        if jobs.len() + inputs.len().saturating_mul(points.len()) > MAX_JOBS {
            return Err(source.error(&entry.span, format!("more than {MAX_JOBS} jobs; split the file")));
        }
        for input in inputs {
            for point in &points {
                jobs.push(job(source, entry, input.clone(), point)?);
            }
        }
    }
    Ok(jobs)
}

/// A point of a sweep: an axis and a value of it.
type Point<'a> = Vec<(&'a Axis, &'a Value)>;

/// All points of the sweep of a table.
fn points<'a>(entry: &'a JobEntry) -> Vec<Point<'a>> {
    let rows = entry.zip.first().map_or(1, |axis| axis.values.len());
    let mut points: Vec<Point<'a>> =
        (0..rows).map(|row| entry.zip.iter().map(|axis| (axis, &axis.values[row])).collect()).collect();
    for axis in &entry.sweep {
        // A number of points that no memory holds is refused afterwards: it stops growing here.
        if points.len().saturating_mul(axis.values.len()) > MAX_JOBS {
            points.truncate(MAX_JOBS / axis.values.len() + 1);
        }
        let at = |point: &Point<'a>, value: &'a Value| [&point[..], &[(axis, value)]].concat();
        points = points.iter().flat_map(|point| axis.values.iter().map(move |v| at(point, v))).collect();
    }
    points
}

fn job(source: &TomlSource, entry: &JobEntry, inputs: Vec<String>, point: &Point) -> Result<Job> {
    let mut options = entry.options.clone();
    options.retain(|o| point.iter().all(|(axis, _)| !axis.is_option || axis.name != o.name));
    let swept = |(axis, value): &(&Axis, &Value)| Opt {
        name: axis.name.clone(),
        value: (*value).clone(),
        span: axis.span.clone(),
        is_default: false,
    };
    options.extend(point.iter().filter(|(axis, _)| axis.is_option).map(swept));
    let mut fields = fields(entry, &inputs, &options);
    fields.extend(point.iter().map(|(axis, value)| (axis.name.clone(), plain(&value.shown()))));
    let filled = |text: &str, span: &Span| fill(text, &fields).map_err(|what| source.error(span, what));
    for option in &mut options {
        let span = &option.span;
        option.value = option.value.try_map(|text| filled(text, span))?;
    }
    let (name, at) = match &entry.name {
        Some((template, span)) => (template.clone(), span),
        None => (default_name(entry, point), &entry.span),
    };
    let after = entry.after.iter().map(|(text, span)| Ok((filled(text, span)?, span.clone())));
    Ok(Job {
        name: filled(&name, at)?,
        command: entry.command,
        inputs: inputs.iter().map(|text| filled(text, &entry.span)).collect::<Result<_>>()?,
        options,
        tags: entry.tags.iter().map(|text| filled(text, &entry.span)).collect::<Result<_>>()?,
        after: after.collect::<Result<_>>()?,
        needs: Vec::new(),
        limits: entry.limits,
        retry: entry.retry,
        span: at.clone(),
    })
}

/// Values of the keys in templates of a job: command, scene without folder and extension, folder of the scene, and options.
fn fields(entry: &JobEntry, inputs: &[String], options: &[Opt]) -> Fields {
    let options = options.iter().map(|o| (o.name.clone(), plain(&o.value.shown())));
    let mut fields: Fields = options.collect();
    fields.insert("command".into(), entry.command.name.into());
    if let Some(scene) = inputs.first() {
        let stem = Path::new(scene).file_stem().unwrap_or_default().to_string_lossy();
        fields.insert("scene".into(), plain(&stem));
        let folder = Path::new(scene).parent().unwrap_or(Path::new("")).to_string_lossy();
        fields.insert("folder".into(), plain(&folder));
    }
    fields
}

/// Template of a name: the command, the scene and all swept values.
fn default_name(entry: &JobEntry, point: &Point) -> String {
    let scene = if entry.scenes.is_empty() { "" } else { "-{scene}" };
    let swept: String = point.iter().map(|(axis, _)| format!("-{0}={{{0}}}", axis.name)).collect();
    format!("{{command}}{scene}{swept}")
}

/// The scenes of a pattern relative to the job file, in alphabetic order. A path that exists, or without signs of a pattern, is that
/// file; one that names outputs of a job is left as it is.
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

/// Values by key.
pub type Fields = BTreeMap<String, String>;

/// A part of a template.
enum Part<'a> {
    Text(&'a str),
    /// The content of a pair of braces, which may hold others.
    Braces(&'a str),
}

/// Splits a template at its outer braces.
fn parts(text: &str) -> Result<Vec<Part<'_>>, String> {
    let (mut parts, mut rest) = (Vec::new(), text);
    while let Some(start) = rest.find(['{', '}']) {
        parts.push(Part::Text(&rest[..start]));
        let mut depth = 0;
        let end = rest[start..].char_indices().find_map(|(i, c)| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            (depth <= 0).then_some(start + i)
        });
        let Some(end) = end.filter(|_| rest[start..].starts_with('{')) else {
            return Err(format!("`{}` has a brace without its partner", quote(text)));
        };
        parts.push(Part::Braces(&rest[start + 1..end]));
        rest = &rest[end + 1..];
    }
    parts.push(Part::Text(rest));
    Ok(parts)
}

/// The text with values for keys. Names in `{out:NAME}` are filled in and stay in their braces.
///
/// # Errors
/// A key is unknown, or braces do not match.
pub fn fill(text: &str, fields: &Fields) -> Result<String, String> {
    let mut out = String::new();
    for part in parts(text)? {
        match part {
            Part::Text(text) => out += text,
            Part::Braces(inner) => match inner.strip_prefix("out:") {
                Some(name) => out += &format!("{{out:{}}}", fill(name, fields)?),
                None => {
                    out += fields.get(inner).ok_or_else(|| {
                        let similar = suggestion(inner, fields.keys().map(String::as_str));
                        format!("`{{{}}}` is no value of this job{similar}", quote(inner))
                    })?
                }
            },
        }
    }
    Ok(out)
}

/// Names of the jobs whose outputs a filled text names.
pub fn outputs_of(text: &str) -> Vec<&str> {
    let parts = parts(text).unwrap_or_default();
    parts
        .into_iter()
        .filter_map(|part| match part {
            Part::Braces(inner) => inner.strip_prefix("out:"),
            Part::Text(_) => None,
        })
        .collect()
}

/// A filled text with the folders of the jobs that it names.
pub fn resolve_outputs(text: &str, folder: impl Fn(&str) -> String) -> String {
    let parts = parts(text).unwrap_or_default();
    let resolved = parts.into_iter().map(|part| match part {
        Part::Text(text) => text.to_owned(),
        Part::Braces(inner) => inner.strip_prefix("out:").map_or_else(|| format!("{{{inner}}}"), &folder),
    });
    resolved.collect()
}
