//! Where MR is slower or less accurate than exact rays.

use maud::{Markup, html};

use super::receivers::Spot;
use super::{MrImage, ReceiverImages};
use crate::Result;
use crate::bench::record::Record;
use crate::metrics::fbem::fbem_at;
use crate::page::{TableCell, length, signed, table, times};
use crate::plot::number;

/// Slow rows, receivers where exact images of 16 rays are more accurate, and the largest differences.
pub(super) fn section(record: &Record, receivers: &[ReceiverImages]) -> Result<Markup> {
    let unit = &record.unit;
    let is_slow = |speedup| record.gain(speedup).is_some_and(|s| s < 1.0);
    let slow = record
        .shown_rows()
        .iter()
        .filter(|row| is_slow(Some(row.speedup_per_segment)) || is_slow(row.speedup_at_same_rms));
    let slow: Vec<_> = slow.collect();
    let mut worse = Vec::new();
    let mut largest = Vec::new();
    for receiver in receivers {
        for MrImage { size, image, .. } in &receiver.mr {
            let size = f64::from(*size);
            let (mr, exact) = (
                fbem_at(&receiver.reference, image, size)?.value,
                fbem_at(&receiver.reference, &receiver.exact16, size)?.value,
            );
            if mr > exact {
                let name = TableCell::words(&receiver.name);
                worse.push([name, length(size, unit).into(), number(mr).into(), number(exact).into()]);
            }
            largest.push((&receiver.name, size, Spot::of(&receiver.reference, image)?));
        }
    }
    largest.sort_by(|(.., a), (.., b)| b.difference.abs().total_cmp(&a.difference.abs()));
    let largest: Vec<[TableCell; 4]> = largest
        .into_iter()
        .take(6)
        .map(|(name, size, Spot { x, y, difference, .. })| {
            let place = format!("{x}, {y}").into();
            [TableCell::words(name), length(size, unit).into(), place, signed(difference).into()]
        })
        .collect();
    Ok(html! {
        section {
            h2 { "Where multi-resolution loses" }
            h3 { "Slower than exact" }
            @if slow.is_empty() {
                p { "At no feature size, neither per segment nor at the same error." }
            } @else {
                ul {
                    @for row in slow {
                        li {
                            "s = " (length(row.feature_size, unit)) ", " (row.rays) " segments: " (times(Some(row.speedup_per_segment)))
                            " per segment, " (times(row.speedup_at_same_rms)) " at the same RMS error"
                        }
                    }
                }
            }
            @if !receivers.is_empty() {
                h3 { "Less accurate than exact with 16 rays, by features" }
                @if worse.is_empty() {
                    p { "On no receiver." }
                } @else {
                    (table("receiver | s | FBEM, multi-resolution | FBEM, exact 16", &worse))
                }
                h3 { "Largest differences to the reference" }
                (table("receiver | s | texel | difference", &largest))
            }
        }
    })
}
