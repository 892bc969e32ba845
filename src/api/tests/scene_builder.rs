//! Scenes from arrays: equal to those of files, and wrong arrays are named.

use crate::math::rows;
use crate::model::{Model, PrepareOptions};
use crate::scene::generate::{Spec, placed, soup};
use crate::scene::{LoadOptions, PlacedSoup, Scene, Soup, write_gltf, write_obj};
use crate::{Error, MeshArrays, SceneBuilder, Strided};
use glam::{DAffine3, DMat3, DVec3};
use proptest::prelude::*;

/// The arrays of one object of a soup: positions, indices, sizes and materials of its polygons.
type Arrays = (Vec<[f64; 3]>, Vec<u32>, Vec<u32>, Vec<u32>);

/// The polygons of an object; materials as `material` numbers them.
fn arrays(soup: &Soup, object: u32, material: impl Fn(u32) -> u32) -> Arrays {
    let positions = soup.positions.iter().map(|p| p.to_array()).collect();
    let (mut indices, mut sizes, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    for i in (0..soup.polygons()).filter(|&i| soup.polygon_object[i] == object) {
        indices.extend_from_slice(&soup.corners[soup.span(i)]);
        sizes.push(soup.span(i).len() as u32);
        materials.push(material(soup.polygon_material[i]));
    }
    (positions, indices, sizes, materials)
}

/// A builder with everything of a soup.
fn built(all: &PlacedSoup) -> SceneBuilder {
    let mut builder = SceneBuilder::default();
    let mut names: Vec<&str> = Vec::new();
    for m in all.soup.materials.iter().chain(all.meshes.iter().flat_map(|mesh| &mesh.materials)) {
        if !names.contains(&m.name.as_str()) {
            names.push(&m.name);
            builder.add_material(&m.name, m.reflectance, m.emission).unwrap();
        }
    }
    let number = |soup: &Soup, m: u32| {
        let name = &soup.materials[m as usize].name;
        names.iter().position(|known| known == name).unwrap() as u32
    };
    for (object, name) in (0..).zip(&all.soup.objects) {
        let (positions, indices, sizes, materials) = arrays(&all.soup, object, |m| number(&all.soup, m));
        let mesh = MeshArrays::new(name, &positions[..], &indices);
        builder.add_object(&mesh.polygon_sizes(&sizes).face_materials(&materials)).unwrap();
    }
    for mesh in &all.meshes {
        let (positions, indices, sizes, materials) = arrays(mesh, 0, |m| number(mesh, m));
        let arrays = MeshArrays::new(&mesh.objects[0], &positions[..], &indices);
        builder.add_shared_mesh(&arrays.polygon_sizes(&sizes).face_materials(&materials)).unwrap();
    }
    for p in &all.placements {
        builder.add_instance(p.mesh, &p.name, rows(&p.transform)).unwrap();
    }
    builder
}

/// Corners of all triangles with the names of object and material and their light, and the emitters.
fn content(scene: &Scene) -> (Vec<String>, Vec<String>) {
    let triangles = (0..scene.triangles.len() as u32).map(|t| {
        let corners = scene.corners(t).map(|p| (scene.origin + p.as_dvec3()).to_array());
        let object = &scene.objects[scene.triangle_object[t as usize] as usize].name;
        let material = &scene.materials[scene.triangle_material[t as usize] as usize];
        format!("{corners:?} {object} {} {:?} {:?}", material.name, material.reflectance, material.emission)
    });
    (
        triangles.collect(),
        scene.emitters.iter().map(|e| format!("{} {} {:?}", e.name, e.area, e.emission)).collect(),
    )
}

/// Transmittances from a few points of the box of the scene to its first source.
fn answers(scene: Scene) -> Vec<u32> {
    let [low, high] = scene.bounds().map(DVec3::from_array);
    let model = Model::prepare(scene, &PrepareOptions::default()).unwrap();
    let visibility = model.visibility();
    let answer = |k: u32| {
        let place = sobol_burley::sample_4d(k, 0, 3).map(f64::from);
        let point = low + (high - low) * DVec3::from_slice(&place[..3]);
        let up = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]][k as usize % 2];
        let size = (high - low).length() as f32 / 50.0;
        let query = visibility.from_point(point.to_array(), up).to_source(0).feature_size(size);
        query.answer().map_or(u32::MAX, |a| a.transmittance.to_bits())
    };
    (0..64).map(answer).collect()
}

#[test]
fn arrays_make_the_scene_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["cornell", "desk-room"] {
        let soup = soup(&Spec::new(name)).unwrap();
        let path = folder.path().join(name).with_extension("obj");
        write_obj(&path, &soup, &[]).unwrap();
        let file = Scene::load(&path).unwrap();
        let arrays = built(&PlacedSoup { soup, ..PlacedSoup::default() });
        let arrays = arrays.finish(&LoadOptions::default()).unwrap();
        assert_eq!(content(&file), content(&arrays), "{name}");
        assert_eq!(content(&file), content(&file.flattened(u64::MAX).unwrap()), "nothing to flatten");
        assert_eq!(answers(file), answers(arrays), "{name}");
    }
}

#[test]
fn instances_make_the_scene_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forest.glb");
    let all = placed(&Spec { trees: 9, leaves: 60, instances: true, ..Spec::new("forest") }).unwrap();
    write_gltf(&path, &all, "test").unwrap();
    let file = Scene::load(&path).unwrap();
    // A file lists shared meshes and materials in its own order, so the placements are compared where they are.
    let arrays = built(&all).finish(&LoadOptions::default()).unwrap();
    assert_eq!(file.visible_triangle_count(), arrays.visible_triangle_count());
    let flat = |scene: &Scene| content(&scene.flattened(u64::MAX).unwrap());
    assert_eq!(flat(&file), flat(&arrays));
    assert_eq!(answers(file), answers(arrays));
}

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// A builder with a grey and an emissive material.
fn with_materials() -> SceneBuilder {
    let mut builder = SceneBuilder::default();
    assert_eq!(builder.add_material("grey", [0.5; 3], [0.0; 3]).unwrap(), 0);
    assert_eq!(builder.add_material("light", [0.0; 3], [1.0; 3]).unwrap(), 1);
    builder
}

fn says<T: std::fmt::Debug>(result: crate::Result<T>, part: &str) {
    let message = result.unwrap_err().to_string();
    assert!(message.contains(part), "{message}");
}

#[test]
fn instances_alone_make_a_scene() {
    let mut builder = with_materials();
    let mesh = MeshArrays::new("square", &SQUARE[..], &[0, 1, 2, 3]).polygon_sizes(&[4]);
    assert_eq!(builder.add_shared_mesh(&mesh).unwrap(), 0);
    // A mirrored square, whose front still shows upwards, and another above it.
    let mirror = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
    builder.add_instance(0, "first", rows(&mirror)).unwrap();
    builder.add_instance(0, "second", rows(&DAffine3::from_translation(DVec3::Z))).unwrap();
    let scene = builder.finish(&LoadOptions::default()).unwrap();
    assert_eq!((scene.triangle_count(), scene.visible_triangle_count()), (4, 4));
    assert_eq!(scene.object_names().collect::<Vec<_>>(), ["first"]);
    assert_eq!(scene.bounds(), [[-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]);
    let [a, b, c] = scene.corners(0);
    assert!((b - a).cross(c - a).z > 0.0);
}

#[test]
fn wrong_arrays_are_named() {
    let square = || MeshArrays::new("a", &SQUARE[..], &[0, 1, 2]);
    let add = |mesh: &MeshArrays| with_materials().add_object(mesh);
    says(add(&MeshArrays::new("a", &SQUARE[..], &[0, 1, 4])), "`indices`[2] 4 of mesh `a`: must be below 4");
    says(add(&MeshArrays::new("a", &SQUARE[..], &[0, 1, 2, 3])), "no multiple of 3");
    says(add(&MeshArrays::new("a", &SQUARE[..], &[])), "`indices` is empty");
    says(add(&square().polygon_sizes(&[4])), "`polygon_sizes` sum to 4");
    says(add(&square().polygon_sizes(&[3, 0])), "`polygon_sizes`[1] 0");
    says(add(&square().material(2)), "`material`[0] 2 of mesh `a`: there are 2 materials");
    says(add(&square().face_materials(&[0, 0])), "2 entries for 1 polygons");
    says(add(&MeshArrays::new("", &SQUARE[..], &[0, 1, 2])), "must not be empty");
    let bad = [[0.0f64; 3], [0.0, f64::NAN, 0.0], [0.0; 3]];
    says(add(&MeshArrays::new("a", &bad[..], &[0, 1, 2])), "`positions`[1]");
    let far = Strided::new(&[0.0, 0.0, 2e12], 0, 1).unwrap();
    says(add(&MeshArrays::new("a", far, &[0, 0, 0])), "`positions`[0]");

    let mut builder = with_materials();
    says(builder.add_material("grey", [0.0; 3], [0.0; 3]), "this name is taken");
    says(builder.add_material("b", [1.5, 0.0, 0.0], [0.0; 3]), "`reflectance` 1.5");
    says(builder.add_material("b", [0.0; 3], [f32::INFINITY, 0.0, 0.0]), "`emission` inf");
    builder.add_object(&square()).unwrap();
    says(builder.add_object(&square()), "this name is taken");
    says(builder.add_shared_mesh(&square().material(1)), "its material `light` emits");
    says(builder.add_instance(0, "i", rows(&DAffine3::IDENTITY)), "shared meshes of the scene: 0;");
    builder.add_shared_mesh(&square()).unwrap();
    says(builder.add_instance(0, "a", rows(&DAffine3::IDENTITY)), "this name is taken");
    says(builder.add_instance(0, "i", rows(&DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0)))), "ratio 2.000");
    says(builder.add_instance(0, "i", rows(&DAffine3::from_translation(DVec3::NAN))), "not finite");
    says(builder.add_instance(0, "i", [[0.0; 4]; 3]), "its scale must not be 0");
    says(
        builder.add_instance(0, "i", rows(&DAffine3::from_scale(DVec3::splat(1e200)))),
        "beyond 1e12; lower the scale",
    );
    says(builder.add_instance(0, "i", rows(&DAffine3::from_scale(DVec3::splat(2e12)))), "beyond 1e12");
    builder.add_instance(0, "i", rows(&DAffine3::IDENTITY)).unwrap();
    says(
        builder.finish(&LoadOptions {
            emitters: vec![("i".into(), crate::Strength::Watts(1.0))],
            ..LoadOptions::default()
        }),
        "the instance `i` would emit",
    );
    assert!(matches!(SceneBuilder::default().finish(&LoadOptions::default()), Err(Error::File { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Whatever the arrays hold: a scene or an error, and an error changes nothing.
    #[test]
    fn any_arrays_give_a_scene_or_an_error(
        positions in prop::collection::vec(prop::array::uniform3(prop_oneof![
            -2.0f64..2.0, Just(0.0), Just(1e12), Just(f64::NAN), Just(f64::INFINITY), Just(1e-300),
        ]), 0..9),
        indices in prop::collection::vec(0u32..10, 0..16),
        sizes in prop::option::of(prop::collection::vec(0u32..7, 0..5)),
        materials in prop::option::of(prop::collection::vec(0u32..3, 0..5)),
        shared in any::<bool>(),
        matrix in prop::array::uniform3(prop::array::uniform4(prop_oneof![
            Just(0.0f64), Just(1.0), Just(-1.0), -1e3..1e3, Just(f64::NAN),
        ])),
    ) {
        let mut builder = with_materials();
        let mut mesh = MeshArrays::new("mesh", &positions[..], &indices);
        if let Some(sizes) = &sizes {
            mesh = mesh.polygon_sizes(sizes);
        }
        if let Some(materials) = &materials {
            mesh = mesh.face_materials(materials);
        }
        if shared {
            let added = builder.add_shared_mesh(&mesh).is_ok();
            let placed = builder.add_instance(0, "instance", matrix);
            prop_assert!(added || placed.is_err());
        } else if builder.add_object(&mesh).is_err() {
            let empty = MeshArrays::new("mesh", &SQUARE[..], &[0, 1, 2]);
            prop_assert!(builder.add_object(&empty).is_ok());
        }
        match builder.finish(&LoadOptions::default()) {
            Ok(scene) => prop_assert!(scene.triangle_count() > 0),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
