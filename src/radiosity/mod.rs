//! Hierarchical radiosity: refinement of links by their errors, sweeps of light along them, and what comes out.
//!
//! [`run()`] does all of it for a scene. The solver starts with the link of the root with itself, which stands for all
//! exchange of light [Sillion 95], and refines the links with the greatest errors in steps (progressive multi-gridding
//! [SD95 sec 6.2], method A.12): after every step the light is consistent, so that a solution can be had at any time.
//! In scenes with clusters a local pass ends it: links say what reaches a cluster, rays what reaches each surface in it.

mod audit;
mod clock;
mod cut;
mod direct;
pub mod elements;
mod engine;
mod field;
mod histogram;
mod importance;
mod iterate;
mod krylov;
mod lamps;
mod ledger;
pub mod links;
mod local;
mod more;
mod notes;
mod options;
mod probe;
mod reach;
mod receive;
mod record;
mod refine;
mod rows;
mod run;
mod scaling;
mod show;
mod sizes;
pub mod solution;
mod steps;
mod system;
#[cfg(test)]
mod tests;
mod versus;
mod walk;

pub use audit::Audit;
pub use importance::View;
pub use ledger::Ledger;
pub use more::{Answer, More};
pub use options::{Inside, Options, Oracle, Rows, Visibility};
pub use receive::Receiver;
pub use record::{Ended, Iteration, Outcome, Record, Seconds, Settled, Unlit};
pub use run::{run, run_then};
pub use scaling::{Scaling, ScalingRow, check_scaling, scaling};
pub use versus::{Versus, versus};

use crate::radiosity::elements::Elements;
use crate::radiosity::links::{Between, Light, Link, Meter, Sight, Tally};
use crate::ray::EndRule;
use field::{Incoming, Rgb};
use local::Local;
use probe::Probe;

/// A solution under way.
pub struct Solver {
    elements: Elements,
    links: Vec<Link>,
    probe: Probe,
    sight: Sight,
    ends: EndRule,
    seed: u64,
    /// Feature size for each element as a receiver, and where they come from.
    feature_sizes: Vec<f32>,
    sizes: sizes::Sizes,
    /// What errors count at each element, relative to the most important one; empty if all count.
    importance: Vec<f32>,
    /// By side, whether it is important by itself.
    important: Vec<bool>,
    inside: Inside,
    oracle: Oracle,
    /// Mean irradiance by the emitted power and the mean reflectance, W/m²: what errors are relative to.
    scale: f64,
    /// Radiosity of all elements, irradiance of all surface elements.
    radiosity: Vec<Rgb>,
    incident: Vec<Rgb>,
    /// Where sweeps ended, with the size of their cut.
    state: Option<(usize, Incoming)>,
    /// By element: what leaves that see no way out must gather more to gather all (1 elsewhere).
    closure: Vec<cut::Closure>,
    /// By element: what the row of a leaf that sees no way out must sum up to: 1, or less where something covers part of it.
    whole: Vec<f32>,
    /// How that is made.
    rows: Rows,
    /// What the oracle knows of each element's light.
    light: Vec<Light>,
    /// What the local pass found, if there was one.
    local: Option<Local>,
    tally: Tally,
    /// Seconds that the last sweeps over all links and elements take, for each of them.
    closing: f64,
    /// Links at which refinement stops for lack of memory.
    max_links: usize,
}

impl Solver {
    /// Starts with the root's link.
    pub fn new(elements: Elements, probe: Probe, sight: Sight, ends: EndRule, options: &Options) -> Solver {
        let (mut power, mut absorbed) = (0.0, 0.0);
        for side in &elements.sides {
            let area = elements.elements[side.element as usize].area;
            power += area * mean(side.exitance);
            absorbed += area * (1.0 - mean(side.reflectance.map(f64::from)));
        }
        let scale = if absorbed > 0.0 { power / absorbed } else { 0.0 };
        let root = Link {
            a: 0,
            b: 0,
            coupling: (f64::from(probe.enclosed[0]) * elements.area) as f32,
            transmittance: 1.0,
            variation: [elements.area as f32; 2],
            noise: elements.area as f32,
            rays: 0,
            between: Between::SOMETHING,
        };
        let mut solver = Solver {
            links: vec![root],
            probe,
            sight,
            ends,
            seed: options.seed,
            feature_sizes: Vec::new(),
            sizes: sizes::Sizes { all: options.feature_size, own: vec![f32::INFINITY; elements.sides.len()] },
            importance: Vec::new(),
            important: Vec::new(),
            inside: options.inside,
            oracle: options.oracle,
            scale,
            radiosity: Vec::new(),
            state: None,
            incident: Vec::new(),
            closure: Vec::new(),
            whole: Vec::new(),
            rows: options.rows,
            light: Vec::new(),
            local: None,
            tally: Tally::default(),
            closing: 0.0,
            max_links: options.max_links,
            elements,
        };
        solver.size();
        solver.start();
        solver
    }

    /// The elements.
    pub fn elements(&self) -> &Elements {
        &self.elements
    }

    /// The links.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// How visibility was answered so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    fn meter(&self) -> Meter<'_> {
        Meter {
            elements: &self.elements,
            sight: &self.sight,
            ends: self.ends,
            seed: self.seed,
            inside: self.inside,
        }
    }
}

/// Mean of the channels.
fn mean(v: [f64; 3]) -> f64 {
    (v[0] + v[1] + v[2]) / 3.0
}
