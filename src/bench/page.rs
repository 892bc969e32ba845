//! `report.html`: results of a benchmark.
//!
//! One file without references to other files or to the network: pictures are inline PNG and SVG. The page is a pure
//! function of record and images.

use maud::{Markup, html};

use super::record::{MrRow, NO_FASTER, Record};
use crate::Result;
use crate::metrics::Image;
use crate::page::{document, figure, file_name, length, percent, times};

mod classes;
mod losses;
mod maps;
mod plots;
mod prose;
mod receivers;
mod tables;
mod trust;

/// Shadow images of one receiver, of equal size: fraction of the unoccluded irradiance at each texel, in [0, 1].
/// Feature masks are computed from the reference.
#[derive(Clone, Debug)]
pub struct ReceiverImages {
    /// Name of the receiver, as in the record.
    pub name: String,
    /// Sides of the surface that the images are a window of, scene units.
    pub surface: [f64; 2],
    /// Exact, with the rays of the reference.
    pub reference: Image<'static>,
    /// Exact, with 16 rays per texel.
    pub exact16: Image<'static>,
    /// MR, by feature size.
    pub mr: Vec<MrImage>,
    /// If all bundles of all sizes were handed to Embree: what clusters answer at the largest size.
    pub clusters: Option<Image<'static>>,
}

/// A shadow image by MR.
#[derive(Clone, Debug)]
pub struct MrImage {
    /// Feature size, scene units.
    pub size: f32,
    /// The image.
    pub image: Image<'static>,
    /// Whether all bundles were handed to Embree: the image is an exact one.
    pub handed_over: bool,
}

/// The page as HTML. `command` is the command line that repeats the run, if there is one.
///
/// # Errors
/// [`Error::Argument`](crate::Error::Argument): the images of a receiver differ in size, or a feature size is
/// invalid.
pub fn render(record: &Record, receivers: &[ReceiverImages], command: &str) -> Result<String> {
    let title = format!("mrvis bench: {}", file_name(&record.scene.path));
    let shadows = receivers.iter().map(|r| receivers::section(record, r)).collect::<Result<Vec<_>>>()?;
    let body = html! {
        (headline(record))
        (tables::scene(record))
        section {
            h2 { "Error against time" }
            (plots::error_against_time(record)?)
        }
        (tables::measurements(record))
        (classes::section(&record.classes, &record.unit))
        (trust::calibration(record)?)
        section {
            h2 { "Shadow images" }
            @if receivers.is_empty() { p { "No receiver was imaged in this run." } }
            @else { (prose::shadow_images()) }
            @for shadow in shadows { (shadow) }
        }
        (maps::section(&record.maps, &record.unit)?)
        (losses::section(record, receivers)?)
        (prose::how_to_read())
        (footer(record, command))
    };
    Ok(document(&title, &body))
}

/// Title, the result in one sentence, and the largest speed-ups.
fn headline(record: &Record) -> Markup {
    let best_of = |speed: fn(&MrRow) -> Option<f64>| {
        record.shown_rows().iter().filter_map(speed).filter(|v| v.is_finite()).reduce(f64::max)
    };
    let figure = |value: Option<f64>, what: &str| figure(&times(value), what);
    html! {
        header {
            p.kicker { "Exact against multi-resolution visibility" }
            h1 { (file_name(&record.scene.path)) }
            (sentence(record))
            div.figures {
                (figure(best_of(|row| row.speedup_at_same_rms), "speed-up at the same error (RMS)"))
                (figure(best_of(|row| row.speedup_at_same_fbem), "speed-up at the same feature error (FBEM)"))
                (figure(best_of(|row| Some(row.speedup_per_segment)), "speed-up per segment"))
            }
            @if let Some(sky) = &record.workload.sky { p.note { (sky.sentence()) } }
            @for warning in &record.warnings { p.warning { (warning) } }
        }
    }
}

/// The best row in one sentence.
fn sentence(record: &Record) -> Markup {
    if let Some(nothing) = &record.nothing_averaged {
        return html! { p.lead { (nothing) } };
    }
    let Some((best, speed)) = record.best().and_then(|row| Some((row, row.speedup_at_same_rms?))) else {
        return html! { p.lead { "This run has no multi-resolution row whose speed could be compared." } };
    };
    let size = length(best.feature_size, &record.unit);
    let (exact, gain) = (best.compared_in_words(), best.certificates_gain());
    html! {
        p.lead {
            @if speed >= NO_FASTER[1] {
                "At feature size " (size) " multi-resolution visibility was "
                strong { (times(Some(speed))) " faster" }
                " than " (exact) " of the same accuracy"
            } @else if speed > NO_FASTER[0] {
                "Multi-resolution visibility was " strong { "no faster" }
                " than " (exact) " of the same accuracy on this scene; its best feature size was " (size)
            } @else {
                "On this scene multi-resolution visibility was " strong { "slower" }
                " than " (exact) " of the same accuracy: " (times(Some(speed))) " of its speed at best, at "
                (size)
            }
            ", with a root mean square error of " (percent(best.rms)) " of the light. "
            (percent(best.aggregated_fraction)) " of its segments met averaged clusters."
            @if let Some((row, speed)) = record.faster_at_same_fbem() {
                " At the same feature error (FBEM) it was " strong { (times(Some(speed))) " as fast" }
                " at feature size " (length(row.feature_size, &record.unit)) "."
            }
            @if gain > NO_FASTER[1] {
                " Certificates alone, without averaging, make exact rays " (times(Some(gain))) " as fast."
            }
        }
        @if best.extrapolated {
            p.note {
                "No measured number of exact rays is as accurate. The time of exact rays is extrapolated: half the \
                 error takes four times the rays."
            }
        }
    }
}

/// Versions, settings and the command that repeats the run, if there is one.
fn footer(record: &Record, command: &str) -> Markup {
    let plural = if record.threads == 1 { "thread" } else { "threads" };
    html! {
        footer {
            h2 { "To repeat this" }
            p {
                "mrvis " (record.mrvis) " · Embree " (record.embree) " (" (record.isa) ") · "
                (record.threads) " " (plural) " in the timed sections · seed " (record.seed) " · lengths in " (record.unit)
            }
            @if !command.is_empty() { pre { (command) } }
            p.note {
                "A repetition gives the same results except for times, which depend on the machine and its load. \
                 Speed-ups are ratios of times of one run."
            }
        }
    }
}

#[cfg(test)]
mod tests;
