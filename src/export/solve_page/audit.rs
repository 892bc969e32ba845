//! Error bars against errors.

use crate::Result;
use crate::page::{chart, percent};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};
use crate::radiosity::Record;
use maud::{Markup, html};

/// Part of normally distributed errors within 1/4, 2/4, … 12/4 standard deviations: erf(k/4 / √2).
const NORMAL: [f64; 12] =
    [0.1974, 0.3829, 0.5467, 0.6827, 0.7887, 0.8664, 0.9199, 0.9545, 0.9756, 0.9876, 0.9940, 0.9973];

/// What the part of the errors within one error bar says, where chance explains twice its standard deviation.
fn verdict(elements: usize, within_one: f64) -> &'static str {
    let chance = 2.0 * (NORMAL[3] * (1.0 - NORMAL[3]) / elements as f64).sqrt();
    match within_one - NORMAL[3] {
        more if more > chance => "the bars are cautious, and most errors are smaller than they say",
        less if less < -chance => "the bars are too narrow, and errors are larger than they say",
        _ => "the bars say how large errors are",
    }
}

/// Plot and words; empty without an audit.
pub(super) fn section(record: &Record) -> Result<Markup> {
    let Some(audit) = record.audit.as_ref().filter(|audit| audit.elements > 0) else { return Ok(html! {}) };
    let series = |name: &str, parts: &[f64; 12], marks| {
        Series::new(
            name,
            parts
                .iter()
                .enumerate()
                .map(|(k, &y)| PlotPoint { x: 0.25 * (k + 1) as f64, y, label: String::new() })
                .collect(),
            marks,
        )
    };
    let plot = Plot::new(
        ("error, in error bars", Scale::Linear),
        ("part of the elements", Scale::Linear),
        vec![
            series("normal distribution", &NORMAL, Marks::Line),
            series("elements of the audit", &audit.within_quarters, Marks::Points),
        ],
    );
    let chart = chart(
        &plot,
        320,
        "Part of the audited elements whose error is at most so many error bars. Points above the line: the bars are \
         wider than the errors; below: too narrow.",
    )?;
    Ok(html! {
        section {
            h2 { "Are the error bars right?" }
            p {
                "The light of " (audit.elements) " elements, drawn by area, was computed again by independent paths of \
                 exact rays. " (percent(audit.within_one)) " of their errors lie within one error bar and "
                (percent(audit.within_two)) " within two (68 and 95 % for a normal distribution): " (verdict(audit.elements, audit.within_one)) ". The error of the \
                 whole solution above comes from the same paths."
            }
            (chart)
        }
    })
}
