//! What tests of the engines stand on.

use super::{Leaf, MultiResolution};
use crate::characterise::{self, Traits, characterise};
use crate::embree::{CommittedScene, Device, SceneBuilder, Traversal};
use crate::hierarchy::{self, Hierarchy};
use crate::scene::Scene;

pub const SINGLE: Traversal = Traversal { width: 1, coherent: false };

/// A scene with all that the engines need.
pub struct Stage {
    pub scene: Scene,
    pub hierarchy: Hierarchy,
    pub traits: Vec<Traits>,
    pub traced: CommittedScene,
}

impl Stage {
    pub fn with(scene: Scene, options: &hierarchy::Options, how: &characterise::Options) -> Stage {
        let hierarchy = hierarchy::build(&scene, options);
        hierarchy.check(&scene).expect("hierarchy");
        let traits = characterise(&scene, &hierarchy.micro, how);
        let device = Device::new(1).expect("device");
        let mut builder = SceneBuilder::new(&device, Default::default()).expect("builder");
        builder.add_triangles(&scene.positions, &scene.triangles, 1).expect("triangles");
        let traced = builder.commit().expect("scene");
        Stage { scene, hierarchy, traits, traced }
    }

    /// Clusters that are averaged whatever is in them: nothing counts as large.
    pub fn apart(scene: Scene, how: &characterise::Options) -> Stage {
        let apart = hierarchy::Options { large_surface: f32::INFINITY, ..Default::default() };
        Stage::with(scene, &apart, how)
    }

    pub fn engine(&self, leaf: Leaf) -> MultiResolution<'_> {
        MultiResolution::new(&self.scene, &self.hierarchy, &self.traits, &self.traced, SINGLE, leaf)
    }
}
