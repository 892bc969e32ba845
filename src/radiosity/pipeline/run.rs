//! The stages of a solution, in their order.

use super::engine::engine_for;
use super::notes::{self, Notes};
use super::point_query::{Solution, relative};
use super::record::{Outcome, Record, Seconds, timed};
use crate::clusters::Hierarchy;
use crate::model::summary::SceneSummary;
use crate::model::{Detail, Model};
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::audit::{
    AuditSize, ErrorBarAudit, ErrorEstimate, FinalLight, PointsError, Solved, error_estimate,
    link_uncertainty,
};
use crate::radiosity::deadline::{Deadline, DeadlinePlan};
use crate::radiosity::elements::{Elements, lit_inside};
use crate::radiosity::final_gather::FinalGather;
use crate::radiosity::links::Tally;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::options::Options;
use crate::radiosity::refinement::{
    Iteration, LinkedScene, Refined, StopReason, Unrefined, apply_importance,
};
use crate::radiosity::rgb::Rgb;
use crate::radiosity::surroundings::{Surroundings, Unlit, probe, unlit_sides};
use crate::radiosity::transport::Convergence;
use crate::ranks::Ranks;
use crate::scene::Scene;
use crate::visibility::Engine;
use crate::visibility::Exact;
use crate::{Error, Result};
use std::time::Instant;

/// Smallest and largest diagonal of a scene, scene units: within them f32 represents areas and the squares of large areas.
const MIN_DIAGONAL: f64 = 1e-9;
const MAX_DIAGONAL: f64 = 5e9;

/// Solves a model for elements and points (file coordinates).
///
/// # Errors
/// Options are out of range, or Embree refuses.
pub fn run(model: &Model, points: &[Point], options: &Options, progress: &dyn Progress) -> Result<Outcome> {
    solve(model, points, options, progress).map(|(outcome, _)| outcome)
}

/// Like [`run()`], with a [`Solution`] that answers irradiance at more points afterwards.
pub fn solve(
    model: &Model,
    points: &[Point],
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Outcome, Solution)> {
    options.check_ranges()?;
    model.check_single("the radiosity solver")?;
    if options.engine != Engine::Exact {
        model.check_clusters("averaged visibility")?;
    }
    let scene = model.scene();
    check_size(scene)?;
    let deadline = Deadline::start(progress, options.max_seconds).after(options.seconds_spent);
    let mut stages = Stages {
        model,
        scene,
        options,
        progress,
        deadline,
        seconds: preparation(model, options),
        notes: Notes::default(),
    };
    let (coarse, unlit) = stages.coarse()?;
    let asked = !points.is_empty() || options.more_points;
    // Direct light at points needs no light of elements.
    let idle = options.direct_only && !options.elements;
    let local = !idle && coarse.needs_local_pass(options);
    let plan = DeadlinePlan::new(deadline, asked, local);
    let start = Instant::now();
    let coarse_light = [coarse.0.mean_irradiance; 3];
    let refined = match idle {
        true => coarse.unrefined(options),
        false => {
            let estimate = |linked: &LinkedScene| error_estimate(linked, &link_uncertainty(linked));
            coarse.refine(options, &estimate, progress, &plan.refinement)
        }
    };
    let (solved, steps) = stages.final_light(refined, points, idle, local, &plan, start);
    let gather = FinalGather::new(model, &solved.linked, options);
    let (irradiance, points_tally) = stages.points(&gather, points, &plan);
    let (uncertainty, audit, audit_tally) = stages.audit(&gather, &solved, &plan);
    let points_error = stages.points_error(points, &irradiance, &plan);
    let arrives = stages.notes_of_light(&solved, &irradiance, &coarse_light);
    if !solved.is_finite() || irradiance.iter().flatten().any(|v| !v.is_finite()) {
        return Err(Error::Scene(notes::NOT_FINITE.into()));
    }
    let mut tally = solved.linked.tally;
    tally.add(points_tally);
    tally.add(audit_tally);
    let parts = RecordParts { unlit, steps, tally, audit, uncertainty: &uncertainty, points_error, arrives };
    let record = stages.record(&solved, parts);
    let mesh = if options.elements { solved.mesh(scene, &uncertainty) } else { RadiosityMesh::default() };
    let outcome = Outcome { mesh, record, irradiance };
    Ok((
        outcome,
        Solution {
            // Only one rank computes points of the solution.
            model: model.clone().on_ranks(Ranks::default()),
            solved,
            options: options.clone(),
            deadline: deadline.for_caller(&()),
        },
    ))
}

/// Seconds that the preparation of the model took, by stage.
fn preparation(model: &Model, options: &Options) -> Seconds {
    let report = model.report();
    let mut seconds = Seconds { embree: report.embree_s, hierarchy: report.clusters_s, ..Seconds::default() };
    match (options.engine, model.detail()) {
        (Engine::Exact, Detail::Optics) => {}
        (Engine::Exact, _) => seconds.hierarchy += report.cache_s,
        _ => seconds.characterise = report.optics_s + report.cache_s,
    }
    seconds
}

/// Rejects scenes whose areas f32 cannot represent.
fn check_size(scene: &Scene) -> Result<()> {
    let diagonal = f64::from(scene.bounds.diagonal());
    if (MIN_DIAGONAL..=MAX_DIAGONAL).contains(&diagonal) {
        return Ok(());
    }
    let unit = &scene.unit;
    Err(Error::Scene(format!(
        "the scene measures {diagonal:.1e} {unit} across: give it in another unit of length, in which that lies in \
         {MIN_DIAGONAL:e}..{MAX_DIAGONAL:e}"
    )))
}

/// The steps of refinement and the last sweeps along links.
struct RefinementSteps {
    iterations: Vec<Iteration>,
    ended: StopReason,
    convergence: Convergence,
}

/// Data of the record besides the solution.
struct RecordParts<'a> {
    unlit: Unlit,
    steps: RefinementSteps,
    tally: Tally,
    audit: ErrorBarAudit,
    uncertainty: &'a [f64],
    points_error: Option<PointsError>,
    /// Whether the light of every emitter reaches a surface, and some light the points.
    arrives: bool,
}

/// The stages of one solution, with their seconds and notes.
pub(super) struct Stages<'a> {
    pub(super) model: &'a Model,
    pub(super) scene: &'a Scene,
    pub(super) options: &'a Options,
    pub(super) progress: &'a dyn Progress,
    pub(super) deadline: Deadline<'a>,
    pub(super) seconds: Seconds,
    pub(super) notes: Notes,
}

impl Stages<'_> {
    /// Elements with the link of the root, importance and feature sizes.
    fn coarse(&mut self) -> Result<(Unrefined, Unlit)> {
        let (scene, options) = (self.scene, self.options);
        let exact = &self.model.exact();
        self.notes.extend(scene.repairs.messages.clone());
        self.notes.extend(self.model.report().note.clone());
        let hierarchy = self.model.base().hierarchy();
        let (elements, surroundings, unlit) = timed(&mut self.seconds.elements, || {
            lit_elements(scene, hierarchy, exact, options, &self.deadline)
        });
        let model = self.model;
        let engine = timed(&mut self.seconds.characterise, || engine_for(model, &elements, options));
        let mut linked = LinkedScene::new(elements, surroundings, engine, options);
        linked.ranks = model.ranks().clone();
        if let Some(environment) = &scene.environment {
            linked.add_environment(environment);
        }
        apply_importance(&mut linked, scene, options, exact)?;
        self.notes.extend(notes::unlit(&unlit));
        self.notes.extend(notes::late_preparation(options, &self.deadline));
        Ok((Unrefined(linked), unlit))
    }

    /// The final light: none, by a local pass or along links. `start` is when refinement began.
    fn final_light(
        &mut self,
        mut refined: Refined,
        points: &[Point],
        idle: bool,
        local: bool,
        plan: &DeadlinePlan,
        start: Instant,
    ) -> (Solved, RefinementSteps) {
        self.progress.stage("last sweeps", 0);
        let mut steps = RefinementSteps {
            iterations: refined.iterations.clone(),
            ended: refined.ended,
            convergence: refined.convergence,
        };
        if idle {
            return (Solved { linked: refined.linked, closing: FinalLight::Nothing }, steps);
        }
        if local {
            self.seconds.solve = start.elapsed().as_secs_f64();
            // The given points set the importance only if elements and further points are not asked for, and the caller has named nothing
            // important.
            let linked = &mut refined.linked;
            let alike = self.options.elements || self.options.more_points;
            if !alike && linked.feature_sizes.important.is_empty() && !self.deadline.late() {
                linked.look_from(&relative(self.scene, points), &self.model.exact());
            }
            self.progress.stage("local pass", 0);
            return (self.light_by_rays(refined, &plan.light), steps);
        }
        let solved = Solved::by_links(refined, &plan.light);
        if let FinalLight::Links(closing) = &solved.closing {
            self.notes.extend(notes::bounded(closing.bounded));
            self.notes.extend(notes::unconverged(&closing.convergence, &plan.light));
            steps.convergence = closing.convergence;
            if self.options.direct_only {
                self.notes.extend([notes::DIRECT_AT_POINTS.to_owned()]);
            }
            if solved.linked.elements.has_profiles() {
                self.notes.extend([notes::DIFFUSE_LUMINAIRES.to_owned()]);
            }
            self.notes.extend(notes::coarse_links(self.options));
            let crossed = solved.linked.count_crossed(&self.model.exact());
            self.notes.extend(notes::walls_across_elements(crossed));
        }
        self.seconds.solve = start.elapsed().as_secs_f64();
        (solved, steps)
    }

    /// Irradiance at points, W/m².
    fn points(&mut self, gather: &FinalGather, points: &[Point], plan: &DeadlinePlan) -> (Vec<Rgb>, Tally) {
        self.progress.stage("points", points.len() as u64);
        let done = |n| self.progress.advance(n as u64);
        let (scene, options) = (self.scene, self.options);
        if points.is_empty() {
            return (Vec::new(), Tally::default());
        }
        let points = relative(scene, points);
        let found = timed(&mut self.seconds.points, || {
            match gather.options_within_time(&points, options, &plan.closing) {
                Some(fewer) => {
                    FinalGather::new(self.model, gather.linked(), &fewer).irradiance(&points, &done)
                }
                None => gather.irradiance(&points, &done),
            }
        });
        let on_surfaces = points.len().saturating_sub(options.points_in_space);
        self.notes.extend(self.model.notes_of_points(&points[..on_surfaces]));
        found
    }

    /// The uncertainty of all elements, corrected by one set of independent paths and audited by another.
    fn audit(
        &mut self,
        gather: &FinalGather,
        solved: &Solved,
        plan: &DeadlinePlan,
    ) -> (Vec<f64>, ErrorBarAudit, Tally) {
        let mut uncertainty = solved.uncertainty();
        let size = AuditSize::of(self.options);
        self.progress.stage("audit", 2 * size.elements as u64);
        timed(&mut self.seconds.audit, || {
            let (factor, mut tally) = gather.bar_factor(&uncertainty, size, &plan.closing);
            uncertainty.iter_mut().for_each(|u| *u *= factor);
            let (audit, cost) = gather.audit(&uncertainty, size, &plan.closing);
            tally.add(cost);
            (uncertainty, ErrorBarAudit { factor, ..audit }, tally)
        })
    }

    /// Adds notes about light that reaches no surface or no point; returns whether there are none.
    fn notes_of_light(&mut self, solved: &Solved, irradiance: &[Rgb], coarse_light: &Rgb) -> bool {
        let (model, scene, dark) = (self.model, self.scene, solved.linked.dark());
        let lost = if scene.emitters.is_empty() && scene.environment.is_none() {
            vec![notes::NO_EMITTERS.into()]
        } else if irradiance
            .iter()
            .chain([coarse_light, &solved.mean_irradiance()])
            .flatten()
            .all(|&e| e <= dark || e.is_nan())
        {
            self.notes.extend(model.notes_of_coarseness());
            vec![format!("no light arrives anywhere: {}", model.cause_of_darkness())]
        } else {
            self.notes.extend(model.notes_of_coarseness());
            let dark = notes::dark_points(irradiance, dark);
            let lost: Vec<String> = model.notes_of_lost_light().into_iter().chain(dark).collect();
            let all_lost = || notes::all_lost(&solved.ledger(&scene.unit), &model.cause_of_darkness());
            if lost.is_empty() && scene.environment.is_none() {
                all_lost().into_iter().collect()
            } else {
                lost
            }
        };
        let arrives = lost.is_empty();
        self.notes.extend(lost);
        self.notes.extend(notes::lost_with_target(self.options).filter(|_| !arrives));
        arrives
    }

    /// The error of the irradiance at points.
    fn points_error(
        &mut self,
        points: &[Point],
        irradiance: &[Rgb],
        plan: &DeadlinePlan,
    ) -> Option<PointsError> {
        let (model, options) = (self.model, self.options);
        timed(&mut self.seconds.audit, || PointsError::of(model, points, irradiance, options, &plan.closing))
    }

    fn record(mut self, solved: &Solved, parts: RecordParts) -> Record {
        let RecordParts { unlit, steps, tally, audit, uncertainty, points_error, arrives } = parts;
        let (scene, options, linked) = (self.scene, self.options, &solved.linked);
        let estimate = match options.elements {
            true => ErrorEstimate::of(&audit, error_estimate(linked, uncertainty)),
            false => points_error.map(ErrorEstimate::of_points),
        };
        let error_estimate = estimate.map(|e| e.rms);
        self.notes.extend(notes::ended(steps.ended, options, error_estimate));
        self.notes.extend(notes::missed(options, steps.ended, error_estimate));
        let ledger = solved.ledger(&scene.unit);
        let imbalance = notes::imbalance(&ledger, error_estimate, steps.ended, options);
        let balanced = imbalance.is_none();
        self.notes.extend(imbalance);
        let (bytes, local_convergence) = match &solved.closing {
            FinalLight::Links(links) => (links.bytes, None),
            FinalLight::Rays(local) => (0, Some(local.convergence)),
            FinalLight::Nothing => (0, None),
        };
        Record {
            mrvis: env!("CARGO_PKG_VERSION").into(),
            embree: self.model.embree_version(),
            threads: rayon::current_num_threads(),
            unit: scene.unit.clone(),
            options: options.clone(),
            scene: SceneSummary::of(self.model),
            warnings: self.notes.into_words(),
            iterations: steps.iterations,
            ended: steps.ended,
            convergence: steps.convergence,
            local_convergence,
            target_met: options
                .target_error
                .map(|t| arrives && balanced && error_estimate.is_some_and(|e| e <= t)),
            seconds: self.seconds,
            cache: self.model.report().origin.name().into(),
            links: linked.link_count(),
            elements: linked.elements.len(),
            unlit,
            bytes: linked.elements.bytes()
                + size_of_val(linked.links.as_slice())
                + size_of_val(linked.sky_links.as_slice())
                + bytes,
            exact_rays: tally.exact_rays,
            bundles: tally,
            ledger,
            error_estimate,
            error_estimate_upper: estimate.and_then(|e| e.upper),
            error_estimate_source: estimate.map(|e| e.source),
            points_error,
            audit: (audit.elements > 0).then_some(audit),
            mean_irradiance: solved.mean_irradiance(),
            interrupted: self.progress.stopped(),
        }
    }
}

/// The elements of all sides that light reaches, and their surroundings.
fn lit_elements(
    scene: &Scene,
    hierarchy: &Hierarchy,
    exact: &Exact,
    options: &Options,
    deadline: &Deadline,
) -> (Elements, Surroundings, Unlit) {
    let area = total_area(scene);
    let length = scene.ray_length();
    let around = |elements: &Elements| probe(elements, exact, length, options.seed, deadline);
    // Ranges of ids have room for all elements of the local pass.
    let elements = |open: &[u32]| {
        let mut elements = Elements::build(scene, hierarchy, options.local_area() * area, open);
        elements.min_area = options.min_area * area;
        elements
    };
    // Direct light at points needs to know where surfaces see the sky, and no more.
    if options.direct_only && !options.elements {
        let elements = elements(&[]);
        let found = match scene.environment {
            Some(_) => around(&elements),
            None => Surroundings::unknown(&elements, length),
        };
        let of = elements.sides.len();
        return (elements, found, Unlit { of, ..Unlit::default() });
    }
    let build = |open: &[u32]| {
        let elements = elements(open);
        let found = around(&elements);
        (elements, found)
    };
    let (elements, found) = build(&[]);
    let open = lit_inside(scene, &found.entered);
    let (elements, found) = if open.is_empty() { (elements, found) } else { build(&open) };
    let dark = unlit_sides(scene, &elements, exact, options.seed);
    let (sides, before) = (elements.sides.len(), elements.area);
    if dark.is_empty() {
        return (elements, found, Unlit { of: sides, ..Unlit::default() });
    }
    let elements = elements.without(&dark, scene, hierarchy);
    let found = around(&elements);
    let unlit = Unlit { sides: dark.len(), of: sides, area: 1.0 - elements.area / before };
    (elements, found, unlit)
}

/// Area of all triangles, one side of each, scene units squared.
pub fn total_area(scene: &Scene) -> f64 {
    (0..scene.triangles.len() as u32).map(|t| scene.face_area(t)).sum()
}
