//! From a scene to a solution: preparation, steps of refinement, and what is written down about them.

use super::clock::Clock;
use super::engine::engine_for;
use super::field::Rgb;
use super::local::LATE;
use super::more::{More, relative};
use super::notes::{hurried, unsettled};
use super::record::{Ended, Outcome, Record, Seconds, Settled, Unlit};
use super::steps::{least, solve};
use super::{Audit, Options, Receiver, Solver, Visibility, probe, reach};
use crate::model::summary::SceneSummary;
use crate::model::{Detail, Model};
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::elements::{Elements, lit_inside};
use crate::radiosity::links::Sight;
use crate::scene::Scene;
use crate::visibility::Exact;
use crate::{Error, Result};
use std::sync::Arc;
use std::time::Instant;

/// Change of the radiosity at which the last sweeps end, and how many there are at most.
const FINE: f64 = 1e-6;
const MOST_SWEEPS: usize = 400;
/// Parts of the time: for the light where nothing and where points come after it, and of that for refining links where a
/// local pass and where another look at all of them follows.
const LIGHT: f64 = 0.9;
const LIGHT_AND_POINTS: f64 = 0.75;
const LINKS: f64 = 0.4;
const LINKS_ALONE: f64 = 0.6;

/// Diagonals of scenes whose areas, and the squares of large ones, 32 bits hold.
const SMALLEST: f64 = 1e-9;
const LARGEST: f64 = 5e9;

const NOT_FINITE: &str = "the light in this scene is beyond all numbers: give it in other units of length or power, so that \
     neither are far from 1";

/// Solves a scene for elements and points (file coordinates).
///
/// # Errors
/// Options are out of range, or Embree refuses.
pub fn run(model: &Model, points: &[Point], options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    run_then(model, points, options, progress, |outcome, _| Ok(outcome))
}

/// Like [`run()`], and hands the outcome to `then` while light at more points can still be asked for, without solving
/// again: pixels of pictures are known only when there is something to see.
///
/// # Errors
/// Those of [`run()`] and of `then`.
pub fn run_then<T>(
    model: &Model,
    points: &[Point],
    options: &Options,
    progress: &dyn Progress,
    then: impl FnOnce(Outcome, &More) -> Result<T>,
) -> Result<T> {
    options.check()?;
    let scene = model.scene();
    let diagonal = f64::from(scene.bounds.diagonal());
    if !(SMALLEST..=LARGEST).contains(&diagonal) {
        let unit = &scene.unit;
        return Err(Error::Scene(format!(
            "the scene measures {diagonal:.1e} {unit} across: give it in another unit of length, in which that lies in \
             {SMALLEST:e}..{LARGEST:e}"
        )));
    }
    let report = model.report();
    let mut seconds = Seconds { embree: report.embree_s, hierarchy: report.clusters_s, ..Seconds::default() };
    match (options.visibility, model.detail()) {
        (Visibility::Exact, Detail::Optics) => {}
        (Visibility::Exact, _) => seconds.hierarchy += report.cache_s,
        _ => seconds.characterise = report.optics_s + report.cache_s,
    }
    // The time that the preparation of the model took counts.
    let clock = Clock::start_after(report.seconds(), progress, options.max_seconds);
    let hierarchy = model.base().hierarchy();
    let exact = Exact { scene: model.traced().clone(), traversal: model.widest_packets() };
    let ends = model.end_rule();
    let area = areas(scene);
    let finest = options.local_area();
    let (elements, found, unlit) = timed(&mut seconds.elements, || {
        let length = 1.01 * scene.bounds.diagonal();
        let look = |elements: &Elements| {
            probe::probe(elements, &exact.scene, exact.traversal, ends, length, options.seed)
        };
        // Ids for all that the local pass splits.
        let build = |open: &[u32]| {
            let mut elements = Elements::build(scene, hierarchy, finest * area, open);
            elements.min_area = options.min_area * area;
            let found = look(&elements);
            (elements, found)
        };
        let (elements, found) = build(&[]);
        let open = lit_inside(scene, &found.entered);
        let (elements, found) = if open.is_empty() { (elements, found) } else { build(&open) };
        let dark = reach::unlit(scene, &elements, &exact, ends, options.seed);
        let (sides, before) = (elements.sides.len(), elements.area);
        if dark.is_empty() {
            return (elements, found, Unlit { of: sides, ..Unlit::default() });
        }
        let elements = elements.without(&dark, scene, hierarchy);
        let found = look(&elements);
        let unlit = Unlit { sides: dark.len(), of: sides, area: 1.0 - elements.area / before };
        (elements, found, unlit)
    });
    let engine = timed(&mut seconds.characterise, || engine_for(model, &elements, options));
    let sight = engine
        .as_ref()
        .map_or(Sight::Exact(exact.clone()), |engine| Sight::MultiResolution(Arc::new(engine.clone())));
    let mut solver = Solver::new(elements, found, sight, ends, options);
    solver.name(scene, options, (&exact.scene, exact.traversal))?;
    let mut warnings = scene.repairs.messages.clone();
    warnings.extend(report.note.clone());
    warnings.extend(unlit.note());
    if let Some(limit) = options.max_seconds.filter(|_| clock.late() && !clock.interrupted()) {
        let taken = clock.elapsed();
        warnings.push(format!(
            "--max-seconds {limit}: preparing the scene took {taken:.1} s; this is the coarsest light there is"
        ));
    }
    let asked = !points.is_empty() || options.more_points;
    let light = clock.part(if asked { LIGHT_AND_POINTS } else { LIGHT });
    let start = Instant::now();
    // Points need no elements for what emitters send them directly.
    let idle = options.direct_only && !points.is_empty();
    let local = !idle && solver.local_pass(options);
    let refining = light.part(if local { LINKS } else { LINKS_ALONE });
    let (iterations, ended) = match idle {
        true => (Vec::new(), Ended::Nothing),
        false => solve(&mut solver, options, progress, &refining),
    };
    progress.stage("last sweeps", 0);
    let mut closed = None;
    let mut settled = iterations.last().map_or_else(Settled::default, |(_, settled)| *settled);
    let mut bytes = 0;
    if !local {
        solver.look_again(least(&solver, options), &light);
        let (sampled, bounded) = solver.close(&light);
        let cut = solver.cut();
        settled = solver.settle(&cut, FINE, MOST_SWEEPS, &light);
        bytes = cut.bytes();
        closed = Some((sampled, solver.row_sums(&cut)));
        solver.look();
        warnings.extend(unsettled(&settled, bounded, &light));
    }
    seconds.solve = start.elapsed().as_secs_f64();
    let mut settled_local = None;
    if local {
        progress.stage("local pass", 0);
        let (found, note) = timed(&mut seconds.local, || {
            let traced = (&exact.scene, exact.traversal);
            let all = options.local_rays() as f64;
            let rays = match light.limited() {
                true => Receiver::new(scene, &solver, traced, options).affordable(all, &light),
                false => Some(all).filter(|_| !light.late()),
            };
            let smallest = match rays {
                Some(rays) if rays >= all => finest,
                fewer => Options::area_for(fewer.unwrap_or(LATE)).max(finest),
            };
            solver.split_all(smallest * area, &light);
            (Receiver::new(scene, &solver, traced, options).local(rays, &light), hurried(rays, all, &light))
        });
        warnings.extend(note);
        settled_local = Some(found.settled);
        warnings.extend(unsettled(&found.settled, 0, &light));
        solver.adopt(found);
    }

    progress.stage("points", 0);
    let relative = relative(scene, points);
    let receiver = Receiver::new(scene, &solver, (&exact.scene, exact.traversal), options);
    let hurried = timed(&mut seconds.points, || receiver.hurried(&relative, options, &clock.with_grace()));
    let receiver = match &hurried {
        Some(options) => Receiver::new(scene, &solver, (&exact.scene, exact.traversal), options),
        None => receiver,
    };
    let (irradiance, tally) = timed(&mut seconds.points, || receiver.irradiance(&relative));
    warnings.extend(receiver.far_off(&relative));
    let mut bundles = solver.tally();
    bundles.add(tally);
    let mut uncertainty = solver.uncertainty();
    let audited = if options.direct_only { 0 } else { options.audit };
    progress.stage("audit", 0);
    let late = || clock.with_grace().late();
    let (factor, tally) = timed(&mut seconds.audit, || receiver.factor(&uncertainty, audited, &late));
    bundles.add(tally);
    uncertainty.iter_mut().for_each(|u| *u *= factor);
    let (audit, tally) = timed(&mut seconds.audit, || receiver.audit(&uncertainty, audited, &late));
    let audit = Audit { factor, ..audit };
    bundles.add(tally);
    if scene.emitters.is_empty() {
        warnings
            .push("nothing emits light: everything is black (--emitter NAME=W makes something emit)".into());
    }
    if solver.incident.iter().chain(&solver.radiosity).chain(&irradiance).flatten().any(|v| !v.is_finite()) {
        return Err(Error::Scene(NOT_FINITE.into()));
    }
    let error_estimate = solver.error_estimate(&uncertainty);
    let target_met = options.target_error.map(|target| error_estimate <= target);
    warnings.extend(ended.note(options, iterations.last().map(|(i, _)| i), error_estimate));
    if let (Some(false), Some(target)) = (target_met, options.target_error) {
        warnings.push(format!(
            "--target-error {target} was missed: the estimated error is {error_estimate:.2e}; a smaller --error or \
             --min-area, more time or more links bring it down"
        ));
    }
    let record = Record {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        embree: model.embree_version(),
        threads: rayon::current_num_threads(),
        unit: scene.unit.clone(),
        options: options.clone(),
        scene: SceneSummary::of(model),
        warnings,
        iterations: iterations.into_iter().map(|(iteration, _)| iteration).collect(),
        ended,
        settled,
        settled_local,
        target_met,
        seconds,
        cache: report.origin.name().into(),
        links: solver.links.len(),
        elements: solver.elements.len(),
        unlit,
        bytes: solver.elements.bytes() + size_of_val(solver.links.as_slice()) + bytes,
        exact_rays: bundles.exact_rays,
        bundles,
        ledger: solver.ledger(&scene.unit, closed.as_ref().map(|(before, after)| [&before[..], &after[..]])),
        error_estimate,
        audit: (audit.elements > 0).then_some(audit),
        mean_irradiance: solver.mean_irradiance(),
        interrupted: progress.stopped(),
        versus: None,
    };
    let outcome = Outcome { solution: solver.solution(scene, &uncertainty), record, irradiance };
    then(outcome, &More { scene, solver: &solver, traced: (&exact.scene, exact.traversal), options, clock })
}

impl Solver {
    /// Whether a local pass is to follow refinement: in scenes with clusters.
    pub(super) fn local_pass(&self, options: &Options) -> bool {
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

/// Area of all triangles, one side of each.
pub(super) fn areas(scene: &Scene) -> f64 {
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
