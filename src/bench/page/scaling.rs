//! Growth of cost: plot and table, and a page of their own for `bench --scaling` without a scene.

use maud::{Markup, html};

use crate::Result;
use crate::bench::record::{ScalingRecord, ScalingRow};
use crate::page::{Cell, bytes, chart, count, document, length, seconds, table};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series, number};

/// The rows of a series, in order.
fn series<'a>(rows: &'a [ScalingRow], name: &str) -> Vec<&'a ScalingRow> {
    rows.iter().filter(|r| r.series == name).collect()
}

/// Time per bundle over triangles; empty without rows.
pub(super) fn section(rows: &[ScalingRow], unit: &str) -> Result<Markup> {
    let Some(first) = rows.first() else { return Ok(html! {}) };
    Ok(html! {
        section {
            h2 { "How cost grows" }
            p {
                "Forests of equal trees, with " (first.rays) " segments from each point to the sky panel, at feature size " (length(first.feature_size, unit)) ". "
                em { "More trees" } ": constant density over more ground, constant solid angle of the panel. "
                em { "Finer leaves" } ": as many trees with more and smaller leaves of constant total area."
            }
            (plot(rows)?)
            (growth(rows))
            @for (name, words) in SERIES { @if let Some(text) = verdict(&series(rows, name), words) { p.note { (text) } } }
        }
    })
}

/// Names of the series in the record and on the page.
const SERIES: [(&str, &str); 2] = [("wider", "more trees"), ("finer", "finer leaves")];

fn plot(rows: &[ScalingRow]) -> Result<Markup> {
    let mut lines = Vec::new();
    for (name, words) in SERIES {
        let line = |engine: &str, time: fn(&ScalingRow) -> f64| Series {
            name: format!("{engine}, {words}"),
            points: series(rows, name)
                .iter()
                .map(|r| PlotPoint { x: r.triangles as f64, y: 1e6 * time(r), label: String::new() })
                .collect(),
            marks: Marks::Joined,
        };
        lines.push(line("exact", |r| r.seconds_per_bundle_exact));
        lines.push(line("multi-res.", |r| r.seconds_per_bundle_mr));
    }
    lines.retain(|line| !line.points.is_empty());
    let plot = Plot {
        y_reach: 0.0,
        x_label: "triangles".into(),
        y_label: "time per bundle, microseconds".into(),
        x_scale: Scale::Log,
        y_scale: Scale::Log,
        series: lines,
    };
    chart(
        &plot,
        400,
        "Both axes are logarithmic: a horizontal line is a cost that does not depend on the size of the scene.",
    )
}

fn growth(rows: &[ScalingRow]) -> Markup {
    let columns = [
        "series",
        "triangles",
        "µs, exact",
        "µs, multi-res.",
        "RMS, exact",
        "RMS, multi-res.",
        "nodes",
        "preparation",
        "memory",
        "per triangle",
    ];
    let line = |row: &ScalingRow| -> [Cell; 10] {
        [
            Cell::from(&row.series),
            count(row.triangles as u64).into(),
            number(1e6 * row.seconds_per_bundle_exact).into(),
            number(1e6 * row.seconds_per_bundle_mr).into(),
            number(row.rms_exact).into(),
            number(row.rms_mr).into(),
            number(row.nodes_per_segment).into(),
            seconds(row.build_s).into(),
            bytes(row.bytes).into(),
            format!("{} B", number(row.bytes_per_triangle.total)).into(),
        ]
    };
    table(columns, &rows.iter().map(line).collect::<Vec<_>>())
}

/// Ratio of the times of the largest and the smallest forest, beside the ratio of the logarithms of their sizes.
fn verdict(rows: &[&ScalingRow], words: &str) -> Option<String> {
    let (first, last) = (rows.first()?, rows.last()?);
    if first.triangles >= last.triangles {
        return None;
    }
    let log = (last.triangles as f64).ln() / (first.triangles as f64).ln();
    let times = |time: fn(&ScalingRow) -> f64| number(time(last) / time(first));
    Some(format!(
        "{words}: {} times the triangles take {} times the time by multi-resolution visibility and {} times by exact \
         rays; their logarithm is {} times as large.",
        number(last.triangles as f64 / first.triangles as f64),
        times(|r| r.seconds_per_bundle_mr),
        times(|r| r.seconds_per_bundle_exact),
        number(log)
    ))
}

/// The page of a run that measured growth only.
///
/// # Errors
/// The plot cannot be drawn.
pub fn render_scaling(record: &ScalingRecord) -> Result<String> {
    let ScalingRecord { mrvis, embree, threads, isa, unit, seed, scaling } = record;
    let plural = if *threads == 1 { "thread" } else { "threads" };
    let body = html! {
        header {
            p.kicker { "Exact against multi-resolution visibility" }
            h1 { "Cost by size of the scene" }
        }
        (section(scaling, unit)?)
        footer {
            p {
                "mrvis " (mrvis) " · Embree " (embree) " (" (isa) ") · " (threads) " " (plural)
                " in the timed sections · seed " (seed) " · lengths in " (unit)
            }
        }
    };
    Ok(document("mrvis bench: cost by size of the scene", &body))
}
