//! Leaves that were not traced for lack of time: the light along links, corrected by the results of rays at leaves around them.
//!
//! Links distribute the light of a cluster among its surfaces by orientation, but the level of this light may be far off. The correction
//! factor is that of the traced leaves in the smallest element or cluster above an untraced leaf that contains enough of them: their
//! light by rays over their light along links. The deviation of the traced leaves from the factor is the error bar of the untraced leaf.
//! All untraced leaves together are then scaled towards the power that the traced ones leave over.

use super::local_noise::LocalResult;
use crate::math::parallel;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::SkyPower;
use glam::Vec3;
use std::array::from_fn;

/// Smallest number of traced leaves that determine the factor: their deviation is known to 1/√(2 · 7) = 27 %.
const MIN_TRACED: u32 = 8;
/// Smallest number of traced leaves of which the brightest bounds the light of untraced ones: one more leaf of the same kind is brighter
/// than all of them with a probability of 1/65.
const MIN_BOUNDING: u32 = 64;
/// Largest factor of [`Surrounding::balance`], and the inverse of the smallest: the whole of the untraced leaves is known to a factor of
/// 2 by the traced ones around them, so that a larger factor is an error of the balance.
const MAX_FACTOR: f64 = 2.0;

/// Area-weighted sums over traced leaves: of the light by rays and along links, and of their squares and product (means over the
/// channels); the largest light of a leaf by rays. Sums of the exchange values of [`LocalResult`], weighted by the power that the leaves
/// send out.
#[derive(Clone, Copy, Default)]
struct TracedSums {
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

impl TracedSums {
    /// A leaf with its radiosity and its light along links.
    fn of(area: f64, links: Rgb, radiosity: Rgb, result: &LocalResult) -> TracedSums {
        let power = area * mean(radiosity);
        let (by_rays, by_links) = (mean(result.irradiance), mean(links));
        TracedSums {
            count: 1,
            area,
            rays: result.irradiance.map(|v| area * v),
            links: links.map(|v| area * v),
            brightest: result.irradiance,
            squares: [area * by_rays * by_rays, area * by_links * by_links],
            product: area * by_rays * by_links,
            power,
            row_sum: power * f64::from(result.row_sum),
            kept: power * f64::from(result.kept),
        }
    }

    fn add(&mut self, other: &TracedSums) {
        self.count += other.count;
        self.area += other.area;
        add(&mut self.rays, 1.0, other.rays);
        add(&mut self.links, 1.0, other.links);
        larger(&mut self.brightest, &other.brightest);
        (0..2).for_each(|k| self.squares[k] += other.squares[k]);
        self.product += other.product;
        self.power += other.power;
        self.row_sum += other.row_sum;
        self.kept += other.kept;
    }

    /// The light of an untraced leaf with this light along links that is at most the `brightest` traced leaf around.
    fn estimate(&self, links: Rgb, brightest: Rgb) -> LocalResult {
        if self.count == 0 {
            return LocalResult {
                irradiance: links,
                noise: mean(links) as f32,
                row_sum: 1.0,
                kept: 1.0,
                ..LocalResult::default()
            };
        }
        // Where links bring no light at all, the mean light by rays is used instead. Where they bring most of it to small leaves, the
        // factor is large.
        let of = |k: usize| match self.links[k] > 0.0 {
            true => (links[k] * self.rays[k] / self.links[k]).min(brightest[k]),
            false => self.rays[k] / self.area,
        };
        let [by_rays, by_links] = [mean(self.rays), mean(self.links)];
        let factor = if by_links > 0.0 { by_rays / by_links } else { 0.0 };
        let sent = |sum: f64| if self.power > 0.0 { (sum / self.power) as f32 } else { 1.0 };
        let [rays2, links2] = self.squares;
        let squares = rays2 - 2.0 * factor * self.product + factor * factor * links2;
        let variance = squares.max(0.0) / self.area * (1.0 + 1.0 / f64::from(self.count));
        LocalResult {
            irradiance: from_fn(of),
            noise: variance.sqrt() as f32,
            row_sum: sent(self.row_sum),
            kept: sent(self.kept),
            ..LocalResult::default()
        }
    }
}

/// Replaces each channel of `a` by the maximum of `a` and `b`.
fn larger(a: &mut Rgb, b: &Rgb) {
    (0..3).for_each(|k| a[k] = a[k].max(b[k]));
}

/// The elements and clusters above leaves, with the traced leaves below each.
pub struct Surrounding<'a> {
    elements: &'a Elements,
    /// Elements with children, parents first.
    inner: Vec<u32>,
    /// By element, its place in `inner`.
    place: Vec<u32>,
    /// By place, the number of traced leaves below.
    counts: Vec<u32>,
}

impl<'a> Surrounding<'a> {
    /// The surroundings with these traced leaves.
    pub fn new(elements: &'a Elements, traced: &[u32]) -> Surrounding<'a> {
        let inner: Vec<u32> =
            (0..elements.len() as u32).filter(|&e| !elements.elements[e as usize].is_leaf()).collect();
        let mut place = vec![u32::MAX; elements.len()];
        (0..).zip(&inner).for_each(|(k, &e)| place[e as usize] = k);
        let mut found = Surrounding { elements, inner, place, counts: Vec::new() };
        found.counts = found.sums(traced.iter().map(|&leaf| (leaf, 1)), |sum, count| *sum += count);
        found
    }

    /// The place of the element above one.
    fn above(&self, e: u32) -> usize {
        self.place[self.elements.elements[e as usize].parent as usize] as usize
    }

    /// By place, the sum of the values of the leaves below.
    fn sums<T: Copy + Default>(
        &self,
        leaves: impl Iterator<Item = (u32, T)>,
        add: impl Fn(&mut T, &T),
    ) -> Vec<T> {
        let mut sums = vec![T::default(); self.inner.len()];
        leaves.for_each(|(leaf, value)| add(&mut sums[self.above(leaf)], &value));
        for k in (1..self.inner.len()).rev() {
            let below = sums[k];
            add(&mut sums[self.above(self.inner[k])], &below);
        }
        sums
    }

    /// The place of the smallest element above a leaf with at least `count` traced leaves, or of the root.
    fn of(&self, leaf: u32, count: u32) -> usize {
        let mut around = self.above(leaf);
        while around > 0 && self.counts[around] < count {
            around = self.above(self.inner[around]);
        }
        around
    }

    /// Caps the light along links of untraced leaves, by element: single links of unfinished refinement may bring ten thousand times the
    /// light of all leaves around. No leaf is brighter than the brightest traced leaf along links around it. Returns the fraction, by
    /// channel, that each of `untraced` keeps.
    pub fn cap_links(&self, traced: &[u32], untraced: &[u32]) -> Vec<Vec3> {
        let links = |leaf: u32| self.elements.states[leaf as usize].irradiance;
        let brightest = self.sums(traced.iter().map(|&leaf| (leaf, links(leaf))), larger);
        let part = |&leaf: &u32| {
            let around = self.of(leaf, MIN_BOUNDING);
            let (own, most) = (links(leaf), brightest[around]);
            let is_known = self.counts[around] > 0;
            let of = |k: usize| if is_known && own[k] > most[k] { most[k] / own[k] } else { 1.0 };
            Vec3::from_array(from_fn(|k| of(k) as f32))
        };
        parallel::map(untraced, part)
    }

    /// Estimates the light of leaves without rows from that of the traced ones in `results`. `part`: the fraction of the light along
    /// links that a leaf keeps.
    pub fn estimate(
        &self,
        traced: &[u32],
        leaves: &[u32],
        part: impl Fn(u32) -> Vec3 + Sync,
        results: &mut [LocalResult],
    ) {
        let of = |leaf: u32| {
            let state = &self.elements.states[leaf as usize];
            let area = self.elements.elements[leaf as usize].area;
            TracedSums::of(area, state.irradiance, state.radiosity, &results[leaf as usize])
        };
        let sums = self.sums(traced.iter().map(|&leaf| (leaf, of(leaf))), TracedSums::add);
        let estimate = |&leaf: &u32| {
            let (links, part) = (self.elements.states[leaf as usize].irradiance, part(leaf));
            let brightest = sums[self.of(leaf, MIN_BOUNDING)].brightest;
            let links = from_fn(|k| f64::from(part[k]) * links[k]);
            (leaf, sums[self.of(leaf, MIN_TRACED)].estimate(links, brightest))
        };
        let found: Vec<(u32, LocalResult)> = parallel::map(leaves, estimate);
        found.into_iter().for_each(|(leaf, result)| results[leaf as usize] = result);
    }

    /// The power that arrives at untraced leaves from beyond the scene: as much per area as at the traced leaves around them, whose
    /// irradiance by the sky and by suns is given.
    pub fn arrived(&self, traced: impl Iterator<Item = (u32, [Vec3; 2])>, untraced: &[u32]) -> SkyPower {
        let area = |leaf: u32| self.elements.elements[leaf as usize].area;
        let of = |(leaf, [sky, sun]): (u32, [Vec3; 2])| {
            (leaf, (area(leaf), SkyPower::of([(area(leaf), sky, sun)].into_iter())))
        };
        let sums = self.sums(traced.map(of), |sum: &mut (f64, SkyPower), other| {
            sum.0 += other.0;
            sum.1.add(other.1);
        });
        let mut all = SkyPower::default();
        for &leaf in untraced {
            let (around, arrived) = sums[self.of(leaf, MIN_TRACED)];
            if around > 0.0 {
                all.add(arrived.times(area(leaf) / around));
            }
        }
        all
    }

    /// Scales the light of `untraced` leaves towards what balances the scene: all `leaves` together receive what emitters, sky and suns
    /// send them, `received`, and what leaves reflect to each other, Σ A E (1 - s ρ) = `received` for areas A, irradiances E,
    /// reflectances ρ and the fraction s of its light that a leaf sends to others. Links within clutter lose light; without the factor a
    /// kitchen lacks 4 % of the emitted power. Both sides are uncertain: the light of untraced leaves by their noise u, which they share,
    /// and the rest by `error`. The factor is the mean of 1 and of the one that balances, weighted by 1 / u² and 1 / error². Powers are
    /// in W/m² times scene units squared.
    pub fn balance(
        &self,
        leaves: &[u32],
        untraced: &[u32],
        received: Rgb,
        error: f64,
        results: &mut [LocalResult],
    ) {
        let kept = |leaf: u32| {
            let (element, result) = (&self.elements.elements[leaf as usize], &results[leaf as usize]);
            let Shape::Surface { side, .. } = element.shape else { return ([0.0; 3], 0.0) };
            let reflectance = self.elements.sides[side as usize].reflectance;
            let sent = f64::from(result.row_sum).min(1.0);
            let part: Rgb = from_fn(|k| element.area * (1.0 - sent * f64::from(reflectance[k])));
            (from_fn(|k| part[k] * result.irradiance[k]), mean(part) * f64::from(result.noise))
        };
        let sum = |leaves: &[u32]| {
            leaves.iter().fold(([0.0; 3], 0.0), |mut sum, &leaf| {
                let (power, noise) = kept(leaf);
                add(&mut sum.0, 1.0, power);
                (sum.0, sum.1 + noise)
            })
        };
        let (all, (own, noise)) = (sum(leaves).0, sum(untraced));
        let weight = noise.powi(2) / (noise.powi(2) + error.powi(2)).max(f64::MIN_POSITIVE);
        let factor = |k: usize| match own[k] > 0.0 {
            true => (1.0 + weight * (received[k] - all[k]) / own[k]).clamp(1.0 / MAX_FACTOR, MAX_FACTOR),
            false => 1.0,
        };
        let factors: Rgb = from_fn(factor);
        for &leaf in untraced {
            let result = &mut results[leaf as usize];
            result.irradiance.iter_mut().zip(factors).for_each(|(e, factor)| *e *= factor);
            result.noise *= mean(factors) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clusters;
    use crate::scene::testing::Pieces;
    use glam::DVec3;

    fn of_rays(value: f64) -> LocalResult {
        LocalResult { irradiance: [value; 3], rays: 4, row_sum: 1.0, kept: 1.0, ..LocalResult::default() }
    }

    /// Light along links that is twice too bright everywhere is corrected without an error; deviations from a common factor are stated.
    #[test]
    fn levels_are_corrected_and_deviations_are_stated() {
        let around = |by_rays: &dyn Fn(f64) -> f64| {
            let mut sum = TracedSums::default();
            for k in 1..=100 {
                let links = f64::from(k) / 10.0;
                sum.add(&TracedSums::of(1.0, [links; 3], [links; 3], &of_rays(by_rays(links))));
            }
            sum
        };
        let exact = around(&|links| 0.5 * links).estimate([3.0; 3], [5.0; 3]);
        assert!((exact.irradiance[0] - 1.5).abs() < 1e-9 && exact.noise < 1e-5, "{exact:?}");
        // Rays find the same light everywhere: the error is the spread of the light along links, uniform in 0..10.
        let flat = around(&|_| 5.0).estimate([8.0; 3], [5.0; 3]);
        let spread = 10.0 / 12f32.sqrt();
        assert!((flat.noise / spread - 1.0).abs() < 0.05, "{flat:?}");
        // No leaf is brighter than the brightest traced one.
        let beyond = around(&|links| 0.5 * links).estimate([1e6, 3.0, 10.0], [5.0; 3]);
        assert!(
            beyond.irradiance.iter().zip([5.0, 1.5, 5.0]).all(|(e, of)| (e - of).abs() < 1e-9),
            "{beyond:?}"
        );
        // Nothing is known without any traced leaf.
        let unknown = TracedSums::default().estimate([2.0; 3], [5.0; 3]);
        assert!(unknown.irradiance == [2.0; 3] && unknown.noise == 2.0, "{unknown:?}");
    }

    /// A room of which every second leaf is traced. Light along links that is far too bright at an untraced leaf is capped; untraced
    /// leaves receive what is missing of the power, as far as it is known better than their light, and what arrives on an area as large
    /// of the sky; traced leaves keep their light.
    #[test]
    fn untraced_leaves_receive_what_is_missing() {
        let mut pieces = Pieces::empty();
        pieces.grey("shelves", 0.5);
        (0..20).for_each(|k| {
            pieces.rectangle(DVec3::Z * f64::from(k), DVec3::X, f64::from(1 + k) * DVec3::Y);
        });
        let scene = pieces.scene();
        let mut elements = Elements::build(&scene, &clusters::build(&scene, &Default::default()), 0.1, &[]);
        let is_leaf = |e: &u32| elements.elements[*e as usize].is_leaf();
        let leaves: Vec<u32> = (0..elements.len() as u32).filter(is_leaf).collect();
        let [traced, untraced] =
            [0, 1].map(|odd| leaves.iter().copied().skip(odd).step_by(2).collect::<Vec<u32>>());
        leaves.iter().for_each(|&leaf| elements.states[leaf as usize].irradiance = [2.0; 3]);
        elements.states[untraced[0] as usize].irradiance = [1e4, 2.0, 1.0];
        let elements = &elements;
        let around = Surrounding::new(elements, &traced);
        let parts = around.cap_links(&traced, &untraced);
        assert!(parts[0].distance(Vec3::new(2e-4, 1.0, 1.0)) < 1e-7 && parts[1] == Vec3::ONE, "{parts:?}");
        let mut results = vec![LocalResult::default(); elements.len()];
        traced.iter().for_each(|&leaf| results[leaf as usize] = of_rays(1.0));
        let part = |leaf: u32| if leaf == untraced[0] { parts[0] } else { Vec3::ONE };
        around.estimate(&traced, &untraced, part, &mut results);
        let light = |results: &[LocalResult], leaf: u32| results[leaf as usize].irradiance;
        for (leaf, want) in [(untraced[0], [1.0, 1.0, 0.5]), (untraced[1], [1.0; 3])] {
            let found = light(&results, leaf);
            assert!(found.iter().zip(want).all(|(e, want)| (e - want).abs() < 1e-6), "{found:?}");
        }
        let area = |leaves: &[u32]| leaves.iter().map(|&e| elements.elements[e as usize].area).sum::<f64>();
        let arrived = around.arrived(traced.iter().map(|&leaf| (leaf, [Vec3::ONE, Vec3::ZERO])), &untraced);
        assert!(
            (arrived.sky[0] / area(&untraced) - 1.0).abs() < 1e-6 && arrived.sun == [0.0; 3],
            "{arrived:?}"
        );
        // The power that all would keep if untraced leaves had half as much light again.
        let wanted = |results: &[LocalResult], factor: f64| {
            let of = |leaf: u32| {
                let Shape::Surface { side, .. } = elements.elements[leaf as usize].shape else {
                    unreachable!()
                };
                let kept = 1.0 - f64::from(elements.sides[side as usize].reflectance[1]);
                elements.elements[leaf as usize].area * kept * results[leaf as usize].irradiance[1]
            };
            traced.iter().map(|&e| of(e)).sum::<f64>() + factor * untraced.iter().map(|&e| of(e)).sum::<f64>()
        };
        for (noise, want) in [(1.0, 1.5), (0.0, 1.0)] {
            let mut results = results.clone();
            untraced.iter().for_each(|&leaf| results[leaf as usize].noise = noise);
            let received = [wanted(&results, 1.5); 3];
            around.balance(&leaves, &untraced, received, 1e-6, &mut results);
            let found = light(&results, untraced[1])[1];
            assert!(
                (found - want).abs() < 1e-6 && light(&results, traced[0]) == [1.0; 3],
                "{noise}: {found}"
            );
            assert!((results[untraced[1] as usize].noise - noise * want as f32).abs() < 0.1);
        }
    }
}
