//! Models for tests.

use super::{Detail, Model, PrepareOptions};
use crate::scene::Scene;

/// The model of a scene, without a cache.
pub fn model(scene: &Scene, detail: Detail) -> Model {
    let options = PrepareOptions { detail, ..PrepareOptions::default() };
    Model::prepare(scene.clone(), &options, &()).expect("a model")
}
