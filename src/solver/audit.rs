//! Error bars against the truth: paths from a few elements that are followed to the end by exact rays; they share nothing
//! with the solution but the sides that are taken for unlit.

use super::field::{Rgb, add};
use super::mean;
use super::receive::{Buffers, Receiver};
use super::walk::Place;
use crate::element::Shape;
use crate::link::{Tally, mix, point_on};
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
        let elements = &self.solver.elements;
        let (mut areas, mut sum, mut light) = (Vec::new(), 0.0, 0.0);
        for (e, element) in elements.elements.iter().enumerate() {
            if element.is_leaf() && !element.is_cluster() && element.area > 0.0 {
                sum += element.area;
                light += element.area * mean(self.solver.incident[e]);
                areas.push((sum, e as u32));
            }
        }
        if areas.is_empty() || light <= 0.0 || count == 0 {
            return (Audit::default(), Tally::default());
        }
        let drawn = |k: usize| {
            let at = (k as f64 + 0.5) / count as f64 * sum;
            areas[areas.partition_point(|a| a.0 <= at).min(areas.len() - 1)].1
        };
        let truths: Option<Vec<(u32, f64, f64, Tally)>> = (0..count)
            .into_par_iter()
            .map_init(Buffers::default, |buffers, k| {
                if stop() {
                    return None;
                }
                buffers.scratch.tally = Tally::default();
                let (truth, error) = self.truth(drawn(k), buffers);
                Some((drawn(k), truth, error, buffers.scratch.tally))
            })
            .collect();
        let Some(truths) = truths else { return (Audit::default(), Tally::default()) };
        let (mut audit, mut tally) = (Audit { elements: count, ..Audit::default() }, Tally::default());
        for (e, truth, noise, cost) in truths {
            tally.add(cost);
            let error = (mean(self.solver.incident[e as usize]) - truth).abs();
            let bar = bars[e as usize];
            audit.within_one += f64::from(u8::from(error <= bar.hypot(noise)));
            audit.within_two += f64::from(u8::from(error <= 2.0 * bar.hypot(noise)));
            audit.rms_error += error * error - noise * noise;
            audit.rms_bar += bar * bar;
        }
        let (n, level) = (count as f64, light / sum);
        audit.within_one /= n;
        audit.within_two /= n;
        audit.rms_error = (audit.rms_error.max(0.0) / n).sqrt() / level;
        audit.rms_bar = (audit.rms_bar / n).sqrt() / level;
        (audit, tally)
    }

    /// Mean irradiance of an element over the channels, and its standard error.
    fn truth(&self, element: u32, buffers: &mut Buffers) -> (f64, f64) {
        let Shape::Surface { side, corners } = self.solver.elements.elements[element as usize].shape else {
            return (0.0, 0.0);
        };
        let seed = mix(!self.solver.seed ^ mix(u64::from(element)));
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
