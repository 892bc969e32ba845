//! `report.html`: results of a benchmark.
//!
//! One file without references to other files or to the network: pictures are inline PNG and SVG. The page is a pure
//! function of record and images.

mod classes;
mod losses;
mod maps;
mod receivers;
mod trust;

use super::record::{Build, ExactRow, MrRow, NO_FASTER, Record, Workload};
use crate::Result;
use crate::metrics::{Fbem, Image};
use crate::page::{
    Cell, bytes, chart, count, document, figure, file_name, length, percent, properties, seconds, signed,
    table, times,
};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
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
        (classes::section(&record.classes, &record.unit))
        (trust::calibration(record)?)
        section {
            h2 { "Shadow images" }
            @if receivers.is_empty() { p { "No receiver was imaged in this run." } }
            @else { (shadow_images()) }
            @for shadow in shadows { (shadow) }
        }
        (maps::section(&record.maps, &record.unit)?)
        (losses::section(record, receivers)?)
        (how_to_read())
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
pub(super) fn scene(record: &Record) -> Markup {
    let (scene, build, work) = (&record.scene, &record.build, &record.workload);
    let spent: Vec<(&str, String)> = record.spent.parts().map(|(name, s)| (name, seconds(s))).into();
    html! {
        section {
            h2 { "Scene and workload" }
            div.columns {
                (properties("Scene", &[
                    ("triangles", count(scene.triangles as u64)),
                    ("objects", count(scene.objects as u64)),
                    ("emitters", count(scene.emitters as u64)),
                    ("closed parts", count(scene.closed_parts as u64)),
                    ("sheets", count(scene.sheet_parts as u64)),
                    ("clusters", count(scene.clusters as u64)),
                    ("levels", count(scene.levels as u64)),
                ]))
                (properties("Preparation", &[
                    ("reading", seconds(build.load_s)),
                    ("Embree's tree", seconds(build.embree_s)),
                    ("hierarchy", format!("{} ({})", seconds(build.hierarchy_s), build.builder)),
                    ("measuring clusters", seconds(build.characterise_s)),
                    ("clusters' cache", cache(build)),
                    ("budget of exact rays", seconds(build.budget_s)),
                    ("set-up, exact", seconds(build.exact_setup_s)),
                    ("set-up, multi-resolution", seconds(build.mr_setup_s)),
                    ("memory, clusters", bytes(build.hierarchy_bytes)),
                    ("memory, Embree", bytes(build.embree_bytes)),
                    ("memory per triangle", per_triangle(build)),
                ]))
                (properties("Workload", &workload(work)))
                (properties("Time of this run", &spent))
            }
            @if let Some(note) = &build.cache_note { p.note { (note) } }
            (repairs(record))
        }
    }
}

/// The queries, with the sources of light at infinity.
fn workload(work: &Workload) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        ("points", count(work.points as u64)),
        ("segments per point and emitter", count(work.rays as u64)),
        ("segments", count(work.segments)),
        ("reference rays", count(work.reference_rays as u64)),
        ("noise of the reference (RMS)", number(work.reference_rms)),
    ];
    if let Some(sky) = &work.sky {
        rows.extend([
            ("patches of the sky", count(sky.patches as u64)),
            ("largest angle of a patch", format!("{:.1}°", sky.largest_angle)),
            ("patches per point", count(sky.patches_per_point as u64)),
            ("suns", count(sky.suns as u64)),
        ]);
    }
    rows
}

/// Memory by part, bytes per triangle.
fn per_triangle(build: &Build) -> String {
    let b = build.bytes_per_triangle;
    let parts = [
        ("scene", b.scene),
        ("clusters", b.hierarchy),
        ("optics", b.optics),
        ("traversal", b.wide),
        ("Embree", b.embree),
    ];
    let parts: Vec<String> = parts.iter().map(|(name, bytes)| format!("{name} {bytes:.0}")).collect();
    format!("{:.0} B ({})", b.total, parts.join(", "))
}

/// Origin of the clusters.
fn cache(build: &Build) -> String {
    match build.cache.as_str() {
        "hit" => format!("read in {}", seconds(build.cache_s)),
        "made" => format!("written in {}", seconds(build.cache_s)),
        _ => "not used".into(),
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
pub(super) fn measurements(record: &Record) -> Markup {
    let columns = [
        ("s", "feature size, a length on the receiving surface"),
        ("rays", "segments from a point to an emitter"),
        (
            "by",
            "what answers: walks of bundles, the distance cut, exact rays where these are expected to be faster (speed-ups are 1), or \
            certified exact rays",
        ),
        (
            "time",
            "time of the queries alone, minimum of several runs (as many for every row), without preparation",
        ),
        ("RMS", "root mean square error of the visible fraction, the reference's noise subtracted"),
        ("bias", "mean error; positive: too bright"),
        (
            "speed-up, same RMS",
            "time of the fastest exact rays for this RMS error, certificates included, divided by this row's time; ~: \
            extrapolated beyond the largest measured number of rays",
        ),
        ("speed-up, same FBEM", "the same with the feature-based error of the shadow images at this s"),
        ("speed-up, segment", "best exact time for the same number of segments, divided by this row's time"),
        ("averaged", "part of the segments that met at least one averaged cluster"),
        ("exact rays", "segments of bundles for which triangles were tested, by MR or by Embree"),
        ("nodes", "mean number of visited clusters per segment"),
        ("in bounds", "part of the stated intervals that the reference confirms"),
    ];
    let mr: Vec<_> = record.shown_rows().iter().map(|row| mr_row(row, &record.unit)).collect();
    let exact: Vec<_> = record.exact.iter().chain(&record.certified).map(exact_row).collect();
    html! {
        section {
            h2 { "Measurements" }
            h3 { "Multi-resolution" }
            (table(&columns.map(|(name, _)| name).join(" | "), &mr))
            h3 { "Exact" }
            (table("rays | time | RMS | bias | call", &exact))
            details.details open {
                summary { "What the columns mean" }
                dl.glossary {
                    @for (name, meaning) in columns { dt { (name) } dd { (meaning) } }
                    dt { "call" } dd {
                        "Embree's fastest ray call: 1, 4, 8 or 16 rays at once; certified: exact rays with certificates"
                    }
                }
            }
        }
    }
}

fn mr_row(row: &MrRow, unit: &str) -> [Cell; 13] {
    [
        length(row.feature_size, unit).into(),
        row.rays.into(),
        Cell::words(row.route_in_a_word()),
        seconds(row.seconds).into(),
        number(row.rms).into(),
        signed(row.bias).into(),
        Cell::speedup(row.speedup_at_same_rms, row.extrapolated),
        Cell::speedup(row.speedup_at_same_fbem, false),
        Cell::speedup(Some(row.speedup_per_segment), false),
        percent(row.aggregated_fraction).into(),
        count(row.exact_rays).into(),
        number(row.nodes_per_segment).into(),
        percent(row.interval_coverage).into(),
    ]
}

fn exact_row(row: &ExactRow) -> [Cell; 5] {
    [
        row.rays.into(),
        seconds(row.seconds).into(),
        number(row.rms).into(),
        signed(row.bias).into(),
        Cell::from(&row.mode),
    ]
}

#[cfg(test)]
mod tests;
