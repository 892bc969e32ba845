//! Lightmaps in the texture coordinates of the scene's file.

use super::lightmap::{
    MAX_SIDE_TEXELS, TRIANGLES_BETWEEN_LOOKS, check_room, covered_texels, go_on, middle, weights,
};
use super::{Lightmap, Stage};
use crate::Result;
use crate::error::quote;
use crate::math::{Aabb, triangle_normal};
use crate::progress::Progress;
use crate::ray::{LANES, Packet};
use crate::scene::{Scene, magnitude};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Tolerance of texture coordinates outside 0..1: files with four digits round by half of it.
const TEXCOORD_TOLERANCE: f32 = 1e-4;
/// Marks texels without a face.
const FREE: u32 = u32::MAX;

/// Irradiance of the fronts of all faces, in a square image of about `texels` texels; or a sentence that says why the coordinates are
/// unsuitable: they are missing, leave 0..1, have no area, or overlap.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory); [`Error::Cancelled`](crate::Error::Cancelled) if `progress` stops it.
pub fn unwrapped_lightmap(
    stage: &Stage,
    scene: &Scene,
    texels: usize,
    progress: &dyn Progress,
) -> Result<Result<Lightmap, String>> {
    let side = ((texels as f64).sqrt().ceil() as usize).clamp(1, MAX_SIDE_TEXELS);
    let faces = match placed(scene, side) {
        Ok(faces) => faces,
        Err(why) => return Ok(Err(why)),
    };
    check_room(side, side)?;
    let owner = match owners(scene, &faces, side, progress)? {
        Ok(owner) => owner,
        Err(why) => return Ok(Err(why)),
    };
    let mut map = Lightmap {
        width: side,
        height: side,
        texel: texel(scene, &faces),
        irradiance: vec![[0.0; 3]; side * side],
        covered: vec![false; side * side],
        texcoords: Vec::new(),
        sides: Vec::new(),
    };
    let rows = map.irradiance.par_chunks_mut(side).zip(map.covered.par_chunks_mut(side));
    rows.zip(owner.par_chunks(side)).enumerate().try_for_each(|(y, ((light, covered), owner))| {
        go_on(progress)?;
        for left in (0..side).step_by(LANES) {
            let rays = probe_rays(scene, &faces, owner, [left, y]);
            for (lane, met) in stage.irradiance(&rays).into_iter().enumerate() {
                if let Some(found) = met {
                    (light[left + lane], covered[left + lane]) = (found, true);
                }
            }
        }
        Ok(())
    })?;
    map.fill_margins(progress)?;
    Ok(Ok(map))
}

/// Corners of each face in texels from the upper left corner.
fn placed(scene: &Scene, side: usize) -> std::result::Result<Vec<[Vec2; 3]>, String> {
    if scene.triangle_texcoords.is_empty() {
        return Err("the file has no texture coordinates".into());
    }
    let name = |t: usize| quote(&scene.objects[scene.triangle_object[t] as usize].name);
    let inside = |[u, v]: [f32; 2]| {
        [u, v].iter().all(|x| (-TEXCOORD_TOLERANCE..=1.0 + TEXCOORD_TOLERANCE).contains(x))
    };
    let place = |(t, uv): (usize, &[[f32; 2]; 3])| {
        if !uv.iter().all(|&uv| inside(uv)) {
            return Err(format!("texture coordinates of `{}` leave 0..1", name(t)));
        }
        let [a, b, c] = uv.map(|[u, v]| side as f32 * Vec2::new(u, 1.0 - v));
        match (b - a).perp_dot(c - a) {
            0.0 => Err(format!("faces of `{}` have no area in texture coordinates", name(t))),
            _ => Ok([a, b, c]),
        }
    };
    scene.triangle_texcoords.iter().enumerate().map(place).collect()
}

/// Index of the face at each texel's centre, or [`FREE`].
fn owners(
    scene: &Scene,
    faces: &[[Vec2; 3]],
    side: usize,
    progress: &dyn Progress,
) -> Result<Result<Vec<u32>, String>> {
    let mut owner = vec![FREE; side * side];
    let (mut all, mut taken) = (0.0, 0usize);
    // At least half a texel inside the face, where adjacent faces do not reach.
    let deep = |face: [Vec2; 3], p: Vec2| {
        let [a, b, c] = face;
        let area = (b - a).perp_dot(c - a).abs();
        let sides = [b.distance(c), c.distance(a), a.distance(b)];
        weights(face, p).iter().zip(sides).all(|(w, s)| w * area > 0.5 * s)
    };
    for (t, &face) in faces.iter().enumerate() {
        if t % TRIANGLES_BETWEEN_LOOKS == 0 {
            go_on(progress)?;
        }
        let [a, b, c] = face;
        all += f64::from(0.5 * (b - a).perp_dot(c - a).abs());
        for ([x, y], _) in covered_texels(face, [side; 2]) {
            let (at, p) = (&mut owner[y * side + x], middle(x, y));
            if *at == FREE {
                taken += 1;
                *at = t as u32;
            } else if deep(face, p) && deep(faces[*at as usize], p) {
                let name = |t: usize| quote(&scene.objects[scene.triangle_object[t] as usize].name);
                let (one, other) = (name(*at as usize), name(t));
                return Ok(Err(format!("faces of `{one}` and `{other}` overlap in texture coordinates")));
            }
        }
    }
    // Faces below the size of a texel: the number of centres inside is proportional to their area, up to chance.
    if all > 1.1 * taken as f64 + 4.0 * (faces.len() as f64).sqrt() {
        return Ok(Err("faces overlap in texture coordinates".into()));
    }
    Ok(Ok(owner))
}

/// Rays from just in front of the surface onto it, at up to sixteen texels of a row.
fn probe_rays(scene: &Scene, faces: &[[Vec2; 3]], owner: &[u32], [left, y]: [usize; 2]) -> Packet {
    let mut rays = Packet::EMPTY;
    for (lane, &t) in owner[left..].iter().take(LANES).enumerate().filter(|(_, t)| **t != FREE) {
        let corners = scene.corners(t);
        let shares = weights(faces[t as usize], middle(left + lane, y));
        let place: Vec3 = corners.into_iter().zip(shares).map(|(p, w)| w * p).sum();
        let [a, b, c] = corners;
        let normal = triangle_normal(a, b, c);
        // Elements of the face may be off its plane by a part of its size, and by rounding.
        let off = 1e-5 * Aabb::of(corners).diagonal() + 2e-6 * magnitude(corners);
        rays.set_ray(lane, place + off * normal, -normal);
        rays.far[lane] = 2.0 * off;
    }
    rays
}

/// Mean side of a texel, scene units.
fn texel(scene: &Scene, faces: &[[Vec2; 3]]) -> f32 {
    let surface: f64 = (0..faces.len() as u32).map(|t| scene.face_area(t)).sum();
    let shown: f64 = faces.iter().map(|[a, b, c]| f64::from(0.5 * (*b - *a).perp_dot(*c - *a).abs())).sum();
    (surface / shown).sqrt() as f32
}
