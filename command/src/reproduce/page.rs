//! The page of a reproduction: for each item the paper's claim, what was made here, and the verdict.

use super::item::{Chart, ChartRow, Check, Item, PictureRow, Table};
use super::{Report, fixed};
use maud::{Markup, html};
use mrvis::Result;
use mrvis::internals::page::{chart, data_url, document, figure, seconds, small_chart};

const TITLE: &str = "Feature-based control of visibility error, reproduced";
/// Characters of a cell beyond which its column is text, whose lines are broken.
const MIN_TEXT_CELL: usize = 24;
/// Number of charts of a row beyond which they are small, two side by side.
const LARGE_CHARTS: usize = 2;
/// Said of checks of times.
const TIMED: &str = "timed: varies from run to run";
/// Height of a chart in wide windows, pixels.
const CHART_HEIGHT: u32 = 340;

/// The page, one file without references to others.
///
/// # Errors
/// A picture or chart cannot be drawn.
pub fn page(report: &Report, command: &str) -> Result<String> {
    let items = report.items.iter().map(section).collect::<Result<Vec<_>>>()?;
    let failed: Vec<&Item> = report.items.iter().filter(|item| !item.holds).collect();
    let body = html! {
        p.kicker { "mrvis " (report.mrvis) ", " (report.threads) " threads" }
        h1 { (TITLE) }
        p.lead {
            strong { (report.summary()) }
            ": figures and tables of F. Sillion and G. Drettakis, Feature-based control of visibility error: a multi-resolution \
             clustering algorithm for global illumination (INRIA RR-2503, 1995), made again with this engine. "
            "Scenes of the paper that are lost were built again with the same kind and number of polygons; each item says how."
        }
        div.figures {
            (figure(&format!("{} of {}", report.hold, report.items.len()), "verdicts hold"))
            (figure(&seconds(report.seconds), "for all items"))
        }
        @for item in &failed {
            p.warning {
                a href={ "#" (item.name) } { (item.title) } ": " (item.verdict()) ", "
                (item.missed()) " of " (item.checks.len()) " checks do not hold"
            }
        }
        h2 { "Verdicts" }
        (overview(report))
        @for item in items { (item) }
        h2 { "Repeat" }
        pre { (command) }
    };
    Ok(document(TITLE, &body))
}

fn overview(report: &Report) -> Markup {
    let mut table = Table::new("", "item | verdict | checks | time");
    for item in &report.items {
        let held = item.checks.len() - item.missed();
        table.push([
            item.title.into(),
            item.verdict().into(),
            format!("{held} of {}", item.checks.len()).into(),
            seconds(item.seconds).into(),
        ]);
    }
    rows(&table)
}

fn section(item: &Item) -> Result<Markup> {
    let pictures = item.pictures.iter().map(picture_row).collect::<Result<Vec<_>>>()?;
    let charts = item.charts.iter().map(chart_row).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        article id=(item.name) {
            h2 { (item.title) }
            div.columns {
                div { h3 { "The paper" } p { (item.claim) } }
                div { h3 { "Here" } p { (prose(&item.here)) } }
            }
            @for warning in &item.warnings { p.warning { (prose(warning)) } }
            @for row in pictures { (row) }
            @for row in charts { (row) }
            @for table in &item.tables {
                @if !table.title.is_empty() { h4 { (table.title) } }
                (rows(table))
            }
            h4 { "Verdict: " @if item.holds { "holds" } @else { span.loss { (item.verdict()) } } ", " (fixed(item.seconds, 1)) " s" }
            @for check in &item.checks { (checked(check)) }
        }
    })
}

/// A check, with its numbers and the reason of a failure.
fn checked(check: &Check) -> Markup {
    let details = html! {
        @if check.timed { " (" (TIMED) ")" }
        @if !check.measured.is_empty() { br; span.note { (check.measured) } }
        @if let Some(reason) = &check.reason { br; span.note { "Reason: " (reason) } }
    };
    match check.holds {
        true => html! { p { "✓ " (check.statement) (details) } },
        false => html! { p.warning { "✗ not so: " (check.statement) (details) } },
    }
}

/// The charts of a row, small ones side by side.
fn chart_row(row: &ChartRow) -> Result<Markup> {
    let large = row.charts.len() <= LARGE_CHARTS;
    let drawn = |c: &Chart| match large {
        true => chart(&c.plot, CHART_HEIGHT, &c.caption),
        false => small_chart(&c.plot, &c.caption),
    };
    let charts = row.charts.iter().map(drawn).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        @if !row.title.is_empty() { h4 { (row.title) } }
        @if large { @for chart in charts { (chart) } } @else { div.views { @for chart in charts { (chart) } } }
    })
}

/// Text in which commands stand between back quotes.
fn prose(text: &str) -> Markup {
    html! {
        @for (k, part) in text.split('`').enumerate() { @if k % 2 == 1 { code { (part) } } @else { (part) } }
    }
}

fn picture_row(row: &PictureRow) -> Result<Markup> {
    let panels = row.panels.iter().map(|p| Ok((data_url(&p.picture)?, p))).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        h4 { (row.title) }
        div.images.small {
            @for (url, panel) in panels {
                figure {
                    div.frame { img.texels src=(url) alt=(panel.caption); }
                    figcaption { (panel.caption) }
                }
            }
        }
    })
}

/// A table whose number of columns is known when it is made; in narrow windows rows are lists.
fn rows(table: &Table) -> Markup {
    let class = if table.columns.len() > 6 { "rows many" } else { "rows" };
    let is_long = |k: usize| table.rows.iter().any(|row| row[k].text().chars().count() > MIN_TEXT_CELL);
    let words = |k: usize| k == 0 || is_long(k);
    html! {
        table class=(class) {
            thead { tr {
                @for (k, column) in table.columns.iter().enumerate() {
                    th scope="col" class=[words(k).then_some("text")] { (column.label()) }
                }
            } }
            tbody {
                @for row in &table.rows {
                    tr {
                        @for (k, (cell, column)) in row.iter().zip(&table.columns).enumerate() {
                            td class=[words(k).then_some("text")] data-name=(column.label()) { (prose(&cell.text())) }
                        }
                    }
                }
            }
        }
    }
}
