//! Receiver points on the surfaces of a scene.

use crate::math::Aabb;
use crate::math::sampling::on_triangle;
use crate::model::{Instance, Mesh, Model};
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// A point on one side of a surface.
#[derive(Clone, Copy, Debug)]
pub struct ReceiverPoint {
    /// Position relative to the scene's origin, scene units.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Largest coordinate magnitude of the surface there, scene units: the scale of rounding errors.
    pub magnitude: f32,
}

/// A hash of 32 bits.
pub(super) fn scramble(v: u64) -> u32 {
    let v = (v ^ v >> 33).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let v = (v ^ v >> 33).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    (v ^ v >> 33) as u32
}

/// `count` area-uniform, low-discrepancy points on the surfaces of a model that do not emit, those of present instances where
/// they stand; a sheet gets points on both sides.
///
/// # Errors
/// Every surface emits.
pub fn surface_points(model: &Model, count: usize, seed: u64) -> crate::Result<Vec<ReceiverPoint>> {
    let meshes: Vec<ReceivingTriangles> =
        model.meshes().iter().map(|mesh| ReceivingTriangles::of(mesh)).collect();
    // Sums of areas: the scene's own triangles first, then the placed meshes.
    let mut sum = 0.0;
    let mut placed = Vec::new();
    for instance in model.instances().iter().filter(|instance| instance.is_present()) {
        placed.push((sum, instance));
        sum += meshes[instance.mesh as usize].area() * area_scale(instance);
    }
    if sum <= 0.0 {
        return Err(crate::Error::Scene(
            "every surface of the scene emits: there is nothing to receive light".into(),
        ));
    }
    let bounds = model.bounds();
    let seed = scramble(seed ^ 0x706f_696e_7473);
    let mut points: Vec<(u64, ReceiverPoint)> = (0..count as u32)
        .into_par_iter()
        .map(|i| {
            let draw = sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
            let target = f64::from(draw[0]) * sum;
            // The first sum is 0; of instances without area the last has the same sum as the next with one.
            let (before, instance) = placed[placed.partition_point(|(before, _)| *before <= target) - 1];
            let target = (target - before) / area_scale(instance);
            let point = meshes[instance.mesh as usize].point(target, draw, instance);
            (curve_key(bounds, point.position), point)
        })
        .collect();
    // Neighbours are adjacent: the caches of both engines are warm.
    points.par_sort_by_key(|(key, _)| *key);
    Ok(points.into_iter().map(|(_, point)| point).collect())
}

/// Triangles of a mesh that do not emit, with cumulative areas.
struct ReceivingTriangles<'a> {
    mesh: &'a Mesh,
    triangles: Vec<u32>,
    sums: Vec<f64>,
}

impl<'a> ReceivingTriangles<'a> {
    fn of(mesh: &'a Mesh) -> ReceivingTriangles<'a> {
        let scene = mesh.scene();
        let triangles: Vec<u32> = (0..scene.triangles.len() as u32)
            .filter(|&t| scene.triangle_emitter[t as usize] == u32::MAX)
            .collect();
        let mut sums = Vec::with_capacity(triangles.len());
        let mut sum = 0.0f64;
        for &t in &triangles {
            sum += scene.face_area(t);
            sums.push(sum);
        }
        ReceivingTriangles { mesh, triangles, sums }
    }

    /// Area of all triangles, squared units of the mesh.
    fn area(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The point at which the cumulative area reaches `target`, where the instance places it; a sheet gets points on both sides.
    fn point(&self, target: f64, draw: [f32; 4], instance: &Instance) -> ReceiverPoint {
        let k = self.sums.partition_point(|&s| s <= target).min(self.sums.len() - 1);
        let (scene, face) = (self.mesh.scene(), self.triangles[k]);
        let corners = scene.corners(face);
        let position = on_triangle(corners, draw[1], draw[2]);
        let mut normal = crate::math::triangle_normal(corners[0], corners[1], corners[2]);
        if scene.triangle_sides[face as usize] == 2 && draw[3] < 0.5 {
            normal = -normal;
        }
        let position = instance.affine().transform_point3(position.as_dvec3()).as_vec3();
        let magnitude = instance.magnitude_of(self.mesh, face);
        ReceiverPoint { position, normal: instance.turned(normal), magnitude }
    }
}

/// Ratio of the area of a placed triangle to its area in the mesh.
fn area_scale(instance: &Instance) -> f64 {
    instance.affine().matrix3.determinant().abs().cbrt().powi(2)
}

/// Index along a Morton curve of 2^10 cells per axis.
fn curve_key(bounds: Aabb, p: Vec3) -> u64 {
    let cell = ((p - bounds.min) / bounds.extent().max_element().max(f32::MIN_POSITIVE) * 1023.0).as_uvec3();
    (0..10).fold(0, |key, bit| {
        let pick = |v: u32| u64::from(v >> bit & 1);
        key | (pick(cell.x) | pick(cell.y) << 1 | pick(cell.z) << 2) << (3 * bit)
    })
}
