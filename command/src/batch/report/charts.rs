//! Charts of errors against times: one for each scene, kind of error and two swept options.

use super::super::table::Row;
use super::{COMPARED, COMPARED_NOISE, errors, swept, text, value};
use maud::Markup;
use mrvis::Result;
use mrvis::internals::page::chart;
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
use std::collections::BTreeMap;

/// Series beside the Pareto front: with it a chart has the five colours that can be told apart.
const MAX_SERIES: usize = 4;
/// Charts of a page: each takes 10 to 50 kB.
const MAX_CHARTS: usize = 40;

/// A chart of the page.
pub struct Chart {
    /// What it shows.
    pub title: String,
    /// The chart with its caption.
    pub markup: Markup,
}

/// Errors against times for any two swept options: the first by colour, the second by labels. At most [`MAX_CHARTS`], and how many there
/// would be without that limit.
///
/// # Errors
/// A chart cannot be drawn.
pub fn charts(rows: &[Row]) -> Result<(Vec<Chart>, usize)> {
    let mut by_scene: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| by_scene.entry(text(row, "scene")).or_default().push(row));
    let several = by_scene.values().filter(|rows| errors(rows.iter().copied()).next().is_some()).count() > 1;
    let (mut charts, mut in_all) = (Vec::new(), 0);
    for (scene, rows) in &by_scene {
        for (column, name) in errors(rows.iter().copied()) {
            let known: Vec<&Row> =
                rows.iter().copied().filter(|row| value(row, column).is_some_and(|e| e > 0.0)).collect();
            let options = swept(known.iter().copied());
            for [a, b] in pairs(&options) {
                in_all += 1;
                if in_all > MAX_CHARTS {
                    continue;
                }
                let short = |option: &str| option.trim_start_matches("option.").to_owned();
                let mut title = format!("{name}, by {}", short(a));
                title += &if a == b { String::new() } else { format!(" and {}", short(b)) };
                title += &if several { format!(": {scene}") } else { String::new() };
                let plot = plot(&known, (column, name), a, (a != b).then_some(b));
                let labels = if a == b { String::new() } else { format!("labels are {}; ", short(b)) };
                let caption = format!(
                    "Each dot is a job; colours are {}, {labels}no other job is at once faster and more exact than those on \
                     the Pareto front.{}",
                    short(a),
                    if column == COMPARED { noise(&known) } else { String::new() }
                );
                charts.push(Chart { title, markup: chart(&plot, 420, &caption)? });
            }
        }
    }
    Ok((charts, in_all))
}

/// Says how much of the differences from references is the noise of these.
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

fn plot(rows: &[&Row], (column, name): (&str, &str), colour: &str, label: Option<&str>) -> Plot {
    let point = |row: &&Row| PlotPoint {
        x: value(row, "job_seconds").unwrap_or(0.0),
        y: value(row, column).unwrap_or(0.0),
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
        (name, scale(all.iter().map(|p| p[1]))),
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
