//! `report.html`: results of a benchmark.
//!
//! One file without references to other files or to the network: pictures are inline PNG and SVG. The page is a pure
//! function of record and images.

mod losses;
mod maps;
mod receivers;
mod trust;

use super::record::{ExactRow, MrRow, ReceiverClass, Record};
use super::shown::{self, MR_COLUMNS};
use crate::Result;
use crate::metrics::{Fbem, Image};
use crate::page::{chart, count, document, figure, file_name, length, properties, table, times};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};
use maud::{Markup, html};

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
        (scene(record))
        section {
            h2 { "Error against time" }
            (error_against_time(record)?)
        }
        (measurements(record))
        (classes(record))
        (trust::calibration(record)?)
        section {
            h2 { "Shadow images" }
            @if receivers.is_empty() { p { "No receiver was imaged in this run." } }
            @else { (shadow_images()) }
            @for shadow in shadows { (shadow) }
        }
        (maps::section(record)?)
        (losses::section(record, receivers)?)
        (how_to_read())
        (footer(record, command))
    };
    Ok(document(&title, &body))
}

/// Title, the result in one sentence, and the largest speed-ups.
fn headline(record: &Record) -> Markup {
    let best_of = |speed: fn(&MrRow) -> Option<f64>| {
        let speeds = record.shown_rows().iter().filter_map(speed);
        speeds.filter_map(|v| record.gain(Some(v))).filter(|v| v.is_finite()).reduce(f64::max)
    };
    let figure = |value: Option<f64>, what: &str| figure(&times(value), what);
    html! {
        header {
            p.kicker { "Exact against multi-resolution visibility" }
            h1 { (file_name(&record.scene.path)) }
            p.lead { (shown::result(record)) }
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

/// Versions, settings and the command that repeats the run, if there is one.
fn footer(record: &Record, command: &str) -> Markup {
    html! {
        footer {
            h2 { "To repeat this" }
            p { (shown::settings(record)) }
            @if !command.is_empty() { pre { (command) } }
            p.note {
                "A repetition gives the same results except for times, which depend on the machine and its load. \
                 Speed-ups are ratios of times of one run."
            }
        }
    }
}

/// Introduction to the shadow images.
fn shadow_images() -> Markup {
    html! {
        p {
            "Each image shows the visible fraction of the emitters at every place of a surface: white sees all of \
             them, black none. The bar at the lower left of the first image is the scale. The difference is \
             multi-resolution minus reference: "
            span.red { "red" } " is too bright, " span.blue { "blue" } " too dark; a " span.mark { "circle" }
            " marks the largest, and the plot below is a cross-section through it. The mask shows in orange all \
             features (shadows and lit regions) larger than s; there the image is compared texel by texel, elsewhere \
             on average. A feature size whose image looks like one that is shown already is only named."
        }
    }
}

/// Glossary.
fn how_to_read() -> Markup {
    let entries = [
        (
            "Visible fraction",
            "The fraction of an emitter's area, between 0 and 1, that a point sees. In scenes with much small detail \
            its computation takes most of the time.",
        ),
        (
            "Exact",
            "Rays from a point to random places on the emitter, tested by Embree. The visible fraction is the fraction \
            of rays that arrive; the noise of n rays falls as 1/√n.",
        ),
        (
            "Multi-resolution (MR)",
            "Clusters of objects are measured beforehand: their average extinction, and the size of their largest \
            blocker or gap. A cluster whose largest umbra would be smaller than s is averaged; otherwise it is opened, \
            down to its triangles.",
        ),
        (
            "Feature size s",
            "The size on the receiving surface below which the shape of shadows does not matter, only their average. \
            MR is faster with a large s and more faithful with a small one.",
        ),
        (
            "Umbra",
            "The part of a shadow that sees nothing of the emitter. The penumbra around it sees a part.",
        ),
        (
            "RMS error",
            "Root mean square of the differences to the reference. It does not distinguish small from large features.",
        ),
        (
            "FBEM",
            "Feature-based error metric: RMS error that compares texel by texel inside features larger than s, and \
            averages over squares of side s elsewhere. At s = 0 it is the RMS error.",
        ),
        (
            "Reference",
            "Exact visibility with many independent rays. Its noise is subtracted from the errors and stated above.",
        ),
    ];
    html! {
        section {
            h2 { "How to read this" }
            dl.glossary { @for (word, meaning) in entries { dt { (word) } dd { (meaning) } } }
            p.note {
                "Multi-resolution visibility and the feature-based error are due to F. Sillion and G. Drettakis, "
                cite { "Feature-based control of visibility error: a multi-resolution clustering algorithm for global \
                    illumination" }
                ", SIGGRAPH 1995 (INRIA report RR-2503)."
            }
        }
    }
}

/// Error against time of each row, both axes logarithmic.
fn error_against_time(record: &Record) -> Result<Markup> {
    let rays = |n: usize| if n == 1 { "1 ray".to_string() } else { format!("{n} rays") };
    let points = |rows: &[ExactRow]| -> Vec<PlotPoint> {
        rows.iter().map(|row| PlotPoint { x: row.seconds, y: row.rms, label: rays(row.rays) }).collect()
    };
    let mut series = vec![Series::new("exact", points(&record.exact), Marks::Joined)];
    if !record.certified.is_empty() {
        let points = points(&record.certified);
        series.push(Series::new("exact with certificates", points, Marks::Joined));
    }
    for row in record.shown_rows() {
        let name = format!("multi-res., {} segments", row.rays);
        let label = format!("s = {}", length(row.feature_size, &record.unit));
        let point = PlotPoint { x: row.seconds, y: row.rms, label };
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series::new(name, vec![point], Marks::Points)),
        }
    }
    let plot = Plot::new(
        ("time of the queries, seconds", Scale::Log),
        ("error (RMS of the visible fraction)", Scale::Log),
        series,
    );
    chart(
        &plot,
        460,
        "Both axes are logarithmic. The lines show exact visibility with increasing numbers of rays from each point to \
         each emitter. A multi-resolution point below and to the left of both lines is faster at the same error: time of \
         the faster line at the height of the point, divided by the time of the point, is the speed-up at the same error.",
    )
}

/// Spectrum (FBEM over feature size) of the exact image of 16 rays, and FBEM of each MR image at its own size.
pub(super) fn spectrum(exact: &[Fbem], mr: &[Fbem], unit: &str) -> Result<Markup> {
    let point = |row: &Fbem| PlotPoint { x: row.size, y: row.value, label: String::new() };
    let series =
        |name: &str, rows: &[Fbem], marks| Series::new(name, rows.iter().map(point).collect(), marks);
    let plot = Plot::new(
        (format!("feature size s, {unit}"), Scale::Linear),
        ("feature-based error FBEM(s)", Scale::Linear),
        vec![
            series("exact, 16 rays", exact, Marks::Joined),
            series("multi-resolution, each image at its own s", mr, Marks::Points),
        ],
    );
    chart(
        &plot,
        340,
        "Feature-based error by feature size: at s = 0 the RMS error, further right the error of features larger than s \
         and of averages.",
    )
}

/// Visible fraction along a row of texels: reference, exact with 16 rays, multi-resolution.
pub(super) fn cross_section(images: [&Image; 3], row: usize, unit: &str) -> Result<Markup> {
    let series =
        images.iter().zip(["reference", "exact, 16 rays", "multi-resolution"]).map(|(image, name)| {
            let at = |x: usize| PlotPoint {
                x: (x as f64 + 0.5) * image.texel(),
                y: f64::from(image.at(x, row)),
                label: String::new(),
            };
            Series::new(name, (0..image.width()).map(at).collect(), Marks::Line)
        });
    let plot = Plot::new(
        (format!("place along row {row} of the texels, {unit}"), Scale::Linear),
        ("visible fraction", Scale::Linear),
        series.collect(),
    );
    chart(&plot, 240, "Cross-section through the largest difference.")
}

/// Scene, preparation and workload.
fn scene(record: &Record) -> Markup {
    html! {
        section {
            h2 { "Scene and workload" }
            div.columns { @for (title, list) in shown::properties(record) { (properties(title, &list)) } }
            @if let Some(note) = &record.build.cache_note { p.note { (note) } }
            (repairs(record))
        }
    }
}

/// Counts of repairs of the scene.
fn repairs(record: &Record) -> Markup {
    let entries = record.scene_repairs.as_object().into_iter().flatten();
    let counts: Vec<_> =
        entries.clone().filter_map(|(k, v)| Some((k, v.as_u64().filter(|n| *n > 0)?))).collect();
    let messages = entries.filter_map(|(_, v)| v.as_array()).flatten().filter_map(|v| v.as_str());
    html! {
        @if counts.is_empty() {
            p.note { "The scene needed no repairs." }
        } @else {
            p {
                "Repairs: "
                @for (i, (name, n)) in counts.iter().enumerate() {
                    @if i > 0 { ", " }
                    (count(*n)) " " (name.replace('_', " "))
                }
                "."
            }
        }
        @for message in messages.take(20) { p.note { (message) } }
    }
}

/// Both tables of rows and the meaning of their columns.
fn measurements(record: &Record) -> Markup {
    let exact = shown::exact(record);
    html! {
        section {
            h2 { "Measurements" }
            h3 { "Multi-resolution" }
            (table(&MR_COLUMNS.map(|(name, _)| name).join(" | "), &shown::mr(record)))
            h3 { "Exact" }
            (table(exact.0, &exact.1))
            details.details open {
                summary { "What the columns mean" }
                dl.glossary {
                    @for (name, meaning) in MR_COLUMNS { dt { (name) } dd { (meaning) } }
                    dt { "call" } dd {
                        "Embree's fastest ray call: 1, 4, 8 or 16 rays at once; certified: exact rays with certificates"
                    }
                }
            }
        }
    }
}

/// The best row of each class; empty without any class.
fn classes(record: &Record) -> Markup {
    let shown = shown::classes(record);
    html! {
        @if !shown.1.is_empty() {
            section {
                h2 { "Classes of receivers" }
                p {
                    "How much averaging gains depends on what lies around a receiver point. Each line is the row of its class with the largest \
                     speed-up at the same error; “slowest row” is the smallest such speed-up of a row of the class. What answers is decided \
                     for each class and row on a sample."
                }
                (table(shown.0, &shown.1))
                dl.glossary {
                    @for class in &record.classes { dt { (class.class.name()) } dd { (meaning(class.class)) } }
                }
            }
        }
    }
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

#[cfg(test)]
mod tests;
