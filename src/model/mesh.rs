//! A mesh of the model: triangles in a local frame with everything that is prepared once for all its instances.

use crate::Result;
use crate::clusters::Hierarchy;
use crate::embree::{CommittedScene, Device, GridPiece, SceneBuilder};
use crate::optics::ClusterOptics;
use crate::optics::groups::Part;
use crate::ray::EndRule;
use crate::scene::{Piece, Scene};
use crate::visibility::WideTree;
use std::sync::{Arc, OnceLock};

/// Triangles in a local frame, their Embree scene, and their clusters with optics as far as they were asked for.
///
/// Instances share a mesh; none of its parts changes when instances move.
pub struct Mesh {
    pub(super) scene: Arc<Scene>,
    pub(super) traced: CommittedScene,
    pub(super) clusters: Option<Arc<Clusters>>,
    magnitudes: OnceLock<Vec<f32>>,
}

/// The clusters of a mesh.
pub struct Clusters {
    /// Cluster trees over the triangles of the mesh.
    pub hierarchy: Arc<Hierarchy>,
    /// Optics of `hierarchy.micro`, one entry a cluster, and the tree that the multi-resolution engine walks; none if only
    /// the trees were asked for.
    pub measured: Option<Measured>,
}

/// Optics and traversal tree for multi-resolution visibility, besides the cluster trees.
pub struct Measured {
    /// One entry a cluster of `hierarchy.micro`.
    pub optics: Vec<ClusterOptics>,
    /// The same clusters, sixteen children side by side.
    pub tree: Arc<WideTree>,
    /// The boxes that stand for the mesh in groups of instances.
    pub parts: Vec<Part>,
}

impl Measured {
    /// Bytes of `parts`.
    pub fn part_bytes(&self) -> usize {
        size_of_val(self.parts.as_slice())
    }
}

impl Mesh {
    pub(super) fn new(scene: Arc<Scene>, traced: CommittedScene, clusters: Option<Arc<Clusters>>) -> Mesh {
        Mesh { scene, traced, clusters, magnitudes: OnceLock::new() }
    }

    /// Memory of the clusters, bytes.
    pub(super) fn cluster_bytes(&self) -> usize {
        let of = |clusters: &Arc<Clusters>| {
            let trees = clusters.hierarchy.micro.bytes() + clusters.hierarchy.large.bytes();
            let measured = |m: &Measured| size_of_val(m.optics.as_slice()) + m.tree.bytes() + m.part_bytes();
            trees + clusters.measured.as_ref().map_or(0, measured)
        };
        self.clusters.as_ref().map_or(0, of)
    }

    /// [`Scene::face_magnitudes`] in the mesh's own frame, made when first asked for.
    pub(crate) fn magnitudes(&self) -> &[f32] {
        self.magnitudes.get_or_init(|| face_magnitudes(&self.scene))
    }

    /// Geometry and materials, in the mesh's own frame.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The cluster trees.
    ///
    /// # Panics
    /// If the model was prepared for rays alone ([`super::Detail::Rays`]).
    pub fn hierarchy(&self) -> &Arc<Hierarchy> {
        &self.clusters.as_ref().expect("the model was prepared with clusters").hierarchy
    }

    /// Optics and the tree of the multi-resolution engine, if they were prepared ([`super::Detail::Optics`]).
    pub fn measured(&self) -> Option<&Measured> {
        self.clusters.as_ref()?.measured.as_ref()
    }
}

/// See [`Scene::face_magnitudes`]. Ends on faces that stand for fine ground are lifted above it.
pub(crate) fn face_magnitudes(scene: &Scene) -> Vec<f32> {
    let mut magnitudes = scene.face_magnitudes();
    if let Some(ground) = &scene.fine_ground {
        for (magnitude, &height) in magnitudes.iter_mut().zip(&ground.heights) {
            *magnitude = magnitude.max(EndRule::magnitude_of_height(height));
        }
    }
    magnitudes
}

/// The Embree scene of the triangles of a mesh.
pub(super) fn commit(
    device: &Device,
    scene: &Scene,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<CommittedScene> {
    let mut builder = SceneBuilder::new(device)?;
    match &scene.fine_ground {
        None => builder.add_triangles(&scene.positions, &scene.triangles)?,
        Some(ground) => {
            // Faces that stand for the ground keep their numbers, without area.
            let met = |(t, &[a, b, c]): (u32, &[u32; 3])| if ground.replaces(t) { [a; 3] } else { [a, b, c] };
            let triangles: Vec<[u32; 3]> = (0..).zip(&scene.triangles).map(met).collect();
            builder.add_triangles(&scene.positions, &triangles)?;
            let piece = |of: &Piece| GridPiece { first: of.first, stride: of.stride, size: of.size };
            let pieces: Vec<GridPiece> = ground.pieces().iter().map(piece).collect();
            let of = ground.clone();
            let face = move |piece, place| of.face_at(piece, place);
            builder.add_grid(&ground.samples, &pieces, Arc::new(face))?;
        }
    }
    builder.commit_unless(stopped)
}
