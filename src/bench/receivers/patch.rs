//! Planar patches of surfaces.

use super::relief::points as relief_points;
use super::{Rectangle, TexelGrid, fit, inscribed};
use crate::bench::workload::ReceiverPoint;
use crate::scene::Scene;
use glam::DVec3;

/// Fraction of its rectangle that a nearly rectangular patch covers at least; the image of any other lies in a rectangle
/// inside it. A disc covers π/4 = 0.785 of its square.
pub(super) const MIN_FILLED_FRACTION: f64 = 0.8;
/// Smallest length of the mean normal of a relief: for slopes of one angle in all directions its cosine, here 37
/// degrees. Terrain exceeds it; foliage, which points everywhere, does not.
const MIN_MEAN_NORMAL: f64 = 0.8;
/// Smallest rectangle inside a patch, relative to the patch: a disc has one of 2/π, a triangle one of 1/2.
const MIN_INSCRIBED_FRACTION: f64 = 0.3;
/// An object without a patch of at least this fraction of its area may be a relief. The sides of a cube (1/6) pass as well;
/// their normals cancel, which [`relief`] tests. Selects receivers only.
const MIN_PATCH_FRACTION: f64 = 0.25;

/// Connected triangles in one plane, or a relief.
#[derive(Clone)]
pub(super) struct Patch {
    pub(super) triangles: Vec<u32>,
    /// Area projected along the rectangle's normal.
    pub(super) area: f64,
    pub(super) rectangle: Rectangle,
    pub(super) relief: bool,
}

impl Patch {
    pub(super) fn filled(&self) -> f64 {
        self.area / (self.rectangle.width * self.rectangle.height)
    }

    /// The patch, or a rectangle inside it if it is not nearly rectangular; `None` if the largest such rectangle is small against it.
    pub(super) fn rectangular(self, scene: &Scene) -> Option<Patch> {
        if self.filled() >= MIN_FILLED_FRACTION {
            return Some(self);
        }
        let rectangle = inscribed(scene, &self.triangles, &self.rectangle)?;
        let area = rectangle.width * rectangle.height;
        (area >= MIN_INSCRIBED_FRACTION * self.area).then_some(Patch { area, rectangle, ..self })
    }

    /// Centres of texels in a rectangle of the patch's plane, row by row from the top left.
    pub(super) fn points(
        &self,
        scene: &Scene,
        rectangle: &Rectangle,
        grid: &TexelGrid,
    ) -> Vec<ReceiverPoint> {
        if self.relief {
            return relief_points(scene, &self.triangles, rectangle, grid);
        }
        let TexelGrid { width, height, texel } = *grid;
        let Rectangle { right, normal, .. } = *rectangle;
        let magnitude = scene.magnitude_of(&self.triangles);
        // A thousandth of a texel above the surface, so that coplanar faces of other objects do not block.
        let centre = rectangle.lifted() + 1e-3 * texel * normal;
        let up = normal.cross(right);
        let at = move |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * texel;
        let texel = move |x, y| ReceiverPoint {
            position: (centre + at(x, width) * right - at(y, height) * up).as_vec3(),
            normal: normal.as_vec3(),
            magnitude,
        };
        (0..height).flat_map(|y| (0..width).map(move |x| texel(x, y))).collect()
    }

    /// Test points in a rectangle: columns and rows, `longer` along the longer side, and the points.
    pub(super) fn spread(
        &self,
        scene: &Scene,
        rectangle: &Rectangle,
        longer: usize,
    ) -> ([usize; 2], Vec<ReceiverPoint>) {
        let texel = rectangle.width / longer as f64;
        let rows = (rectangle.height / texel).round().max(1.0) as usize;
        ([longer, rows], self.points(scene, rectangle, &TexelGrid { width: longer, height: rows, texel }))
    }
}

/// [`Scene::planar_patches`], each of one object.
pub(super) fn patches(scene: &Scene, triangles: &[u32]) -> Vec<Patch> {
    let patch = |triangles: Vec<u32>| {
        let area = triangles.iter().map(|&t| scene.face_area(t)).sum();
        let rectangle = fit(scene, &triangles, scene.face_normal(triangles[0]).as_dvec3())?;
        Some(Patch { triangles, area, rectangle, relief: false })
    };
    let patches = scene.planar_patches(triangles, |t| scene.triangle_object[t as usize]);
    patches.into_iter().filter_map(patch).collect()
}

/// The relief of some faces; `None` if one of their planar patches is large, or if the faces point into all directions.
pub(super) fn relief<'a>(
    scene: &Scene,
    triangles: &[u32],
    patches: impl Iterator<Item = &'a Patch>,
) -> Option<Patch> {
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    for &t in triangles {
        let own = scene.face_area(t);
        sum += own * scene.face_normal(t).as_dvec3();
        area += own;
    }
    let largest = patches.filter(|p| p.filled() >= MIN_FILLED_FRACTION).map(|p| p.area).fold(0.0, f64::max);
    if largest >= MIN_PATCH_FRACTION * area || sum.length() < MIN_MEAN_NORMAL * area {
        return None;
    }
    let rectangle = fit(scene, triangles, sum.normalize())?;
    Some(Patch { triangles: triangles.to_vec(), area: sum.length(), rectangle, relief: true })
}
