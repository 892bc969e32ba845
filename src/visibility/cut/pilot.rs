//! Reach, correction, error and use of the cut, from exact segments of a scene (docs/method.md, Distance cut).
//!
//! Children of the cut that a segment meets one after the other belong to the same plants: they are not independent, and products of
//! their transmittances are wrong in the mean. One factor of all extinctions makes it right, fitted where the cut is used.

use super::{Cut, Sums};
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::answer::Bundle;
use crate::visibility::cost_model::{CUT_CLASSES, CutUse};

/// Reaches that are tried: the width of a compact emitter's parts, that of a dome's (e is 0.4 of the root of its area), and between. Plants
/// of independent leaves are best averaged widely, those with boughs and clumps narrowly.
const REACHES: [f32; 3] = [1.0, 1.75, 3.0];
/// Smallest gain over exact rays that the same tree traces, at equal error, at which the cut is used. Those take up to twice as long
/// as Embree's outdoors (`cargo bench --bench distance_cut`, rows of reach 0).
const MIN_GAIN: f64 = 2.0;
/// Fewest bundles of a class that decide: 16 limit the relative error of a mean cost to about a quarter.
const MIN_BUNDLES: usize = 16;
/// Steps of the fit of the factor: 2⁻²⁰ of its range.
const STEPS: usize = 20;
/// Range of the factor.
const FACTORS: [f32; 2] = [0.25, 2.0];

/// A bundle of the pilot: what exact segments and the cut found.
struct Met {
    class: usize,
    averaged: Sums,
    /// Work of exact segments through the tree.
    exact: f64,
    depths: [f32; LANES],
    /// Segments that are open but for aggregated children, and those that are visible.
    open: u32,
    visible: u32,
    active: u32,
}

/// Fits the cut to a pilot: independent bundles of one packet each, of independent segments.
pub(super) fn fit(cut: &mut Cut, bundles: &[Bundle], exact: &impl Occluder) {
    let packets: Vec<Packet> = bundles.iter().map(|bundle| bundle.packets[0].clone()).collect();
    let mut blocked = vec![0; packets.len()];
    exact.occluded(&packets, &mut blocked);
    let visible: Vec<u32> = packets.iter().zip(&blocked).map(|(p, blocked)| p.active & !blocked).collect();
    let mut work = Vec::with_capacity(bundles.len());
    cut.each_packet(bundles, None, |sums, _, _| work.push(sums.work()));
    let mut best = (f64::NEG_INFINITY, cut.reach, cut.factor, CutUse::default());
    for reach in REACHES {
        (cut.reach, cut.factor) = (reach, 1.0);
        let mut all = Vec::with_capacity(bundles.len());
        cut.each_packet(bundles, Some(0.0), |averaged, depths, open| {
            let k = all.len();
            let (exact, visible, active) = (work[k], visible[k], packets[k].active);
            all.push(Met { class: 0, averaged, exact, depths: *depths, open, visible, active });
        });
        for (met, bundle) in all.iter_mut().zip(bundles) {
            met.class = cut.class(bundle, 0.0);
        }
        let (score, factor, uses) = evaluate(&all);
        if score > best.0 {
            best = (score, reach, factor, uses);
        }
    }
    (_, cut.reach, cut.factor, cut.uses) = best;
}

/// Sum of the logarithms of the gains of all bundles that the cut answers, its factor, and where it is used.
fn evaluate(all: &[Met]) -> (f64, f32, CutUse) {
    let gains = |factor: f32, model: f32| -> [f64; CUT_CLASSES] {
        std::array::from_fn(|class| gain(&of(all, |met| met.class == class), factor, model))
    };
    let pays = |gains: [f64; CUT_CLASSES]| gains.map(|gain| gain >= MIN_GAIN);
    let first = pays(gains(1.0, 0.0));
    let used = of(all, |met| first[met.class]);
    let factor = factor(&used);
    let model = model_error(&used, factor);
    let gains = gains(factor, model);
    let classes = pays(gains);
    let score = of(all, |met| classes[met.class]).iter().map(|met| gains[met.class].ln()).sum();
    (score, factor, CutUse { classes, model })
}

fn of(all: &[Met], is_in: impl Fn(&Met) -> bool) -> Vec<&Met> {
    all.iter().filter(|met| is_in(met)).collect()
}

/// Time of exact rays through the tree over that of the cut, at the same error: ratio of work times ratio of mean square errors. 0 for too
/// few bundles.
fn gain(bundles: &[&Met], factor: f32, model: f32) -> f64 {
    let (mut work, mut square) = ([0.0; 2], [0.0; 2]);
    for met in bundles {
        let n = f64::from(met.active.count_ones()).max(1.0);
        let values = transmittances(met, factor);
        let mean = values.iter().sum::<f64>() / n;
        let visible = f64::from(met.visible.count_ones()) / n;
        square[0] += visible * (1.0 - visible);
        square[1] += (values.iter().map(|t| t * t).sum::<f64>() / n - mean * mean).max(0.0);
        square[1] += n * f64::from(model) * mean * (1.0 - mean);
        work = [work[0] + met.exact, work[1] + met.averaged.work()];
    }
    if bundles.len() < MIN_BUNDLES || square[0] <= 0.0 {
        return 0.0;
    }
    work[0] / work[1].max(1.0) * square[0] / square[1].max(f64::MIN_POSITIVE)
}

/// The factor with which the cut transmits as much as was visible, by bisection.
fn factor(bundles: &[&Met]) -> f32 {
    if bundles.is_empty() {
        return 1.0;
    }
    let visible: f64 = bundles.iter().map(|met| f64::from(met.visible.count_ones())).sum();
    let [mut low, mut high] = FACTORS;
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        let passed: f64 = bundles.iter().map(|met| transmittances(met, middle).iter().sum::<f64>()).sum();
        (low, high) = if passed > visible { (middle, high) } else { (low, middle) };
    }
    0.5 * (low + high)
}

/// Mean square of the error of a bundle's mean that is not due to its segments, relative to T (1 - T).
fn model_error(bundles: &[&Met], factor: f32) -> f32 {
    let (mut square, mut spread) = (0.0, 0.0);
    for met in bundles {
        let n = f64::from(met.active.count_ones()).max(1.0);
        let values = transmittances(met, factor);
        let lanes = (0..LANES).filter(|lane| met.active >> lane & 1 == 1);
        let differences: Vec<f64> =
            lanes.map(|lane| values[lane] - f64::from(met.visible >> lane & 1)).collect();
        let mean = differences.iter().sum::<f64>() / n;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        let t = values.iter().sum::<f64>() / n;
        square += mean * mean - variance / n;
        spread += t * (1.0 - t);
    }
    if spread > 0.0 { (square / spread).clamp(0.0, 1.0) as f32 } else { 0.0 }
}

/// Transmittance of each segment with a factor of all extinctions.
fn transmittances(met: &Met, factor: f32) -> [f64; LANES] {
    std::array::from_fn(|lane| match met.open >> lane & 1 {
        1 => f64::from((-factor * met.depths[lane]).exp()),
        _ => 0.0,
    })
}
