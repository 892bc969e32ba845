//! A scene whose light is final.

use crate::model::Model;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{ElementState, Elements, Shape};
use crate::radiosity::final_gather::{ElementSamples, FinalGather, LocalPass, limit_negative_light};
use crate::radiosity::options::Options;
use crate::radiosity::refinement::{LinkClosing, LinkedScene, Refined};
use crate::radiosity::rgb::{Rgb, add};

/// Largest factor by which light along links is scaled to conserve its power, and the inverse of the smallest: light that is off by
/// more is wrong in its distribution as well, which no factor repairs; the ledger then shows the difference.
const MAX_POWER_FACTOR: f64 = 2.0;

/// Method of the final light, with its results.
pub enum FinalLight {
    /// Links.
    Links(LinkClosing),
    /// Rays of the local pass.
    Rays(LocalPass),
    /// Elements have no light: only direct light at points is asked for.
    Nothing,
}

/// A scene whose light is final.
pub struct Solved {
    /// Elements, links and light.
    pub linked: LinkedScene,
    /// Method of the light, with its results.
    pub closing: FinalLight,
}

impl Solved {
    /// The final light along links.
    pub fn by_links(mut refined: Refined, deadline: &Deadline) -> Solved {
        let closing = FinalLight::Links(refined.close_links(deadline));
        let mut solved = Solved { linked: refined.linked, closing };
        solved.balance_power();
        solved
    }

    /// Multiplies the light of all leaves by a factor for each channel, so that leaves receive as much power as they send to each other.
    /// No factors bring all row sums of a few coarse links to 1, so that the factors by which they gather and send differ and power would
    /// appear or vanish: 6 % of the power of a town with 143 links.
    fn balance_power(&mut self) {
        let Elements { elements, states, sides, .. } = &self.linked.elements;
        // `sent`: the power from emitters and from beyond the scene to leaves. `lost`: the power that leaves absorb or lose.
        let (mut sent, mut lost) = ([0.0; 3], [0.0; 3]);
        if let FinalLight::Links(links) = &self.closing {
            add(&mut sent, 1.0, links.arrived.sky);
            add(&mut sent, 1.0, links.arrived.sun);
        }
        for leaf in self.linked.leaves() {
            let Shape::Surface { side, .. } = elements[leaf as usize].shape else { continue };
            let (area, side) = (elements[leaf as usize].area, &sides[side as usize]);
            let part = self.row_sums(leaf as usize).sent.min(1.0);
            let kept = |k: usize| 1.0 - part * f64::from(side.reflectance[k]);
            add(&mut sent, area * part, side.exitance);
            add(&mut lost, area, std::array::from_fn(|k| kept(k) * states[leaf as usize].irradiance[k]));
        }
        let factor = |k: usize| match sent[k] > 0.0 && lost[k] > 0.0 {
            true => (sent[k] / lost[k]).clamp(1.0 / MAX_POWER_FACTOR, MAX_POWER_FACTOR),
            false => 1.0,
        };
        let factors: Rgb = std::array::from_fn(factor);
        let balanced = |state: &ElementState| std::array::from_fn(|k| factors[k] * state.irradiance[k]);
        let light: Vec<Rgb> = states.iter().map(balanced).collect();
        self.linked.set_irradiance(light.into_iter());
        self.linked.update_oracle_statistics();
    }

    /// The final light of the local pass.
    pub fn by_rays(mut linked: LinkedScene, local: LocalPass) -> Solved {
        linked.tally.add(local.tally);
        linked.set_irradiance(local.results.iter().map(|r| r.irradiance));
        Solved { linked, closing: FinalLight::Rays(local) }
    }

    /// The light of elements by a fraction of their rays; none where there is no time for rays.
    pub fn sample_elements(
        &mut self,
        model: &Model,
        options: &Options,
        part: f64,
        deadline: &Deadline,
    ) -> Option<ElementSamples> {
        let FinalLight::Rays(local) = &mut self.closing else { return None };
        let rays = part * local.element_rays.filter(|_| !deadline.late())?;
        let known = std::mem::take(&mut local.samples);
        Some(FinalGather::new(model, &self.linked, options).sample_elements(local, known, rays, deadline))
    }

    /// Splits leaves into parts with the same light, which are returned.
    pub fn split(&mut self, leaves: &[u32]) -> Vec<u32> {
        let first = self.linked.elements.len() as u32;
        for &leaf in leaves {
            self.linked.split(leaf);
            if let FinalLight::Rays(local) = &mut self.closing {
                local.results.resize(self.linked.elements.len(), local.results[leaf as usize]);
            }
        }
        (first..self.linked.elements.len() as u32).collect()
    }

    /// Adds the light of the parts of leaves that were split.
    pub fn sample_parts(
        &self,
        model: &Model,
        options: &Options,
        samples: &mut ElementSamples,
        parts: &[u32],
        deadline: &Deadline,
    ) {
        let FinalLight::Rays(local) = &self.closing else { return };
        FinalGather::new(model, &self.linked, options).sample_parts(samples, local, parts, deadline);
    }

    /// Gives elements the light of their samples, shared between neighbours. Returns the number of leaves without samples.
    pub fn share_samples(
        &mut self,
        model: &Model,
        options: &Options,
        samples: ElementSamples,
        deadline: &Deadline,
    ) -> usize {
        let FinalLight::Rays(local) = &mut self.closing else { return 0 };
        let gather = FinalGather::new(model, &self.linked, options);
        let gathered = gather.share_samples(samples, local, deadline);
        self.linked.tally.add(gathered.tally);
        (local.received, local.arrived) = (gathered.received, gathered.arrived);
        for (leaf, light) in gathered.light {
            let result = &mut local.results[leaf as usize];
            result.irradiance = light.irradiance;
            result.noise = light.error.sqrt() as f32;
        }
        self.linked.set_irradiance(local.results.iter().map(|r| r.irradiance));
        gathered.skipped
    }

    /// The irradiance of all elements without negative values, W/m². Light to gather from keeps them, see [`limit_negative_light`].
    pub(super) fn shown_irradiance(&self) -> Vec<Rgb> {
        let mut light = self.linked.elements.states.iter().map(|state| state.irradiance).collect::<Vec<_>>();
        limit_negative_light(&self.linked.elements, &mut light);
        light
    }

    /// Mean irradiance of the sides that [count](LinkedScene::lit_sides), W/m²; NaN where elements have no light.
    pub fn mean_irradiance(&self) -> Rgb {
        if matches!(self.closing, FinalLight::Nothing) {
            return [f64::NAN; 3];
        }
        let elements = &self.linked.elements;
        let (mut sum, mut area) = ([0.0; 3], 0.0);
        for e in self.linked.lit_leaves() {
            let own = elements.elements[e as usize].area;
            area += own;
            add(&mut sum, own, elements.states[e as usize].irradiance);
        }
        sum.map(|s| if area > 0.0 { s / area } else { 0.0 })
    }

    /// Whether all light is a finite number.
    pub fn is_finite(&self) -> bool {
        let light = |s: &ElementState| [s.irradiance, s.radiosity];
        self.linked.elements.states.iter().flat_map(light).flatten().all(f64::is_finite)
    }
}
