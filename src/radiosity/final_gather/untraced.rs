//! Leaves that were not traced for lack of time: the light along links, corrected by the results of rays at leaves around them.
//!
//! Links distribute the light of a cluster among its surfaces by orientation, but the level of this light may be far off. The correction
//! factor is that of the traced leaves in the smallest element or cluster above an untraced leaf that contains enough of them: their
//! light by rays over their light along links. The deviation of the traced leaves from the factor is the error bar of the untraced leaf.

use super::local_noise::LocalResult;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::rgb::{Rgb, add, mean};
use rayon::prelude::*;

/// Smallest number of traced leaves that determine the factor: their deviation is known to 1/√(2 · 7) = 27 %.
const MIN_TRACED: u32 = 8;
/// Largest factor of [`balance_untraced`], and the inverse of the smallest: where untraced leaves receive little of the power, the noise of the traced ones
/// must not become their light.
const MAX_FACTOR: f64 = 2.0;

/// Area-weighted sums over traced leaves: of the light by rays and along links, and of their squares and product (means over the
/// channels); the largest light of a leaf along links. Sums of the exchange values of [`LocalResult`], weighted by the power that the leaves send out.
#[derive(Clone, Copy, Default)]
struct Traced {
    count: u32,
    area: f64,
    rays: Rgb,
    links: Rgb,
    brightest: Rgb,
    squares: [f64; 2],
    product: f64,
    power: f64,
    row_sum: f64,
    kept: f64,
}

impl Traced {
    /// A leaf with its radiosity and its light along links.
    fn of(area: f64, [links, radiosity]: [Rgb; 2], result: &LocalResult) -> Traced {
        let power = area * mean(radiosity);
        let (by_rays, by_links) = (mean(result.irradiance), mean(links));
        Traced {
            count: 1,
            area,
            rays: result.irradiance.map(|v| area * v),
            links: links.map(|v| area * v),
            brightest: links,
            squares: [area * by_rays * by_rays, area * by_links * by_links],
            product: area * by_rays * by_links,
            power,
            row_sum: power * f64::from(result.row_sum),
            kept: power * f64::from(result.kept),
        }
    }

    fn add(&mut self, other: &Traced) {
        self.count += other.count;
        self.area += other.area;
        add(&mut self.rays, 1.0, other.rays);
        add(&mut self.links, 1.0, other.links);
        (0..3).for_each(|k| self.brightest[k] = self.brightest[k].max(other.brightest[k]));
        (0..2).for_each(|k| self.squares[k] += other.squares[k]);
        self.product += other.product;
        self.power += other.power;
        self.row_sum += other.row_sum;
        self.kept += other.kept;
    }

    /// The light of an untraced leaf with this light along links.
    fn estimate(&self, links: Rgb) -> LocalResult {
        if self.count == 0 {
            return LocalResult {
                irradiance: links,
                noise: mean(links) as f32,
                row_sum: 1.0,
                kept: 1.0,
                ..LocalResult::default()
            };
        }
        // Where links bring no light at all, the mean light by rays is used instead. Single links of unfinished refinement may bring ten thousand times the
        // light of all leaves around: no leaf is brighter than the brightest traced leaf along links.
        let of = |k: usize| match self.links[k] > 0.0 {
            true => links[k].min(self.brightest[k]) * self.rays[k] / self.links[k],
            false => self.rays[k] / self.area,
        };
        let [by_rays, by_links] = [mean(self.rays), mean(self.links)];
        let factor = if by_links > 0.0 { by_rays / by_links } else { 0.0 };
        let sent = |sum: f64| if self.power > 0.0 { (sum / self.power) as f32 } else { 1.0 };
        let [rays2, links2] = self.squares;
        let squares = rays2 - 2.0 * factor * self.product + factor * factor * links2;
        let variance = squares.max(0.0) / self.area * (1.0 + 1.0 / f64::from(self.count));
        LocalResult {
            irradiance: std::array::from_fn(of),
            noise: variance.sqrt() as f32,
            row_sum: sent(self.row_sum),
            kept: sent(self.kept),
            ..LocalResult::default()
        }
    }
}

/// Estimates the light of all `leaves` without rays in `results`. The states of the elements have the light along links.
pub fn estimate_untraced(elements: &Elements, leaves: &[u32], results: &mut [LocalResult]) {
    let parent = |e: u32| elements.elements[e as usize].parent;
    // Elements with children, in their order, so that parents come first; and by element, its place among them.
    let inner: Vec<u32> =
        (0..elements.len() as u32).filter(|&e| !elements.elements[e as usize].is_leaf()).collect();
    let mut place = vec![u32::MAX; elements.len()];
    (0..).zip(&inner).for_each(|(k, &e)| place[e as usize] = k);
    let mut traced = vec![Traced::default(); inner.len()];
    let above = |e: u32| place[parent(e) as usize] as usize;
    for &leaf in leaves.iter().filter(|&&leaf| results[leaf as usize].rays > 0) {
        let state = &elements.states[leaf as usize];
        let light = [state.irradiance, state.radiosity];
        let of = Traced::of(elements.elements[leaf as usize].area, light, &results[leaf as usize]);
        traced[above(leaf)].add(&of);
    }
    for k in (1..inner.len()).rev() {
        let below = traced[k];
        traced[above(inner[k])].add(&below);
    }
    let estimate = |&leaf: &u32| {
        let mut around = above(leaf);
        while around > 0 && traced[around].count < MIN_TRACED {
            around = above(inner[around]);
        }
        (leaf, traced[around].estimate(elements.states[leaf as usize].irradiance))
    };
    let found: Vec<(u32, LocalResult)> =
        leaves.par_iter().filter(|&&leaf| results[leaf as usize].rays == 0).map(estimate).collect();
    found.into_iter().for_each(|(leaf, result)| results[leaf as usize] = result);
}

/// Scales the light of the `leaves` without rays such that all leaves together receive what emitters, sky and suns send them, `received`, and what leaves
/// reflect to each other: Σ A E (1 - s ρ) = `received` for areas A, irradiances E, reflectances ρ and the part s of its light that a leaf sends to others.
/// Links within clutter lose light; without the factor a kitchen lacks 4 % of the emitted power. The power is in W/m² times scene units squared.
pub fn balance_untraced(elements: &Elements, leaves: &[u32], received: Rgb, results: &mut [LocalResult]) {
    // By channel, the power that traced and untraced leaves receive and do not send to others.
    let mut kept = [[0.0; 3]; 2];
    for &leaf in leaves {
        let result = &results[leaf as usize];
        let Shape::Surface { side, .. } = elements.elements[leaf as usize].shape else { continue };
        let reflectance = elements.sides[side as usize].reflectance;
        let sent = f64::from(result.row_sum).min(1.0);
        let own = std::array::from_fn(|k| result.irradiance[k] * (1.0 - sent * f64::from(reflectance[k])));
        add(&mut kept[usize::from(result.rays == 0)], elements.elements[leaf as usize].area, own);
    }
    let factors = factors(received, kept);
    for &leaf in leaves {
        let result = &mut results[leaf as usize];
        if result.rays == 0 {
            result.irradiance.iter_mut().zip(factors).for_each(|(e, factor)| *e *= factor);
        }
    }
}

/// The factors of the light of untraced leaves, by channel, for the power that traced and untraced leaves keep.
fn factors(received: Rgb, [traced, untraced]: [Rgb; 2]) -> Rgb {
    std::array::from_fn(|k| match untraced[k] > 0.0 {
        true => ((received[k] - traced[k]) / untraced[k]).clamp(1.0 / MAX_FACTOR, MAX_FACTOR),
        false => 1.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_rays(value: f64) -> LocalResult {
        LocalResult { irradiance: [value; 3], rays: 4, row_sum: 1.0, kept: 1.0, ..LocalResult::default() }
    }

    /// Light along links that is twice too bright everywhere is corrected without an error; deviations from a common factor are stated.
    #[test]
    fn levels_are_corrected_and_deviations_are_stated() {
        let around = |by_rays: &dyn Fn(f64) -> f64| {
            let mut sum = Traced::default();
            for k in 1..=100 {
                let links = f64::from(k) / 10.0;
                sum.add(&Traced::of(1.0, [[links; 3]; 2], &of_rays(by_rays(links))));
            }
            sum
        };
        let exact = around(&|links| 0.5 * links).estimate([3.0; 3]);
        assert!((exact.irradiance[0] - 1.5).abs() < 1e-9 && exact.noise < 1e-5, "{exact:?}");
        // Rays find the same light everywhere: the error is the spread of the light along links, uniform in 0..10.
        let flat = around(&|_| 5.0).estimate([8.0; 3]);
        let spread = 10.0 / 12f32.sqrt();
        assert!((flat.noise / spread - 1.0).abs() < 0.05, "{flat:?}");
        // Links alone do not make a leaf brighter than all traced leaves.
        let beyond = around(&|links| 0.5 * links).estimate([1e6, 3.0, 10.0]);
        assert!(
            beyond.irradiance.iter().zip([5.0, 1.5, 5.0]).all(|(e, of)| (e - of).abs() < 1e-9),
            "{beyond:?}"
        );
        // Nothing is known without any traced leaf.
        let unknown = Traced::default().estimate([2.0; 3]);
        assert!(unknown.irradiance == [2.0; 3] && unknown.noise == 2.0, "{unknown:?}");
    }

    /// Untraced leaves receive what is missing of the power, within limits; channels without light stay dark.
    #[test]
    fn untraced_leaves_receive_the_missing_power() {
        let [received, traced, untraced] = [[10.0, 10.0, 4.0], [6.0, 9.9, 4.0], [5.0, 5.0, 0.0]];
        let factors = factors(received, [traced, untraced]);
        assert!((traced[0] + factors[0] * untraced[0] - received[0]).abs() < 1e-12, "{factors:?}");
        assert_eq!(factors[1..], [1.0 / MAX_FACTOR, 1.0]);
    }
}
