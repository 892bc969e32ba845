//! Refinement in steps, until the error asked for is reached, or time or memory end.

use super::clock::Clock;
use super::record::{Ended, Iteration, Settled};
use super::refine::Refined;
use super::{Options, Solver};
use crate::progress::Progress;
use std::time::Instant;

/// Link errors that are refined, as part of the error asked for: many links end at an element, and their errors add up.
const SHARE: f64 = 0.01;
/// How many times larger they may be where a local pass follows: there links are only where it starts.
const COARSE: f64 = 4.0;
/// Each step's threshold is this much below the last one's, starting so many steps above the final one and not below this
/// error: what is refined by halves when the time is up is then the last of many steps.
const STEP: f64 = 4.0;
const STEPS: i32 = 4;
const FIRST: f64 = 0.05;
/// Part of a step that is for refinement at least, and how much longer sweeps may take than last time.
const LEAST_ROOM: f64 = 0.05;
const SWEEP_MARGIN: f64 = 1.2;
/// Change of the radiosity at which sweeps between steps end.
const ROUGH: f64 = 3e-3;
/// Sweeps that rows and the last light are expected to take when the time is nearly up.
const CLOSING: f64 = 16.0;

/// Refines in steps until the error asked for is reached or time is up. Says how the light settled after each.
pub(super) fn solve(
    solver: &mut Solver,
    options: &Options,
    progress: &dyn Progress,
    clock: &Clock,
) -> (Vec<(Iteration, Settled)>, Ended) {
    let mut iterations = Vec::new();
    if solver.scale <= 0.0 {
        return (iterations, Ended::Nothing);
    }
    let least = least(solver, options);
    // Links a step and what sweeps and looks take, learnt from step to step.
    let (mut work, mut sweeping) = (64.0, 0.0);
    let steps = (FIRST / f64::from(least)).log(STEP).ceil().max(f64::from(STEPS));
    let mut next = f64::from(least) * STEP.powf(steps);
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
        let late = |closing: f64, size: usize| clock.left() <= closing * size as f64;
        let closing = solver.closing;
        let over = |size: usize| late(closing, size) || start.elapsed().as_secs_f64() > room;
        let Refined { replaced, full } = solver.refine(&errors, threshold, once, &over);
        let refining = start.elapsed().as_secs_f64();
        let mut cut = solver.cut();
        solver.tame(&mut cut);
        let settled = solver.settle(&cut, ROUGH, if once { 1 } else { 12 }, clock);
        solver.spread_importance(&cut);
        solver.look();
        let taken = start.elapsed().as_secs_f64();
        let (links, elements) = (solver.links.len(), solver.elements.len());
        let size = links + elements;
        solver.closing = CLOSING * (taken - refining) / (settled.sweeps.max(1) * size) as f64;
        if once {
            // A margin for the next step, which has more links; a step that was held up by others counts half.
            let now = SWEEP_MARGIN * (taken - refining);
            sweeping = if sweeping > 0.0 { 0.5 * (sweeping + now) } else { now };
            let factor = room * replaced.max(1) as f64 / (refining.max(1e-6) * work);
            work = (work * factor.clamp(0.25, 2.0)).max(1.0);
        }
        let iteration = Iteration {
            seconds: taken,
            links,
            elements,
            refined: replaced,
            error_bound: threshold.into(),
            residual: settled.residual,
        };
        iterations.push((iteration, settled));
        progress.stage(&format!("{links} links, error {threshold:.2e}"), 0);
        next /= STEP;
        let is_done = match once {
            true => replaced == 0,
            false => f64::from(threshold) <= f64::from(least),
        };
        let reached =
            || options.target_error.is_some_and(|t| solver.error_estimate(&solver.uncertainty()) <= t);
        let ended = if clock.interrupted() {
            Ended::Interrupted
        } else if late(solver.closing, size) {
            Ended::Time
        } else if full {
            Ended::Links
        } else if is_done {
            Ended::Error
        } else if reached() {
            Ended::Target
        } else {
            continue;
        };
        return (iterations, ended);
    }
}

/// The error that links are refined to, relative to the mean irradiance.
pub(super) fn least(solver: &Solver, options: &Options) -> f32 {
    let coarse = if solver.local_pass(options) { COARSE } else { 1.0 };
    (options.error * SHARE * coarse) as f32
}
