//! Measures the gain and the errors of the cut, class by class, with exact segments of a scene (docs/method.md, Distance cut).
//!
//! The children of the cut along a segment belong to the same plants: they are not independent, and the product of their
//! transmittances has a biased mean. A factor of all extinctions, one for each class and width, corrects the mean.

use super::DistanceCut;
use super::modes::{CLASSES, Fit, Mode, SMOOTH_EXPONENT, STRATIFIED_EXPONENT};
use super::sums::{BundleSums, PacketResult, Tracing};
use super::traverse::OPAQUE_DEPTH;
use crate::math::parallel;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::answer::Bundle;
use glam::Vec3;

/// Widths that are tried, relative to the emitter's: the umbra criterion allows no more than 1. Steps of about a quarter: the times to an
/// error of neighbouring widths differ by less than the choice of routes can resolve, by a benchmark that is no longer in the repository
/// (`git show 2d559b4:benches/distance_cut.rs`).
const CANDIDATE_WIDTHS: [f32; 4] = [1.0, 0.75, 0.5, 0.25];
/// Receivers of the first round, after which scenes where no class gains are rejected: a class of [`MIN_CLASS_FRACTION`] has 41 of them,
/// which measure its variance to √(2 / 41) = 22 % if it is normally distributed.
const MIN_PILOT_RECEIVERS: u32 = 1 << 12;
/// Receivers by which scenes are rejected before extinctions are measured: a quarter of [`MIN_PILOT_RECEIVERS`], because only a
/// fraction is compared.
const SCREENING_RECEIVERS: u32 = 1 << 10;
/// Smallest fraction of the segments of these receivers that must meet averaged children: that of a class of 2 % of the receivers, all
/// of whose segments do.
const MIN_AVERAGED_FRACTION: f64 = 0.02;
/// Largest number of receivers: limits the time of the pilot to that of about a hundred million tests.
const MAX_PILOT_RECEIVERS: u32 = 1 << 15;
/// Smallest fraction of the packets for which a class uses its own measurements: smaller classes use those of all packets.
const MIN_CLASS_FRACTION: f32 = 0.01;
/// Fewest packets for which a class uses its own measurements: factors are fitted to their mean, which is uncertain for a few packets.
const MIN_CLASS_PACKETS: f64 = 200.0;
/// Largest error of the mean transmittance of a class, twice its standard error: less than a step of 8-bit grey, 1/255.
const MAX_BIAS: f64 = 0.003;
/// Smallest gain over Embree for which a width is kept: gains are measured to a tenth.
const MIN_GAIN: f32 = 1.25;
/// Largest number of steps of the fit of the factor, of which about six are needed.
const MAX_FIT_STEPS: usize = 20;
/// Excess of light, relative to what is visible, at which the fit ends: far below [`MAX_BIAS`].
const MAX_EXCESS: f64 = 1e-5;
/// Range of the factor: 0.5 to 1.8 was measured in garden, park, orchard, forest and valley, by the benchmark of
/// [`CANDIDATE_WIDTHS`]. A width that needs one outside is not used: its extinctions do not describe the scene.
const FACTORS: [f32; 2] = [0.25, 2.0];
/// Bundles per task: 256 segments.
const BUNDLES_PER_TASK: usize = 16;

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

/// A set of the pilot: the exact results, and those with each width.
struct PilotSet {
    visible: u32,
    /// Work of Embree.
    work: f64,
    traces: [SetTrace; CANDIDATE_WIDTHS.len()],
}

/// Results of the cut for a set with one width.
#[derive(Clone, Copy)]
struct SetTrace {
    depths: [f32; LANES],
    /// Segments that are open if aggregated children are ignored.
    open: u32,
    class: usize,
    work: f64,
    aggregated: u32,
}

impl DistanceCut {
    /// Whether more than a few segments of the pilot meet children that the largest width averages. Extinctions are not needed.
    pub(super) fn averages_enough<'a>(
        &self,
        candidate: &(impl Fn(u32) -> Option<Candidate<'a>> + Sync),
    ) -> bool {
        let mode = Mode::unmeasured(CANDIDATE_WIDTHS[0], FACTORS[0]);
        let counted = |k: u32| {
            let bundles = candidate(k)?;
            let sums = self.sum(&bundles.bundles()[0], Tracing::Mode(&mode));
            Some([sums.aggregated, sums.segments])
        };
        let counts: Vec<[u32; 2]> = parallel::flat_map(0..SCREENING_RECEIVERS, counted);
        let [averaged, all] = counts.iter().fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
        f64::from(averaged) > MIN_AVERAGED_FRACTION * f64::from(all)
    }

    /// Measures gains and errors on a pilot. None if it pays for no receiver.
    pub(super) fn fit<'a>(
        mut self,
        candidate: impl Fn(u32) -> Option<Candidate<'a>> + Sync,
        exact: &impl Occluder,
    ) -> Option<DistanceCut> {
        let mut pairs: Vec<[PilotSet; 2]> = Vec::new();
        let mut next = [0, MIN_PILOT_RECEIVERS];
        loop {
            let found: Vec<Candidate> = parallel::flat_map(next[0]..next[1], &candidate);
            pairs.extend(parallel::flat_map(parallel::chunks(&found, BUNDLES_PER_TASK), |part| {
                self.sets(part, exact)
            }));
            let modes: Vec<(Mode, bool)> =
                (0..CANDIDATE_WIDTHS.len()).filter_map(|k| mode(&pairs, k)).collect();
            // The first round measures the gains of rare classes to about a fifth.
            let hopeful = |mode: &Mode, smallest: f32| {
                mode.fits.iter().any(|fit| fit.part >= MIN_CLASS_FRACTION && fit.gain() >= smallest)
            };
            let known = modes.iter().all(|(mode, known)| *known || !hopeful(mode, MIN_GAIN));
            if known
                || next[1] >= MAX_PILOT_RECEIVERS
                || !modes.iter().any(|(mode, _)| hopeful(mode, 0.75 * MIN_GAIN))
            {
                self.modes = modes.into_iter().map(|m| m.0).filter(|mode| hopeful(mode, MIN_GAIN)).collect();
                return (!self.modes.is_empty()).then_some(self);
            }
            next = [next[1], 2 * next[1]];
        }
    }

    /// Follows the sets of some receivers.
    fn sets(&self, part: &[Candidate], exact: &impl Occluder) -> Vec<[PilotSet; 2]> {
        let packets: Vec<Packet> = part.iter().flat_map(|c| c.packets.clone()).collect();
        let mut blocked = vec![0; packets.len()];
        exact.occluded(&packets, &mut blocked);
        let bundles: Vec<Bundle> = part.iter().flat_map(Candidate::bundles).collect();
        let mut work = Vec::with_capacity(bundles.len());
        let exactly = Tracing::Exact { shells: true };
        self.each_sum(&bundles, exactly, |_, sums| work.push(sums.embree_work()));
        let mut traces = CANDIDATE_WIDTHS.map(|width| {
            // Depths are needed up to those that the smallest factor makes opaque.
            let mode = Mode::unmeasured(width, FACTORS[0]);
            let mut all = Vec::with_capacity(bundles.len());
            self.each_packet(&bundles, Tracing::Mode(&mode), &mut |_, packet| {
                all.push(SetTrace::of(&packet))
            });
            all.into_iter()
        });
        let mut sets = packets.iter().zip(blocked).zip(work).map(|((packet, blocked), work)| PilotSet {
            visible: packet.active & !blocked,
            work,
            traces: traces.each_mut().map(|trace| trace.next().expect("a result a packet")),
        });
        let pair = |_: &Candidate| [(); 2].map(|()| sets.next().expect("two sets a receiver"));
        part.iter().map(pair).collect()
    }
}

impl SetTrace {
    fn of(&PacketResult { trace, segments, class, .. }: &PacketResult) -> SetTrace {
        let work = BundleSums::counted(trace, segments).work();
        SetTrace { depths: trace.depths, open: trace.open, class, work, aggregated: trace.aggregated }
    }

    /// Sum of the transmittances with a factor of all extinctions.
    fn passed(&self, factor: f32) -> f64 {
        self.transmittances(factor).iter().sum()
    }

    /// Transmittance of each segment with a factor of all extinctions.
    fn transmittances(&self, factor: f32) -> [f64; LANES] {
        std::array::from_fn(|lane| {
            let depth = factor * self.depths[lane];
            let open = self.open >> lane & 1 == 1 && depth <= OPAQUE_DEPTH;
            if open { f64::from((-depth).exp()) } else { 0.0 }
        })
    }
}

/// Sums over the packets of a class.
#[derive(Clone, Copy, Default)]
struct Totals {
    packets: f64,
    /// Work of Embree and of the cut.
    work: [f64; 2],
    /// Variances of the means of sets, exact and of the cut, and of single segments of the cut.
    exact: f64,
    spread: f64,
    single: f64,
    /// Sums of the squares of the error of the model, and of the squares of these values.
    model: [f64; 2],
    /// T (1 - T).
    binary: f64,
    /// Errors and their squares.
    errors: [f64; 2],
}

impl Totals {
    /// Adds a receiver to the classes of its sets. The sets are independent: half of the square of their difference estimates a
    /// variance, and the product of their errors does not contain their variances.
    fn add(of_class: &mut [Totals; CLASSES], pair: &[PilotSet; 2], width: usize, factors: &[f32; CLASSES]) {
        let n = LANES as f64;
        let traces = pair.each_ref().map(|set| &set.traces[width]);
        let seen = pair.each_ref().map(|set| f64::from(set.visible.count_ones()) / n);
        let values = traces.map(|trace| trace.transmittances(factors[trace.class]));
        let means = values.map(|values| values.iter().sum::<f64>() / n);
        let errors = [means[0] - seen[0], means[1] - seen[1]];
        for k in 0..2 {
            let totals = &mut of_class[traces[k].class];
            totals.packets += 1.0;
            totals.exact += 0.5 * (seen[0] - seen[1]).powi(2);
            totals.spread += 0.5 * (means[0] - means[1]).powi(2);
            let model = errors[0] * errors[1];
            totals.model = [totals.model[0] + model, totals.model[1] + model * model];
            totals.binary += means[k] * (1.0 - means[k]);
            let squares = values[k].iter().map(|t| t * t).sum::<f64>() / n;
            totals.single += (squares - means[k].powi(2)) * n / (n - 1.0);
            totals.errors = [totals.errors[0] + errors[k], totals.errors[1] + errors[k] * errors[k]];
            totals.work = [totals.work[0] + pair[k].work, totals.work[1] + traces[k].work];
        }
    }

    fn joined(all: &[Totals; CLASSES]) -> Totals {
        let sum = |of: fn(&Totals) -> f64| all.iter().map(of).sum::<f64>();
        Totals {
            packets: sum(|t| t.packets),
            work: [sum(|t| t.work[0]), sum(|t| t.work[1])],
            exact: sum(|t| t.exact),
            spread: sum(|t| t.spread),
            single: sum(|t| t.single),
            model: [sum(|t| t.model[0]), sum(|t| t.model[1])],
            binary: sum(|t| t.binary),
            errors: [sum(|t| t.errors[0]), sum(|t| t.errors[1])],
        }
    }

    /// Error of the mean transmittance.
    fn bias(&self) -> f64 {
        self.errors[0] / self.packets
    }

    /// Standard error of the mean transmittance; both sets of a receiver err alike at worst.
    fn error(&self) -> f64 {
        let [mean, square] = self.errors.map(|sum| sum / self.packets);
        ((square - mean * mean).max(0.0) / (0.5 * self.packets - 1.0)).sqrt()
    }

    /// The fit of the class; none for few packets, or where all segments agree.
    fn fit(&self, factor: f32, all: f64) -> Option<Fit> {
        if self.packets < 4.0 || self.binary <= 0.0 || self.work[1] <= 0.0 {
            return None;
        }
        let relative = |sum: f64| (sum.max(0.0) / self.binary) as f32;
        // Both sets of a receiver have the same product.
        let [model, square] = self.model;
        let model_error = (2.0 * (square - model * model / self.packets).max(0.0)).sqrt();
        Some(Fit {
            factor,
            exact: relative(self.exact),
            spread: relative(self.spread),
            single: relative(self.single),
            model: relative(model.max(0.0) + model_error),
            work: self.work.map(|work| (work / (LANES as f64 * self.packets)) as f32),
            power: STRATIFIED_EXPONENT,
            part: (self.packets / all) as f32,
        })
    }
}

/// The mode of a width, and whether the means of all classes are known; none if no factor corrects the means, or if the width
/// averages nothing.
fn mode(pairs: &[[PilotSet; 2]], width: usize) -> Option<(Mode, bool)> {
    let sets = || pairs.as_flattened().iter();
    if sets().all(|set| set.traces[width].aggregated == 0) {
        return None;
    }
    let common = factor(&sets().map(|set| (set, &set.traces[width])).collect::<Vec<_>>())?;
    let mut factors = [common; CLASSES];
    for (class, own) in factors.iter_mut().enumerate() {
        let of_class = sets().map(|set| (set, &set.traces[width])).filter(|(_, trace)| trace.class == class);
        let of_class: Vec<_> = of_class.collect();
        if decides(of_class.len() as f64, 2.0 * pairs.len() as f64) {
            // Where hardly anything is averaged, there may be no factor; the common factor then changes the result very little.
            *own = factor(&of_class).unwrap_or(common);
        }
    }
    let mut totals = [Totals::default(); CLASSES];
    pairs.iter().for_each(|pair| Totals::add(&mut totals, pair, width, &factors));
    let joined = Totals::joined(&totals);
    let all = joined.fit(common, joined.packets)?;
    let fit = |class: usize| {
        let rare = Fit { part: (totals[class].packets / joined.packets) as f32, ..all };
        let own = totals[class].fit(factors[class], joined.packets);
        let own = own
            .map(|fit| Fit { power: if class == 0 { SMOOTH_EXPONENT } else { STRATIFIED_EXPONENT }, ..fit });
        own.filter(|_| decides(totals[class].packets, joined.packets)).unwrap_or(rare)
    };
    let fits = std::array::from_fn(fit);
    let deciding = || totals.iter().filter(|class| decides(class.packets, joined.packets));
    if deciding().any(|class| class.bias().abs() > MAX_BIAS + 2.0 * class.error()) {
        return None;
    }
    let known = deciding().all(|class| 2.0 * class.error() <= MAX_BIAS);
    Some((Mode { width: CANDIDATE_WIDTHS[width], fits }, known))
}

/// Whether a class with this number of all packets uses its own measurements.
fn decides(packets: f64, all: f64) -> bool {
    packets >= MIN_CLASS_PACKETS && packets >= f64::from(MIN_CLASS_FRACTION) * all
}

/// The factor with which the cut transmits as much as was visible, by the Illinois algorithm (M. Dowell, P. Jarratt 1971); none if it lies
/// outside of the range.
fn factor(all: &[(&PilotSet, &SetTrace)]) -> Option<f32> {
    let visible: f64 = all.iter().map(|(set, _)| f64::from(set.visible.count_ones())).sum();
    let excess = |factor: f64| -> f64 {
        let sums: Vec<f64> = parallel::map(all, |(_, trace)| trace.passed(factor as f32));
        sums.iter().sum::<f64>() - visible
    };
    let [mut low, mut high] = FACTORS.map(|factor| (f64::from(factor), excess(f64::from(factor))));
    if low.1 < 0.0 || high.1 > 0.0 {
        return None;
    }
    let enough = MAX_EXCESS * visible;
    for _ in 0..MAX_FIT_STEPS {
        let middle =
            if low.1 > high.1 { (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1) } else { low.0 };
        let found = excess(middle);
        if found.abs() <= enough {
            return Some(middle as f32);
        }
        // The end that stays counts half, so that neither end stays for long.
        if found > 0.0 {
            (low, high.1) = ((middle, found), 0.5 * high.1);
        } else {
            (high, low.1) = ((middle, found), 0.5 * low.1);
        }
    }
    Some((0.5 * (low.0 + high.0)) as f32)
}
