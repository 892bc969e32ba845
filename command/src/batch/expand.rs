//! Expands the tables of a job file to jobs.

use super::glob_scenes::scenes;
use super::job::{Job, Opt, Value};
use super::job_file::{Axis, JobEntry, JobFile};
use super::names::plain;
use super::template::{Fields, fill};
use super::toml_source::{Span, TomlSource};
use mrvis::Result;
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

/// What templates of a job may name: its command, its scene without folder and extension, the folder of its scene, and its options.
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
