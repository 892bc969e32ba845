//! The page of a batch: a table of all jobs, charts of differences from references against times, pictures.

#[cfg(test)]
mod tests;

use super::table::{COMPARED, COMPARED_NOISE, JobGrid, Row, cell};
use maud::{Markup, PreEscaped, html};
use mrvis::Result;
use mrvis::internals::image_io::Picture;
use mrvis::internals::page::{
    TableCell, bytes, chart, count, data_url, document, figure, seconds, table as plain_table,
};
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
use std::collections::{BTreeMap, BTreeSet};

const SCRIPT: &str = include_str!("report.js");

/// Quantity that charts show: estimates are in the table alone.
const DIFFERENCE: &str = "RMS difference from the reference";
/// Errors of the table: measured by comparison with a reference, estimated, of form factors, of path tracing.
const ERRORS: [(&str, &str); 5] = [
    (COMPARED, DIFFERENCE),
    ("error_estimate", "estimated RMS error"),
    ("report.row_standard_error", "standard error of a row"),
    ("report.row_sum_error", "error of row sums"),
    ("noise", "standard error"),
];
/// Columns of options in the table besides the job: with more it becomes a list on a screen of a notebook.
const MAX_OPTIONS: usize = 5;
/// Columns of errors, for the same reason.
const MAX_ERRORS: usize = 2;
/// Jobs without a row that are named: the figures below stay on the first screen.
const MAX_FAULTS: usize = 10;

/// Grids of points that are listed: a few screens.
const MAX_GRIDS: usize = 200;

/// Contents of the page.
#[derive(Default)]
pub struct Report<'a> {
    /// Name of the output folder.
    pub name: &'a str,
    /// Rows of the table of results.
    pub rows: &'a [Row],
    /// Number of jobs of the job file.
    pub jobs_in_all: usize,
    /// Reasons why jobs have no row.
    pub faults: &'a [String],
    /// Light on grids of points.
    pub grids: &'a [JobGrid],
    /// Pictures of jobs.
    pub pictures: &'a [JobPicture],
    /// Errors of pictures that cannot be read.
    pub unreadable: &'a [String],
    /// Number of pictures that jobs have made.
    pub pictures_in_all: usize,
}

/// A picture that a job has made.
pub struct JobPicture {
    /// Name of the job.
    pub job: String,
    /// Name of the file below the job's folder.
    pub file: String,
    /// Width and height of the picture in the file, pixels.
    pub size: [u32; 2],
    /// The picture, or a smaller one.
    pub picture: Picture,
}

impl JobPicture {
    /// Description of its content: a feature mask, a difference and a grid are recognised by the name of their file.
    fn what(&self) -> String {
        let stem = self.file.rsplit_once('.').map_or(self.file.as_str(), |(stem, _)| stem);
        let size = stem.rsplit_once("mask-").and_then(|(_, size)| size.parse().ok());
        match (size, stem.ends_with("difference")) {
            // Sizes of `fbem` may be in texels.
            (Some(size), _) if stem.starts_with("mask-") => {
                format!("mask of features larger than {} texels or scene units, as in the job", number(size))
            }
            (Some(size), _) => format!("mask of features larger than {} scene units", number(size)),
            (None, true) => "difference from the reference".into(),
            (None, false) if stem.starts_with("grid-") => "light on a grid of points".into(),
            (None, false) => "picture".into(),
        }
    }
}

/// The page as HTML, without references to other files.
///
/// # Errors
/// A picture or a chart cannot be drawn.
pub fn report_page(report: &Report) -> Result<String> {
    let rows = report.rows;
    let (charts, charts_in_all) = charts(rows)?;
    let body = html! {
        (headline(report))
        (failures(rows))
        @if !charts.is_empty() { section { h2 { "Differences against time" } (chart_section(&charts, charts_in_all)) } }
        section {
            h2 { "Jobs" }
            (controls(rows))
            (table(rows))
            p.note { "All figures of all jobs are in results.csv and results.jsonl." }
        }
        (grids(report.grids))
        @if report.pictures_in_all > 0 { section { h2 { "Pictures" } (pictures(report)?) } }
        script { (PreEscaped(SCRIPT)) }
    };
    Ok(document(&format!("mrvis batch: {}", report.name), &body))
}

fn text(row: &Row, column: &str) -> String {
    cell(row.get(column))
}

fn value(row: &Row, column: &str) -> Option<f64> {
    row.get(column).and_then(serde_json::Value::as_f64)
}

/// Columns of options that differ between these jobs.
fn swept<'a>(rows: impl IntoIterator<Item = &'a Row> + Clone) -> Vec<String> {
    let names: BTreeSet<&String> =
        rows.clone().into_iter().flat_map(Row::keys).filter(|k| k.starts_with("option.")).collect();
    let differs = |name: &&String| {
        let values: BTreeSet<String> = rows
            .clone()
            .into_iter()
            .filter(|row| row.contains_key(*name))
            .map(|row| text(row, name))
            .collect();
        values.len() > 1
    };
    names.into_iter().filter(differs).cloned().collect()
}

/// Errors that at least two jobs state.
fn errors<'a>(
    rows: impl IntoIterator<Item = &'a Row> + Clone,
) -> impl Iterator<Item = (&'static str, &'static str)> {
    let known = move |(name, _): &(&str, &str)| {
        rows.clone().into_iter().filter(|row| value(row, name).is_some_and(|e| e > 0.0)).count() > 1
    };
    ERRORS.into_iter().filter(known).take(MAX_ERRORS)
}

fn headline(report: &Report) -> Markup {
    let rows = report.rows;
    let total = |column: &str| rows.iter().filter_map(|row| value(row, column)).sum::<f64>();
    let [failed, missed, skipped] = ["failed", "missed", "skipped"]
        .map(|status| rows.iter().filter(|row| text(row, "status") == status).count());
    html! {
        header {
            p.kicker { "Batch of jobs" }
            h1 { (report.name) }
            p.lead {
                strong { (rows.len() - failed - skipped) } " of " strong { (report.jobs_in_all) } " jobs are done"
                @if missed > 0 { ", " (missed) " of them missed a tolerance" }
                @if skipped > 0 { ", " (skipped) " were skipped because a job that they need failed" } "."
            }
            @for what in report.faults.iter().take(MAX_FAULTS) { p.warning { (what) } }
            @if report.faults.len() > MAX_FAULTS { p.warning { "and " (report.faults.len() - MAX_FAULTS) " more jobs" } }
            div.figures {
                (figure(&count(rows.len() as u64), "jobs"))
                (figure(&seconds(total("job_seconds")), "time of all jobs together"))
                (figure(&bytes(total("output_bytes") as u64), "outputs"))
            }
        }
    }
}

/// Errors of failed jobs; a list that is longer than a screen says so.
fn failures(rows: &[Row]) -> Markup {
    const MAX: usize = 10;
    let failed: Vec<&Row> = rows.iter().filter(|row| text(row, "status") == "failed").collect();
    html! {
        @if !failed.is_empty() {
            section {
                h2 { "Failed" }
                @for row in failed.iter().take(MAX) { p.warning { b { (text(row, "job")) } ": " (text(row, "error_message")) } }
                @if failed.len() > MAX { p.note { "and " (failed.len() - MAX) " more in the table: type failed into its filter" } }
            }
        }
    }
}

fn chart_section(charts: &[Chart], in_all: usize) -> Markup {
    html! {
        @if in_all > charts.len() {
            p.note { (charts.len()) " of " (in_all) " charts: one for each scene and two swept options. The others can be made from results.csv." }
        }
        @if charts.len() > 1 {
            p.controls hidden {
                label { "Chart " select id="chart" { @for (k, chart) in charts.iter().enumerate() { option value=(k) { (chart.title) } } } }
            }
        }
        @for (k, chart) in charts.iter().enumerate() { div.chart id=(format!("chart-{k}")) { h3 { (chart.title) } (chart.markup) } }
    }
}

/// A column of the table: its key in the rows, its heading, and whether it has numbers.
struct Column {
    key: String,
    name: String,
    unit: Unit,
}

#[derive(PartialEq)]
enum Unit {
    Words,
    Number,
    Seconds,
    Bytes,
}

fn columns(rows: &[Row]) -> Vec<Column> {
    let column = |key: &str, name: &str, unit| Column { key: key.into(), name: name.into(), unit };
    let mut columns = vec![column("job", "job", Unit::Words)];
    for (key, name) in [("command", "command"), ("scene", "scene")] {
        let values: BTreeSet<String> = rows.iter().map(|row| text(row, key)).collect();
        columns.extend((values.len() > 1).then(|| column(key, name, Unit::Words)));
    }
    for key in swept(rows).iter().take(MAX_OPTIONS) {
        let numbers = rows.iter().filter_map(|row| row.get(key)).all(serde_json::Value::is_number);
        let unit = if numbers { Unit::Number } else { Unit::Words };
        columns.push(column(key, key.trim_start_matches("option."), unit));
    }
    columns.push(column("status", "status", Unit::Words));
    columns.push(column("job_seconds", "time", Unit::Seconds));
    columns.extend(errors(rows).map(|(key, name)| column(key, name, Unit::Number)));
    columns.push(column("output_bytes", "outputs", Unit::Bytes));
    columns
}

fn controls(rows: &[Row]) -> Markup {
    html! {
        p.controls hidden {
            label { "Filter " input id="filter" type="search" size="24"; }
            label { "Sort by " select id="sort" { @for (k, column) in columns(rows).iter().enumerate() { option value=(k) { (column.name) } } } }
            label { input id="down" type="checkbox"; " falling" }
            span.note id="count" {}
        }
    }
}

fn table(rows: &[Row]) -> Markup {
    let columns = columns(rows);
    let class = |column: &Column| (column.unit == Unit::Words).then_some("text");
    html! {
        table.rows.many id="jobs" {
            thead { tr { @for column in &columns { th scope="col" class=[class(column)] { (column.name) } } } }
            tbody {
                @for row in rows {
                    tr {
                        @for column in &columns {
                            td class=[class(column)] data-name=(column.name) data-value=[value(row, &column.key)] { (shown(row, column)) }
                        }
                    }
                }
            }
        }
    }
}

fn shown(row: &Row, column: &Column) -> String {
    match (value(row, &column.key), &column.unit) {
        (Some(s), Unit::Seconds) => seconds(s),
        (Some(n), Unit::Bytes) => bytes(n as u64),
        (Some(x), Unit::Number) => number(x),
        _ => text(row, &column.key),
    }
}

/// The light on grids of points; their pictures are among those of the jobs.
fn grids(grids: &[JobGrid]) -> Markup {
    let row = |JobGrid { job, grid }: &JobGrid| {
        let [height, minimum, mean, maximum] =
            [grid.height, grid.minimum, grid.mean, grid.maximum].map(|x| TableCell::from(number(x)));
        let points = format!("{} × {}", grid.columns, grid.rows);
        let uniformity = grid.uniformity.map_or_else(String::new, |u| format!("{u:.2}"));
        let [job, name, unit] = [job, &grid.name, &grid.unit].map(TableCell::words);
        [job, name, points.into(), height, minimum, mean, maximum, unit, uniformity.into()]
    };
    let columns =
        "job | surface | points | height, scene units | minimum | mean | maximum | unit | uniformity U0";
    let rows: Vec<_> = grids.iter().take(MAX_GRIDS).map(row).collect();
    html! {
        @if !grids.is_empty() {
            section {
                h2 { "Grids of points" }
                (plain_table(columns, &rows))
                p.note {
                    "Uniformity U0 is the minimum divided by the mean (EN 12464)."
                    @if grids.len() > MAX_GRIDS { " These are " (MAX_GRIDS) " of " (grids.len()) " grids; the others are in the records of their jobs." }
                }
            }
        }
    }
}

fn pictures(report: &Report) -> Result<Markup> {
    let urls = report.pictures.iter().map(|picture| Ok((picture, data_url(&picture.picture)?)));
    let urls = urls.collect::<Result<Vec<_>>>()?;
    Ok(html! {
        @if report.pictures_in_all > urls.len() + report.unreadable.len() {
            p.note { (urls.len()) " of " (report.pictures_in_all) " pictures; the others are in the folders of their jobs." }
        }
        @for what in report.unreadable { p.warning { "A picture cannot be read: " (what) } }
        div.images.small {
            @for (picture, url) in &urls {
                @let JobPicture { job, file, size: [width, height], .. } = picture;
                figure data-job=(job) {
                    div.frame { img src=(url) alt=(format!("{} of {job}", picture.what())); }
                    figcaption { (job) ": " (picture.what()) ", " (file) ", " (width) " × " (height) " pixels" }
                }
            }
        }
    })
}

/// Series beside the Pareto front: with it a chart has the five colours that can be told apart.
const MAX_SERIES: usize = 4;
/// Charts of a page: each takes 10 to 50 kB.
const MAX_CHARTS: usize = 40;

/// A chart of the page.
pub struct Chart {
    /// Title of the chart.
    pub title: String,
    /// The chart with its caption.
    pub markup: Markup,
}

/// Differences from references against times for any two swept options: the first by colour, the second by labels. At most
/// [`MAX_CHARTS`], and how many there would be without that limit.
///
/// # Errors
/// A chart cannot be drawn.
pub fn charts(rows: &[Row]) -> Result<(Vec<Chart>, usize)> {
    let mut by_scene: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| by_scene.entry(text(row, "scene")).or_default().push(row));
    let compared = |row: &&Row| value(row, COMPARED).is_some_and(|e| e > 0.0);
    by_scene.values_mut().for_each(|rows| rows.retain(compared));
    by_scene.retain(|_, rows| rows.len() > 1);
    let several = by_scene.len() > 1;
    let (mut charts, mut in_all) = (Vec::new(), 0);
    for (scene, rows) in &by_scene {
        for [a, b] in pairs(&swept(rows.iter().copied())) {
            in_all += 1;
            if in_all > MAX_CHARTS {
                continue;
            }
            let short = |option: &str| option.trim_start_matches("option.").to_owned();
            let mut title = format!("{DIFFERENCE}, by {}", short(a));
            title += &if a == b { String::new() } else { format!(" and {}", short(b)) };
            title += &if several { format!(": {scene}") } else { String::new() };
            let plot = plot(rows, a, (a != b).then_some(b));
            let labels = if a == b { String::new() } else { format!("labels are {}; ", short(b)) };
            let caption = format!(
                "Each dot is a job; colours are {}, {labels}no other job is at once faster and more exact than those on \
                 the Pareto front.{}",
                short(a),
                noise(rows)
            );
            charts.push(Chart { title, markup: chart(&plot, 420, &caption)? });
        }
    }
    Ok((charts, in_all))
}

/// A sentence about the fraction of the differences that is noise of the references.
fn noise(rows: &[&Row]) -> String {
    let values = || rows.iter().filter_map(|row| value(row, COMPARED_NOISE));
    let (least, most) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
    match most > 0.0 {
        true if least == most => {
            format!(" Each difference includes the noise of the reference, {}.", number(most))
        }
        true => {
            format!(
                " Each difference includes the noise of its reference, {} to {}.",
                number(least),
                number(most)
            )
        }
        false => String::new(),
    }
}

/// All pairs of options, in both orders; the only option with itself.
fn pairs<'a>(options: &'a [String]) -> Vec<[&'a str; 2]> {
    match options {
        [] => Vec::new(),
        [only] => vec![[only, only]],
        _ => {
            let of = |a: &'a String| {
                options.iter().filter(move |b| *b != a).map(move |b| [a.as_str(), b.as_str()])
            };
            options.iter().flat_map(of).collect()
        }
    }
}

fn plot(rows: &[&Row], colour: &str, label: Option<&str>) -> Plot {
    let point = |row: &&Row| PlotPoint {
        x: value(row, "job_seconds").unwrap_or(0.0),
        y: value(row, COMPARED).unwrap_or(0.0),
        label: label.map_or(String::new(), |label| text(row, label)),
    };
    let short = colour.trim_start_matches("option.");
    let mut series: Vec<Series> = groups(rows, colour)
        .into_iter()
        .map(|(values, rows)| {
            Series::new(format!("{short} {values}"), rows.iter().map(point).collect(), Marks::Points)
        })
        .collect();
    let all: Vec<[f64; 2]> = rows.iter().map(point).map(|p| [p.x, p.y]).collect();
    let front = front(&all).into_iter().map(|[x, y]| PlotPoint { x, y, label: String::new() });
    series.push(Series::new("Pareto front", front.collect(), Marks::Joined));
    Plot::new(
        ("time of the job, s", scale(all.iter().map(|p| p[0]))),
        (DIFFERENCE, scale(all.iter().map(|p| p[1]))),
        series,
    )
}

/// A logarithmic scale if it has at least two powers of ten to be labelled: below that a linear one has more marks.
fn scale(values: impl Iterator<Item = f64> + Clone) -> Scale {
    let (least, most) = (values.clone().fold(f64::INFINITY, f64::min), values.fold(0.0, f64::max));
    if least > 0.0 && most > 100.0 * least { Scale::Log } else { Scale::Linear }
}

/// Jobs by the value of an option. Beyond [`MAX_SERIES`] values, neighbours are put together in groups of equal numbers of values.
fn groups<'a>(rows: &[&'a Row], option: &str) -> Vec<(String, Vec<&'a Row>)> {
    let mut values: Vec<(Option<f64>, String)> =
        rows.iter().map(|row| (value(row, option), text(row, option))).collect();
    values.sort_by(|a, b| match (a.0, b.0) {
        (Some(x), Some(y)) => x.total_cmp(&y),
        (x, y) => x.is_none().cmp(&y.is_none()).then_with(|| a.1.cmp(&b.1)),
    });
    values.dedup();
    let size = values.len().div_ceil(MAX_SERIES).max(1);
    let shown = |(number_of, text): &(Option<f64>, String)| match (number_of, text.as_str()) {
        (Some(x), _) => number(*x),
        (None, "") => "not given".into(),
        (None, text) => text.to_owned(),
    };
    let group = |part: &[(Option<f64>, String)]| {
        let name = match part {
            [one] => shown(one),
            [first, .., last] => format!("{} to {}", shown(first), shown(last)),
            [] => String::new(),
        };
        let own = |row: &&&Row| part.iter().any(|(_, known)| *known == text(row, option));
        (name, rows.iter().filter(own).copied().collect())
    };
    values.chunks(size).map(group).collect()
}

/// The points that no other point beats in both times and errors, by time.
pub fn front(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut front: Vec<[f64; 2]> = Vec::new();
    for point in sorted {
        if front.last().is_none_or(|last| point[1] < last[1]) {
            front.push(point);
        }
    }
    front
}
