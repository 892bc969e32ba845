//! From a scene to a solution: preparation, steps of refinement, and what is written down about them.

use super::field::Rgb;
use super::prepare::Prepared;
use super::record::{Iteration, Outcome, Record, Seconds};
use super::{Options, Receiver, Solver, probe};
use crate::Result;
use crate::element::Elements;
use crate::facts::SceneFacts;
use crate::link::Sight;
use crate::points::Point;
use crate::scene::Scene;
use crate::visibility::reference;
use glam::Vec3;
use std::time::Instant;

/// Told what is going on, and asked whether to go on.
pub trait Progress: Sync {
    /// A part of the work begins.
    fn stage(&self, name: &str);
    /// Whether refinement shall end with what there is.
    fn stopped(&self) -> bool;
}

impl Progress for () {
    fn stage(&self, _: &str) {}
    fn stopped(&self) -> bool {
        false
    }
}

/// Link errors that are refined, as part of the error asked for: many links end at an element, and their errors add up.
const SHARE: f64 = 0.01;
/// How many times larger they may be where a local pass follows: there links are only where it starts.
const COARSE: f64 = 4.0;
/// Each step's threshold is this much below the last one's, starting so many steps above the final one.
const STEP: f64 = 4.0;
const STEPS: i32 = 4;
/// Part of a step that is for refinement at least, and how much longer sweeps may take than last time.
const LEAST_ROOM: f64 = 0.05;
const SWEEP_MARGIN: f64 = 1.2;
/// Change of the radiosity at which sweeps end: between steps and at the end.
const ROUGH: f64 = 3e-3;
const FINE: f64 = 1e-6;

/// Solves a scene for elements and points (file coordinates).
///
/// # Errors
/// Options are out of range, or Embree refuses.
pub fn run(scene: &Scene, points: &[Point], options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    run_then(scene, points, options, progress, |outcome, _| Ok(outcome))
}

/// Irradiance at more points (file coordinates), W/m², by the solution that was found.
pub type More<'a> = &'a dyn Fn(&[Point]) -> Vec<Rgb>;

/// Like [`run()`], and hands the outcome to `then` while light at more points can still be asked for, without solving
/// again: pixels of pictures are known only when there is something to see.
///
/// # Errors
/// Those of [`run()`] and of `then`.
pub fn run_then<T>(
    scene: &Scene,
    points: &[Point],
    options: &Options,
    progress: &dyn Progress,
    then: impl FnOnce(Outcome, More) -> Result<T>,
) -> Result<T> {
    options.check()?;
    let mut seconds = Seconds::default();
    let begun = Instant::now();
    progress.stage("preparing");
    let prepared = Prepared::of(scene, options, &mut seconds, progress)?;
    let (exact, ends) = (prepared.exact(), reference::end_rule(scene));
    let (elements, found) = timed(&mut seconds.elements, || {
        let area: f64 = areas(scene);
        // Ids for all that the local pass splits.
        let build = |entered: &[u32]| {
            let mut elements =
                Elements::build(scene, &prepared.hierarchy, options.local_area() * area, entered);
            elements.min_area = options.min_area * area;
            let length = 1.01 * scene.bounds.diagonal();
            let found = probe::probe(&elements, exact.scene, exact.traversal, ends, length, options.seed);
            (elements, found)
        };
        let (elements, found) = build(&[]);
        if found.entered.is_empty() { (elements, found) } else { build(&found.entered) }
    });
    let engine = timed(&mut seconds.characterise, || prepared.engine(scene, &elements, ends, options));
    let sight = engine.as_ref().map_or(Sight::Exact(exact), Sight::MultiResolution);
    let mut solver = Solver::new(elements, found, sight, ends, options);
    solver.name(scene, options, (exact.scene, exact.traversal))?;
    let start = Instant::now();
    let late =
        || progress.stopped() || options.max_seconds.is_some_and(|s| begun.elapsed().as_secs_f64() > s);
    // Points need no elements for what emitters send them directly.
    let idle = options.direct_only && !points.is_empty();
    let iterations = if idle { Vec::new() } else { solve(&mut solver, options, progress, &late) };
    progress.stage("last sweeps");
    let local = solver.local_pass(options);
    let mut row_sums = None;
    let mut bytes = 0;
    if !local || progress.stopped() {
        solver.look_again(least(&solver, options));
        let sampled = solver.close();
        let cut = solver.cut();
        solver.settle(&cut, FINE, 400);
        bytes = cut.bytes();
        row_sums = Some((sampled, solver.row_sums(&cut)));
        solver.look();
    }
    seconds.solve = start.elapsed().as_secs_f64();
    if row_sums.is_none() {
        progress.stage("local pass");
        let local = timed(&mut seconds.local, || {
            solver.split_all(options.local_area() * areas(scene));
            Receiver::new(scene, &solver, (exact.scene, exact.traversal), options)
                .local(options.local_rays() as f64)
        });
        solver.adopt(local);
    }

    progress.stage("points");
    let asked = |points: &[Point]| -> Vec<(Vec3, Vec3)> {
        points.iter().map(|p| ((p.position - scene.origin).as_vec3(), p.normal.as_vec3())).collect()
    };
    let receiver = Receiver::new(scene, &solver, (exact.scene, exact.traversal), options);
    let (irradiance, tally) = timed(&mut seconds.points, || receiver.irradiance(&asked(points)));
    let mut bundles = solver.tally();
    bundles.add(tally);
    let uncertainty = solver.uncertainty();
    let audited = if options.direct_only || progress.stopped() { 0 } else { options.audit };
    progress.stage("audit");
    let (audit, tally) = timed(&mut seconds.audit, || receiver.audit(&uncertainty, audited));
    bundles.add(tally);
    let mut warnings = scene.repairs.messages.clone();
    warnings.extend(prepared.note.clone());
    if scene.emitters.is_empty() {
        warnings
            .push("nothing emits light: everything is black (--emitter NAME=W makes something emit)".into());
    }
    let record = Record {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        embree: prepared.device.version(),
        threads: rayon::current_num_threads(),
        unit: scene.unit.clone(),
        options: options.clone(),
        scene: SceneFacts::of(scene, &prepared.hierarchy),
        warnings,
        iterations,
        seconds,
        cache: prepared.origin.into(),
        links: solver.links.len(),
        elements: solver.elements.len(),
        bytes: solver.elements.bytes() + size_of_val(solver.links.as_slice()) + bytes,
        exact_rays: bundles.exact_rays,
        bundles,
        ledger: solver.ledger(row_sums.as_ref().map(|(before, after)| [&before[..], &after[..]])),
        error_estimate: solver.error_estimate(&uncertainty),
        audit: (audit.elements > 0).then_some(audit),
        mean_irradiance: solver.mean_irradiance(),
        interrupted: progress.stopped(),
        versus: None,
    };
    let outcome = Outcome { solution: solver.solution(scene, &uncertainty), record, irradiance };
    then(outcome, &|points| receiver.irradiance(&asked(points)).0)
}

/// Refines in steps until the error asked for is reached or time is up.
fn solve(
    solver: &mut Solver,
    options: &Options,
    progress: &dyn Progress,
    late: &dyn Fn() -> bool,
) -> Vec<Iteration> {
    let mut iterations = Vec::new();
    if solver.scale <= 0.0 {
        return iterations;
    }
    let least = least(solver, options);
    // Links a step and what sweeps and looks take, learnt from step to step.
    let (mut work, mut sweeping) = (64.0, 0.0);
    let mut next = f64::from(least) * STEP.powi(STEPS);
    loop {
        let start = Instant::now();
        let errors = solver.errors();
        let once = options.step_seconds.is_some();
        let threshold = match once {
            true => solver.threshold(&errors, work as usize, least),
            false => (next as f32).max(least),
        };
        let room =
            options.step_seconds.map_or(f64::INFINITY, |step| (step - sweeping).max(LEAST_ROOM * step));
        let over = || late() || start.elapsed().as_secs_f64() > room;
        let refined = solver.refine(&errors, threshold, once, &over);
        let refining = start.elapsed().as_secs_f64();
        let cut = solver.cut();
        let residual = solver.settle(&cut, ROUGH, if once { 1 } else { 12 });
        solver.spread_importance(&cut);
        solver.look();
        let taken = start.elapsed().as_secs_f64();
        if options.step_seconds.is_some() {
            // A margin for the next step, which has more links; a step that was held up by others counts half.
            let now = SWEEP_MARGIN * (taken - refining);
            sweeping = if sweeping > 0.0 { 0.5 * (sweeping + now) } else { now };
            let factor = room * refined.max(1) as f64 / (refining.max(1e-6) * work);
            work = (work * factor.clamp(0.25, 2.0)).max(1.0);
        }
        iterations.push(Iteration {
            seconds: taken,
            links: solver.links.len(),
            elements: solver.elements.len(),
            refined,
            error_bound: threshold.into(),
            residual,
        });
        progress.stage(&format!("{} links, error {:.2e}", solver.links.len(), threshold));
        next /= STEP;
        let done = match once {
            true => refined == 0,
            false => f64::from(threshold) <= f64::from(least),
        };
        let reached = options.target_error.is_some_and(|t| solver.error_estimate(&solver.uncertainty()) <= t);
        if done || reached || late() || solver.links.len() >= solver.max_links {
            return iterations;
        }
    }
}

/// The error that links are refined to, relative to the mean irradiance.
fn least(solver: &Solver, options: &Options) -> f32 {
    let coarse = if solver.local_pass(options) { COARSE } else { 1.0 };
    (options.error * SHARE * coarse) as f32
}

impl Solver<'_> {
    /// Whether a local pass is to follow refinement: in scenes with clusters.
    fn local_pass(&self, options: &Options) -> bool {
        self.elements.large_from > 0 && options.local_rays() > 0 && !options.direct_only && self.scale > 0.0
    }

    fn mean_irradiance(&self) -> Rgb {
        let mut sum = [0.0; 3];
        for (e, element) in self.elements.elements.iter().enumerate() {
            if element.is_leaf() && !element.is_cluster() {
                super::field::add(&mut sum, element.area / self.elements.area, self.incident[e]);
            }
        }
        sum
    }
}

fn areas(scene: &Scene) -> f64 {
    (0..scene.triangles.len() as u32)
        .map(|t| {
            let [a, b, c] = scene.corners(t);
            crate::math::triangle_area(a, b, c)
        })
        .sum()
}

/// The result and, added up, the seconds it took.
pub(super) fn timed<R>(seconds: &mut f64, make: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = make();
    *seconds += start.elapsed().as_secs_f64();
    result
}
