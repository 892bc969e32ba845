//! Models for tests.

use super::{Detail, Model, PrepareOptions};
use crate::scene::Scene;

/// The model of a scene, without a cache.
pub fn model(scene: &Scene, detail: Detail) -> Model {
    let options = PrepareOptions { detail, ..PrepareOptions::default() };
    Model::prepare(scene.clone(), &options).expect("a model")
}

/// The same model, whose report states `seconds` for the preparation.
pub fn prepared_in(mut model: Model, seconds: f64) -> Model {
    let inner = std::sync::Arc::get_mut(&mut model.inner).expect("no other copy");
    inner.report.embree_s = seconds;
    model
}
