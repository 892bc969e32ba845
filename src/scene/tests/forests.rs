//! Generated forests of instances.

use super::*;

fn spec() -> generate::Spec {
    generate::Spec { trees: 30, leaves: 40, species: 3, instances: true, ..generate::Spec::new("forest") }
}

#[test]
fn generated_forests_load_as_they_were() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let placed = generate::placed(&spec()).expect("a forest");
    let built = generate::build(&spec()).expect("a forest");
    assert_eq!((built.placements.len(), built.shared.len()), (30, 3));
    assert_eq!(built.visible_triangles(), 4 + 30 * 2 * 40);
    for name in ["forest.glb", "forest.gltf"] {
        let path = folder.path().join(name);
        write_gltf(&path, &placed, "test").expect("written");
        let loaded = Scene::load_with(&path, &LoadOptions::default()).expect(name);
        check_consistent(&loaded);
        assert!(loaded.repairs.messages.is_empty(), "{:?}", loaded.repairs.messages);
        for (a, b) in loaded.placements.iter().zip(&built.placements) {
            assert_eq!((a.mesh, &a.name), (b.mesh, &b.name));
            // Numbers of JSON are read to a unit in the last place.
            assert!(a.transform.abs_diff_eq(b.transform, 1e-13), "{a:?} {b:?}");
        }
        assert_eq!(loaded.placements.len(), built.placements.len());
        assert_eq!(all_corners(&loaded), all_corners(&built));
        assert_eq!(format!("{:?}", loaded.emitters), format!("{:?}", built.emitters));
        let power = loaded.power(&loaded.emitters[0])[0];
        let (width, _) = generate::ground_and_sky(30);
        assert!((power / (std::f64::consts::PI * 30.0 * width * width) - 1.0).abs() < 1e-6, "{power}");
        for (a, b) in loaded.shared.iter().zip(&built.shared) {
            check_consistent(a);
            assert_eq!(all_corners(a), all_corners(b));
            assert_eq!((a.closed_parts, a.sheet_parts), (0, 40));
            assert_eq!(
                (&a.objects[0].name, &a.triangle_reflectance),
                (&b.objects[0].name, &b.triangle_reflectance)
            );
        }
        check_consistent(&loaded.flattened(u64::MAX).expect("flat"));
    }
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 2, "temporary files are left");
}

#[test]
fn trees_are_placed_at_random() {
    let place = |seed| generate::placed(&generate::Spec { seed, ..spec() }).expect("a forest").placements;
    assert_eq!(format!("{:?}", place(5)), format!("{:?}", place(5)));
    assert_ne!(format!("{:?}", place(5)), format!("{:?}", place(6)));
    for p in place(1) {
        let m = p.transform.matrix3;
        let scale = m.z_axis.z;
        assert!((0.8..1.25).contains(&scale));
        assert!((m.x_axis.length() / scale - 1.0).abs() < 1e-6 && m.x_axis.z == 0.0 && m.z_axis.x == 0.0);
    }
    let check = |spec: generate::Spec, want: &str| {
        let text = generate::build(&spec).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check(generate::Spec { name: "cubes".into(), ..spec() }, "`cubes` has none");
    check(generate::Spec { species: 31, ..spec() }, "`species` 31: must lie in 1..=30");
    check(generate::Spec { trees: 3_000_000, ..spec() }, "`trees` 3000000: a scene has at most");
    check(generate::Spec { leaves: 90_000_000, ..spec() }, "leaves are stored");
    assert!(generate::soup(&spec()).is_err() && generate::placed(&generate::Spec::new("forest")).is_err());
}

/// Trunks have polygons of eight corners, and the soup has two materials.
#[test]
fn trunks_stay_closed() {
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = folder.path().join("forest.glb");
    let spec = generate::Spec { trunks: true, species: 1, ..spec() };
    write_gltf(&path, &generate::placed(&spec).expect("a forest"), "test").expect("written");
    let s = Scene::load_with(&path, &LoadOptions::default()).expect("a forest");
    let tree = &s.shared[0];
    assert_eq!((tree.closed_parts, tree.sheet_parts, tree.materials.len()), (1, 40, 2));
    assert_eq!(tree.triangles.len(), 80 + 16 + 12);
}
