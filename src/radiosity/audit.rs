//! Error bars against the truth: paths from a few elements that are followed to the end by exact rays; they share nothing
//! with the solution but the sides that are taken for unlit.

use super::field::{Rgb, add};
use super::mean;
use super::receive::{Buffers, Receiver};
use super::walk::Place;
use crate::radiosity::elements::Shape;
use crate::radiosity::links::{Tally, mix, point_on};
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// Paths an element, in groups whose spread says how sure the truth is.
const GROUPS: u32 = 8;
const PATHS: u32 = 16;

/// How error bars compare with errors, over some elements drawn by area.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Audit {
    /// Elements whose irradiance was computed anew by paths.
    pub elements: usize,
    /// Part of them whose error lies within the bar (0.68 of a normal distribution would).
    pub within_one: f64,
    /// Within twice the bar (0.95 would).
    pub within_two: f64,
    /// Root mean square of the errors, less the noise of the paths, relative to the mean irradiance of all elements.
    pub rms_error: f64,
    /// Root mean square of the bars, relative to the same.
    pub rms_bar: f64,
    /// What bars have been multiplied with, in `[1/4, 4]`, by as many other elements.
    pub factor: f64,
}

/// Least and largest factor that an audit brings bars to the truth with, and elements that it takes.
const FACTORS: [f64; 2] = [0.25, 4.0];
const ENOUGH: usize = 40;
/// Part of the errors that should lie within twice the bars. Errors have longer tails than a normal distribution: bars that
/// hold two thirds of them would be too small.
const WITHIN_TWO: f64 = 0.9545;
/// Where in its part of the area an element is drawn: for the factor, and for the audit.
const FOR_FACTOR: f64 = 0.25;
const FOR_AUDIT: f64 = 0.75;

/// An element that was looked at, W/m².
struct Check {
    /// How far off the solution is.
    error: f64,
    /// Standard error of that.
    noise: f64,
    /// What its bar says.
    bar: f64,
}

impl Receiver<'_> {
    /// Audits the solver's irradiance and `bars` (standard uncertainty by element, W/m²) at `count` elements; none if it is
    /// stopped before it is done.
    pub(super) fn audit(
        &self,
        bars: &[f64],
        count: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> (Audit, Tally) {
        let (checks, tally) = self.checks(bars, count, FOR_AUDIT, stop);
        if checks.is_empty() {
            return (Audit::default(), tally);
        }
        let mut audit = Audit { elements: checks.len(), ..Audit::default() };
        for Check { error, noise, bar } in checks {
            audit.within_one += f64::from(u8::from(error <= bar.hypot(noise)));
            audit.within_two += f64::from(u8::from(error <= 2.0 * bar.hypot(noise)));
            audit.rms_error += error * error - noise * noise;
            audit.rms_bar += bar * bar;
        }
        let (n, level) = (audit.elements as f64, self.level());
        audit.within_one /= n;
        audit.within_two /= n;
        audit.rms_error = (audit.rms_error.max(0.0) / n).sqrt() / level;
        audit.rms_bar = (audit.rms_bar / n).sqrt() / level;
        (audit, tally)
    }

    /// What bars must be multiplied with so that as many of `count` elements (others than an audit looks at) lie within twice
    /// them as should; 1 where too few of them have bars that the truth's own noise does not hide. Samples that are spread evenly are
    /// better than the independent ones that bars are made of, and errors of links are not independent.
    pub(super) fn factor(
        &self,
        bars: &[f64],
        count: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> (f64, Tally) {
        let (mut checks, tally) = self.checks(bars, count, FOR_FACTOR, stop);
        checks.retain(|check| check.noise < check.bar);
        if checks.len() < ENOUGH {
            return (1.0, tally);
        }
        let within = |factor: f64| {
            let held = checks.iter().filter(|c| c.error <= 2.0 * (factor * c.bar).hypot(c.noise)).count();
            held as f64 / checks.len() as f64
        };
        let [mut low, mut high] = FACTORS;
        for _ in 0..20 {
            let middle = (low * high).sqrt();
            if within(middle) < WITHIN_TWO { low = middle } else { high = middle }
        }
        (high, tally)
    }

    /// Mean irradiance of all elements.
    fn level(&self) -> f64 {
        let (mut area, mut light) = (0.0, 0.0);
        for (e, element) in self.solver.elements.elements.iter().enumerate() {
            if element.is_leaf() && !element.is_cluster() {
                (area, light) = (area + element.area, light + element.area * mean(self.solver.incident[e]));
            }
        }
        if area > 0.0 { light / area } else { 0.0 }
    }

    /// Looks at `count` elements, drawn by area; `place` in `[0, 1)` says which. None without light, or if it is stopped.
    fn checks(
        &self,
        bars: &[f64],
        count: usize,
        place: f64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> (Vec<Check>, Tally) {
        let (mut areas, mut sum) = (Vec::new(), 0.0);
        for e in self.leaves() {
            sum += self.solver.elements.elements[e as usize].area;
            areas.push((sum, e));
        }
        if areas.is_empty() || self.level() <= 0.0 {
            return (Vec::new(), Tally::default());
        }
        let drawn = |k: usize| {
            let at = (k as f64 + place) / count as f64 * sum;
            areas[areas.partition_point(|a| a.0 <= at).min(areas.len() - 1)].1
        };
        let made: Option<Vec<(Check, Tally)>> = (0..count)
            .into_par_iter()
            .map_init(Buffers::default, |buffers, k| {
                if stop() {
                    return None;
                }
                buffers.scratch.tally = Tally::default();
                let e = drawn(k);
                let (truth, noise) = self.truth(e, place.to_bits(), buffers);
                let error = (mean(self.solver.incident[e as usize]) - truth).abs();
                Some((Check { error, noise, bar: bars[e as usize] }, buffers.scratch.tally))
            })
            .collect();
        let (mut checks, mut tally) = (Vec::new(), Tally::default());
        for (check, cost) in made.into_iter().flatten() {
            checks.push(check);
            tally.add(cost);
        }
        (checks, tally)
    }

    /// Mean irradiance of an element over the channels, and its standard error.
    fn truth(&self, element: u32, seed: u64, buffers: &mut Buffers) -> (f64, f64) {
        let Shape::Surface { side, corners } = self.solver.elements.elements[element as usize].shape else {
            return (0.0, 0.0);
        };
        let seed = mix(!self.solver.seed ^ mix(seed ^ u64::from(element)));
        let groups: Vec<f64> = (0..GROUPS)
            .map(|g| {
                let seed = mix(seed ^ u64::from(g));
                buffers.places.clear();
                buffers.places.extend((0..PATHS).map(|k| {
                    let [u, v, ..] = sample_4d(k, 0, seed as u32);
                    Place { at: point_on(&corners, u, v), side, leaf: element, share: Vec3::ONE }
                }));
                let mut sum: Rgb = [0.0; 3];
                self.follow(mix(seed), true, &mut sum, buffers);
                let mut value = [0.0; 3];
                add(&mut value, 1.0 / f64::from(PATHS), sum);
                mean(value)
            })
            .collect();
        let n = f64::from(GROUPS);
        let level = groups.iter().sum::<f64>() / n;
        let spread: f64 = groups.iter().map(|g| (g - level).powi(2)).sum();
        (level, (spread / (n * (n - 1.0))).sqrt())
    }
}
