//! BSIZE as the paper measures it [SD95 sec 3.3]: erosions of one orthographic projection of a cluster, until all objects have
//! disappeared, and of the free space between them.
//!
//! [`mrvis::internals::optics`] measures the same by direction, and free regions only where they are the smaller part.

use glam::{Vec2, Vec3};
use mrvis::Scene;
use mrvis::internals::SceneParts;
use mrvis::internals::clusters::Tree;
use mrvis::internals::raster::{BitImage, Opener, fill_triangle};
use mrvis::metrics::Morphology;
use rayon::prelude::*;

/// Pixels across the longer side of a projected box.
pub const PIXELS: usize = 64;

/// For each cluster the larger one of the sizes of its blocked and of its free regions in the projection along a unit vector, scene units.
pub fn blocker_sizes(scene: &Scene, tree: &Tree, view: Vec3) -> Vec<f32> {
    let size = |c: usize| {
        let [blocked, free] = sizes(scene, tree.triangles_of(c), view);
        blocked.max(free)
    };
    (0..tree.clusters.len()).into_par_iter().map(size).collect()
}

/// Sizes of the blocked and of the free regions of some triangles.
pub fn sizes(scene: &Scene, faces: &[u32], view: Vec3) -> [f32; 2] {
    let (u, v) = view.any_orthonormal_pair();
    let flat = |p: Vec3| Vec2::new(p.dot(u), p.dot(v));
    let corners = || faces.iter().flat_map(|&t| scene.corners(t)).map(flat);
    let low = corners().fold(Vec2::INFINITY, Vec2::min);
    let extent = corners().fold(Vec2::NEG_INFINITY, Vec2::max) - low;
    let pixel = extent.max_element() / PIXELS as f32;
    if pixel <= 0.0 {
        return [0.0; 2];
    }
    let size = (extent / pixel).ceil().max(Vec2::ONE).as_uvec2();
    let mut image = BitImage::new(size.x as usize, size.y as usize);
    for &t in faces {
        fill_triangle(&mut image, scene.corners(t).map(|p| (flat(p) - low) / pixel));
    }
    let free = image.complement();
    [image, free].map(|image| Opener::new(image, Morphology::Paper8).largest() * pixel)
}
