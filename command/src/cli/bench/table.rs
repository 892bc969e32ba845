//! The record of a benchmark as text.

use crate::cli::args::grouped;
use mrvis::internals::bench::record::{
    Build, BytesPerTriangle, ClassRecord, ExactRow, MapMrRow, MapRecord, MrRow, NO_FASTER, Record,
    SceneSummary, Workload,
};
use mrvis::internals::error::quote;
use mrvis::internals::plot::number;
use std::fmt::Write as _;

/// The record as text.
pub fn table(record: &Record) -> String {
    let unit = &record.unit;
    let mut text = head(record);
    text += &exact_rows(record);
    text += &mr_rows(record.shown_rows());
    text += &lines(&record.classes, unit);
    text += &maps(&record.maps);
    text += &setup(record);
    text += &spent(record);
    text += &audits(&record.mr);
    let result = record.nothing_averaged.clone().unwrap_or_else(|| of(record));
    text + &format!("\n{result}\n")
}

/// Scene, preparation, memory, workload and warnings.
fn head(record: &Record) -> String {
    let Record { scene, build, workload, threads, isa, .. } = record;
    let SceneSummary { triangles, objects, emitters, closed_parts, sheet_parts, clusters, levels, .. } =
        scene;
    let mut text = format!(
        "{}: {triangles} triangles, {objects} objects, {emitters} emitters, {closed_parts} closed parts, {sheet_parts} sheets, \
         {clusters} clusters in {levels} levels\n",
        quote(&scene.path)
    );
    let [reading, embree] = [build.load_s, build.embree_s].map(seconds);
    text += &format!("built in: reading {reading}, Embree {embree}, {}\n", clusters_of(build));
    let BytesPerTriangle { scene, hierarchy, optics, wide, embree, total } = build.bytes_per_triangle;
    text += &format!(
        "memory: {total:.0} bytes per triangle (scene {scene:.0}, clusters {hierarchy:.0}, optics {optics:.0}, traversal {wide:.0}, Embree \
         {embree:.0})\n"
    );
    let Workload { points, segments, rays, reference_rays, reference_rms, sky, .. } = workload;
    let (noise, plural) = (number(*reference_rms), if *threads == 1 { "" } else { "s" });
    text += &format!(
        "{points} points, {segments} segments at {rays} rays; reference of {reference_rays} rays, noise {noise}; {threads} \
         thread{plural}, {isa}\n"
    );
    if let Some(sky) = sky {
        text += &format!("{}\n", sky.sentence());
    }
    for warning in record.warnings.iter().chain(&build.cache_note) {
        text += &format!("note: {warning}\n");
    }
    text
}

/// Rows of exact visibility, without and with certificates.
fn exact_rows(record: &Record) -> String {
    let mut text = "\nexact    rays       time        RMS       bias  call\n".to_owned();
    for row in record.exact.iter().chain(&record.certified) {
        let ExactRow { rays, rms, bias, mode, .. } = row;
        let (time, coherent) = (seconds(row.seconds), if row.coherent { ", coherent" } else { "" });
        text += &format!("{rays:>13} {time:>10} {rms:>10.5} {bias:>+10.5}  {mode}{coherent}\n");
    }
    text
}

/// Rows of multi-resolution visibility.
fn mr_rows(rows: &[MrRow]) -> String {
    let mut text =
        "\nmulti-resolution                                           speed-up at same\n".to_owned();
    text += "       s   rays       time        RMS       bias       RMS      FBEM   segment  averaged  nodes  in bounds  by\n";
    for row in rows {
        let MrRow { rays, rms, bias, .. } = row;
        let [size, nodes] = [row.feature_size, row.nodes_per_segment].map(number);
        let (time, by) = (seconds(row.seconds), row.route_in_words());
        let same_rms = times(row.speedup_at_same_rms, row.extrapolated);
        let same_fbem = times(row.speedup_at_same_fbem, false);
        let segment = times(Some(row.speedup_per_segment), false);
        let [averaged, within] = [row.aggregated_fraction, row.interval_coverage].map(|part| 100.0 * part);
        text += &format!(
            "{size:>8} {rays:>6} {time:>10} {rms:>10.5} {bias:>+10.5} {same_rms:>9} {same_fbem:>9} {segment:>9} "
        );
        text += &format!("{averaged:>7.1} % {nodes:>6} {within:>8.1} %  {by}\n");
    }
    if rows.iter().any(|row| row.extrapolated) {
        text += "~ beyond the most exact rays measured, extrapolated\n";
    }
    let whole = rows.iter().filter(|row| row.handed_over == 1.0).count();
    if whole > 0 {
        let of = rows.len();
        text += &format!(
            "{whole} of {of} rows were not expected to be faster: their bundles were handed to Embree\n"
        );
    }
    text
}

/// Of each map the best row of each feature size.
fn maps(maps: &[MapRecord]) -> String {
    let mut text = String::new();
    if maps.is_empty() {
        return text;
    }
    text += "\nmaps                                                                                     time of exact maps of the same RMS / time\n";
    text += "                        s   rays  spacing       time    set-up        RMS      FBEM    queries  with set-up  over texels same FBEM\n";
    for map in maps {
        let MapRecord { width, height, reference_rays, .. } = map;
        let (name, noise) = (quote(&map.receiver), number(map.reference_rms));
        text += &format!(
            "{name}: {width} x {height} texels, reference of {reference_rays} rays, noise {noise}\n"
        );
        for row in map.best_by_size() {
            let route = if row.route == "embree" { "  by exact rays" } else { "" };
            let MapMrRow { rays, spacing, rms, fbem, .. } = row;
            let (size, [time, setup]) = (number(row.feature_size), [row.seconds, row.setup_s].map(seconds));
            let [same_rms, with_setup] =
                [row.speedup_at_same_rms, row.speedup_with_setup].map(|v| times(v, row.extrapolated));
            let over_texels = times(row.speedup_over_texels, row.texels_extrapolated);
            let same_fbem = times(row.speedup_at_same_fbem, false);
            text +=
                &format!("{size:>25} {rays:>6} {spacing:>8} {time:>10} {setup:>9} {rms:>10.5} {fbem:>9.5} ");
            text += &format!("{same_rms:>10} {with_setup:>12} {over_texels:>12} {same_fbem:>9}{route}\n");
        }
    }
    text
}

/// Origin and time of the clusters.
fn clusters_of(build: &Build) -> String {
    if build.cache == "hit" {
        return format!("clusters from the cache {}", seconds(build.cache_s));
    }
    let kept =
        if build.cache == "made" { format!(", kept in {}", seconds(build.cache_s)) } else { String::new() };
    let [hierarchy, measuring] = [build.hierarchy_s, build.characterise_s].map(seconds);
    format!("hierarchy {hierarchy}, measuring clusters {measuring}{kept}")
}

/// Preparation of both engines, which the times of rows do not include, in one line.
fn setup(record: &Record) -> String {
    let build = &record.build;
    format!(
        "preparation: exact {} (Embree's tree {}, choice of ray calls {}); multi-resolution {} in addition (clusters {}, \
         budget {}, decisions {}); each row is the minimum of {} runs\n",
        seconds(build.exact_setup_s),
        seconds(build.embree_s),
        seconds(build.exact_setup_s - build.embree_s),
        seconds(build.mr_setup_s),
        seconds(build.mr_preparation() - build.budget_s),
        seconds(build.budget_s),
        seconds(build.mr_setup_s - build.mr_preparation()),
        record.workload.rounds
    )
}

/// Where the time of the run went, in one line.
fn spent(record: &Record) -> String {
    let parts = record.spent.parts();
    let total: f64 = parts.iter().map(|(_, s)| s).sum();
    let parts: Vec<String> =
        parts.iter().filter(|(_, s)| *s >= 1e-3).map(|(name, s)| format!("{name} {}", seconds(*s))).collect();
    if parts.is_empty() {
        return String::new();
    }
    format!("this run took {} after the preparation: {}\n", seconds(total), parts.join(", "))
}

/// Summary of the audits in one line.
fn audits(rows: &[MrRow]) -> String {
    let audits: Vec<_> = rows.iter().filter_map(|row| row.audit.as_ref()).collect();
    let Some(first) = audits.first() else { return String::new() };
    let overclaimed = audits.iter().filter(|a| a.observed_lo > a.claimed_rms).count();
    let lowest = audits.iter().map(|a| a.coverage).fold(1.0, f64::min);
    format!(
        "audit of {} bundles, {} exact rays each: {overclaimed} of {} rows have larger errors than claimed; at least {:.1} % of \
         the intervals are confirmed\n",
        first.bundles,
        first.rays,
        audits.len(),
        100.0 * lowest
    )
}

fn seconds(s: f64) -> String {
    if s < 0.1 { format!("{:.2} ms", 1000.0 * s) } else { format!("{s:.3} s") }
}

fn times(v: Option<f64>, about: bool) -> String {
    v.map_or("-".into(), |v| format!("{}{v:.2}x", if about { "~" } else { "" }))
}

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

/// The result in one sentence.
pub(super) fn of(record: &Record) -> String {
    let unit = &record.unit;
    let Some((row, speed)) = record.best().and_then(|row| Some((row, row.speedup_at_same_rms?))) else {
        return "no multi-resolution row could be compared with exact at the same error".into();
    };
    let about = if row.extrapolated { "about " } else { "" };
    let speed = match speed {
        v if v >= NO_FASTER[1] => format!("{about}{} times faster than", number(v)),
        v if v > NO_FASTER[0] => "no faster than".into(),
        v => format!("{about}{} times slower than", number(1.0 / v)),
    };
    let gain = row.certificates_gain();
    let extrapolated =
        if row.extrapolated { " (more exact rays than were measured, extrapolated)" } else { "" };
    let certificates = match gain > NO_FASTER[1] {
        true => format!("; certificates alone make exact rays {} times faster", number(gain)),
        false => String::new(),
    };
    let features = record.faster_at_same_fbem().map_or(String::new(), |(row, speed)| {
        let s = number(row.feature_size);
        format!("; at the same feature error (FBEM) s = {s} {unit} is {} times faster", number(speed))
    });
    format!(
        "best: s = {} {unit} with {} segments is {speed} {} at the same RMS error of {} %{extrapolated} (per segment {}); {} % of \
         its segments met averaged clusters{features}{certificates}",
        number(row.feature_size),
        row.rays,
        row.compared_in_words(),
        number(100.0 * row.rms),
        times(Some(row.speedup_per_segment), false),
        number(100.0 * row.aggregated_fraction)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use mrvis::internals::bench::record::{ExactRow, MrRow, ReceiverClass};

    /// Whatever its measured time says, a row of plain exact rays is what it is compared with.
    #[test]
    fn exact_rays_gain_nothing_over_themselves() {
        let exact = [(4, 1.0, 0.02), (16, 4.0, 0.02)].map(|(rays, seconds, rms)| ExactRow {
            rays,
            seconds,
            rms,
            ..ExactRow::default()
        });
        let row = |route: &str| {
            let route = route.into();
            let mut row = MrRow { rays: 16, seconds: 3.0, rms: 0.002, route, ..MrRow::default() };
            row.compare(&exact, &[]);
            [row.speedup_at_same_rms.expect("a speed-up"), row.speedup_per_segment]
        };
        assert_eq!(row("embree"), [1.0, 1.0]);
        assert!(row("bundle").iter().all(|speed| *speed > 1.2));
    }

    #[test]
    fn rows_name_their_route_and_the_run_its_time() {
        let row = |route: &str| MrRow { route: route.into(), rays: 16, ..MrRow::default() };
        let spent =
            mrvis::internals::bench::record::Spent { points_s: 2.0, images_s: 1.0, ..Default::default() };
        let mr = vec![row("embree"), row("bundle")];
        let text = table(&Record { mr, spent, ..Record::default() });
        assert!(text.contains("%  exact rays\n") && text.contains("%  walks of bundles\n"), "{text}");
        let time = "this run took 3.000 s after the preparation: rows over all points 2.000 s, shadow images 1.000 s";
        assert!(text.contains(time), "{text}");
    }

    #[test]
    fn nothing_averaged_is_the_result() {
        let mr = [0.1, 0.4].map(|feature_size| MrRow { feature_size, rays: 16, ..MrRow::default() });
        let mut record =
            Record { mr: mr.into(), nothing_averaged: Some("Nothing.".into()), ..Record::default() };
        record.workload.rays = 16;
        let text = table(&record);
        assert!(text.ends_with("\nNothing.\n") && !text.contains("best:"), "{text}");
        assert!(text.contains("\n     0.4     16") && !text.contains("\n     0.1     16"), "{text}");
    }

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

    #[test]
    fn losses_are_said_plainly() {
        let row = |speed| MrRow {
            speedup_at_same_rms: Some(speed),
            rms: 0.01,
            feature_size: 0.1,
            ..MrRow::default()
        };
        let said = |rows: &[MrRow]| of(&Record { mr: rows.into(), unit: "m".into(), ..Record::default() });
        assert!(said(&[row(2.0)]).contains("2 times faster"));
        assert!(said(&[row(0.5)]).contains("2 times slower"));
        assert!(said(&[row(1.03)]).contains("no faster than exact rays"));
        assert!(said(&[]).contains("no multi-resolution row"));
        let features = MrRow { feature_size: 0.4, speedup_at_same_fbem: Some(9.29), ..row(0.97) };
        let both = said(&[row(1.03), features]);
        assert!(
            both.contains("no faster") && both.contains("(FBEM) s = 0.4 m is 9.29 times faster"),
            "{both}"
        );
    }

    #[test]
    fn what_certificates_gain_is_not_the_gain_of_averaging() {
        let exact = ExactRow { rays: 16, seconds: 2.0, rms: 0.01, ..ExactRow::default() };
        let certified = ExactRow { seconds: 1.0, ..exact.clone() };
        let mut row = MrRow { rays: 16, seconds: 1.0, rms: 0.01, ..MrRow::default() };
        row.compare(&[exact], &[certified]);
        let text = of(&Record { mr: vec![row], unit: "m".into(), ..Record::default() });
        assert!(text.contains("no faster than exact rays (Embree) with certificates"), "{text}");
        assert!(text.contains("certificates alone make exact rays 2 times faster"), "{text}");
    }
}
