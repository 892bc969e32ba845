//! A scene whose light is final.

use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::ElementState;
use crate::radiosity::final_gather::{Gathered, LocalPass};
use crate::radiosity::refinement::{LinkClosing, LinkedScene, Refined};
use crate::radiosity::rgb::{Rgb, add};

/// Where the final light comes from.
pub enum Closing {
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
    /// Where the light comes from.
    pub closing: Closing,
}

impl Solved {
    /// The final light along links.
    pub fn by_links(mut refined: Refined, deadline: &Deadline) -> Solved {
        let closing = Closing::Links(refined.close_links(deadline));
        Solved { linked: refined.linked, closing }
    }

    /// A scene without light of its elements.
    pub fn without_elements(refined: Refined) -> Solved {
        Solved { linked: refined.linked, closing: Closing::Nothing }
    }

    /// The final light of the local pass.
    pub fn by_rays(mut linked: LinkedScene, local: LocalPass) -> Solved {
        linked.tally.add(local.tally);
        linked.set_irradiance(local.results.iter().map(|r| r.irradiance));
        Solved { linked, closing: Closing::Rays(local) }
    }

    /// The same scene with the light that its elements gathered by more rays.
    pub fn with_gathered(mut self, gathered: Gathered) -> Solved {
        self.linked.tally.add(gathered.tally);
        if let Closing::Rays(local) = &mut self.closing {
            local.received = gathered.received;
            for (leaf, light) in gathered.light {
                let result = &mut local.results[leaf as usize];
                result.irradiance = light.irradiance;
                result.noise = light.error.sqrt() as f32;
            }
            self.linked.set_irradiance(local.results.iter().map(|r| r.irradiance));
        }
        self
    }

    /// Mean irradiance of the sides that light arrives at, W/m²; no number where elements have no light.
    pub fn mean_irradiance(&self) -> Rgb {
        if matches!(self.closing, Closing::Nothing) {
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
