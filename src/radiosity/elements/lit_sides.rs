//! Which sides of the faces light can reach.

use crate::math::parallel;
use crate::math::{Aabb, triangle_normal, winding_number};
use crate::ray::EndRule;
use crate::scene::{Scene, badly_wound, magnitude};
use glam::Vec3;

/// For each face whether front and back can be reached by light.
///
/// Sheets have two lit sides. A closed part is lit on the sides that have an emitter: outside for a chair, inside for a room
/// that is one closed box, whatever its winding; the winding number at a point in front of the emitter decides. Parts that are
/// not consistently wound count as sheets, and so do the parts listed in `open`. The [`ground`] is lit from above.
pub(super) fn lit_sides(scene: &Scene, open: &[u32]) -> Vec<[bool; 2]> {
    let mut parts = closed_parts(scene);
    open.iter().for_each(|&part| parts[part as usize].clear());
    let lights = light_points(scene);
    let mut seen_of_part: Vec<[bool; 2]> = parallel::map(&parts, |faces| {
        if faces.is_empty() {
            return [true, true];
        }
        let bounds = Aabb::of(faces.iter().flat_map(|&t| scene.corners(t)));
        let outward = signed_volume(scene, faces, bounds.center()) > 0.0;
        let (mut inside, mut outside) = (false, lights.is_empty() || scene.environment.is_some());
        for &light in &lights {
            let holds = light.cmpge(bounds.min).all()
                && light.cmple(bounds.max).all()
                && winding(scene, faces, light).abs() > 0.5;
            (inside, outside) = (inside || holds, outside || !holds);
        }
        if outward { [outside, inside] } else { [inside, outside] }
    });
    if let Some((part, front_is_up)) = ground(scene) {
        seen_of_part[part as usize] = [front_is_up, !front_is_up];
    }
    scene.triangle_component.iter().map(|&part| seen_of_part[part as usize]).collect()
}

/// A ray that met a face on a side that was assumed to be dark.
#[derive(Clone, Copy, Debug)]
pub struct DarkSideHit {
    /// The face.
    pub triangle: u32,
    /// Origin of the ray, scene units.
    pub from: Vec3,
    /// Whether the origin is on an emitter.
    pub emits: bool,
}

/// Largest number of rays of a part whose origins are tested: limits the time to 8 winding numbers per part.
const MAX_TESTED_RAYS: usize = 8;
/// Fraction of the tested rays that must start outside: 2 of 8, so that one ray that slips through an edge does not decide.
const MIN_OUTSIDE_SHARE: f64 = 0.25;

/// The closed parts (components of the scene, ascending) that have light on both sides: rays from outside or from an emitter
/// have met their inside, because some of their faces are turned over. Other rays that meet a closed part from within start on
/// an object that reaches into the part or stands on the same floor, and that is dark there.
pub fn lit_inside(scene: &Scene, entered: &[DarkSideHit]) -> Vec<u32> {
    let parts = closed_parts(scene);
    let mut by_part: Vec<Vec<DarkSideHit>> = vec![Vec::new(); parts.len()];
    for ray in entered {
        by_part[scene.triangle_component[ray.triangle as usize] as usize].push(*ray);
    }
    let is_lit = |part: usize| {
        let (rays, faces) = (&by_part[part], &parts[part]);
        if rays.is_empty() || faces.is_empty() {
            return false;
        }
        // Where faces were moved into a part, rays enter between them and their neighbours by rounding.
        if scene.wound_parts.contains(&(part as u32)) {
            let inside = |ray: &&DarkSideHit| winding(scene, faces, ray.from).abs() > 0.5;
            return rays.iter().filter(|ray| ray.emits).take(MAX_TESTED_RAYS).any(|ray| inside(&ray));
        }
        let tested: Vec<&DarkSideHit> = rays.iter().step_by(rays.len().div_ceil(MAX_TESTED_RAYS)).collect();
        let outside = |ray: &&&DarkSideHit| winding(scene, faces, ray.from).abs() < 0.5;
        let from_outside = tested.iter().filter(outside).count() as f64;
        rays.iter().any(|ray| ray.emits) || from_outside >= MIN_OUTSIDE_SHARE * tested.len() as f64
    };
    parallel::flat_map(0..parts.len(), |part| is_lit(part).then_some(part as u32))
}

/// The faces of each closed and consistently wound part; an empty list for other parts.
fn closed_parts(scene: &Scene) -> Vec<Vec<u32>> {
    let count = scene.triangle_component.iter().max().map_or(0, |&m| m as usize + 1);
    let mut parts = vec![Vec::new(); count];
    let one_sided = || (0..scene.triangles.len() as u32).filter(|&t| scene.triangle_sides[t as usize] == 1);
    let part = |t: u32| scene.triangle_component[t as usize];
    one_sided().for_each(|t| parts[part(t) as usize].push(t));
    // Edges of faces that were moved off others have lost their second face.
    let is_known = |part: &u32| scene.wound_parts.contains(part);
    for part in badly_wound(one_sided().map(|t| (part(t), scene.triangles[t as usize]))) {
        if !is_known(&part) {
            parts[part as usize].clear();
        }
    }
    parts
}

/// Points in front of at most four faces of every emitter, and behind them for two-sided emission.
fn light_points(scene: &Scene) -> Vec<Vec3> {
    // Faces of an emitter that are tested: limits the time to 4 winding numbers per emitter (8 if it emits from both sides).
    const FACES: usize = 4;
    let mut points = Vec::new();
    for emitter in &scene.emitters {
        for k in 0..FACES.min(emitter.triangles.len()) {
            let t = emitter.triangles[k * emitter.triangles.len() / FACES.min(emitter.triangles.len())];
            let [a, b, c] = scene.corners(t);
            let (middle, normal) = ((a + b + c) / 3.0, triangle_normal(a, b, c));
            let step = EndRule::new(magnitude([a, b, c])).height();
            points.push(middle + step * normal);
            if scene.two_sided_emission {
                points.push(middle - step * normal);
            }
        }
    }
    points
}

fn signed_volume(scene: &Scene, faces: &[u32], from: Vec3) -> f64 {
    let from = from.as_dvec3();
    let six = |t: &u32| {
        let [a, b, c] = scene.corners(*t).map(|p| p.as_dvec3() - from);
        a.dot(b.cross(c))
    };
    faces.iter().map(six).sum()
}

fn winding(scene: &Scene, faces: &[u32], from: Vec3) -> f64 {
    winding_number(faces.iter().map(|&t| scene.corners(t)), from)
}

/// Largest distance between the edges of ground and scene, as a fraction of the scene's extent: rounding of coordinates in files.
const GROUND_EDGE: f32 = 1e-3;

/// The component that is the ground, and whether the fronts of its faces are above. None if light may come from below: from a sky with a
/// lower half or a ground of its own, or from surfaces that lie deeper than the ground.
///
/// Light reaches the lower side of such a surface only past its edge. If this side had elements, it would take half of the rays of a
/// terrain.
pub(super) fn ground(scene: &Scene) -> Option<(u32, bool)> {
    let environment = scene.environment.as_ref().filter(|environment| environment.is_dark_below())?;
    let up = environment.frame().up.as_vec3();
    let axis = up.abs().max_position();
    let heights = |of: &Aabb| match up[axis] > 0.0 {
        true => of.min[axis],
        false => -of.max[axis],
    };
    let faces = 0..scene.triangles.len() as u32;
    let bounds = scene.component_bounds();
    let whole = bounds.iter().fold(Aabb::EMPTY, |all, own| all.union(*own));
    let within = GROUND_EDGE * whole.extent().max_element();
    let lowest = heights(&whole) + within;
    let is_under_all = |own: &Aabb| {
        (0..3)
            .filter(|k| *k != axis)
            .all(|k| own.min[k] <= whole.min[k] + within && own.max[k] >= whole.max[k] - within)
            && heights(own) <= lowest
    };
    let mut candidates = (0u32..).zip(&bounds).filter(|(_, own)| is_under_all(own)).map(|(c, _)| c);
    let (only, None) = (candidates.next()?, candidates.next()) else { return None };
    // 1 and 2 for faces whose front is above and below, 3 for those that stand upright.
    let facing = |t: u32| {
        let rise = scene.face_normal(t).dot(up);
        if rise > 0.0 {
            1
        } else if rise < 0.0 {
            2
        } else {
            3
        }
    };
    let emits = |t: u32| {
        scene.materials[scene.triangle_material[t as usize] as usize].emission.iter().any(|l| *l > 0.0)
    };
    let is_own = |t: u32| scene.triangle_component[t as usize] == only;
    let way = |t: u32| is_own(t).then(|| if emits(t) { 3u8 } else { facing(t) });
    let found = parallel::flat_map(faces, way).into_iter().fold(0, |a, b| a | b);
    matches!(found, 1 | 2).then_some((only, found == 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::LoadOptions;
    use crate::sky::SkyOptions;

    fn ground_of(obj: &str, sky: &str) -> Option<(u32, bool)> {
        let folder = tempfile::tempdir().expect("scratch folder");
        let path = folder.path().join("a.obj");
        std::fs::write(&path, obj).expect("written");
        let options = LoadOptions { up: Some(crate::scene::UpAxis::Z), ..LoadOptions::default() };
        let mut scene = Scene::load_with(&path, &options).expect("a scene");
        std::fs::write(folder.path().join("sky.toml"), sky).expect("written");
        let sky = folder.path().join("sky.toml");
        let options = SkyOptions::of_texts(Some(sky.to_str().expect("UTF-8")), None, None, None);
        scene.set_sky(&options.expect("a sky")).expect("set");
        ground(&scene)
    }

    const HILL: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 2 2 1\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";
    const BLACK: &str = "sky = \"uniform\"\n";

    #[test]
    fn the_ground_faces_up_and_has_nothing_below() {
        assert_eq!(ground_of(HILL, BLACK), Some((0, true)));
        // Something on it.
        let table = format!("{HILL}v 1 1 2\nv 2 1 2\nv 1 2 2\nf 6 7 8\n");
        assert_eq!(ground_of(&table, BLACK), Some((0, true)));
        // Wound the other way round.
        let turned = HILL.replace("f 1 2 5", "f 2 1 5").replace("f 2 3 5", "f 3 2 5");
        assert_eq!(ground_of(&turned, BLACK), None, "wound both ways");
        let turned = turned.replace("f 3 4 5", "f 4 3 5").replace("f 4 1 5", "f 1 4 5");
        assert_eq!(ground_of(&turned, BLACK), Some((0, false)));
        // Light from below: a bright ground, a surface that lies deeper, and one that ends before the scene.
        assert_eq!(ground_of(HILL, "sky = \"uniform\"\nground = 0.2\n"), None);
        assert_eq!(ground_of(&format!("{HILL}v 1 1 -1\nv 2 1 -1\nv 1 2 -1\nf 6 7 8\n"), BLACK), None);
        assert_eq!(ground_of(&format!("{HILL}v 9 9 3\nv 8 9 3\nv 8 8 3\nf 6 7 8\n"), BLACK), None);
    }
}
