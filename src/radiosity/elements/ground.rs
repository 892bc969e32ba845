//! The ground of a scene: a surface that faces up everywhere, lies under the whole scene, and has no light below it.

use crate::math::Aabb;
use crate::scene::Scene;
use rayon::prelude::*;

/// How far the ground may end from the edge of the scene, as part of the scene's extent: rounding of coordinates in files.
const EDGE: f32 = 1e-3;

/// The component that is the ground, and whether the fronts of its faces are above. None if light may come from below: from a sky with a lower half or
/// a ground of its own, or from surfaces that lie deeper than the ground.
///
/// Light reaches the lower side of such a surface only past its edge. If this side had elements, it would take half of the rays of a terrain.
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
    let within = EDGE * whole.extent().max_element();
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
    let own = faces.into_par_iter().filter(|&t| scene.triangle_component[t as usize] == only);
    let found = own.map(|t| if emits(t) { 3 } else { facing(t) }).reduce(|| 0u8, |a, b| a | b);
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
