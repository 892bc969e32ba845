//! Claimed against observed error.

use maud::{Markup, html};

use crate::Result;
use crate::bench::record::{IntervalAudit, MrRow, Record};
use crate::bench::shown;
use crate::page::{chart, length, table};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};

/// Largest number of feature sizes in the plot: with the diagonal, one per colour.
const MAX_SIZES: usize = 4;

/// Calibration plot and table; empty without an audit.
pub(super) fn calibration(record: &Record) -> Result<Markup> {
    let rows = shown::audited(record);
    let Some(&(_, any)) = rows.first() else { return Ok(html! {}) };
    let audits = shown::audits(record);
    Ok(html! {
        section {
            h2 { "Claimed and observed errors" }
            p {
                "Every answer has an interval that is stated to contain the true visible fraction in 95 of 100 cases; \
                 its width claims a standard error. The audit compares the answers of " (any.bundles) " random \
                 bundles with " (any.rays) " independent exact rays each. In the plot each point is a group of bundles \
                 with similar claimed errors. On the diagonal claimed and observed error are equal; above it the \
                 observed error is larger than claimed."
            }
            (plot(&rows, &record.unit)?)
            (table(audits.0, &audits.1))
            p.note {
                "Rows of " (record.workload.rays) " segments. The noise of the audit's rays is subtracted from the \
                 observed error. An interval is confirmed if the mean of the rays differs from the answer by no more \
                 than the stated half width and 1.96 standard errors of the rays, added as squares: correct intervals \
                 are confirmed in 95 of 100 cases, and one ray refutes a certificate. “In bounds” is the part of all \
                 bundles whose interval is confirmed by the reference of " (record.workload.reference_rays)
                " rays on every bundle."
            }
        }
    })
}

fn plot(rows: &[(&MrRow, &IntervalAudit)], unit: &str) -> Result<Markup> {
    let point = |x: f64, y: f64| PlotPoint { x, y, label: String::new() };
    let shown: Vec<Series> = rows
        .iter()
        .take(MAX_SIZES)
        .map(|(row, audit)| {
            Series::new(
                format!("s = {}", length(row.feature_size, unit)),
                audit.bins.iter().map(|bin| point(bin.claimed, bin.observed)).collect(),
                Marks::Points,
            )
        })
        .collect();
    let claims = shown.iter().flat_map(|s| &s.points).map(|p| p.x).filter(|x| *x > 0.0);
    let ends = claims.fold((f64::MAX, 0.0), |(a, b): (f64, f64), x| (a.min(x), b.max(x)));
    let diagonal =
        Series::new("claimed = observed", vec![point(ends.0, ends.0), point(ends.1, ends.1)], Marks::Joined);
    let plot = Plot::new(
        ("claimed standard error of the visible fraction", Scale::Log),
        ("observed error (RMS)", Scale::Log),
        std::iter::once(diagonal).chain(shown).collect(),
    );
    chart(
        &plot,
        380,
        "Claimed against observed error, both axes logarithmic. Groups without any observed error are not shown.",
    )
}
