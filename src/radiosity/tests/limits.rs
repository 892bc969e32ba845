//! Time limits, interruption, missed targets, and light that would grow without end.

use super::*;
use crate::progress::testing::stop_when;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::final_gather::FinalGather;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::refinement::StopReason;
use crate::scene::generate::{Spec, build};
use crate::scene::testing::{Pieces, facing_down};
use std::collections::HashMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

fn clutter() -> Scene {
    generated("desk-room")
}

/// Points on all surfaces of a scene, chosen by a coarse solution's elements.
pub fn on_surfaces(scene: &Scene, count: usize) -> Vec<Point> {
    let links_alone = Options { error: 0.5, audit: 0, local_rays: Some(0), ..Options::default() };
    let coarse = solved(scene, &[], &links_alone);
    let elements = &coarse.mesh.elements;
    (elements.iter().step_by(elements.len().div_ceil(count)))
        .map(|e| {
            let [a, b, c, _] = e.corners.map(|v| coarse.mesh.vertices[v as usize].as_dvec3());
            Point { position: (a + b + c) / 3.0 + scene.origin, normal: (b - a).cross(c - a).normalize() }
        })
        .collect()
}

/// Irradiance at points by brute force.
pub fn truth(scene: &Scene, points: &[Point], samples: u32) -> Vec<f64> {
    traced(scene, points, samples, 3).into_iter().map(mean).collect()
}

/// Root mean square difference and difference of the means, relative to the mean.
pub fn off(got: &[Rgb], want: &[f64]) -> (f64, f64) {
    let (mut squares, mut sum, mut all) = (0.0, 0.0, 0.0);
    for (got, want) in got.iter().zip(want) {
        squares += (mean(*got) - want).powi(2);
        sum += mean(*got) - want;
        all += want;
    }
    let n = want.len() as f64;
    ((squares / n).sqrt() / (all / n), sum / all)
}

/// Whenever clutter is interrupted, what is written is the light as paths see it, only with more noise.
#[test]
fn interrupted_clutter_is_lit_as_paths_say() {
    let scene = clutter();
    let points = on_surfaces(&scene, 150);
    let want = truth(&scene, &points, 1024);
    let all = solved(&scene, &[], &Options { error: 0.1, ..coarse() });
    for stages in [1, 3, 5] {
        let stop = stop_when(|c| c.stages >= stages);
        let outcome = run(&model_for(&scene, &coarse()), &points, &coarse(), &stop).expect("a solution");
        let Record { interrupted, ended, local_convergence, mean_irradiance, ledger, .. } = &outcome.record;
        assert!(*interrupted && *ended == StopReason::Interrupted, "{stages}: {ended:?}");
        let (rms, bias) = off(&outcome.irradiance, &want);
        assert!(rms < 0.25 && bias.abs() < 0.05, "{stages}: {rms} {bias}");
        assert!(local_convergence.is_some() && ledger.created.abs() < 1e-2 * ledger.emitted, "{ledger:?}");
        let ratio = mean(*mean_irradiance) / mean(all.record.mean_irradiance);
        assert!((ratio - 1.0).abs() < 0.03, "{stages}: {ratio}");
    }
}

/// However fine the solution that is asked for.
#[test]
fn time_limits_bound_the_time() {
    for scene in [room(true), clutter()] {
        let points = floor(200);
        let limit = 0.5;
        let options = Options {
            error: 1e-5,
            min_area: 1e-7,
            local_rays: Some(100_000_000),
            gather_rays: Some(1 << 16),
            max_seconds: Some(limit),
            ..Options::default()
        };
        // Without a limit it would take hours.
        let Record { ended, warnings, ledger, .. } = solved(&scene, &points, &options).record;
        assert_eq!(ended, StopReason::Time);
        assert!(warnings.iter().any(|w| w.contains("⟨max_seconds⟩ 0.5 ended refinement")), "{warnings:?}");
        // What has fewer rays is told once.
        assert!(warnings.iter().filter(|w| w.contains("noisier")).count() == 1, "{warnings:?}");
        assert!(ledger.created.abs() < 1e-2 * ledger.emitted, "{ledger:?}");
    }
}

/// Few coarse links have row sums that no factors bring to 1; light along them keeps its power.
#[test]
fn solutions_of_any_number_of_links_keep_their_power() {
    for max_links in [1, 20, 143, 1000] {
        let options = Options { max_links, local_rays: Some(0), audit: 0, ..Options::default() };
        let ledger = solved(&clutter(), &[], &options).record.ledger;
        assert!(ledger.created.abs() < 1e-3 * ledger.emitted, "{max_links}: {ledger:?}");
    }
}

#[test]
fn a_missed_target_is_recorded() {
    let target_at = |points: &[Point], target_error: f64, max_links: usize| {
        // A given number of rays is not raised to meet the target. Small targets need many paths at each element that is audited.
        let rays = Options { error: 0.05, local_rays: Some(100_000), audit: 4, ..coarse() };
        let options = Options { target_error: Some(target_error), max_links, ..rays };
        solved(&room(true), points, &options).record
    };
    let target = |target_error, max_links| target_at(&[], target_error, max_links);
    let missed = target(1e-6, 10_000_000);
    assert!(missed.target_met == Some(false) && missed.ended == StopReason::Error);
    assert!(missed.warnings.iter().any(|w| w.contains("target_error")), "{:?}", missed.warnings);
    let met = target(0.5, 10_000_000);
    assert!(
        met.target_met == Some(true)
            && met.ended == StopReason::Target
            && met.error_estimate.is_some_and(|e| e <= 0.5)
    );
    // Below the floor, where no light arrives.
    let below = Point { position: DVec3::new(1.0, 1.0, -1.0), normal: DVec3::NEG_Z };
    assert_eq!(target_at(&[below], 0.5, 10_000_000).target_met, Some(false));
    let full = target(1e-6, 500);
    assert!(full.ended == StopReason::Links && full.links <= 500, "{:?} {}", full.ended, full.links);
    assert!(full.warnings.iter().any(|w| w.contains("⟨max_links⟩ 500")), "{:?}", full.warnings);
    let audited = Options { audit: 20, error: 0.3, ..coarse() };
    assert_eq!(solved(&room(true), &[], &audited).record.target_met, None);
}

/// More rays are traced until independent paths find no larger error than the target; whether it is met is what the last audit finds.
#[test]
fn targets_are_kept_by_more_rays() {
    let target = 0.014;
    let solve = |target_error| {
        let options = Options { error: 0.2, seed: 3, target_error, ..Options::default() };
        let record = solved(&clutter(), &[], &options).record;
        (record.error_estimate.expect("an audit"), record)
    };
    let ((first, without), (found, record)) = (solve(None), solve(Some(target)));
    // The last audit draws other elements than the one that ends the attempts, and may find more than the target.
    assert!(first > 1.3 * target && found <= 1.3 * target, "{first} {found}");
    assert_eq!(record.target_met, Some(found <= target), "{found}");
    assert!(2 * record.exact_rays > 3 * without.exact_rays, "{} {}", record.exact_rays, without.exact_rays);
}

/// All three ways through clusters, in all scenes that are generated, with what is hidden left out and put in: light stays
/// light, and settles.
#[test]
fn light_does_not_grow_inside_clusters() {
    for kind in crate::scene::generate::KINDS {
        let count = if kind.name == "urban-block" { Some(300) } else { None };
        let mut spec = Spec { count, ..Spec::new(kind.name) };
        (spec.trees, spec.leaves) = (6, 60);
        let scene = build(&spec).expect("a scene");
        let solve = |inside, row_sums| {
            let options =
                Options { inside, row_sums, error: 0.3, audit: 0, local_rays: Some(0), ..Options::default() };
            solved(&scene, &[], &options).record
        };
        let right = mean(solve(Inside::Visible, RowNormalisation::Balanced).mean_irradiance);
        for inside in [Inside::Isotropic, Inside::Oriented, Inside::Visible] {
            let record = solve(inside, RowNormalisation::Sampled);
            let ratio = mean(record.mean_irradiance) / right;
            assert!(record.convergence.converged, "{} {inside:?}: {:?}", kind.name, record.convergence);
            assert!(ratio > 0.3 && ratio < 5.0, "{} {inside:?}: {ratio}", kind.name);
        }
    }
}

/// The furnace in other units: as small and as large as its numbers allow, and nothing wrong beyond.
#[test]
fn light_does_not_depend_on_the_unit_of_length() {
    for scale in [1e-9, 1e-6, 1.0, 1e6, 1e9] {
        let scene = furnace_of(0.5, scale);
        let points: Vec<Point> =
            floor(9).into_iter().map(|p| Point { position: scale * p.position, ..p }).collect();
        let outcome = solved(&scene, &points, &quick());
        // Rays of points that end nearby continue as paths, which have noise.
        for value in outcome.irradiance {
            assert!((value[0] / 2.0 - 1.0).abs() < 5e-3, "{scale}: {value:?}");
        }
        assert!((outcome.record.mean_irradiance[0] / 2.0 - 1.0).abs() < 2e-3, "{scale}");
    }
    for scale in [1e-10, 1e10] {
        let refused =
            run(&model_for(&furnace_of(0.5, scale), &Options::default()), &[], &Options::default(), &());
        assert!(refused.err().is_some_and(|e| e.to_string().contains("another unit")), "{scale}");
    }
}

/// Powers are watts, whatever the unit of length.
#[test]
fn ledgers_are_in_watts() {
    let ledger = |unit: &str, scale: f64| {
        let mut scene = furnace_of(0.5, scale);
        scene.unit = unit.into();
        solved(&scene, &[], &Options { error: 0.3, ..quick() }).record.ledger
    };
    let (metres, millimetres, unknown) = (ledger("m", 1.0), ledger("mm", 1000.0), ledger("ell", 1.0));
    assert!((metres.emitted - 6.0).abs() < 1e-3 && (millimetres.emitted - 6.0).abs() < 1e-3);
    assert!(metres.unit == "W" && millimetres.unit == "W" && unknown.unit.contains("ell"), "{unknown:?}");
}

#[test]
fn points_off_surfaces_are_counted() {
    let mut points = floor(5);
    points[3].position.z = 1.7;
    let options = Options { error: 0.3, local_rays: Some(20_000), audit: 0, ..Options::default() };
    let warnings = |points: &[Point]| solved(&room(true), points, &options).record.warnings;
    let found = warnings(&points);
    assert!(found.iter().any(|w| w.starts_with("1 of 5 points lie")), "{found:?}");
    assert!(!warnings(&floor(5)).iter().any(|w| w.contains("points lie")));
    // Points that are meant to be off surfaces are not reported.
    points.swap(3, 4);
    let options = Options { points_in_space: 1, ..options.clone() };
    assert!(!solved(&room(true), &points, &options).record.warnings.iter().any(|w| w.contains("points lie")));
}

/// Calls of this clock are a millisecond apart, so that a test has the same time on every machine.
fn counting_clock() -> Instant {
    static BEGUN: OnceLock<Instant> = OnceLock::new();
    static CALLS: AtomicU64 = AtomicU64::new(0);
    *BEGUN.get_or_init(Instant::now) + Duration::from_millis(CALLS.fetch_add(1, Ordering::Relaxed))
}

/// Light at pixels that the time does not suffice for is gathered with fewer rays, or left to the elements; a note says which.
#[test]
fn light_at_more_points_keeps_to_the_time() {
    let scene = room(true);
    let options = Options {
        light_rays: Some(4096),
        gather_rays: Some(4096),
        error: 0.1,
        more_points: true,
        audit: 0,
        ..Options::default()
    };
    let (_, mut solution) = solve(&model_for(&scene, &options), &[], &options, &()).expect("a solution");
    // Without a limit all rays are traced.
    let all = solution.irradiance_within(&floor(50), 1.0, &());
    assert!(all.note.is_none());
    assert_eq!(all.irradiance.expect("light"), solution.irradiance_unless(&floor(50), &()).expect("light"));
    // By this clock the timed sample of 64 points takes a millisecond, so that 12,000 points would take 188 ms on one thread and
    // 94 ms on two.
    solution.options.max_seconds = Some(0.02);
    let mut limited = |seconds: f64, points: usize| {
        solution.deadline = Deadline::start(&(), Some(seconds)).with_clock(counting_clock);
        on_threads(2, || solution.irradiance_within(&floor(points), 1.0, &()))
    };
    let some = limited(0.02, 12_000);
    let note = some.note.expect("a note");
    assert!(note.starts_with("⟨max_seconds⟩ 0.02: light at pixels by "), "{note}");
    let some = some.irradiance.expect("light");
    assert!(some.len() == 12_000 && some.iter().all(|e| e[0] > 0.0 && e[0].is_finite()));
    // There is no time for the smallest number of rays of each of three million points, nor for any when time is up.
    for (seconds, points) in [(0.02, 3_000_000), (0.0, 12_000)] {
        let none = limited(seconds, points);
        let note = none.note.expect("a note");
        assert!(none.irradiance.is_none() && note.contains(&format!("{points} pixels")), "{note}");
    }
    // Interrupted in the middle of it, at the third check.
    solution.deadline = Deadline::start(&(), None);
    let none = solution.irradiance_within(&floor(100_000), 1.0, &stop_when(|c| c.asked >= 3));
    assert!(none.irradiance.is_none() && none.note.expect("a note").starts_with("interrupted"));
}

// Local passes that are cut short.

/// A limited exchange that has a quarter of its rays leaves the time for the others to the light of elements: a seventh of 30,000 rays.
#[test]
fn elements_have_the_rays_that_a_limited_exchange_lacks() {
    let scene = room(true);
    let options = Options { error: 0.1, ..Options::default() };
    let model = model_for(&scene, &options);
    let linked = visibility::linked(&model, &options);
    let traced = |seconds: Option<f64>, rays: f64| {
        let deadline = Deadline::start(&(), seconds);
        let found = FinalGather::new(&model, &linked, &options).local_pass(Some(rays), 4e4, 1e6, &deadline);
        (found.element_rays.expect("rays of elements"), found.traced_part)
    };
    let [endless, limited] = [None, Some(1e9)].map(|seconds| traced(seconds, 1e4));
    assert!(endless.0 > 0.0 && (limited.0 - endless.0 - 3e4 / 7.0).abs() < 1.0, "{endless:?} {limited:?}");
    assert!(endless.1 < 0.97 && (limited.1 - 1.0).abs() < 1e-9, "{endless:?} {limited:?}");
    assert_eq!(traced(None, 4e4), traced(Some(1e9), 4e4));
}

/// A local pass of many elements that is interrupted at its beginning or in its middle traces few more rays; the light is that of the
/// whole pass within the error bars, and notes say what it is.
#[test]
fn an_interrupted_pass_of_many_elements_keeps_its_light() {
    let scene = crate::scene::testing::forest(27, 1200);
    let options = Options { error: 0.1, audit: 0, ..Options::default() };
    let model = model_for(&scene, &options);
    let solve = |stop: &dyn Progress| run(&model, &[], &options, stop).expect("a solution");
    let all = solve(&());
    let leaves = all.mesh.elements.len();
    // No more than 100,000 have rays all the same.
    assert!(leaves > 105_000, "{leaves} elements");
    let place = |mesh: &RadiosityMesh, e: &Element| {
        e.corners.map(|c| mesh.vertices[c as usize].to_array().map(f32::to_bits))
    };
    let places: HashMap<_, _> = all.mesh.elements.iter().map(|e| (place(&all.mesh, e), e)).collect();
    for steps in [0, leaves / 2] {
        let stop = stop_when(|told| told.stage == "local pass, rays" && told.stage_steps >= steps as u64);
        let Outcome { mesh, record, .. } = solve(&stop);
        assert!(record.interrupted && record.ended != StopReason::Interrupted, "{:?}", record.ended);
        let notes = record.warnings.join("\n");
        assert!(notes.contains("elements have no rays") && notes.contains("an interruption"), "{notes}");
        assert!(record.exact_rays < all.record.exact_rays / 2, "{steps}: {} rays", record.exact_rays);
        let ratio = mean(record.mean_irradiance) / mean(all.record.mean_irradiance);
        assert!((ratio - 1.0).abs() < 0.1, "{steps}: {ratio}");
        let created = record.ledger.created.abs() / record.ledger.emitted;
        assert!(created < 0.02, "{steps}: {created}");
        // Most elements are the same, as surfaces had been split before; some are split further where light differs on them.
        let (mut squares, mut bars, mut found) = (0.0, 0.0, 0);
        for got in &mesh.elements {
            let Some(want) = places.get(&place(&mesh, got)) else { continue };
            found += 1;
            squares += got.area * (mean(got.irradiance) - mean(want.irradiance)).powi(2);
            bars += got.area * mean(got.error).powi(2) + got.area * mean(want.error).powi(2);
        }
        assert!(found > 100_000 && found < mesh.elements.len(), "{found}");
        let part: f64 = (squares / bars).sqrt();
        assert!((0.25..1.5).contains(&part), "{steps}: errors are {part} of their bars");
    }
}

/// Time that is up before the local pass: the largest elements, on which most light falls, have rays all the same.
#[test]
fn late_passes_trace_what_is_large() {
    let scene = room(true);
    let whole = Options { error: 0.05, audit: 0, ..Options::default() };
    let options = Options { max_seconds: Some(1e-6), ..whole.clone() };
    let late = solved(&scene, &[], &options).record;
    let all = solved(&scene, &[], &whole).record;
    let ratio = mean(late.mean_irradiance) / mean(all.mean_irradiance);
    assert!((ratio - 1.0).abs() < 0.1 && late.exact_rays < all.exact_rays / 2, "{ratio}");
    assert!(!late.warnings.join(" ").contains("have no rays"), "{:?}", late.warnings);
}

/// Time that is up before the local pass of a white box of shelves, each nearer to the next than elements are wide: most light goes
/// through gaps, several times.
#[test]
fn late_passes_keep_the_light_in_gaps() {
    let mut pieces = Pieces::empty();
    pieces.grey("box", 0.9).room(DVec3::ZERO, DVec3::splat(2.0)).object("shelves");
    for k in 1..20 {
        let z = 0.1 * f64::from(k);
        pieces.rectangle(DVec3::new(0.0, 0.0, z), DVec3::X, 2.0 * DVec3::Y);
    }
    pieces.glowing("lamp", 10.0).object("lamp").polygon(&facing_down([1.7, 1.9], [0.9, 1.1], 1.99));
    let options = Options { max_seconds: Some(1e-6), audit: 0, ..Options::default() };
    let record = solved(&pieces.scene(), &[], &options).record;
    let created = record.ledger.created / record.ledger.emitted;
    assert!(created.abs() < 0.03, "{created}");
}
