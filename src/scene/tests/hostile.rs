//! Invalid files give a scene or an error, quickly, and never a panic; `suite::fuzz` changes bytes of files.

use super::{
    instances::{file, orchard},
    *,
};
use proptest::prelude::*;

/// Loads a file and checks a resulting scene.
fn survives(extension: &str, bytes: &[u8]) {
    match load_bytes(extension, bytes) {
        Ok(scene) => {
            check_consistent(&scene);
            scene.shared.iter().for_each(|mesh| check_consistent(mesh));
            if let Ok(flat) = scene.flattened(10_000) {
                check_consistent(&flat);
            }
        }
        Err(error) => {
            let text = error.to_string();
            assert!(!text.contains('\n') && !text.is_empty(), "{text:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn numbers_of_nodes(which in 2usize..5, key in 0usize..3, at in 0usize..3, value in any::<f32>()) {
        let mut nodes = orchard();
        let key = ["translation", "rotation", "scale"][key];
        let mut list = if key == "rotation" { vec![0.1f32; 4] } else { vec![1.0; 3] };
        list[at] = if value.is_finite() { value } else { 1e38 };
        nodes[which][key] = serde_json::json!(list);
        survives("gltf", file(nodes).to_string().as_bytes());
    }

    #[test]
    fn random_polygons(corners in prop::collection::vec([-3i8..4, -3i8..4, -1i8..2], 3..14)) {
        // Small integers: repeated, collinear and intersecting corners are frequent.
        let mut obj: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        obj += "f";
        (1..=corners.len()).for_each(|i| obj += &format!(" {i}"));
        survives("obj", obj.as_bytes());
    }
}

#[test]
fn mtl_of_any_bytes() {
    let obj = "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for mtl in [
        "Kd",
        "newmtl",
        "newmtl a\nKd",
        "newmtl a\nmap_Kd",
        "newmtl a\nmap_Kd a.mtl",
        "newmtl a\nmap_Kd .",
        "d",
        "newmtl a\nTr x",
        "newmtl a\nKd 1e39 0 0",
        "illum 999",
        "newmtl a\nmap_Kd -s",
        "\0\u{1}",
        "newmtl a\nd -1",
    ] {
        let _ = load_with(obj, &[("a.mtl", mtl.as_bytes())], &LoadOptions::default());
    }
}

#[test]
fn a_face_of_very_many_corners() {
    let n = 300_000;
    // Convex.
    let circle = |r: &dyn Fn(usize) -> f64| {
        let mut obj = String::new();
        for i in 0..n {
            let (sin, cos) = (i as f64 / n as f64 * std::f64::consts::TAU).sin_cos();
            obj += &format!("v {} {} 0\n", 1e4 * r(i) * cos, 1e4 * r(i) * sin);
        }
        obj += "f";
        (1..=n).for_each(|i| obj += &format!(" {i}"));
        obj
    };
    let s = load(&circle(&|_| 1.0)).expect("a circle");
    assert!((area(&s) / 3.14159265e8 - 1.0).abs() < 1e-3, "{}", area(&s));
    // A star with many self-intersections.
    let _ = load(&circle(&|i| ((i * 7919) % 1000) as f64 / 1000.0 - 0.5));
}

#[test]
fn one_edge_of_very_many_faces() {
    let n = 50_000;
    let mut obj = String::from("v 0 0 0\nv 0 0 1\n");
    for i in 0..n {
        obj += &format!("v 1 {i} 0\no {}\nf 1 2 {}\n", i % 1000, i + 3);
    }
    let s = load(&obj).expect("a fan of pages");
    assert_eq!((s.closed_parts, s.triangles.len()), (0, n));
}
