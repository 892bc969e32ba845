//! Tables of scene, preparation, workload and measured rows.

use maud::{Markup, html};

use crate::bench::record::{Build, ExactRow, MrRow, Record, Workload};
use crate::page::{Cell, bytes, count, length, percent, properties, seconds, signed, table};
use crate::plot::number;

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
