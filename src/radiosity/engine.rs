//! The visibility engine of a solve.

use super::options::{Options, Visibility};
use crate::model::{Detail, Model, PrepareOptions};
use crate::radiosity::elements::Elements;
use crate::radiosity::links::across;
use crate::visibility::{Bundle, Leaf, MultiResolution, Workspace};

/// Bundles on which the cost of exact rays is estimated.
const SAMPLE: usize = 256;

impl Options {
    /// What a model must hold for a solve with these options.
    pub fn prepare(&self) -> PrepareOptions {
        let detail = if self.visibility == Visibility::Exact { Detail::Clusters } else { Detail::Optics };
        PrepareOptions { detail, cache: self.cache.clone(), ..PrepareOptions::default() }
    }
}

/// The multi-resolution engine, if the options ask for one and the model holds optics. The cost of exact rays is estimated on
/// bundles between the surfaces of the scene.
pub(super) fn engine_for(model: &Model, elements: &Elements, options: &Options) -> Option<MultiResolution> {
    let leaf = match options.visibility {
        Visibility::Exact => return None,
        Visibility::Average => Leaf::Extinction,
        _ => Leaf::Exact,
    };
    let tree = model.base().measured()?.tree.clone();
    let engine = MultiResolution::new(tree, model.traced().clone(), model.widest_packets(), leaf);
    let sample = across(elements, model.end_rule(), SAMPLE, options.seed);
    let bundles: Vec<Bundle> = sample
        .iter()
        .map(|(packet, width)| Bundle {
            packets: std::slice::from_ref(packet),
            emitter_size: *width,
            emitter: &[],
        })
        .collect();
    Some(engine.with_budget(&bundles, &mut Workspace::default()))
}
