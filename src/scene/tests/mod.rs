//! Tests of the room as a whole: from files and soups to scenes.

mod forests;
mod formats;
mod generators;
mod hostile;
mod instances;
mod limits;
mod luminaires;
mod memory;
mod moves;
mod overlaps;
mod repairs;

use super::*;
use std::fs;

/// Loads bytes from a file of the given extension in a temporary folder, beside the other files given.
fn load_file(
    extension: &str,
    bytes: &[u8],
    others: &[(&str, &[u8])],
    options: &LoadOptions,
) -> Result<Scene> {
    let folder = tempfile::tempdir().expect("scratch folder");
    let name = format!("scene.{extension}");
    for (name, bytes) in others.iter().chain(&[(name.as_str(), bytes)]) {
        fs::write(folder.path().join(name), bytes).expect("scratch file");
    }
    Scene::load_with(folder.path().join(name), options)
}

fn load_bytes(extension: &str, bytes: &[u8]) -> Result<Scene> {
    load_file(extension, bytes, &[], &LoadOptions::default())
}

fn load_with(obj: &str, others: &[(&str, &[u8])], options: &LoadOptions) -> Result<Scene> {
    load_file("obj", obj.as_bytes(), others, options)
}

fn load(obj: &str) -> Result<Scene> {
    load_with(obj, &[], &LoadOptions::default())
}

/// The message without the path of the folder.
fn message(result: Result<Scene>) -> String {
    let text = result.expect_err("an error").to_string();
    text.rsplit_once("scene.obj").map_or(text.clone(), |(_, tail)| tail.to_owned())
}

/// Corners of all triangles.
fn all_corners(s: &Scene) -> Vec<[Vec3; 3]> {
    (0..s.triangles.len() as u32).map(|t| s.corners(t)).collect()
}

fn area(scene: &Scene) -> f64 {
    (0..scene.triangles.len() as u32).map(|t| scene.face_area(t)).sum()
}

/// Properties of every scene.
fn check_consistent(s: &Scene) {
    let n = s.triangles.len();
    assert!(n > 0);
    for (name, len) in [
        ("object", s.triangle_object.len()),
        ("material", s.triangle_material.len()),
        ("reflectance", s.triangle_reflectance.len()),
        ("sides", s.triangle_sides.len()),
        ("component", s.triangle_component.len()),
        ("emitter", s.triangle_emitter.len()),
    ] {
        assert_eq!(len, n, "triangle_{name}");
    }
    let mut used = vec![false; s.positions.len()];
    for t in 0..n {
        let v = s.triangles[t];
        v.iter().for_each(|&v| used[v as usize] = true);
        let [a, b, c] = s.corners(t as u32);
        assert!(crate::math::triangle_area(a, b, c) > 0.0, "triangle {t} has no area");
        assert!((s.triangle_object[t] as usize) < s.objects.len());
        assert!((s.triangle_material[t] as usize) < s.materials.len());
        assert!((s.triangle_component[t] as usize) < s.closed_parts + s.sheet_parts);
        assert!(matches!(s.triangle_sides[t], 1 | 2));
        assert!(s.triangle_reflectance[t].iter().all(|r| (0.0..1.0).contains(r)));
        let emits = s.materials[s.triangle_material[t] as usize].emission != [0.0; 3];
        assert_eq!(emits, s.triangle_emitter[t] != u32::MAX);
    }
    assert!(used.iter().all(|&u| u), "unused vertices remain");
    assert!(s.positions.iter().all(|p| p.is_finite() && s.bounds.contains(Aabb::of([*p]))));
    for (i, e) in s.emitters.iter().enumerate() {
        assert!(e.area > 0.0 && e.min_width >= 0.0 && e.normal.length() < 1.0001, "{e:?}");
        assert!(e.triangles.iter().all(|&t| s.triangle_emitter[t as usize] == i as u32));
    }
}
