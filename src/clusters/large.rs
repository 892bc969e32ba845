//! Large planar surfaces: kept outside the clusters and always tested exactly (docs/method.md, Clusters).

use crate::math::parallel;
use crate::raster::{BitImage, Edt, fill_triangle};
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// Raster width for the inscribed disc, pixels; 64 with a free border. An error of 3 % is enough for a class boundary.
const DISC_RASTER_PIXELS: usize = 62;

/// Triangles of planar, edge-connected surfaces whose inscribed disc has a diameter of at least `part` times the
/// scene's diagonal; in ascending order.
pub(super) fn surfaces(scene: &Scene, part: f32) -> Vec<u32> {
    let size = part * scene.near_bounds().diagonal();
    // Only components that are wide along two axes can contain such a surface; most small objects are rejected here.
    let extent = scene.component_bounds();
    // A disc of diameter d spans at least d/√2 along two axes whatever its tilt; d/2 is a safe bound.
    let wide = |c: u32| {
        let mut e = extent[c as usize].extent().to_array();
        e.sort_by(f32::total_cmp);
        e[1] >= 0.5 * size && extent[c as usize].diagonal() >= size
    };
    let candidates: Vec<u32> =
        (0..scene.triangles.len() as u32).filter(|&t| wide(scene.triangle_component[t as usize])).collect();
    let patches = scene.planar_patches(&candidates, |_| 0);
    // A patch with such a disc has at least its area; of a terrain hardly any other has to be drawn.
    let disc = 0.25 * std::f64::consts::PI * f64::from(size).powi(2);
    let area = |p: &[u32]| -> f64 { p.iter().map(|&t| scene.face_area(t)).sum() };
    // The raster finds diameters to a 30th: a smaller area has no disc that it could take for a larger one.
    let is_large = |p: &Vec<u32>| area(p) >= 0.9 * disc && inscribed(scene, p) >= size;
    let is_large = parallel::map(&patches, is_large);
    let mut large: Vec<u32> =
        patches.into_iter().zip(is_large).filter(|of| of.1).flat_map(|of| of.0).collect();
    parallel::sort_by_key(&mut large, |&t| (0, t));
    large
}

/// Diameter of the largest disc inside a planar patch; length.
fn inscribed(scene: &Scene, patch: &[u32]) -> f32 {
    let (u, v) = scene.face_normal(patch[0]).any_orthonormal_pair();
    let flat = |p: Vec3| Vec2::new(p.dot(u), p.dot(v));
    let points = || patch.iter().flat_map(|&t| scene.corners(t)).map(flat);
    let low = points().reduce(Vec2::min).unwrap_or_default();
    let high = points().reduce(Vec2::max).unwrap_or_default();
    let span = high - low;
    let pixel = span.max_element() / DISC_RASTER_PIXELS as f32;
    if pixel <= 0.0 {
        return 0.0;
    }
    // A border of one free pixel, so that the patch's own outline limits the disc.
    let size = (span / pixel).ceil().as_uvec2() + 2;
    let mut image = BitImage::new(size.x as usize, size.y as usize);
    for &t in patch {
        fill_triangle(&mut image, scene.corners(t).map(|p| (flat(p) - low) / pixel + 1.0));
    }
    Edt::new().max_inscribed_diameter(&image) * pixel
}
