//! Tests of the page with a synthetic record; set `MRVIS_PAGE` to a file to inspect the page.

use super::*;
use crate::bench::record::{
    Build, CalibrationBin, ExactRow, IntervalAudit, ReceiverErrors, RunSeconds, SceneSummary, SkySources,
    Workload,
};

/// Shadows of 260 discs, six of them large, with noise; `large_only`: of the large ones.
fn shadows(large_only: bool, noise: f32, seed: u64) -> Image<'static> {
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let discs: Vec<[f32; 3]> = (0..260)
        .map(|i| [160.0 * random(), 120.0 * random(), if i < 6 { 12.0 } else { 1.5 + 2.0 * random() }])
        .collect();
    let mut random = seed | 1;
    Image::from_fn(160, 120, 0.05, |x, y| {
        let mut light = if large_only { 0.66 } else { 1.0f32 };
        for [cx, cy, r] in &discs {
            if large_only && *r < 10.0 {
                continue;
            }
            let d = (x as f32 - cx).hypot(y as f32 - cy) - r;
            light *= ((d + 1.5) / 3.0).clamp(0.0, 1.0);
        }
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let sign = (random >> 40) as f32 / (1 << 24) as f32 - 0.5;
        (light + noise * sign).clamp(0.0, 1.0)
    })
    .unwrap()
}

fn audit() -> IntervalAudit {
    let bin = |claimed: f64, observed: f64| CalibrationBin {
        count: 100,
        claimed,
        observed,
        observed_lo: 0.8 * observed,
        observed_hi: 1.1 * observed,
    };
    IntervalAudit {
        fraction: 0.05,
        bundles: 300,
        rays: 64,
        claimed_rms: 0.07,
        observed_rms: 0.05,
        observed_lo: 0.045,
        observed_hi: 0.056,
        coverage: 0.98,
        coverage_lo: 0.95,
        coverage_hi: 0.99,
        bins: vec![bin(0.02, 0.01), bin(0.05, 0.04), bin(0.12, 0.09)],
    }
}

fn exact_rows() -> [ExactRow; 5] {
    [1usize, 4, 16, 64, 256].map(|n| ExactRow {
        rays: n,
        seconds: 0.021 * n as f64,
        mode: "occluded16".into(),
        rms: 0.31 / (n as f64).sqrt(),
        ..ExactRow::default()
    })
}

fn mr_rows() -> [MrRow; 4] {
    let mr = [
        (0.1, 0.19, 0.021, 2.1),
        (0.25, 0.121, 0.034, 3.4),
        (0.6, 0.08, 0.052, 5.9),
        (1.5, 0.05, 0.098, 0.8),
    ];
    mr.map(|(s, seconds, rms, per_segment)| MrRow {
        route: "bundle".into(),
        feature_size: s,
        rays: 16,
        seconds,
        rms,
        bias: -0.004,
        interval_coverage: 0.97,
        audit: Some(audit()),
        aggregated_fraction: 0.81,
        speedup_per_segment: per_segment,
        speedup_at_same_rms: Some(0.021 * (0.31 / rms).powi(2) / seconds),
        compared_with: "exact".into(),
        speedup_over_plain_exact: Some(0.021 * (0.31 / rms).powi(2) / seconds),
        speedup_at_same_fbem: (s > 0.2).then_some(7.0),
        extrapolated: s < 0.2,
        ..MrRow::default()
    })
}

fn example() -> (Record, Vec<ReceiverImages>) {
    let record = Record {
        unit: "m".into(),
        scene: SceneSummary { path: "scenes/park <b>.obj".into(), triangles: 512_340, ..Default::default() },
        scene_repairs: serde_json::json!({"zero_area_faces": 41, "duplicate_faces": 0, "welded_vertices": 120311,
            "messages": ["park.mtl:12: unknown material 'moss', grey used"]}),
        warnings: vec!["Another process used the machine while timing.".into()],
        build: Build {
            load_s: 0.82,
            characterise_s: 4.2,
            cache_note: Some("a cache was damaged".into()),
            embree_bytes: 88_000_000,
            ..Build::default()
        },
        spent: RunSeconds { points_s: 12.3, ..RunSeconds::default() },
        workload: Workload {
            points: 20_000,
            rays: 16,
            segments: 320_000,
            sky: Some(SkySources {
                patches: 64,
                largest_angle: 29.4,
                patches_per_point: 4,
                domes: 0,
                suns: 1,
                shown: "lamps".into(),
            }),
            ..Workload::default()
        },
        exact: exact_rows().into(),
        mr: mr_rows().into(),
        receivers: vec![ReceiverErrors { name: "lawn".into(), ..Default::default() }],
        ..Record::default()
    };
    let images = ReceiverImages {
        name: "lawn".into(),
        reference: shadows(false, 0.0, 1),
        exact16: shadows(false, 0.3, 2),
        surface: [8.0, 6.0],
        mr: [(0.1, 0.1, false), (0.25, 0.1, false), (0.6, 0.02, true)]
            .map(|(size, noise, large_only)| MrImage {
                size,
                image: shadows(large_only, noise, 3),
                handed_over: false,
            })
            .into(),
        clusters: None,
    };
    (record, vec![images])
}

#[test]
fn a_page_stands_alone_and_escapes_names() {
    let (record, receivers) = example();
    let page = render(&record, &receivers, "mrvis bench").unwrap();
    if let Some(path) = std::env::var_os("MRVIS_PAGE") {
        std::fs::write(path, &page).unwrap();
    }
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>"));
    for outside in ["http://", "https://", "src=\"/", "href=", "@import", "url("] {
        let mut found = page.match_indices(outside).map(|(i, _)| &page[i..i + 40]);
        // The name space of SVG is not fetched.
        assert!(found.all(|s| s.starts_with("http://www.w3.org/2000/svg")), "{outside}");
    }
    assert!(page.contains("park &lt;b&gt;.obj") && !page.contains("park <b>"));
    // Error against time, calibration, two cross-sections, spectrum; each for wide and for narrow windows.
    assert_eq!(page.matches("<svg ").count(), 2 * 5);
    // The second size looks like the first.
    assert_eq!(page.matches("data:image/png;base64,").count(), 3 + 2 * 3);
    assert!(page.contains("s = 0.25\u{a0}m: no texel differs visibly from the image of s = 0.1\u{a0}m."));
    assert!(page.contains("24.1×") && page.contains("41 zero area faces"));
    assert!(page.contains("64 patches of the sky up to 29.4° wide, of which a point asks up to 4"));
    assert!(page.contains(">walks</td>") && page.contains("Time of this run"));
    assert!(
        page.contains("At the same feature error (FBEM) it was 7.00×"),
        "the headline names the gain of the table"
    );
    assert_eq!(page, render(&record, &receivers, "mrvis bench").unwrap());
}

#[test]
fn empty_and_odd_records_still_make_a_page() {
    let page = render(&Record::default(), &[], "").unwrap();
    assert!(page.contains("no multi-resolution row"));
    let (mut record, mut receivers) = example();
    for row in &mut record.mr {
        (row.rms, row.seconds, row.speedup_at_same_rms, row.speedup_per_segment) =
            (f64::NAN, 0.0, None, f64::INFINITY);
    }
    let page = render(&record, &receivers, "mrvis bench").unwrap();
    // The letters may occur in encoded images.
    assert!(page.split("data:image").all(|part| !part.split_once('"').map_or(part, |p| p.1).contains("NaN")));
    receivers[0].mr[0].image = Image::new(2, 2, 1.0, vec![0.0; 4]).unwrap();
    assert!(render(&record, &receivers, "mrvis bench").is_err());
}

/// A map has one line a size, that with the largest speed-up including set-up, and exact rows that nothing surpasses.
#[test]
fn maps_show_their_best_rows() {
    use crate::bench::record::{MapExactRow, MapMrRow, MapRecord};
    let exact = |rays, spacing, seconds, rms| MapExactRow {
        rays,
        spacing,
        interpolated: spacing > 1,
        seconds,
        rms,
        ..MapExactRow::default()
    };
    let mr = |feature_size, spacing, speed| MapMrRow {
        feature_size,
        spacing,
        speedup_with_setup: Some(speed),
        ..MapMrRow::default()
    };
    let (mut record, receivers) = example();
    record.maps = vec![MapRecord {
        receiver: "<lawn>".into(),
        exact: vec![exact(16, 1, 0.4, 0.05), exact(16, 2, 0.1, 0.04), exact(64, 1, 1.6, 0.02)],
        mr: vec![mr(0.1, 1, 3.5), mr(0.1, 2, 12.5), mr(0.4, 1, 95.5), mr(0.4, 4, f64::NAN)],
        ..MapRecord::default()
    }];
    let spacings: Vec<usize> = record.maps[0].best_by_size().iter().map(|row| row.spacing).collect();
    assert_eq!(spacings, [2, 1]);
    let rays: Vec<usize> = record.maps[0].best_exact().iter().map(|row| row.rays).collect();
    assert_eq!(rays, [16, 64]);
    let page = render(&record, &receivers, "").unwrap();
    assert!(page.contains("<h3>&lt;lawn&gt;</h3>") && page.contains("12.5×") && page.contains("95.5×"));
    assert!(!page.contains("3.5×"));
    // The headline tells of a map that gains more than points.
    let told = super::shown::result(&record);
    assert!(told.contains("In the map of `<lawn>` it was, with set-up, 95.5× as fast"), "{told}");
}

/// A class has one line, that with the largest speed-up; a class whose rows err nowhere has one too.
#[test]
fn classes_show_their_best_rows() {
    use crate::bench::record::{ClassRecord, ReceiverClass};
    let (mut record, receivers) = example();
    let row = |route: &str, speed| MrRow {
        route: route.into(),
        speedup_at_same_rms: speed,
        speedup_per_segment: 1.0,
        aggregated_fraction: 0.5,
        ..MrRow::default()
    };
    let class = |class, mr| ClassRecord { class, points: 1234, mr, ..ClassRecord::default() };
    record.classes = vec![
        class(
            ReceiverClass::Near,
            vec![row("cut", Some(7.25)), row("cut", Some(8.25)), row("embree", Some(0.75))],
        ),
        class(ReceiverClass::Interior, vec![row("embree", None)]),
    ];
    let page = render(&record, &receivers, "").unwrap();
    let section = page.split("Classes of receivers").nth(1).unwrap().split("</section>").next().unwrap();
    for shown in
        ["<dt>near</dt>", "<dt>interior</dt>", "8.25×", "0.75×", "distance cut", "exact rays", "1\u{202f}234"]
    {
        assert!(section.contains(shown), "{shown}: {section}");
    }
    assert!(!section.contains("7.25×") && !section.contains("<dt>open</dt>"), "{section}");
    // The headline tells of a class that gains where all points together do not.
    let told = "receiver points of class “near” alone it was 8.25× as fast as";
    assert!(!page.contains(told));
    record.mr.iter_mut().for_each(|row| row.speedup_at_same_rms = Some(1.0));
    assert!(render(&record, &receivers, "").unwrap().contains(told));
    record.classes.clear();
    assert!(!render(&record, &receivers, "").unwrap().contains("Classes of receivers"));
}

/// A scene in which nothing is averaged has one sentence and one row, although the sizes that were asked for keep theirs in the record.
#[test]
fn nothing_averaged_is_said_once() {
    let (mut record, receivers) = example();
    let rows =
        |page: &str| page.matches("0.25\u{a0}m</td>").count() + page.matches("0.6\u{a0}m</td>").count();
    let before = render(&record, &receivers, "").unwrap();
    record.nothing_averaged = Some("Nothing may be averaged in this scene.".into());
    let page = render(&record, &receivers, "").unwrap();
    assert_eq!(page.matches("Nothing may be averaged in this scene.").count(), 1);
    assert!(!page.contains("24.1×") && rows(&page) < rows(&before), "{} {}", rows(&page), rows(&before));
}
