//! Orthographic projections of a cluster and the sizes measured on them [SD95 sec 3.3]; method A.7.

use super::Options;
use super::Extinction;
use super::axes::AXES;
use super::grain::Cells;
use crate::math::Aabb;
use crate::raster::{BitImage, Edt, Morphology, Opener, Outside, fill_triangle};
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// Buffers that are kept from one projection to the next.
#[derive(Default)]
pub(super) struct Silhouettes {
    contents: BitImage,
    gaps: BitImage,
    edt: Edt,
    hull: BitImage,
    cells: Cells,
}

/// What one projection shows. Lengths in scene units.
pub(super) struct Measured {
    pub blocked: f32,
    pub free: f32,
    pub coverage: f32,
    pub extinction: f32,
    pub grain: f32,
}

/// Pixels across the longer side: finer where more triangles share the picture.
fn resolution(triangles: usize) -> usize {
    match triangles {
        0..=16 => 32,
        17..=4096 => 64,
        _ => 128,
    }
}

impl Silhouettes {
    pub fn measure(
        &mut self,
        scene: &Scene,
        triangles: &[u32],
        bounds: Aabb,
        axis: usize,
        analytic: f32,
        options: &Options,
    ) -> Measured {
        let direction = AXES[axis];
        let (u, v) = direction.any_orthonormal_pair();
        let flat = |p: Vec3| Vec2::new(p.dot(u), p.dot(v));
        let centre = flat(bounds.center());
        let half = 0.5 * bounds.extent();
        let reach = Vec2::new(half.dot(u.abs()), half.dot(v.abs()));
        let pixel = 2.0 * reach.max_element() / resolution(triangles.len()) as f32;
        if pixel <= 0.0 {
            return Measured { blocked: 0.0, free: 0.0, coverage: 0.0, extinction: analytic, grain: 0.0 };
        }
        // A free pixel around, so that outlines count as ends of blocked regions.
        let size = (2.0 * reach / pixel).ceil().as_uvec2() + 2;
        let offset = 0.5 * size.as_vec2() - centre / pixel;
        let to_pixels = |p: Vec3| flat(p) / pixel + offset;
        self.contents.reset(size.x as usize, size.y as usize);
        for &t in triangles {
            fill_triangle(&mut self.contents, scene.corners(t).map(to_pixels));
        }
        self.hull.reset(size.x as usize, size.y as usize);
        fill_box(&mut self.hull, bounds, direction, to_pixels);
        // Outlines of both are sampled at the same centres; what the hull misses by rounding is no content.
        let all = self.hull.count().max(1);
        // Outside the projected box counts as object: only gaps inside are free regions.
        self.gaps.clone_from(&self.hull);
        self.gaps.subtract(&self.contents);
        let coverage = 1.0 - self.gaps.count() as f32 / all as f32;
        let origin = bounds.center() - pixel * (0.5 * size.x as f32 * u + 0.5 * size.y as f32 * v);
        self.cells.fill(&self.hull, &self.gaps, bounds, direction, (origin, pixel * u, pixel * v));
        let extinction = match options.extinction {
            Extinction::Analytic => analytic,
            Extinction::Measured => self.cells.fitted_extinction(),
        };
        Measured {
            blocked: self.diameter(false, options.morphology) * pixel,
            free: if coverage > 0.5 { self.diameter(true, options.morphology) * pixel } else { 0.0 },
            coverage,
            extinction,
            grain: self.cells.grain(extinction, options.tolerance) * pixel,
        }
    }

    /// Largest inscribed size in pixels of the contents or of the gaps.
    fn diameter(&mut self, gaps: bool, morphology: Morphology) -> f32 {
        let image = if gaps { &self.gaps } else { &self.contents };
        match morphology {
            Morphology::Euclid => self.edt.max_inscribed_diameter(image, Outside::Free),
            counts => Opener::new(image.clone(), counts).largest(),
        }
    }
}

/// The projection of a box: its faces, each two triangles (opposite faces project alike or cover each other).
fn fill_box(image: &mut BitImage, bounds: Aabb, direction: Vec3, to_pixels: impl Fn(Vec3) -> Vec2) {
    for axis in 0..3 {
        if direction[axis] == 0.0 && bounds.extent()[axis] > 0.0 {
            continue;
        }
        // The face that the direction leaves through.
        let side = if direction[axis] >= 0.0 { bounds.max[axis] } else { bounds.min[axis] };
        let corner = |i: usize, j: usize| {
            let mut p = bounds.min;
            p[axis] = side;
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            p[a] = if i == 1 { bounds.max[a] } else { bounds.min[a] };
            p[b] = if j == 1 { bounds.max[b] } else { bounds.min[b] };
            to_pixels(p)
        };
        let (p, q, r, s) = (corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1));
        fill_triangle(image, [p, q, r]);
        fill_triangle(image, [p, r, s]);
    }
}
