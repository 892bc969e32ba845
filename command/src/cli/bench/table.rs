//! The record of a benchmark as text.

mod classes;
mod headline;

use mrvis::internals::bench::record::{Build, MapRecord, MrRow, Record};
use mrvis::internals::error::quote;
use mrvis::internals::plot::number;
use std::fmt::Write as _;

/// The record as text.
pub fn table(record: &Record) -> String {
    let unit = &record.unit;
    let mut text = head(record);
    text += &exact_rows(record);
    text += &mr_rows(record.shown_rows());
    text += &classes::lines(&record.classes, unit);
    text += &maps(&record.maps);
    text += &setup(record);
    text += &spent(record);
    text += &audits(&record.mr);
    // Writing to a string cannot fail.
    let result = record.nothing_averaged.clone().unwrap_or_else(|| headline::of(record));
    let _ = writeln!(text, "\n{result}");
    text
}

/// Scene, preparation, memory, workload and warnings.
fn head(record: &Record) -> String {
    let Record { scene, build, workload, .. } = record;
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{}: {} triangles, {} objects, {} emitters, {} closed parts, {} sheets, {} clusters in {} levels",
        quote(&scene.path),
        scene.triangles,
        scene.objects,
        scene.emitters,
        scene.closed_parts,
        scene.sheet_parts,
        scene.clusters,
        scene.levels
    );
    let _ = writeln!(
        text,
        "built in: reading {}, Embree {}, {}",
        seconds(build.load_s),
        seconds(build.embree_s),
        clusters(build)
    );
    let b = build.bytes_per_triangle;
    let _ = writeln!(
        text,
        "memory: {:.0} bytes per triangle (scene {:.0}, clusters {:.0}, optics {:.0}, traversal {:.0}, Embree {:.0})",
        b.total, b.scene, b.hierarchy, b.optics, b.wide, b.embree
    );
    let _ = writeln!(
        text,
        "{} points, {} segments at {} rays; reference of {} rays, noise {}; {} thread{}, {}",
        workload.points,
        workload.segments,
        workload.rays,
        workload.reference_rays,
        number(workload.reference_rms),
        record.threads,
        if record.threads == 1 { "" } else { "s" },
        record.isa
    );
    if let Some(sky) = &workload.sky {
        let _ = writeln!(text, "{}", sky.sentence());
    }
    for warning in record.warnings.iter().chain(&build.cache_note) {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// Rows of exact visibility, without and with certificates.
fn exact_rows(record: &Record) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "\nexact    rays       time        RMS       bias  call");
    for row in record.exact.iter().chain(&record.certified) {
        let coherent = if row.coherent { ", coherent" } else { "" };
        let _ = writeln!(
            text,
            "{:>13} {:>10} {:>10.5} {:>+10.5}  {}{coherent}",
            row.rays,
            seconds(row.seconds),
            row.rms,
            row.bias,
            row.mode
        );
    }
    text
}

/// Rows of multi-resolution visibility.
fn mr_rows(rows: &[MrRow]) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "\nmulti-resolution                                           speed-up at same");
    let _ = writeln!(
        text,
        "       s   rays       time        RMS       bias       RMS      FBEM   segment  averaged  nodes  in bounds  by"
    );
    for row in rows {
        let _ = writeln!(
            text,
            "{:>8} {:>6} {:>10} {:>10.5} {:>+10.5} {:>9} {:>9} {:>9} {:>7.1} % {:>6} {:>8.1} %  {}",
            number(row.feature_size),
            row.rays,
            seconds(row.seconds),
            row.rms,
            row.bias,
            times(row.speedup_at_same_rms, row.extrapolated),
            times(row.speedup_at_same_fbem, false),
            times(Some(row.speedup_per_segment), false),
            100.0 * row.aggregated_fraction,
            number(row.nodes_per_segment),
            100.0 * row.interval_coverage,
            row.route_in_words()
        );
    }
    if rows.iter().any(|row| row.extrapolated) {
        let _ = writeln!(text, "~ beyond the most exact rays measured, extrapolated");
    }
    let whole = rows.iter().filter(|row| row.handed_over == 1.0).count();
    if whole > 0 {
        let _ = writeln!(
            text,
            "{whole} of {} rows were not expected to be faster: their bundles were handed to Embree",
            rows.len()
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
        let _ = writeln!(
            text,
            "{}: {} x {} texels, reference of {} rays, noise {}",
            quote(&map.receiver),
            map.width,
            map.height,
            map.reference_rays,
            number(map.reference_rms)
        );
        for row in map.best_by_size() {
            let route = if row.route == "embree" { "  by exact rays" } else { "" };
            let _ = writeln!(
                text,
                "{:>25} {:>6} {:>8} {:>10} {:>9} {:>10.5} {:>9.5} {:>10} {:>12} {:>12} {:>9}{route}",
                number(row.feature_size),
                row.rays,
                row.spacing,
                seconds(row.seconds),
                seconds(row.setup_s),
                row.rms,
                row.fbem,
                times(row.speedup_at_same_rms, row.extrapolated),
                times(row.speedup_with_setup, row.extrapolated),
                times(row.speedup_over_texels, row.texels_extrapolated),
                times(row.speedup_at_same_fbem, false)
            );
        }
    }
    text
}

/// Origin and time of the clusters.
fn clusters(build: &Build) -> String {
    if build.cache == "hit" {
        return format!("clusters from the cache {}", seconds(build.cache_s));
    }
    let kept =
        if build.cache == "made" { format!(", kept in {}", seconds(build.cache_s)) } else { String::new() };
    format!(
        "hierarchy {}, measuring clusters {}{kept}",
        seconds(build.hierarchy_s),
        seconds(build.characterise_s)
    )
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

#[cfg(test)]
mod tests {
    use super::*;
    use mrvis::internals::bench::record::ExactRow;

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
}
