//! The automatic camera for a scene whose light is not known: the same for all solutions of the scene.

use super::{Camera, Mesh, Stage, best_view};
use crate::Result;
use crate::math::Aabb;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::scene::Scene;

/// Part of the diagonal by which a lamp may reach out of the box around everything else: lamps in openings of a ceiling.
const INSIDE: f32 = 0.01;

/// The automatic camera for a scene with the same light on all surfaces. It depends neither on options of the solver nor on which lamps
/// within the scene are on.
///
/// # Errors
/// Embree fails.
pub fn scene_view(scene: &Scene) -> Result<Camera> {
    let solution = evenly_lit(scene);
    // Nothing stops it.
    let mesh = Mesh::new_unless(&solution, &()).unwrap_or_default();
    let stage = Stage::new(&mesh, &solution)?;
    Ok(best_view(&stage, &solution, scene.up_axis().vector(), &scene.unit))
}

/// The scene with equal light on all lit sides, one element per side of a triangle. Emitters outside the box around everything else emit:
/// the sun, a sky. Others are surfaces like all.
pub(super) fn evenly_lit(scene: &Scene) -> RadiosityMesh {
    let of_emitter = |t: usize| scene.triangle_emitter[t] != u32::MAX;
    let corners = |t: usize| scene.triangles[t].map(|v| scene.positions[v as usize]);
    let dark = Aabb::of((0..scene.triangles.len()).filter(|&t| !of_emitter(t)).flat_map(corners));
    let reach = INSIDE * dark.diagonal();
    let is_outside =
        |t: usize| corners(t).iter().any(|p| (*p - dark.min).min(dark.max - *p).min_element() < -reach);
    let mut solution =
        RadiosityMesh { origin: scene.origin, vertices: scene.positions.clone(), ..RadiosityMesh::default() };
    for (t, &[a, b, c]) in scene.triangles.iter().enumerate() {
        let emits = of_emitter(t) && is_outside(t);
        for front in [true, false].into_iter().take(usize::from(scene.triangle_sides[t])) {
            let corners = if front { [a, b, c, c] } else { [a, c, b, b] };
            let exitance = [f64::from(u8::from(emits && front)); 3];
            solution.elements.push(Element {
                corners,
                radiosity: exitance.map(|e| e + 0.5),
                irradiance: [1.0; 3],
                error: [0.0; 3],
                albedo: [0.5; 3],
                exitance,
                area: 1.0,
                level: 0,
                links: 0,
                triangle: t as u32,
                object: scene.triangle_object[t],
                material: 0,
                front,
                crossed: false,
                walls: 0,
            });
        }
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::testing::Pieces;
    use glam::{DVec3, dvec3};

    /// A room with two lamps below its ceiling, of which the second emits if it is on, otherwise it is a dark plate; and a sun.
    fn room(is_on: bool) -> Scene {
        let mut pieces = Pieces::new();
        pieces.object("room").quad(dvec3(3.0, 2.0, 0.0), 6.0 * DVec3::X, 4.0 * DVec3::Y);
        for x in [0.0, 6.0] {
            let side = if x == 0.0 { 4.0 * DVec3::Y } else { -4.0 * DVec3::Y };
            pieces.quad(dvec3(x, 2.0, 1.5), side, 3.0 * DVec3::Z);
        }
        pieces.object("cupboard").cuboid(dvec3(0.5, 0.5, 0.0), dvec3(1.5, 1.0, 1.8));
        pieces.object("table").cuboid(dvec3(3.0, 2.0, 0.0), dvec3(4.5, 3.0, 0.7));
        pieces.light(dvec3(1.0, 2.0, 2.9), DVec3::Y, DVec3::X);
        if is_on {
            pieces.light(dvec3(5.0, 2.0, 2.9), DVec3::Y, DVec3::X);
        } else {
            pieces.object("plate").quad(dvec3(5.0, 2.0, 2.9), DVec3::Y, DVec3::X);
        }
        pieces.light(dvec3(100.0, 0.0, 100.0), 5.0 * DVec3::Y, 5.0 * DVec3::X);
        pieces.scene()
    }

    #[test]
    fn the_camera_is_the_same_whichever_lamps_are_on() {
        let [on, off] = [true, false].map(|is_on| {
            let scene = room(is_on);
            let camera = scene_view(&scene).expect("a camera");
            (camera.eye.as_dvec3() + scene.origin, camera)
        });
        assert!(on.0.distance(off.0) < 1e-4 && on.1.forward.distance(off.1.forward) < 1e-5, "{on:?} {off:?}");
        // The sun does not widen the view.
        assert!(on.0.distance(dvec3(3.0, 2.0, 1.0)) < 20.0, "{on:?}");
    }
}
