//! The tables of all jobs, `results.csv` and `results.jsonl`, and the light on grids of points in the records of `solve` jobs.

use super::expand::outputs_of;
use super::journal::Entry;
use mrvis::internals::files::{WholeFile, csv_text, escaped};
use mrvis::{Error, Result};
use serde::Deserialize;
use serde_json::{Map, Value, Value as Json};
use std::collections::HashMap;
use std::path::Path;

/// Largest record of a job that is read, bytes: that of a solve has some kilobytes.
const MAX_RECORD: u64 = 16 << 20;

/// Writes the tables of jobs that have ended, in the order of the job file.
///
/// # Errors
/// A table cannot be written.
pub fn write_results<'a>(out: &Path, entries: impl IntoIterator<Item = &'a Entry>) -> Result<()> {
    write_tables(out, &rows(out, entries))
}

/// The rows of jobs in the order of the job file.
pub fn rows<'a>(out: &Path, entries: impl IntoIterator<Item = &'a Entry>) -> Vec<Row> {
    let mut entries: Vec<&Entry> = entries.into_iter().collect();
    entries.sort_by(|a, b| (a.index, &a.job).cmp(&(b.index, &b.job)));
    let mut rows: Vec<Row> = entries.into_iter().map(|entry| row(out, entry)).collect();
    add_comparisons(&mut rows);
    rows
}

/// Column of a job whose output was compared with a reference: the RMS difference that the comparison found.
pub const COMPARED: &str = "compared.rms";

/// Column of the same job: the noise of the reference, which is part of that difference.
pub const COMPARED_NOISE: &str = "compared.noise";

/// Notes the results of comparisons at the jobs whose outputs were compared.
fn add_comparisons(rows: &mut [Row]) {
    let found: HashMap<String, [Json; 2]> = rows
        .iter()
        .filter(|row| row["command"] == "compare")
        .filter_map(|row| {
            let compared = row.get("inputs")?.get(1)?.as_str()?;
            let figures = ["rms", "reference_noise"].map(|name| row.get(name).cloned());
            let [Some(rms), noise] = figures else { return None };
            Some(((*outputs_of(compared).first()?).to_owned(), [rms, noise.unwrap_or_default()]))
        })
        .collect();
    for row in rows {
        if let Some([rms, noise]) = row["job"].as_str().and_then(|job| found.get(job)) {
            row.insert(COMPARED.into(), rms.clone());
            row.insert(COMPARED_NOISE.into(), noise.clone());
        }
    }
}

/// Writes rows as tables of an output folder.
///
/// # Errors
/// A table cannot be written.
fn write_tables(out: &Path, rows: &[Row]) -> Result<()> {
    let lines = rows.iter().map(|row| serde_json::to_string(row).unwrap_or_default() + "\n");
    WholeFile::write(&out.join("results.jsonl"), escaped(lines.collect()))?;
    let columns = columns(rows);
    let path = out.join("results.csv");
    let at = |e: csv::Error| Error::format(&path, None, e.to_string());
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(&columns).map_err(at)?;
    for row in rows {
        table.write_record(columns.iter().map(|name| csv_cell(row.get(name)))).map_err(at)?;
    }
    let text = table.into_inner().map_err(|e| Error::format(&path, None, e.to_string()))?;
    WholeFile::write(&path, text)
}

/// A value in a cell of CSV.
fn csv_cell(value: Option<&Json>) -> String {
    match value {
        Some(Json::String(text)) => csv_text(text).into_owned(),
        _ => cell(value),
    }
}

/// Columns before and after those of swept options; all others follow in alphabetic order.
const BEFORE: [&str; 5] = ["job", "command", "scene", "inputs", "tags"];
const AFTER: [&str; 9] = [
    "status",
    "job_seconds",
    "job_threads",
    "attempt",
    "output_bytes",
    "output_blake3",
    "key",
    "command_line",
    "error_message",
];

/// All names of columns: what a job is, its swept options, how it ended, then the numbers of its record.
fn columns(rows: &[Row]) -> Vec<String> {
    let place =
        |name: &str| match (BEFORE.iter().position(|n| *n == name), AFTER.iter().position(|n| *n == name)) {
            (Some(k), _) => k,
            (_, Some(k)) => BEFORE.len() + 1 + k,
            _ if name.starts_with("option.") => BEFORE.len(),
            _ => BEFORE.len() + 1 + AFTER.len(),
        };
    let mut names: Vec<String> = rows.iter().flat_map(|row| row.keys().cloned()).collect();
    names.sort_by(|a, b| (place(a), a).cmp(&(place(b), b)));
    names.dedup();
    names
}

/// The row of a job: what ran, how it ended, and the numbers of its record.
fn row(out: &Path, entry: &Entry) -> Row {
    let mut row = Row::new();
    row.insert("job".into(), entry.job.as_str().into());
    row.extend(entry.about.clone());
    let mut add = |name: &str, value: Json| drop(row.insert(name.into(), value));
    add("status", serde_json::to_value(entry.status).unwrap_or_default());
    add("job_seconds", entry.seconds.into());
    add("job_threads", entry.threads.into());
    add("attempt", entry.attempt.into());
    add("error_message", entry.error.as_deref().into());
    add("output_bytes", entry.outputs.iter().map(|file| file.bytes).sum::<u64>().into());
    add("output_blake3", entry.fingerprint().into());
    add("key", entry.key.as_str().into());
    add("command_line", entry.command.as_str().into());
    if entry.has_outputs() {
        let record = out.join(&entry.job).join(&entry.record);
        for (name, value) in figures(&record) {
            row.entry(name).or_insert(value);
        }
    }
    row
}

/// The fields of a record; none if there is no such file.
pub fn record(path: &Path) -> Option<Row> {
    let small = std::fs::metadata(path).is_ok_and(|about| about.len() <= MAX_RECORD);
    let text = small.then(|| std::fs::read_to_string(path).ok()).flatten()?;
    serde_json::from_str(&text).ok()
}

/// Numbers and truth values of a record and of the objects in it, as `seconds.solve`; nothing if there is no such file.
fn figures(record: &Path) -> Vec<(String, Json)> {
    let fields = self::record(record).unwrap_or_default();
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

/// Values by the names of their columns.
pub type Row = Map<String, Value>;

/// A value in a cell of text.
pub fn cell(value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
    }
}

/// A grid in a record; see `--grid` of `mrvis solve`.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct RecordedGrid {
    /// The object, group or material.
    pub name: String,
    /// Number of points along the horizontal side.
    pub columns: usize,
    /// Number of points along the vertical side.
    pub rows: usize,
    /// Height above the surface, scene units.
    pub height: f64,
    /// Unit of the light.
    pub unit: String,
    /// Smallest light.
    pub minimum: f64,
    /// Mean light.
    pub mean: f64,
    /// Largest light.
    pub maximum: f64,
    /// Minimum divided by mean.
    pub uniformity: Option<f64>,
}

/// A grid of a job.
#[derive(Clone, Debug)]
pub struct JobGrid {
    /// Name of the job.
    pub job: String,
    /// The grid.
    pub grid: RecordedGrid,
}

/// The grids of jobs with outputs below `out`, in the order of the jobs.
pub fn grids<'a>(out: &Path, entries: impl IntoIterator<Item = &'a Entry>) -> Vec<JobGrid> {
    let of = |entry: &Entry| -> Vec<JobGrid> {
        let fields = record(&out.join(&entry.job).join(&entry.record)).unwrap_or_default();
        let grids = fields.get("grids").and_then(|grids| Vec::<RecordedGrid>::deserialize(grids).ok());
        let of_job = |grid| JobGrid { job: entry.job.clone(), grid };
        grids.unwrap_or_default().into_iter().map(of_job).collect()
    };
    entries.into_iter().filter(|entry| entry.has_outputs()).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn texts_are_no_formulas_for_spreadsheets() {
        for (value, want) in [
            (json!("=1+1"), "'=1+1"),
            (json!("+a"), "'+a"),
            (json!("-a"), "'-a"),
            (json!("@a"), "'@a"),
            (json!("a=1"), "a=1"),
            (json!("\u{202e}=1"), "'=1"),
            (json!(-1.5), "-1.5"),
            (json!(null), ""),
        ] {
            assert_eq!(csv_cell(Some(&value)), want);
        }
    }
}
