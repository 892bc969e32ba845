//! The visibility engine of a solve.

use crate::model::{Detail, Model, PrepareOptions};
use crate::radiosity::elements::Elements;
use crate::radiosity::links::{VisibilityEngine, sample_bundles};
use crate::radiosity::options::{Options, Visibility};
use crate::visibility::{Bundle, Exact, LeafMode, Workspace};
use std::sync::Arc;

/// Bundles on which the cost of exact rays is estimated: limit the time to 256 walks, and the relative standard error
/// of a mean to 1/16 of the spread of one.
const COST_SAMPLE: usize = 256;

impl Options {
    /// What a model must hold for a solve with these options.
    pub fn prepare(&self) -> PrepareOptions {
        let detail = if self.visibility == Visibility::Exact { Detail::Clusters } else { Detail::Optics };
        PrepareOptions { detail, cache: self.cache.clone(), ..PrepareOptions::default() }
    }
}

/// The exact engine of a model.
pub fn exact_engine(model: &Model) -> Exact {
    Exact { scene: model.traced().clone(), traversal: model.widest_packets() }
}

/// The visibility engine that the options ask for: multi-resolution or average visibility if the model holds optics, otherwise exact
/// rays. The cost of exact rays is estimated on bundles between the surfaces of the scene.
pub fn engine_for(model: &Model, elements: &Elements, options: &Options) -> VisibilityEngine {
    let leaf = match options.visibility {
        Visibility::Exact => return VisibilityEngine::Exact(exact_engine(model)),
        Visibility::Average => LeafMode::Average,
        Visibility::Mr => LeafMode::Exact,
    };
    let Some(engine) = model.engine(model.widest_packets(), leaf) else {
        return VisibilityEngine::Exact(exact_engine(model));
    };
    let sample = sample_bundles(elements, model.end_rule(), COST_SAMPLE, options.seed);
    let bundles: Vec<Bundle> = sample
        .iter()
        .map(|(packet, width)| Bundle {
            packets: std::slice::from_ref(packet),
            emitter_size: *width,
            emitter: &[],
        })
        .collect();
    VisibilityEngine::MultiResolution(Arc::new(engine.with_budget(&bundles, &mut Workspace::default())))
}
