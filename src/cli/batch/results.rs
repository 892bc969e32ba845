//! The tables of all jobs: `results.csv` and `results.jsonl`.

use super::plan::Plan;
use crate::batch::{Entries, Entry, Job, Status, Value};
use crate::files::WholeFile;
use crate::{Error, Result};
use serde_json::{Map, Value as Json};
use std::path::Path;

/// Largest record of a job that is read, bytes: that of a solve has some kilobytes.
const MAX_RECORD: u64 = 16 << 20;

/// A row of the table: names and values in the order of columns.
pub type Row = Map<String, Json>;

/// Writes the tables of all jobs that have ended.
///
/// # Errors
/// A table cannot be written.
pub fn write(plan: &Plan, entries: &Entries) -> Result<()> {
    let rows: Vec<Row> =
        (plan.jobs.iter()).filter_map(|job| Some(row(&plan.out, job, entries.get(&job.name)?))).collect();
    write_tables(&plan.out, &rows)
}

/// Writes rows as tables of an output folder.
///
/// # Errors
/// A table cannot be written.
pub fn write_tables(out: &Path, rows: &[Row]) -> Result<()> {
    let lines = rows.iter().map(|row| serde_json::to_string(row).unwrap_or_default() + "\n");
    WholeFile::write(&out.join("results.jsonl"), lines.collect::<String>())?;
    let columns = columns(rows);
    let path = out.join("results.csv");
    let at = |e: csv::Error| Error::format(&path, None, e.to_string());
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(&columns).map_err(at)?;
    for row in rows {
        table.write_record(columns.iter().map(|name| cell(row.get(name)))).map_err(at)?;
    }
    let text = table.into_inner().map_err(|e| Error::format(&path, None, e.to_string()))?;
    WholeFile::write(&path, text)
}

/// All names of columns, in the order in which they first occur.
pub fn columns(rows: &[Row]) -> Vec<String> {
    let mut seen = std::collections::HashSet::new();
    let names = rows.iter().flat_map(|row| row.keys());
    names.filter(|name| seen.insert(name.as_str())).cloned().collect()
}

/// A value in a cell of text.
pub fn cell(value: Option<&Json>) -> String {
    match value {
        None | Some(Json::Null) => String::new(),
        Some(Json::String(text)) => text.clone(),
        Some(other) => other.to_string(),
    }
}

/// The row of a job: what ran, what was swept, how it ended, and the numbers of its record.
fn row(out: &Path, job: &Job, entry: &Entry) -> Row {
    let mut row = Row::new();
    let mut add = |name: &str, value: Json| drop(row.insert(name.into(), value));
    add("job", job.name.as_str().into());
    add("command", job.command.name.into());
    add("scene", job.inputs.first().map(String::as_str).into());
    add("tags", job.tags.join(" ").into());
    add("status", serde_json::to_value(entry.status).unwrap_or_default());
    for name in &job.swept {
        add(&format!("option.{name}"), job.option(name).map_or(Json::Null, option));
    }
    add("job_seconds", entry.seconds.into());
    add("job_threads", entry.threads.into());
    add("attempt", entry.attempt.into());
    add("error_message", entry.error.as_deref().into());
    add("output_bytes", entry.outputs.iter().map(|file| file.bytes).sum::<u64>().into());
    add("key", entry.key.as_str().into());
    if entry.status != Status::Failed {
        let record = out.join(&job.name).join(job.command.record);
        for (name, value) in figures(&record) {
            row.entry(name).or_insert(value);
        }
    }
    row
}

/// A swept value: a number where it is one.
fn option(value: &Value) -> Json {
    match value {
        Value::Flag(set) => (*set).into(),
        other => {
            let text = other.shown();
            let number = text.parse::<f64>().ok().and_then(serde_json::Number::from_f64);
            number.map_or(text.into(), Json::Number)
        }
    }
}

/// Numbers and truth values of a record and of the objects in it, as `seconds.solve`; nothing if there is no such file.
fn figures(record: &Path) -> Vec<(String, Json)> {
    let small = std::fs::metadata(record).is_ok_and(|about| about.len() <= MAX_RECORD);
    let text = small.then(|| std::fs::read_to_string(record).ok()).flatten();
    let Some(Json::Object(fields)) = text.and_then(|text| serde_json::from_str(&text).ok()) else {
        return Vec::new();
    };
    let scalar = |value: &Json| value.is_number() || value.is_boolean();
    let mut found = Vec::new();
    for (name, value) in fields {
        match value {
            // Options are in columns of their own.
            Json::Object(inner) if name != "options" => found.extend(
                inner.into_iter().filter(|(_, v)| scalar(v)).map(|(key, v)| (format!("{name}.{key}"), v)),
            ),
            value if scalar(&value) => found.push((name, value)),
            _ => {}
        }
    }
    found
}
