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

    /// Mean irradiance of all elements, W/m².
    pub fn mean_irradiance(&self) -> Rgb {
        let elements = &self.linked.elements;
        let mut sum = [0.0; 3];
        for (element, state) in elements.elements.iter().zip(elements.states.iter()) {
            if element.is_leaf() && !element.is_cluster() {
                add(&mut sum, element.area / elements.area, state.irradiance);
            }
        }
        sum
    }

    /// Whether all light is a finite number.
    pub fn is_finite(&self) -> bool {
        let light = |s: &ElementState| [s.irradiance, s.radiosity];
        self.linked.elements.states.iter().flat_map(light).flatten().all(f64::is_finite)
    }
}
