//! Scenes prepared for tests of the engines.

use super::{LeafMode, MultiResolution, WideTree};
use crate::clusters::{self, Hierarchy};
use crate::embree::{CommittedScene, Traversal, committed};
use crate::optics::{self, ClusterOptics};
use crate::scene::Scene;
use std::sync::Arc;

pub const SINGLE: Traversal = Traversal { width: 1, coherent: false };

/// A scene with cluster hierarchy, optics and Embree scene.
pub struct Stage {
    pub scene: Scene,
    pub hierarchy: Hierarchy,
    pub optics: Vec<ClusterOptics>,
    pub traced: CommittedScene,
}

impl Stage {
    pub fn with(scene: Scene, options: &clusters::Options, how: &optics::Options) -> Stage {
        let hierarchy = clusters::build(&scene, options);
        hierarchy.check(&scene).expect("hierarchy");
        let optics = optics::measure(&scene, &hierarchy.micro, how);
        let traced = committed(&scene.positions, &scene.triangles);
        Stage { scene, hierarchy, optics, traced }
    }

    /// A scene in which all surfaces belong to clusters: nothing counts as large.
    pub fn apart(scene: Scene, how: &optics::Options) -> Stage {
        let apart = clusters::Options { large_surface: f32::INFINITY, ..Default::default() };
        Stage::with(scene, &apart, how)
    }

    pub fn engine(&self, leaf: LeafMode) -> MultiResolution {
        let tree = WideTree::build(&self.scene, &self.hierarchy, &self.optics);
        MultiResolution::new(Arc::new(tree), self.traced.clone(), SINGLE, leaf)
    }
}
