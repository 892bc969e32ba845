//! Where MR is slower or less accurate than exact rays.

use maud::{Markup, html};

use super::{ReceiverImages, length, receivers::fbem_at, tables::signed, times};
use crate::Result;
use crate::bench::record::Record;
use crate::metrics::difference;
use crate::plot::number;

/// Slow rows, receivers where exact images of 16 rays are more accurate, and the largest differences.
pub(super) fn section(record: &Record, receivers: &[ReceiverImages]) -> Result<Markup> {
    let unit = &record.unit;
    let slow = record
        .mr
        .iter()
        .filter(|row| row.speedup_per_segment < 1.0 || row.speedup_at_same_rms.is_some_and(|s| s < 1.0));
    let slow: Vec<_> = slow.collect();
    let mut worse = Vec::new();
    let mut largest = Vec::new();
    for receiver in receivers {
        for (size, image) in &receiver.mr {
            let size = f64::from(*size);
            let (mr, exact) = (
                fbem_at(&receiver.reference, image, size)?.value,
                fbem_at(&receiver.reference, &receiver.exact16, size)?.value,
            );
            if mr > exact {
                worse.push((&receiver.name, size, mr, exact));
            }
            let d = difference(&receiver.reference, image)?;
            let (at, d) = d.iter().enumerate().fold(
                (0, 0.0),
                |m: (usize, f64), (i, d)| {
                    if d.abs() > m.1.abs() { (i, *d) } else { m }
                },
            );
            largest.push((&receiver.name, size, at % image.width(), at / image.width(), d));
        }
    }
    largest.sort_by(|a, b| b.4.abs().total_cmp(&a.4.abs()));
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
                    div.scroll {
                        table.rows {
                            thead { tr { th.text { "receiver" } th { "s" } th { "FBEM, multi-resolution" } th { "FBEM, exact 16" } } }
                            tbody {
                                @for (name, size, mr, exact) in worse {
                                    tr { td.text { (name) } td { (length(size, unit)) } td { (number(mr)) } td { (number(exact)) } }
                                }
                            }
                        }
                    }
                }
                h3 { "Largest differences to the reference" }
                div.scroll {
                    table.rows {
                        thead { tr { th.text { "receiver" } th { "s" } th { "texel" } th { "difference" } } }
                        tbody {
                            @for (name, size, x, y, d) in largest.iter().take(6) {
                                tr {
                                    td.text { (name) } td { (length(*size, unit)) } td { (x) ", " (y) }
                                    td { (signed(*d)) }
                                }
                            }
                        }
                    }
                }
            }
        }
    })
}
