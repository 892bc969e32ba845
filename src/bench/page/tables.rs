//! Tables of scene, preparation, workload and measured rows.

use maud::{Markup, html};

use super::{length, percent, times};
use crate::bench::record::{Build, ExactRow, MrRow, Record};
use crate::plot::number;

/// Scene, preparation and workload.
pub(super) fn scene(record: &Record) -> Markup {
    let (scene, build, work) = (&record.scene, &record.build, &record.workload);
    let summary_table = |title: &str, rows: &[(&str, String)]| {
        html! {
            div.facts {
                h3 { (title) }
                table { @for (name, value) in rows { tr { th scope="row" { (name) } td { (value) } } } }
            }
        }
    };
    html! {
        section {
            h2 { "Scene and workload" }
            div.columns {
                (summary_table("Scene", &[
                    ("triangles", count(scene.triangles as u64)),
                    ("objects", count(scene.objects as u64)),
                    ("emitters", count(scene.emitters as u64)),
                    ("closed parts", count(scene.closed_parts as u64)),
                    ("sheets", count(scene.sheet_parts as u64)),
                    ("clusters", count(scene.clusters as u64)),
                    ("levels", count(scene.levels as u64)),
                ]))
                (summary_table("Preparation", &[
                    ("reading", seconds(build.load_s)),
                    ("Embree's tree", seconds(build.embree_s)),
                    ("hierarchy", seconds(build.hierarchy_s)),
                    ("measuring clusters", seconds(build.characterise_s)),
                    ("clusters' cache", cache(build)),
                    ("budget of exact rays", seconds(build.budget_s)),
                    ("set-up, exact", seconds(build.exact_setup_s)),
                    ("set-up, multi-resolution", seconds(build.mr_setup_s)),
                    ("memory, clusters", bytes(build.hierarchy_bytes)),
                    ("memory, Embree", bytes(build.embree_bytes)),
                    ("memory per triangle", per_triangle(build)),
                ]))
                (summary_table("Workload", &[
                    ("points", count(work.points as u64)),
                    ("segments per point and emitter", count(work.rays as u64)),
                    ("segments", count(work.segments)),
                    ("reference rays", count(work.reference_rays as u64)),
                    ("noise of the reference (RMS)", number(work.reference_rms)),
                ]))
            }
            @if let Some(note) = &build.cache_note { p.note { (note) } }
            (repairs(record))
        }
    }
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
            "time",
            "time of the queries alone, minimum of several runs (as many for every row), without preparation",
        ),
        ("decision", "time to decide on a sample whether MR is faster, part of the set-up"),
        ("RMS", "root mean square error of the visible fraction, the reference's noise subtracted"),
        ("bias", "mean error; positive: too bright"),
        (
            "same RMS",
            "time of exact rays for this RMS error, divided by this row's time; ~: extrapolated beyond \
            the largest measured number of rays",
        ),
        ("same FBEM", "the same with the feature-based error of the shadow images at this s"),
        ("segment", "best exact time for the same number of segments, divided by this row's time"),
        ("averaged", "part of the segments that met at least one averaged cluster"),
        ("exact rays", "segments of bundles for which triangles were tested, by MR or by Embree"),
        ("nodes", "mean number of visited clusters per segment"),
        ("in bounds", "part of the stated intervals that the reference confirms"),
    ];
    html! {
        section {
            h2 { "Measurements" }
            h3 { "Multi-resolution" }
            div.scroll {
                table.rows {
                    thead {
                        tr {
                            th colspan="6" {} th.group colspan="3" { "speed-up" } th colspan="4" {}
                        }
                        tr { @for (name, meaning) in &columns { th scope="col" title=(meaning) { (name) } } }
                    }
                    tbody { @for row in &record.mr { (mr_row(row, &record.unit)) } }
                }
            }
            h3 { "Exact" }
            div.scroll {
                table.rows {
                    thead {
                        tr { @for name in ["rays", "time", "RMS", "bias", "call"] { th scope="col" { (name) } } }
                    }
                    tbody { @for row in record.exact.iter().chain(&record.certified) { (exact_row(row)) } }
                }
            }
            details open {
                summary { "What the columns mean" }
                dl.columns-help {
                    @for (name, meaning) in columns { dt { (name) } dd { (meaning) } }
                    dt { "call" } dd {
                        "Embree's fastest ray call: 1, 4, 8 or 16 rays at once; certified: exact rays with certificates"
                    }
                }
            }
        }
    }
}

fn mr_row(row: &MrRow, unit: &str) -> Markup {
    let loss = |v: Option<f64>| if v.is_some_and(|v| v < 1.0) { "loss" } else { "" };
    let about = if row.extrapolated { "~" } else { "" };
    html! {
        tr {
            td { (length(row.feature_size, unit)) }
            td { (row.rays) }
            td { (seconds(row.seconds)) }
            td { (seconds(row.decide_s)) }
            td { (number(row.rms)) }
            td { (signed(row.bias)) }
            td class=(loss(row.speedup_at_same_rms)) { (about) (times(row.speedup_at_same_rms)) }
            td class=(loss(row.speedup_at_same_fbem)) { (times(row.speedup_at_same_fbem)) }
            td class=(loss(Some(row.speedup_per_segment))) { (times(Some(row.speedup_per_segment))) }
            td { (percent(row.aggregated_fraction)) }
            td { (count(row.exact_rays)) }
            td { (number(row.nodes_per_segment)) }
            td { (percent(row.interval_coverage)) }
        }
    }
}

fn exact_row(row: &ExactRow) -> Markup {
    html! {
        tr {
            td { (row.rays) }
            td { (seconds(row.seconds)) }
            td { (number(row.rms)) }
            td { (signed(row.bias)) }
            td { (row.mode) }
        }
    }
}

/// A number with its sign.
pub(super) fn signed(v: f64) -> String {
    if v > 0.0 { format!("+{}", number(v)) } else { number(v).replace('-', "−") }
}

/// A count with digits in groups of three.
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().filter_map(|g| std::str::from_utf8(g).ok()).collect();
    groups.join("\u{202f}")
}

/// A time in seconds or milliseconds.
pub(super) fn seconds(s: f64) -> String {
    if s != 0.0 && s.abs() < 0.1 { format!("{} ms", number(1000.0 * s)) } else { format!("{} s", number(s)) }
}

/// Memory in a suitable unit.
pub(super) fn bytes(n: u64) -> String {
    let n = n as f64;
    match n {
        n if n < 1e3 => format!("{n} B"),
        n if n < 1e6 => format!("{} kB", number(n / 1e3)),
        n if n < 1e9 => format!("{} MB", number(n / 1e6)),
        n => format!("{} GB", number(n / 1e9)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_written_for_people() {
        assert_eq!(count(1234567).replace('\u{202f}', " "), "1 234 567");
        assert_eq!((count(0), count(999)), ("0".into(), "999".into()));
        assert_eq!(
            (seconds(0.0123), seconds(2.0), seconds(0.0)),
            ("12.3 ms".into(), "2 s".into(), "0 s".into())
        );
        assert_eq!((bytes(12), bytes(45_600_000)), ("12 B".into(), "45.6 MB".into()));
        assert_eq!((signed(0.5), signed(-0.25)), ("+0.5".into(), "−0.25".into()));
    }
}
