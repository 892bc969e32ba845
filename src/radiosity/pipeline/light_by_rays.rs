//! The light of elements by rays, with more rays until the error is below the target.

use super::notes;
use super::record::timed;
use super::run::{Stages, total_area};
use crate::radiosity::audit::{AuditSize, FinalLight, Solved};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::final_gather::{FinalGather, LATE_RAYS, LocalPass};
use crate::radiosity::options::Options;
use crate::radiosity::refinement::{LinkedScene, Refined};

/// Largest number of local passes for [`Options::target_error`]: each has more rays than all before it together.
const MAX_ATTEMPTS: usize = 5;
/// Largest accepted error of an attempt, as a fraction of the target: the error of 200 elements is known to 1/√(2 · 200) = 5 %, and the
/// final audit draws other elements.
const ATTEMPT_MARGIN: f64 = 0.9;
/// Error that the next attempt is planned for, as a fraction of the target: it may come out larger by a fifth without exceeding
/// [`ATTEMPT_MARGIN`].
const TARGET_MARGIN: f64 = 0.75;
/// Smallest factor between the errors of two attempts: at most sixteen times the rays, as the first attempt's error is known only to
/// about a quarter.
const MIN_ERROR_STEP: f64 = 0.25;

/// Fraction of the rays of elements that are traced before any element is split. The error at points of an office is 10.3 % with 0.8 and
/// 10.5 % with 0.6 (`scenes/room.py`).
const SHARE_BEFORE_SPLIT: f64 = 0.8;
/// Largest number of elements that are added where direct light varies, as a fraction of all elements: the error of an office is as small
/// with 0.15 as with 1, which takes a tenth more time.
const MAX_ADDED: f64 = 0.15;
/// Area-weighted mean variance of direct light over elements, relative to the square of the error, up to which no element is split: the
/// other half of the square is for the noise of rays and for reflected light.
const MAX_VARIANCE_WITHIN: f64 = 0.5;

impl Stages<'_> {
    /// Repeats the local pass and the light of elements with more rays until independent paths find no larger error than the target.
    pub(super) fn light_by_rays(&mut self, mut refined: Refined, deadline: &Deadline) -> Solved {
        let mut options = self.options.clone();
        for attempt in 1.. {
            self.notes.start_attempt();
            let found = self.local_pass(&mut refined.linked, &options, deadline);
            let notes = notes::unconverged(&found.convergence, deadline);
            let solved = Solved::by_rays(refined.linked, found);
            if !options.elements {
                self.notes.extend(notes);
                return solved;
            }
            let solved = self.element_light(solved, &options, deadline);
            let smaller = self.smaller_error(&solved, &options, deadline);
            let Some(error) = smaller.filter(|_| attempt < MAX_ATTEMPTS) else {
                self.notes.extend(notes);
                return solved;
            };
            options.error = error;
            refined.linked = solved.linked;
        }
        unreachable!("the last attempt returns")
    }

    /// The option `error` with which the light of elements should meet the target; `None` if it is met already, or more rays are not
    /// possible. Errors are inversely proportional to the root of the number of rays, which is proportional to 1 / error²; a quarter of
    /// the target is kept as a margin for the noise of the comparison.
    fn smaller_error(&mut self, solved: &Solved, options: &Options, deadline: &Deadline) -> Option<f64> {
        let target = options.target_error.filter(|_| options.local_rays.is_none() && !deadline.late())?;
        let FinalLight::Rays(local) = &solved.closing else { return None };
        local.element_rays?;
        let size = AuditSize::of(options);
        self.progress.stage("error of elements", size.elements as u64);
        let gather = FinalGather::new(self.model, &solved.linked, options);
        let bars = solved.uncertainty();
        let (found, _) = timed(&mut self.seconds.audit, || gather.sampled_error(&bars, size, deadline));
        let error = options.error * (TARGET_MARGIN * target / found?).max(MIN_ERROR_STEP);
        let more = Options { error, ..options.clone() };
        (found? > ATTEMPT_MARGIN * target && more.local_rays() > options.local_rays()).then_some(error)
    }

    /// Splits surfaces as finely as the rays allow, and traces the rays of the exchange between elements.
    fn local_pass(&mut self, linked: &mut LinkedScene, options: &Options, deadline: &Deadline) -> LocalPass {
        let scene = self.scene;
        let (found, note) = timed(&mut self.seconds.local, || {
            let all = options.local_rays() as f64;
            let rays = match deadline.limited() {
                true => FinalGather::new(self.model, linked, options).affordable_rays(all, deadline),
                false => Some(all).filter(|_| !deadline.late()),
            };
            // Elements are as small as the rays allow; around few large surfaces with dark backs they have the size asked for, unless a
            // target needs smaller ones: the error of the Cornell box is 1.5 % with 33,000 elements and with 132,000.
            let finest = match linked.elements.dark.is_empty() || options.target_error.is_some() {
                true => options.local_area(),
                false => options.min_area,
            };
            let smallest = match rays {
                Some(rays) if rays >= all => finest,
                fewer => Options::area_for(fewer.unwrap_or(LATE_RAYS)).max(finest),
            };
            linked.split_all(smallest * total_area(scene), deadline);
            linked.split_small_surfaces(deadline);
            linked.split_near_emitters(scene, deadline);
            linked.divide_at_crossings(scene, &self.model.exact(), deadline);
            linked.mark_gaps(&self.model.exact());
            linked.mark_rims(&self.model.exact());
            let gather = FinalGather::new(self.model, linked, options);
            let useful = gather.useful_rays(all);
            let rays = rays.map(|rays| rays.min(useful));
            let found = gather.local_pass(rays, useful, all, deadline);
            let note = notes::fewer_local_rays(rays.map(|_| found.traced_part), found.wanted, deadline);
            (found, note)
        });
        self.notes.extend(note);
        let all = linked.leaves().len();
        self.notes.extend(notes::reduced_leaves(found.reduced, all, deadline));
        self.notes.extend(notes::untraced(found.untraced, all, deadline));
        found
    }

    /// Gathers the light of the local pass at all elements, and splits the elements over which direct light varies.
    fn element_light(&mut self, mut solved: Solved, options: &Options, deadline: &Deadline) -> Solved {
        let model = self.model;
        let skipped = timed(&mut self.seconds.local, || {
            let mut samples = solved.sample_elements(model, options, SHARE_BEFORE_SPLIT, deadline)?;
            let variance = MAX_VARIANCE_WITHIN * options.error * options.error;
            let mut room = (MAX_ADDED * solved.linked.leaves().len() as f64) as usize;
            while !deadline.late() {
                let varying = samples.most_varying(&solved.linked.elements, variance, room / 4);
                let parts = solved.split(&varying);
                if parts.is_empty() {
                    break;
                }
                room -= parts.len();
                solved.sample_parts(model, options, &mut samples, &parts, deadline);
            }
            Some(solved.share_samples(model, options, samples, deadline))
        });
        let all = solved.linked.leaves().len();
        self.notes.extend(notes::reduced_leaves(skipped.unwrap_or(0), all, deadline));
        solved
    }
}
