//! Rows by class of receiver as text.

use super::times;
use crate::cli::args::grouped;
use mrvis::internals::bench::record::ClassRecord;
use mrvis::internals::plot::number;
use std::fmt::Write as _;

/// Of each class of receivers the best row, in one line.
pub(super) fn lines(classes: &[ClassRecord], unit: &str) -> String {
    let mut text = String::new();
    if !classes.is_empty() {
        text += "\nreceivers    points  same RMS       RMS       bias\n";
    }
    for class in classes {
        let Some(row) = class.shown_row() else { continue };
        let _ = writeln!(
            text,
            "{:<9} {:>9} {:>9} {:>9.5} {:>+10.5}  by {}, s = {} {unit} with {} segments",
            class.class.name(),
            grouped(class.points),
            times(row.speedup_at_same_rms, row.extrapolated),
            row.rms,
            row.bias,
            row.route_in_words(),
            number(row.feature_size),
            row.rays
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use mrvis::internals::bench::record::{MrRow, ReceiverClass};

    #[test]
    fn each_class_has_a_line() {
        let row = |route: &str, speed| MrRow {
            route: route.into(),
            speedup_at_same_rms: Some(speed),
            rays: 16,
            ..MrRow::default()
        };
        let class = |class, mr| ClassRecord { class, points: 1200, mr, ..ClassRecord::default() };
        let text = lines(
            &[
                class(ReceiverClass::Open, vec![row("cut", 4.5), row("bundle", 1.5)]),
                class(ReceiverClass::Inside, vec![row("embree", 1.0)]),
            ],
            "m",
        );
        assert_eq!(text.lines().count(), 4, "{text}");
        assert!(
            text.contains("open") && text.contains("4.50x") && text.contains("by distance cut"),
            "{text}"
        );
        assert!(
            text.contains("inside") && text.contains("1.00x") && text.contains("by exact rays"),
            "{text}"
        );
        assert!(!text.contains("1.50x"), "{text}");
        assert_eq!(lines(&[], "m"), "");
    }
}
