//! Contents of text and page of a record: lists, tables and the result in a sentence, each defined once.

use super::record::{
    Build, ClassRecord, EQUAL_SPEED_RANGE, ExactRow, IntervalAudit, MapExactRow, MapMrRow, MapRecord, MrRow,
    Record, Workload,
};
use crate::error::quote;
use crate::page::{TableCell, bytes, count, length, percent, seconds, signed, text_of, text_table, times};
use crate::plot::number;

/// Names and values under a heading.
pub(super) type Properties = (&'static str, Vec<(&'static str, String)>);

/// Columns of a table, between vertical bars, and its rows.
pub(super) struct Table(pub &'static str, pub Vec<Vec<TableCell>>);

/// The columns of multi-resolution rows and their meaning.
pub(super) const MR_COLUMNS: [(&str, &str); 13] = [
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
        "time of the fastest exact rays for this RMS error, certificates included, divided by this row's time; ~: extrapolated \
         beyond the largest measured number of rays",
    ),
    ("speed-up, same FBEM", "the same with the feature-based error of the shadow images at this s"),
    ("speed-up, segment", "best exact time for the same number of segments, divided by this row's time"),
    ("averaged", "part of the segments that met at least one averaged cluster"),
    ("exact rays", "segments of bundles for which triangles were tested, by MR or by Embree"),
    ("nodes", "mean number of visited clusters per segment"),
    ("in bounds", "part of the stated intervals that the reference confirms"),
];

/// Scene, preparation, workload, and where the time of the run went.
pub(super) fn properties(record: &Record) -> [Properties; 4] {
    let (scene, build) = (&record.scene, &record.build);
    let counts = [
        ("triangles", scene.triangles),
        ("objects", scene.objects),
        ("emitters", scene.emitters),
        ("closed parts", scene.closed_parts),
        ("sheets", scene.sheet_parts),
        ("clusters", scene.clusters),
        ("levels", scene.levels),
    ];
    let parts = record.spent.parts();
    let all = ("all", parts.iter().map(|part| part.1).sum());
    let preparation = vec![
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
    ];
    [
        ("Scene", counts.map(|(name, n)| (name, count(n as u64))).into()),
        ("Preparation", preparation),
        ("Workload", workload(&record.workload)),
        ("Time of this run", parts.into_iter().chain([all]).map(|(name, s)| (name, seconds(s))).collect()),
    ]
}

/// The queries, with the sources of light at infinity.
fn workload(work: &Workload) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        ("points", count(work.points as u64)),
        ("segments per point and emitter", count(work.rays as u64)),
        ("segments", count(work.segments)),
        ("reference rays", count(work.reference_rays as u64)),
        ("noise of the reference (RMS)", number(work.reference_rms)),
        ("runs of each row", count(work.rounds as u64)),
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

/// Rows of multi-resolution visibility.
pub(super) fn mr(record: &Record) -> Vec<Vec<TableCell>> {
    let row = |row: &MrRow| {
        vec![
            length(row.feature_size, &record.unit).into(),
            row.rays.into(),
            TableCell::words(row.route_in_a_word()),
            seconds(row.seconds).into(),
            number(row.rms).into(),
            signed(row.bias).into(),
            TableCell::speedup(record.gain(row.speedup_at_same_rms), row.extrapolated),
            TableCell::speedup(record.gain(row.speedup_at_same_fbem), false),
            TableCell::speedup(record.gain(Some(row.speedup_per_segment)), false),
            percent(row.aggregated_fraction).into(),
            count(row.exact_rays).into(),
            number(row.nodes_per_segment).into(),
            percent(row.interval_coverage).into(),
        ]
    };
    record.shown_rows().iter().map(row).collect()
}

/// Rows of exact visibility, without and with certificates.
pub(super) fn exact(record: &Record) -> Table {
    let row = |row: &ExactRow| {
        let call = format!("{}{}", row.mode, if row.coherent { ", coherent" } else { "" });
        vec![
            row.rays.into(),
            seconds(row.seconds).into(),
            number(row.rms).into(),
            signed(row.bias).into(),
            TableCell::words(call),
        ]
    };
    Table("rays | time | RMS | bias | call", record.exact.iter().chain(&record.certified).map(row).collect())
}

/// The best row of each class of receivers.
pub(super) fn classes(record: &Record) -> Table {
    let row = |class: &ClassRecord| {
        let row = class.shown_row()?;
        Some(vec![
            TableCell::words(class.class.name()),
            count(class.points as u64).into(),
            length(row.feature_size, &record.unit).into(),
            row.rays.into(),
            TableCell::words(row.route_in_words()),
            seconds(row.seconds).into(),
            number(row.rms).into(),
            signed(row.bias).into(),
            TableCell::speedup(record.gain(row.speedup_at_same_rms), row.extrapolated),
            TableCell::speedup(record.gain(class.smallest_speedup()), false),
            TableCell::speedup(record.gain(Some(row.speedup_per_segment)), false),
            percent(row.interval_coverage).into(),
        ])
    };
    let columns = "receivers | points | s | segments | answered by | time | RMS | bias | speed-up, same RMS | slowest row | \
                   speed-up, segment | in bounds";
    Table(columns, record.classes.iter().filter_map(row).collect())
}

/// The audited rows with as many segments as the workload.
pub(super) fn audited(record: &Record) -> Vec<(&MrRow, &IntervalAudit)> {
    let rows = record.shown_rows().iter().filter(|row| row.rays == record.workload.rays);
    rows.filter_map(|row| Some((row, row.audit.as_ref()?))).collect()
}

/// Claimed and observed errors of these rows.
pub(super) fn audits(record: &Record) -> Table {
    let range = |low: String, high: String| TableCell::from(format!("{low} to {high}"));
    let line = |(row, audit): (&MrRow, &IntervalAudit)| {
        vec![
            length(row.feature_size, &record.unit).into(),
            number(audit.claimed_rms).into(),
            number(audit.observed_rms).into(),
            range(number(audit.observed_lo), number(audit.observed_hi)),
            TableCell::from(percent(audit.coverage)).loss(audit.coverage_hi < 0.95),
            range(percent(audit.coverage_lo), percent(audit.coverage_hi)),
            TableCell::from(percent(row.interval_coverage)).loss(row.interval_coverage < 0.95),
        ]
    };
    let columns = "s | claimed RMS | observed RMS | its 95 % interval | intervals confirmed | their 95 % interval | in bounds, all bundles";
    Table(columns, audited(record).into_iter().map(line).collect())
}

/// Size of a map and noise of its reference.
pub(super) fn map(map: &MapRecord, unit: &str) -> String {
    format!(
        "{} × {} texels of {}; reference of {} rays a texel, whose noise of {} is subtracted.",
        map.width,
        map.height,
        length(map.texel, unit),
        map.reference_rays,
        number(map.reference_rms)
    )
}

/// Of a map the best multi-resolution row of each size, and the exact rows that no other surpasses.
pub(super) fn map_rows(map: &MapRecord, record: &Record) -> [Table; 2] {
    // Segments, spacing, times and errors: columns of both tables.
    let measured = |rays: usize, spacing: usize, times: [f64; 2], [rms, bias]: [f64; 2]| {
        let every = if spacing == 1 { "texel".to_owned() } else { format!("{spacing} texels") };
        let [time, setup] = times.map(|t| TableCell::from(seconds(t)));
        vec![rays.into(), every.into(), time, setup, number(rms).into(), signed(bias).into()]
    };
    let mr = |row: &MapMrRow| {
        let speed = |v: Option<f64>| TableCell::speedup(record.gain(v), row.extrapolated);
        let mut cells = vec![length(row.feature_size, &record.unit).into()];
        cells.extend(measured(row.rays, row.spacing, [row.seconds, row.setup_s], [row.rms, row.bias]));
        cells.extend([
            number(row.fbem).into(),
            speed(row.speedup_at_same_rms),
            speed(row.speedup_with_setup),
            TableCell::speedup(record.gain(row.speedup_over_texels), row.texels_extrapolated),
            speed(row.speedup_with_preparation),
            TableCell::speedup(record.gain(row.speedup_at_same_fbem), false),
        ]);
        cells
    };
    let exact =
        |row: &MapExactRow| measured(row.rays, row.spacing, [row.seconds, row.setup_s], [row.rms, row.bias]);
    let columns = "s | segments | every | time | set-up | RMS | bias | FBEM | speed-up, same RMS | with set-up | over every texel | with clusters \
         | same FBEM";
    [
        Table(columns, map.best_by_size().into_iter().map(mr).collect()),
        Table("rays | every | time | set-up | RMS | bias", map.best_exact().into_iter().map(exact).collect()),
    ]
}

/// The result in a sentence.
pub(super) fn result(record: &Record) -> String {
    if let Some(nothing) = &record.nothing_averaged {
        return nothing.clone();
    }
    let Some((best, speed)) = record.best().and_then(|row| Some((row, row.speedup_at_same_rms?))) else {
        return "This run has no multi-resolution row whose speed could be compared.".into();
    };
    let size = length(best.feature_size, &record.unit);
    let than = best.compared_in_words();
    let factor = times(Some(speed));
    let mut text = match speed {
        v if v >= EQUAL_SPEED_RANGE[1] => format!(
            "At feature size {size} multi-resolution visibility was {factor} faster than {than} of the same accuracy"
        ),
        v if v > EQUAL_SPEED_RANGE[0] && best.aggregated_fraction == 0.0 => {
            return format!(
                "Multi-resolution visibility was no faster than {than} of the same accuracy on this scene: in its fastest row, at {size}, \
                 nothing is averaged.{}",
                more(record, best)
            );
        }
        v if v > EQUAL_SPEED_RANGE[0] => format!(
            "Multi-resolution visibility was no faster than {than} of the same accuracy on this scene; its best feature size was {size}"
        ),
        _ => format!(
            "On this scene multi-resolution visibility was slower than {than} of the same accuracy: {factor} of its speed at best, \
             at {size}"
        ),
    };
    text += &format!(
        ", with a root mean square error of {} of the light. {} of its segments met averaged clusters.",
        percent(best.rms),
        percent(best.aggregated_fraction)
    );
    if best.extrapolated {
        text += " No measured number of exact rays is as accurate: their time is extrapolated, as half the error takes four times the rays.";
    }
    text += &more(record, best);
    text
}

/// Gains of features, certificates, classes of receivers and maps.
fn more(record: &Record, best: &MrRow) -> String {
    let (mut text, gain) = (String::new(), best.certificates_gain());
    if let Some((row, speed)) = record.faster_at_same_fbem() {
        let (factor, size) = (times(Some(speed)), length(row.feature_size, &record.unit));
        text += &format!(" At the same feature error (FBEM) it was {factor} as fast at feature size {size}.");
    }
    if gain > EQUAL_SPEED_RANGE[1] {
        let factor = times(Some(gain));
        text += &format!(" Certificates alone, without averaging, make exact rays {factor} as fast.");
    }
    let about = |is_extrapolated| if is_extrapolated { "about " } else { "" };
    // Where all points together gain nothing, those of a class may.
    let speed = |row: &MrRow| row.speedup_at_same_rms.filter(|speed| *speed >= EQUAL_SPEED_RANGE[1]);
    let of_class = |class| {
        let row = ClassRecord::shown_row(class).filter(|row| row.aggregated_fraction > 0.0)?;
        Some((class, row, speed(row)?))
    };
    let of_classes = record.classes.iter().filter_map(of_class);
    let fastest = of_classes.filter(|_| speed(best).is_none()).max_by(|a, b| a.2.total_cmp(&b.2));
    if let Some((class, row, speed)) = fastest {
        text += &format!(
            " At the {} receiver points of class “{}” alone it was {}{} as fast as {} at feature size {}.",
            count(class.points as u64),
            class.class.name(),
            about(row.extrapolated),
            times(Some(speed)),
            row.compared_in_words(),
            length(row.feature_size, &record.unit)
        );
    }
    // Maps may gain more than points: what neighbouring texels see of far clusters is interpolated.
    let gains = speed(best).unwrap_or(EQUAL_SPEED_RANGE[1]);
    let fastest = |of: fn(&MapMrRow) -> Option<f64>| {
        let rows =
            record.maps.iter().flat_map(|map| map.best_by_size().into_iter().map(move |row| (map, row)));
        let speed = |row: &MapMrRow| record.gain(of(row).filter(|v| v.is_finite() && !row.is_exact()));
        let faster = rows.filter_map(|(map, row)| Some((map, row, speed(row).filter(|v| *v > gains)?)));
        faster.max_by(|a, b| a.2.total_cmp(&b.2))
    };
    let said = |(map, row, speed): (&MapRecord, &MapMrRow, f64), what: &str| {
        let (receiver, about) = (quote(&map.receiver), about(row.extrapolated));
        let (factor, size) = (times(Some(speed)), length(row.feature_size, &record.unit));
        format!(" In the map of `{receiver}` {what} {about}{factor} as fast at feature size {size}")
    };
    if let Some(with_setup) = fastest(|row| row.speedup_with_setup) {
        text += &(said(with_setup, "it was, with set-up,") + ".");
    } else if let Some(queries) = fastest(|row| row.speedup_at_same_rms) {
        let all = times(queries.1.speedup_with_setup);
        text += &(said(queries, "its queries were") + &format!("; with set-up, {all}."));
    }
    text
}

/// Versions and settings.
pub(super) fn settings(record: &Record) -> String {
    let Record { mrvis, embree, isa, threads, seed, unit, .. } = record;
    let plural = if *threads == 1 { "thread" } else { "threads" };
    format!(
        "mrvis {mrvis} · Embree {embree} ({isa}) · {threads} {plural} in the timed sections · seed {seed} · lengths in {unit}"
    )
}

/// The record as text.
pub fn text(record: &Record) -> String {
    let mut text = format!("{}\n{}\n", quote(&record.scene.path), settings(record));
    for (title, list) in properties(record) {
        let list: Vec<String> = list.iter().map(|(name, value)| format!("{name} {value}")).collect();
        text += &text_of(&format!("{title}: {}\n", list.join("; ")));
    }
    if let Some(sky) = &record.workload.sky {
        text += &format!("{}\n", sky.sentence());
    }
    for warning in record.warnings.iter().chain(&record.build.cache_note) {
        text += &format!("note: {warning}\n");
    }
    let mut add = |title: &str, columns: &str, rows: &[Vec<TableCell>]| {
        if !rows.is_empty() {
            text += &format!("\n{title}\n{}", text_table(columns, rows));
        }
    };
    let (exact, classes, audits) = (exact(record), classes(record), audits(record));
    add("exact", exact.0, &exact.1);
    let extrapolated = record.shown_rows().iter().any(|row| row.extrapolated);
    let title = if extrapolated {
        "multi-resolution (~: exact time extrapolated to more rays)"
    } else {
        "multi-resolution"
    };
    add(title, &MR_COLUMNS.map(|(name, _)| name).join(" | "), &mr(record));
    add("classes of receivers", classes.0, &classes.1);
    for map in &record.maps {
        let [rows, _] = map_rows(map, record);
        let size = self::map(map, &record.unit);
        add(&format!("map of {}: {}", quote(&map.receiver), text_of(&size)), rows.0, &rows.1);
    }
    if let Some((_, audit)) = audited(record).first() {
        let IntervalAudit { bundles, rays, .. } = audit;
        let title = format!(
            "claimed and observed errors of {} bundles, by {} exact rays each",
            count(*bundles as u64),
            count(*rays as u64)
        );
        add(&title, audits.0, &audits.1);
    }
    text + &format!("\n{}\n", text_of(&result(record)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::record::{ReceiverClass, RunSeconds};

    fn row(route: &str) -> MrRow {
        MrRow { route: route.into(), rays: 16, ..MrRow::default() }
    }

    /// A row of plain exact rays has no speed-up, whatever its measured time.
    #[test]
    fn exact_rays_gain_nothing_over_themselves() {
        let exact = [(4, 1.0, 0.02), (16, 4.0, 0.02)].map(|(rays, seconds, rms)| ExactRow {
            rays,
            seconds,
            rms,
            ..ExactRow::default()
        });
        let row = |route: &str| {
            let mut row = MrRow { seconds: 3.0, rms: 0.002, ..row(route) };
            row.compare(&exact, &[]);
            [row.speedup_at_same_rms.expect("a speed-up"), row.speedup_per_segment]
        };
        assert_eq!(row("embree"), [1.0, 1.0]);
        assert!(row("bundle").iter().all(|speed| *speed > 1.2));
    }

    #[test]
    fn rows_name_their_route_and_the_run_its_time() {
        let spent = RunSeconds { points_s: 2.0, images_s: 1.0, ..RunSeconds::default() };
        let class = ClassRecord {
            class: ReceiverClass::Inside,
            points: 1200,
            mr: vec![row("cut")],
            ..ClassRecord::default()
        };
        let record = Record {
            mr: vec![row("embree"), row("bundle")],
            classes: vec![class],
            spent,
            ..Record::default()
        };
        let text = text(&record);
        for part in [
            "  exact ",
            "  walks ",
            "inside      1,200 ",
            "  distance cut ",
            "over all points 2 s; ",
            "all 3 s",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn nothing_averaged_is_the_result() {
        let speedup_at_same_rms = Some(1.04);
        let mr = [0.1, 0.4].map(|feature_size| MrRow { feature_size, speedup_at_same_rms, ..row("bundle") });
        let mut record =
            Record { mr: mr.into(), nothing_averaged: Some("Nothing.".into()), ..Record::default() };
        record.workload.rays = 16;
        let text = text(&record);
        assert!(
            text.ends_with("\nNothing.\n") && !text.contains("accuracy") && !text.contains('×'),
            "{text}"
        );
        assert!(text.contains("\n0.4     16") && !text.contains("\n0.1     16"), "{text}");
    }

    #[test]
    fn losses_are_said_plainly() {
        let row = |speed| MrRow {
            speedup_at_same_rms: Some(speed),
            rms: 0.01,
            feature_size: 0.1,
            ..MrRow::default()
        };
        let said =
            |rows: &[MrRow]| result(&Record { mr: rows.into(), unit: "m".into(), ..Record::default() });
        assert!(said(&[row(2.0)]).contains("2.00× faster"));
        assert!(said(&[row(0.5)]).contains("slower than exact rays"));
        assert!(said(&[row(1.03)]).contains("no faster than exact rays"));
        assert!(said(&[]).contains("no multi-resolution row"));
        let features = MrRow { feature_size: 0.4, speedup_at_same_fbem: Some(9.29), ..row(0.97) };
        let both = said(&[row(1.03), features]);
        assert!(
            both.contains("no faster")
                && both.contains("(FBEM) it was 9.29× as fast at feature size 0.4\u{a0}m")
        );
    }

    /// What the queries of a map gain is in the result even if set-up takes it away.
    #[test]
    fn the_result_names_what_maps_gain() {
        let map = |queries, with_setup| MapRecord {
            receiver: "floor".into(),
            mr: vec![MapMrRow {
                feature_size: 0.4,
                speedup_at_same_rms: Some(queries),
                speedup_with_setup: Some(with_setup),
                ..MapMrRow::default()
            }],
            ..MapRecord::default()
        };
        let said = |map| {
            let mr = vec![MrRow { speedup_at_same_rms: Some(1.0), ..MrRow::default() }];
            result(&Record { mr, maps: vec![map], unit: "m".into(), ..Record::default() })
        };
        let text = said(map(25.8, 0.96));
        assert!(
            text.contains("its queries were 25.8× as fast") && text.contains("with set-up, 0.96×"),
            "{text}"
        );
        assert!(said(map(25.8, 12.0)).contains("it was, with set-up, 12.0× as fast"));
        assert!(!said(map(1.0, 0.9)).contains("map"));
    }

    #[test]
    fn what_certificates_gain_is_not_the_gain_of_averaging() {
        let exact = ExactRow { rays: 16, seconds: 2.0, rms: 0.01, ..ExactRow::default() };
        let certified = ExactRow { seconds: 1.0, ..exact.clone() };
        let mut row = MrRow { rays: 16, seconds: 1.0, rms: 0.01, ..MrRow::default() };
        row.compare(&[exact], &[certified]);
        assert!(row.speedup_at_same_rms == Some(1.0) && row.compared_with == "certified", "{row:?}");
        assert_eq!(row.speedup_over_plain_exact, Some(2.0));
        let text = result(&Record { mr: vec![row], unit: "m".into(), ..Record::default() });
        assert!(text.contains("no faster than exact rays (Embree) with certificates"), "{text}");
        assert!(
            text.contains("Certificates alone, without averaging, make exact rays 2.00× as fast"),
            "{text}"
        );
    }
}
