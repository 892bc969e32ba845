//! What the cut gains and errs, class by class, from exact segments of a scene (docs/method.md, Distance cut).
//!
//! Children of the cut that a segment meets one after the other belong to the same plants: they are not independent, and products of
//! their transmittances are wrong in the mean. A factor of all extinctions makes it right, one for each class and width.

use super::Cut;
use super::modes::{self, CLASSES, MIN_GAIN, Mode, Plan};
use super::near::Found;
use super::sums::{How, Sums};
use super::traverse::OPAQUE_DEPTH;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::answer::Bundle;
use glam::Vec3;
use rayon::prelude::*;

/// Widths that are tried, relative to the emitter's.
const WIDTHS: [f32; 4] = [1.0, 0.75, 0.5, 0.25];
/// Candidates of the first look, which drops classes and widths without hope: of a class with an eighth of them, 512, gains are known
/// to about a tenth. Classes with fewer than these would not be known to [`MAX_BIAS`] at the end.
const FIRST: u32 = 1 << 12;
const FIRST_OF_CLASS: usize = ENOUGH / (CANDIDATES / FIRST) as usize / 2;
/// Smallest gain at the first look, below [`MIN_GAIN`] by more than its error.
const FIRST_GAIN: f32 = 0.75 * MIN_GAIN;
/// Largest number of candidates, and candidates that are looked at together.
const CANDIDATES: u32 = 1 << 17;
const TOGETHER: u32 = 1 << 12;
/// Receivers of a class that are enough: the mean of their 2¹⁷ segments has a standard error of at most 0.0014.
const ENOUGH: usize = 1 << 12;
/// Largest error of the mean transmittance of a class, twice its standard error.
const MAX_BIAS: f64 = 0.003;
/// Steps of the fit of the factor: 2⁻²⁰ of its range.
const STEPS: usize = 20;
/// Range of the factor. A width that needs one outside is not used.
const FACTORS: [f32; 2] = [0.25, 2.0];
/// Bundles that a task follows: 256 segments.
const TASK: usize = 16;

/// A receiver of the pilot: two sets of sixteen segments from a point of a surface to the front of an emitter, each stratified as those of
/// queries are, and independent of each other.
pub struct Candidate<'a> {
    /// The sets.
    pub packets: [Packet; 2],
    /// See [`Bundle::emitter_size`].
    pub emitter_size: f32,
    /// See [`Bundle::emitter`].
    pub emitter: &'a [Vec3],
}

impl Candidate<'_> {
    fn bundles(&self) -> [Bundle<'_>; 2] {
        let bundle =
            |packet| Bundle { emitter: self.emitter, ..Bundle::of_packet(packet, self.emitter_size) };
        self.packets.each_ref().map(bundle)
    }
}

/// What exact segments of a set found.
struct Truth {
    /// Work of exact segments through the tree.
    work: f64,
    visible: u32,
}

/// What the cut found for a set with one width.
struct Met {
    work: f64,
    depths: [f32; LANES],
    /// Segments that are open but for aggregated children.
    open: u32,
}

/// Receivers of a class.
struct Class<'a> {
    kept: Vec<Candidate<'a>>,
    /// Widths that may be used.
    widths: Vec<f32>,
    /// Number of receivers that were seen, and the work of finding their class.
    seen: usize,
    near: f64,
}

impl Default for Class<'_> {
    fn default() -> Self {
        Class { kept: vec![], widths: WIDTHS.to_vec(), seen: 0, near: 0.0 }
    }
}

impl<'a> Class<'a> {
    fn wants_more(&self) -> bool {
        !self.widths.is_empty() && self.kept.len() < ENOUGH
    }

    fn add(&mut self, near: Found, candidate: Candidate<'a>) {
        (self.seen, self.near) = (self.seen + 1, self.near + near.work());
        if self.wants_more() {
            self.kept.push(candidate);
        }
    }
}

impl Cut {
    /// Measures gains and errors on a pilot, independent bundles by number, and plans which receivers are answered and how. None if it pays
    /// for no receiver.
    #[must_use]
    pub fn fitted<'a>(
        mut self,
        candidate: impl Fn(u32) -> Option<Candidate<'a>> + Sync,
        exact: &impl Occluder,
    ) -> Option<Cut> {
        let mut classes: [Class; CLASSES] = std::array::from_fn(|_| Class::default());
        let mut next = 0;
        while next < CANDIDATES && classes.iter().any(Class::wants_more) {
            let found: Vec<(Found, Candidate)> = (next..next + TOGETHER)
                .into_par_iter()
                .filter_map(|k| {
                    let candidate = candidate(k)?;
                    Some((self.near(&candidate.bundles()[0], modes::limit(CLASSES - 1)), candidate))
                })
                .collect();
            found.into_iter().for_each(|(near, candidate)| classes[modes::class(near)].add(near, candidate));
            next += TOGETHER;
            if next == FIRST {
                for class in &mut classes {
                    let hopeful = |(mode, _): &(Mode, f64)| mode.gain(LANES as f32) >= FIRST_GAIN;
                    let modes = self.modes(class, exact).into_iter().filter(hopeful);
                    let enough = class.kept.len() >= FIRST_OF_CLASS;
                    class.widths = modes.filter(|_| enough).map(|(mode, _)| mode.width).collect();
                }
            }
        }
        let known = |class: &Class| {
            let modes = self.modes(class, exact).into_iter();
            modes.filter(|&(_, error)| 2.0 * error <= MAX_BIAS).map(|(mode, _)| mode).collect()
        };
        self.plan = Plan::of(&classes.each_ref().map(known));
        (!self.plan.is_empty()).then_some(self)
    }

    /// What each width gains and errs for the receivers of a class, with the standard error of its mean.
    fn modes(&self, class: &Class, exact: &impl Occluder) -> Vec<(Mode, f64)> {
        if class.widths.is_empty() {
            return vec![];
        }
        let truths = self.truths(&class.kept, exact);
        let fit = |&width: &f32| {
            // Depths are needed up to those that the smallest factor makes opaque.
            let how = How { width, factor: FACTORS[0], shells: false };
            let met =
                self.follow(&class.kept, how, |sums, &depths, open| Met { work: sums.work(), depths, open });
            let all: Vec<Set> = truths.iter().zip(&met).collect();
            mode(&all, width, class.near / class.seen as f64)
        };
        class.widths.par_iter().filter_map(fit).collect()
    }

    fn truths(&self, kept: &[Candidate], exact: &impl Occluder) -> Vec<Truth> {
        let blocked: Vec<u32> = kept
            .par_chunks(TASK)
            .flat_map_iter(|part| {
                let packets: Vec<Packet> = part.iter().flat_map(|c| c.packets.clone()).collect();
                let mut blocked = vec![0; packets.len()];
                exact.occluded(&packets, &mut blocked);
                blocked
            })
            .collect();
        let work = self.follow(kept, How::EXACT, |sums, _, _| sums.work());
        let active =
            kept.iter().flat_map(|candidate| candidate.packets.each_ref().map(|packet| packet.active));
        let all = active.zip(blocked).zip(work);
        all.map(|((active, blocked), work)| Truth { work, visible: active & !blocked }).collect()
    }

    fn follow<T: Send>(
        &self,
        kept: &[Candidate],
        how: How,
        each: impl Fn(Sums, &[f32; LANES], u32) -> T + Sync,
    ) -> Vec<T> {
        let part = |part: &[Candidate]| {
            let bundles: Vec<Bundle> = part.iter().flat_map(Candidate::bundles).collect();
            let mut all = Vec::with_capacity(part.len());
            self.each_packet(&bundles, how, |sums, depths, open| all.push(each(sums, depths, open)));
            all
        };
        kept.par_chunks(TASK).flat_map_iter(part).collect()
    }
}

/// A set of the pilot; both of a receiver follow each other.
type Set<'a> = (&'a Truth, &'a Met);

/// Sums over the receivers of a class.
#[derive(Default)]
struct Totals {
    receivers: f64,
    /// Work of exact segments and of those of the cut.
    work: [f64; 2],
    /// Variances of the means of sets, exact and of the cut, and of single segments of the cut.
    exact: f64,
    spread: f64,
    single: f64,
    /// Squares of the error of the model.
    model: f64,
    /// T (1 - T).
    binary: f64,
    /// Errors and their squares.
    errors: [f64; 2],
}

impl Totals {
    fn add(&mut self, [a, b]: [&Set; 2], factor: f32) {
        let n = LANES as f64;
        let seen = [a, b].map(|(truth, _)| f64::from(truth.visible.count_ones()) / n);
        let values = [a, b].map(|(_, met)| transmittances(met, factor));
        let means = values.map(|values| values.iter().sum::<f64>() / n);
        let errors = [means[0] - seen[0], means[1] - seen[1]];
        let (mean, error) = (0.5 * (means[0] + means[1]), 0.5 * (errors[0] + errors[1]));
        // The sets are independent: half of the square of a difference is a variance, and a product of errors has none of theirs.
        self.exact += 0.5 * (seen[0] - seen[1]).powi(2);
        self.spread += 0.5 * (means[0] - means[1]).powi(2);
        self.model += errors[0] * errors[1];
        self.binary += mean * (1.0 - mean);
        let squares = values.as_flattened().iter().map(|t| t * t).sum::<f64>() / (2.0 * n);
        self.single += (squares - 0.5 * (means[0].powi(2) + means[1].powi(2))) * n / (n - 1.0);
        self.errors = [self.errors[0] + error, self.errors[1] + error * error];
        self.work = [self.work[0] + a.0.work + b.0.work, self.work[1] + a.1.work + b.1.work];
        self.receivers += 1.0;
    }

    /// Standard error of the mean transmittance.
    fn error(&self) -> f64 {
        let [mean, square] = self.errors.map(|sum| sum / self.receivers);
        ((square - mean * mean).max(0.0) / (self.receivers - 1.0)).sqrt()
    }
}

/// The mode of a width and the standard error of its mean, for receivers whose class takes the work `near`; none for few receivers, or if
/// no factor makes the mean right.
fn mode(all: &[Set], width: f32, near: f64) -> Option<(Mode, f64)> {
    let factor = factor(all)?;
    let mut totals = Totals::default();
    all.chunks_exact(2).for_each(|pair| totals.add([&pair[0], &pair[1]], factor));
    if totals.receivers < 2.0 || totals.binary <= 0.0 || totals.work[1] <= 0.0 {
        return None;
    }
    let relative = |sum: f64| (sum.max(0.0) / totals.binary) as f32;
    let [exact, cut] = totals.work.map(|work| work / (2.0 * LANES as f64 * totals.receivers));
    let mode = Mode {
        width,
        factor,
        exact: relative(totals.exact),
        spread: relative(totals.spread),
        single: relative(totals.single),
        model: relative(totals.model),
        work: [exact, cut, near].map(|work| work as f32),
    };
    Some((mode, totals.error()))
}

/// The factor with which the cut transmits as much as was visible, by bisection; none if it lies outside of the range.
fn factor(all: &[Set]) -> Option<f32> {
    let visible: f64 = all.iter().map(|(truth, _)| f64::from(truth.visible.count_ones())).sum();
    let passed = |factor: f32| -> f64 {
        all.iter().map(|(_, met)| transmittances(met, factor).iter().sum::<f64>()).sum()
    };
    let [mut low, mut high] = FACTORS;
    if passed(low) < visible || passed(high) > visible {
        return None;
    }
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        (low, high) = if passed(middle) > visible { (middle, high) } else { (low, middle) };
    }
    Some(0.5 * (low + high))
}

/// Transmittance of each segment with a factor of all extinctions.
fn transmittances(met: &Met, factor: f32) -> [f64; LANES] {
    std::array::from_fn(|lane| {
        let depth = factor * met.depths[lane];
        let open = met.open >> lane & 1 == 1 && depth <= OPAQUE_DEPTH;
        if open { f64::from((-depth).exp()) } else { 0.0 }
    })
}
