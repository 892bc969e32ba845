//! Rows by class of receiver.

use maud::{Markup, html};

use crate::bench::record::{ClassRecord, MrRow, ReceiverClass};
use crate::page::{Cell, count, length, percent, seconds, signed, table};
use crate::plot::number;

/// The best row of each class; empty without any class.
pub(super) fn section(classes: &[ClassRecord], unit: &str) -> Markup {
    let rows: Vec<_> =
        classes.iter().filter_map(|class| Some(row(class, class.shown_row()?, unit))).collect();
    if rows.is_empty() {
        return html! {};
    }
    let columns = "receivers | points | s | segments | answered by | time | RMS | bias | speed-up, same RMS | slowest row | speed-up, segment | \
         in bounds";
    html! {
        section {
            h2 { "Classes of receivers" }
            p {
                "How much averaging gains depends on what lies around a receiver point. Each line is the row of its class with the largest \
                 speed-up at the same error; “slowest row” is the smallest such speed-up of a row of the class. What answers is decided \
                 for each class and row on a sample."
            }
            (table(columns, &rows))
            dl.glossary {
                @for class in classes { dt { (class.class.name()) } dd { (meaning(class.class)) } }
            }
        }
    }
}

fn row(class: &ClassRecord, row: &MrRow, unit: &str) -> [Cell; 12] {
    [
        Cell::words(class.class.name()),
        count(class.points as u64).into(),
        length(row.feature_size, unit).into(),
        row.rays.into(),
        Cell::words(row.route_in_words()),
        seconds(row.seconds).into(),
        number(row.rms).into(),
        signed(row.bias).into(),
        Cell::speedup(row.speedup_at_same_rms, row.extrapolated),
        Cell::speedup(class.smallest_speedup(), false),
        Cell::speedup(Some(row.speedup_per_segment), false),
        percent(row.interval_coverage).into(),
    ]
}

fn meaning(class: ReceiverClass) -> &'static str {
    match class {
        ReceiverClass::Open => "On a large surface, with nothing small near: a lawn, a facade.",
        ReceiverClass::Near => "On a large surface, with something small near: ground under a hedge.",
        ReceiverClass::Inside => {
            "On something small: a leaf, a twig, a blade of grass, an object on a table outdoors."
        }
        ReceiverClass::Interior => "Enclosed by large surfaces: the emitters are in the same room.",
    }
}
