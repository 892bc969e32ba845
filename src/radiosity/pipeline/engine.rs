//! The visibility engine of a solve.

use crate::model::{Detail, Model, PrepareOptions};
use crate::radiosity::elements::Elements;
use crate::radiosity::links::{VisibilityEngine, sample_bundles};
use crate::radiosity::options::Options;
use crate::visibility::{Bundle, CALIBRATION_BUNDLES, Engine, LeafMode, Workspace};
use std::sync::Arc;

impl Options {
    /// The engine of a solve of `model`: what [`Engine::Automatic`] stands for, other engines as they are.
    pub(crate) fn chosen_engine(&self, model: &Model) -> Engine {
        model.chosen(self.engine, self.feature_size.is_some() || !self.feature_sizes.is_empty())
    }

    /// What a model must hold for a solve with these options.
    #[doc(hidden)]
    pub fn prepare(&self) -> PrepareOptions {
        let detail = if self.engine == Engine::Exact { Detail::Clusters } else { Detail::Optics };
        PrepareOptions {
            detail,
            builder: self.builder,
            cache: self.cache.folder(),
            ..PrepareOptions::default()
        }
    }
}

/// The visibility engine that the options ask for: multi-resolution or average visibility if the model holds optics, otherwise exact
/// rays. The cost of exact rays is estimated on bundles between the surfaces of the scene.
pub fn engine_for(model: &Model, elements: &Elements, options: &Options) -> VisibilityEngine {
    let leaf = match options.chosen_engine(model) {
        Engine::Exact | Engine::Automatic => return VisibilityEngine::Exact(model.exact()),
        Engine::Average => LeafMode::Average,
        Engine::MultiResolution => LeafMode::Exact,
    };
    let Some(engine) = model.engine(model.widest_packets(), leaf) else {
        return VisibilityEngine::Exact(model.exact());
    };
    let sample = sample_bundles(elements, CALIBRATION_BUNDLES, options.seed);
    let bundles: Vec<Bundle> = sample.iter().map(|(p, width)| Bundle::of_packet(p, *width)).collect();
    VisibilityEngine::MultiResolution(Arc::new(engine.with_budget(&bundles, &mut Workspace::default())))
}
