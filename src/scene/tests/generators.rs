//! Properties of the generated scenes.

use super::*;
use crate::math::{triangle_area, triangle_normal};
use crate::scene::generate::*;

/// Faces of the object `name`.
fn object(s: &Scene, name: &str) -> Vec<u32> {
    s.faces_named(name).expect(name)
}

fn area_of(s: &Scene, faces: &[u32]) -> f64 {
    faces.iter().map(|&t| s.corners(t)).map(|[a, b, c]| triangle_area(a, b, c)).sum()
}

#[test]
fn generators_make_consistent_scenes() {
    for kind in KINDS {
        let mut spec = Spec::new(kind.name);
        (spec.trees, spec.leaves) = (9, 50);
        let scene = build(&spec).expect(kind.name);
        check_consistent(&scene);
        // The office has six panels in its ceiling.
        let lamps = if kind.name == "office" { 6 } else { 1 };
        assert_eq!(scene.emitters.len(), lamps, "{}", kind.name);
        assert!(scene.repairs.messages.is_empty(), "{}: {:?}", kind.name, scene.repairs.messages);
        // Of emitters that face away from all surfaces nothing could be measured.
        let (mut before, mut all) = (0, 0);
        for t in (0..scene.triangles.len()).filter(|&t| scene.triangle_emitter[t] == u32::MAX) {
            let [a, b, c] = scene.corners(t as u32);
            let seen = |e: &crate::scene::Emitter| {
                let corner = scene.corners(e.triangles[0])[0];
                e.normal.dot((a + b + c) / 3.0 - corner) > 0.0
            };
            (before, all) = (before + u32::from(scene.emitters.iter().any(seen)), all + 1);
        }
        assert!(2 * before > all, "{}: {before} of {all} triangles lie before a light", kind.name);
    }
}

#[test]
fn written_scenes_load_as_they_were() {
    let folder = tempfile::tempdir().expect("scratch folder");
    for kind in KINDS {
        let mut spec = Spec::new(kind.name);
        (spec.trees, spec.leaves) = (4, 30);
        let built = build(&spec).expect(kind.name);
        let path = folder.path().join("scene.obj");
        write_obj(&path, &soup(&spec).expect(kind.name), &["a", "b\nc"]).expect("written");
        let loaded = Scene::load_with(&path, &LoadOptions { unit: kind.unit.into(), ..Default::default() })
            .expect(kind.name);
        check_consistent(&loaded);
        // Vertices in the file are in the order of their first use.
        assert_eq!(all_corners(&built), all_corners(&loaded), "{}", kind.name);
        assert_eq!(built.triangle_object, loaded.triangle_object);
        assert_eq!(built.triangle_sides, loaded.triangle_sides);
        assert_eq!(built.triangle_reflectance, loaded.triangle_reflectance);
        assert_eq!(format!("{:?}", built.emitters), format!("{:?}", loaded.emitters));
    }
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 2, "temporary files are left");
}

#[test]
fn the_same_seed_makes_the_same_scene() {
    let make = |seed| build(&Spec { seed, count: Some(20), ..Spec::new("cubes") }).expect("cubes").positions;
    assert_eq!(make(5), make(5));
    assert_ne!(make(5), make(6));
}

#[test]
fn wrong_requests_are_refused() {
    let check = |spec: Spec, want: &str| {
        let text = build(&spec).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check(Spec::new("wood"), "no scene is called `wood`; there are cube-groups");
    check(Spec { count: Some(0), ..Spec::new("cubes") }, "`count` 0");
    check(Spec { trees: 1 << 20, leaves: 1 << 20, ..Spec::new("forest") }, "lower `trees`");
    check(Spec { light_size: Some(f64::NAN), ..Spec::new("cubes") }, "light_size");
}

#[test]
fn crowns_have_the_stated_optical_depth() {
    // For any number of leaves, vertical lines near the axis of a crown meet 1.5 leaves on average.
    for leaves in [300, 3000] {
        let s = build(&Spec { trees: 16, leaves, ..Spec::new("forest") }).expect("forest");
        assert_eq!(s.triangles.len(), 4 + 16 * 2 * leaves);
        assert_eq!((s.closed_parts, s.sheet_parts), (0, 2 + 16 * leaves));
        let (mut met, mut lines) = (0, 0);
        for i in 1..=16 {
            let faces = object(&s, &format!("tree {i}"));
            let b = Aabb::of(faces.iter().flat_map(|&t| s.corners(t)));
            let (c, r) = (b.center(), 0.25 * b.extent().x);
            for k in 0..100 {
                // A spiral over the middle quarter of the disc.
                let (sin, cos) = (2.4 * k as f32).sin_cos();
                let q = c + r * 0.5 * (k as f32 / 100.0).sqrt() * Vec3::new(cos, sin, 0.0);
                lines += 1;
                met += faces
                    .iter()
                    .filter(|&&t| {
                        let p = s.corners(t);
                        let side = |a: Vec3, b: Vec3| (b - a).truncate().perp_dot((q - a).truncate());
                        let w = [side(p[0], p[1]), side(p[1], p[2]), side(p[2], p[0])];
                        w.iter().all(|&w| w >= 0.0) || w.iter().all(|&w| w <= 0.0)
                    })
                    .count();
            }
        }
        // Chords at that distance are up to 3 % shorter than the longest.
        let depth = met as f64 / lines as f64;
        assert!((depth - 1.48).abs() < 0.12, "{leaves} leaves: {depth}");
    }
}

#[test]
fn cornell_box_is_the_measured_one() {
    let s = build(&Spec::new("cornell")).expect("cornell");
    assert_eq!(s.unit, "mm");
    assert_eq!((s.closed_parts, s.sheet_parts, s.triangles.len()), (2, 1, 42));
    let check = |name: &str, want: f64| {
        let got = area_of(&s, &object(&s, name));
        assert!((got - want).abs() < 1e-4 * want, "{name}: {got} instead of {want}");
    };
    // Trapezoids: mean of the parallel edges times the distance.
    check("floor", 0.5 * (552.8 + 549.6) * 559.2);
    check("back wall", 0.5 * (549.6 + 556.0) * 548.8);
    check("right wall", 559.2 * 548.8);
    check("light", 130.0 * 105.0);
    check("ceiling", 556.0 * 559.2 - 130.0 * 105.0);
    let light = &s.emitters[0];
    assert_eq!((light.normal, light.min_width), (Vec3::NEG_Y, 105.0));
    let middle = Vec3::new(278.0, 274.0, 280.0);
    for name in
        ["floor", "back wall", "right wall", "left wall", "ceiling", "light", "short block", "tall block"]
    {
        let faces = object(&s, name);
        let inside = Aabb::of(faces.iter().flat_map(|&t| s.corners(t))).center();
        for &t in &faces {
            let [a, b, c] = s.corners(t);
            let n = triangle_normal(a, b, c);
            let good = if name.ends_with("block") { n.dot(a - inside) } else { n.dot(middle - a) };
            assert!(good > 0.0, "{name} shows its back");
        }
    }
}
