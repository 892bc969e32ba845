//! Meshes with several placements.

use super::*;
use base64::{Engine, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

/// A glTF file of three meshes: 0 `ground`, a square of 2 by 2 m; 1 `tree`, a tetrahedron (closed) and a triangle
/// (sheet) of two materials; 2 `lamp`, a square that emits.
pub(super) fn file(nodes: Value) -> Value {
    let square = [[-1f32, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let solid = [[0f32, 0.0, 0.0], [1.0, 0.0, 0.125], [0.0, 1.0, 0.0], [0.0, 0.0, 1.5]];
    let positions: Vec<f32> = square.iter().chain(&solid).flatten().copied().collect();
    let indices: [u32; 21] = [0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3, 1, 3, 2];
    let mut data: Vec<u8> = bytemuck::cast_slice(&positions).to_vec();
    data.extend_from_slice(bytemuck::cast_slice(&indices));
    let part = |positions: u32, indices: u32, material: u32| json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
    let colour =
        |name: &str, c: [f32; 4]| json!({ "name": name, "pbrMetallicRoughness": { "baseColorFactor": c } });
    let mut lamp = colour("glow", [0.0, 0.0, 0.0, 1.0]);
    lamp["emissiveFactor"] = json!([1, 1, 0.5]);
    let points = |offset: u32| {
        json!({
            "bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": 4, "type": "VEC3",
            "min": [-1, -1, 0], "max": [1, 1, 1.5],
        })
    };
    let corners = |first: u32, count: u32| {
        json!({
            "bufferView": 1, "byteOffset": 4 * first, "componentType": 5125, "count": count, "type": "SCALAR",
        })
    };
    let named: Vec<usize> = (0..nodes.as_array().expect("a list").len()).collect();
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": named }], "nodes": nodes,
        "meshes": [
            { "name": "ground", "primitives": [part(0, 2, 0)] },
            { "name": "tree", "primitives": [part(1, 3, 1), part(0, 4, 2)] },
            { "name": "lamp", "primitives": [part(0, 2, 3)] },
        ],
        "materials": [
            colour("soil", [0.25, 0.5, 0.125, 1.0]), colour("bark", [0.5, 0.25, 0.25, 1.0]),
            colour("leaf", [0.125, 0.5, 0.25, 1.0]), lamp,
        ],
        "accessors": [points(0), points(48), corners(0, 6), corners(6, 12), corners(18, 3)],
        "bufferViews": [
            { "buffer": 0, "byteLength": 96 }, { "buffer": 0, "byteOffset": 96, "byteLength": 84 },
        ],
        "buffers": [{ "byteLength": 180, "uri": format!("data:;base64,{}", STANDARD.encode(&data)) }],
    })
}

fn read(file: &Value) -> Result<Scene> {
    read_with(file, &LoadOptions::default())
}

pub(super) fn read_with(file: &Value, options: &LoadOptions) -> Result<Scene> {
    load_file("gltf", file.to_string().as_bytes(), &[], options)
}

/// The same file with a copy of the mesh for each node.
fn without_sharing(file: &Value) -> Value {
    let mut file = file.clone();
    let meshes = file["meshes"].clone();
    let mut copies = Vec::new();
    for node in file["nodes"].as_array_mut().expect("nodes") {
        copies.push(meshes[node["mesh"].as_u64().expect("a mesh") as usize].clone());
        node["mesh"] = json!(copies.len() - 1);
    }
    file["meshes"] = json!(copies);
    file
}

fn ground_and_lamp() -> Vec<Value> {
    vec![
        json!({ "name": "ground", "mesh": 0, "scale": [10, 10, 1], "translation": [0, 0, -1] }),
        json!({ "name": "lamp", "mesh": 2, "translation": [0, 0, 9], "rotation": [1, 0, 0, 0] }),
    ]
}

pub(super) fn orchard() -> Value {
    let mut nodes = ground_and_lamp();
    nodes.push(json!({ "name": "oak", "mesh": 1, "translation": [-5, 0, 0] }));
    nodes.push(json!({
        "name": "elm", "mesh": 1, "translation": [5, 0.3, 0], "rotation": [0, 0, 0.6, 0.8], "scale": [1.3, 1.3, 1.3],
    }));
    nodes.push(json!({ "name": "mirrored", "mesh": 1, "translation": [0, 5, 0], "scale": [-0.7, 0.7, 0.7] }));
    json!(nodes)
}

/// All fields of triangles, materials and parts, without repairs, which count shared meshes once.
fn description(s: &Scene) -> String {
    let parts = (s.closed_parts, s.sheet_parts, s.bounds, s.origin, &s.objects, &s.materials, &s.emitters);
    let faces = (&s.triangle_object, &s.triangle_material, &s.triangle_polygon, &s.triangle_reflectance);
    let more = (&s.triangle_sides, &s.triangle_component, &s.triangle_emitter, &s.triangle_texcoords);
    format!("{parts:?}{faces:?}{more:?}{:?}{:?}", s.positions, s.triangles)
}

#[test]
fn nodes_share_a_mesh() {
    let s = read(&file(orchard())).expect("an orchard");
    check_consistent(&s);
    assert_eq!((s.triangles.len(), s.emitters.len(), s.shared.len()), (4, 1, 1));
    let names: Vec<&str> = s.placements.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["oak", "elm", "mirrored"]);
    let tree = &s.shared[0];
    check_consistent(tree);
    assert_eq!((tree.triangles.len(), tree.closed_parts, tree.sheet_parts), (5, 1, 1));
    assert_eq!((tree.objects[0].name.as_str(), tree.materials.len(), tree.emitters.len()), ("tree", 2, 0));
    assert!(tree.path.to_string_lossy().ends_with("scene.gltf#tree"), "{}", tree.path.display());
    assert_eq!(s.visible_triangles(), 4 + 3 * 5);
    assert!(s.repairs.messages.is_empty(), "{:?}", s.repairs.messages);
    assert!(s.bytes() > tree.bytes());
}

#[test]
fn flattened_is_what_flat_files_hold() {
    for far in [0.0, 3e6] {
        let mut nodes = orchard();
        for node in nodes.as_array_mut().expect("nodes") {
            node["translation"][0] = json!(node["translation"][0].as_f64().expect("a number") + far);
        }
        let shared = file(nodes);
        let (s, flat) = (read(&shared).expect("shared"), read(&without_sharing(&shared)).expect("flat"));
        assert!(flat.placements.is_empty() && flat.shared.is_empty());
        let flattened = s.flattened(u64::MAX).expect("flattened");
        check_consistent(&flattened);
        assert!(flattened.placements.is_empty() && flattened.shared.is_empty());
        assert_eq!(flattened.triangles.len() as u64, s.visible_triangles());
        assert!(s.world_bounds().contains(flattened.bounds));
        if far == 0.0 {
            assert_eq!(description(&flattened), description(&flat));
            assert_eq!(description(&flat.flattened(u64::MAX).expect("flat")), description(&flat));
        } else {
            // The origins differ: the centre of all meshes for the flat file, the centre of the ground otherwise.
            for t in 0..flat.triangles.len() as u32 {
                for (a, b) in flat.corners(t).into_iter().zip(flattened.corners(t)) {
                    let apart = (flat.origin + a.as_dvec3() - flattened.origin - b.as_dvec3()).length();
                    assert!(apart < 1e-5, "triangle {t}: {apart}");
                }
            }
        }
    }
}

#[test]
fn hidden_and_repainted_placements() {
    let mut s = read(&file(orchard())).expect("an orchard");
    s.placements[0].visible = false;
    s.placements[1].material = Some(0);
    let flat = s.flattened(u64::MAX).expect("flattened");
    check_consistent(&flat);
    assert_eq!((flat.objects.len(), s.visible_triangles()), (4, 14));
    let elm = flat.faces_named("elm").expect("elm")[0] as usize;
    assert_eq!((flat.triangle_material[elm], flat.triangle_reflectance[elm]), (0, [0.25, 0.5, 0.125]));
    let refused = |s: &Scene, want: &str| {
        let text = s.flattened(u64::MAX).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    let text = s.flattened(13).expect_err("too many").to_string();
    assert!(text.contains("3 placements of 1 mesh would become 14 triangles"), "{text}");
    s.placements[1].material = Some(3);
    refused(&s, "`elm` has a material that emits");
    s.placements[1].material = Some(99);
    refused(&s, "`elm` refers to a material that does not exist");
    s.placements[1].mesh = 1;
    refused(&s, "`elm` refers to a mesh that does not exist");
    assert_eq!(s.visible_triangles(), 9);
}

#[test]
fn stretched_nodes_are_copied() {
    let mut nodes = orchard();
    nodes[3]["scale"] = json!([1.0, 1.02, 1.0]);
    nodes[4]["scale"] = json!([1.0, 1.005, 1.0]);
    let shared = file(nodes);
    let s = read(&shared).expect("an orchard");
    assert_eq!((s.placements.len(), s.triangles.len(), s.repairs.copied_placements), (2, 9, 1));
    assert_eq!(
        s.repairs.messages,
        ["1 nodes place a shared mesh with shear or unequal scale: their triangles were copied"]
    );
    assert!(
        (area(&s.flattened(u64::MAX).expect("flat")) - area(&read(&without_sharing(&shared)).expect("flat")))
            .abs()
            < 1e-4
    );
}

/// Numbers of 32 bits would place a mesh at five thousand kilometres up to a quarter of a metre beside its place.
#[test]
fn nodes_far_from_the_origin_keep_their_places() {
    let far = 5_432_109.3;
    let s =
        read(&file(json!([{ "name": "ground", "mesh": 0, "translation": [far, 0, 0] }]))).expect("a ground");
    let right = s.origin.x + f64::from(s.bounds.max.x);
    assert!((right - far - 1.0).abs() < 1e-6, "{right}");
}

#[test]
fn emitters_are_never_placements() {
    let mut nodes = orchard();
    let list = nodes.as_array_mut().expect("nodes");
    list.push(
        json!({ "name": "second lamp", "mesh": 2, "translation": [3, 0, 9], "rotation": [1, 0, 0, 0] }),
    );
    let shared = file(nodes);
    let s = read(&shared).expect("two lamps");
    assert_eq!((s.emitters.len(), s.placements.len(), s.emitters[1].name.as_str()), (2, 3, "second lamp"));
    let lit = |name: &str| {
        let options = LoadOptions {
            emitters: vec![(name.into(), Strength::Watts(5.0))],
            sides: Some(2),
            ..Default::default()
        };
        read_with(&shared, &options)
    };
    let s = lit("elm").expect("one tree glows");
    check_consistent(&s);
    assert_eq!((s.placements.len(), s.triangles.len()), (2, 4 + 2 + 5));
    assert!(s.shared[0].triangle_sides.iter().all(|&side| side == 2));
    let power: f64 = s.emitters.iter().filter(|e| e.name.starts_with("elm")).map(|e| s.power(e)[0]).sum();
    assert!((power - 5.0).abs() < 1e-5, "{power}");
    let s = lit("leaf").expect("all leaves glow");
    assert_eq!((s.placements.len(), s.shared.len(), s.triangles.len()), (0, 0, 6 + 15));
    assert!(lit("ash").expect_err("no ash").to_string().contains("is called `ash`"));
}

#[test]
fn a_scene_has_triangles_of_its_own() {
    let trees = |more: Vec<Value>| {
        let mut nodes = vec![
            json!({ "name": "a", "mesh": 1 }),
            json!({ "name": "b", "mesh": 1, "translation": [4, 0, 0] }),
        ];
        nodes.extend(more);
        read(&file(json!(nodes)))
    };
    let s = trees(vec![]).expect("two trees");
    assert_eq!((s.objects[0].name.as_str(), s.placements[0].name.as_str()), ("a", "b"));
    assert_eq!((s.objects.len(), s.placements.len(), s.triangles.len()), (1, 1, 5));
    // The only other node has no face with an area.
    let s = trees(vec![json!({ "mesh": 0, "scale": [0, 0, 0] })]).expect("two trees");
    assert_eq!((s.placements.len(), s.triangles.len(), s.repairs.zero_area_faces), (1, 5, 2));
}

#[test]
fn nodes_in_one_place_and_of_no_size() {
    let mut nodes = orchard();
    let list = nodes.as_array_mut().expect("nodes");
    list.push(json!({ "mesh": 1, "translation": [-5, 0, 0] }));
    list.push(json!({ "mesh": 1, "scale": [0, 0, 0] }));
    list.push(json!({ "mesh": 1, "scale": [1e-30, 1e-30, 1e-30] }));
    let s = read(&file(nodes)).expect("an orchard");
    assert_eq!((s.placements.len(), s.triangles.len()), (3, 4));
    assert_eq!(
        s.repairs.messages,
        [
            "1 nodes place a mesh exactly where another node places it: left out",
            "2 nodes scale their mesh to a size of zero: left out"
        ]
    );
}

#[test]
fn instances_of_the_extension() {
    let mut shared = file(json!(ground_and_lamp()));
    let data: [f32; 6] = [0.0, 0.0, 0.0, 4.0, 0.0, 0.5];
    let turns: [f32; 8] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.6, 0.8];
    let mut bytes: Vec<u8> = bytemuck::cast_slice(&data).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&turns));
    let push = |list: &mut Value, item: Value| list.as_array_mut().expect("a list").push(item);
    push(
        &mut shared["buffers"],
        json!({ "byteLength": 56, "uri": format!("data:;base64,{}", STANDARD.encode(bytes)) }),
    );
    push(&mut shared["bufferViews"], json!({ "buffer": 1, "byteLength": 56 }));
    let accessor = |offset: u32, kind: &str| json!({ "bufferView": 2, "byteOffset": offset, "componentType": 5126, "count": 2, "type": kind });
    push(&mut shared["accessors"], accessor(0, "VEC3"));
    push(&mut shared["accessors"], accessor(24, "VEC4"));
    push(
        &mut shared["nodes"],
        json!({
            "name": "tree", "mesh": 1, "translation": [0, 1, 0], "scale": [2, 2, 2],
            "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 5, "ROTATION": 6 } } },
        }),
    );
    shared["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    shared["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    shared["extensionsRequired"] = shared["extensionsUsed"].clone();
    let s = read(&shared).expect("two trees");
    let names: Vec<&str> = s.placements.iter().map(|p| p.name.as_str()).collect();
    assert_eq!((names, s.triangles.len()), (vec!["tree", "tree 2"], 4));
    let p = s.placements[1].transform.transform_point3(DVec3::X);
    // Turned by 2 atan(0.6 / 0.8) about z, moved, then doubled and moved by the node.
    assert!((p - DVec3::new(2.0 * (4.0 + 0.28), 1.0 + 2.0 * 0.96, 1.0)).length() < 1e-6, "{p}");
    let check = |from: &str, to: &str, want: &str| {
        let text =
            load_bytes("gltf", shared.to_string().replace(from, to).as_bytes()).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check("\"ROTATION\":6", "\"ROTATION\":600", "an accessor that does not exist");
    check("\"ROTATION\":6", "\"ROTATION\":4", "of the wrong kind");
    check("\"ROTATION\":6", "\"SCALE\":0", "its lists have different lengths");
    check("\"attributes\":{\"ROTATION\":6,\"TRANSLATION\":5}", "\"attributes\":{}", "it lists no instances");
}

#[test]
fn matrices_that_mean_harm() {
    let check = |node: Value, want: &str| {
        let mut nodes = orchard();
        nodes.as_array_mut().expect("nodes").push(node);
        let text = read(&file(nodes)).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check(
        json!({ "name": "x", "mesh": 1, "scale": [1e39, 1, 1] }),
        "of `x` has a coordinate that is not finite or beyond 1e12",
    );
    check(
        json!({ "name": "x", "mesh": 1, "translation": [1e13, 0, 0] }),
        "node `x` places its mesh at coordinates",
    );
    check(
        json!({ "name": "x", "mesh": 1, "scale": [1e15, 1e15, 1e15] }),
        "node `x` places its mesh at coordinates",
    );
    check(json!({ "name": "x", "mesh": 7 }), "not a usable glTF file");
    // Singular: flattened to a plane, and to a line.
    for (scale, triangles) in [([1.0, 1.0, 0.0], 4 + 2), ([1.0, 0.0, 0.0], 4)] {
        let mut nodes = orchard();
        nodes
            .as_array_mut()
            .expect("nodes")
            .push(json!({ "mesh": 1, "scale": scale, "translation": [0, 0, 3] }));
        let s = read(&file(nodes)).expect("an orchard");
        check_consistent(&s);
        assert_eq!((s.placements.len(), s.repairs.copied_placements), (3, 1));
        assert_eq!(s.triangles.len(), triangles, "{scale:?}");
    }
}

/// Only faces of the scene's own are put in order: nodes with overlapping faces in one plane are copied, others stay placements.
#[test]
fn nodes_with_faces_in_the_plane_of_others_are_copied() {
    let nodes = |shift: f64, height: f64| {
        let mut nodes = orchard();
        for (name, x, z) in [("left", 0.0, 0.0), ("right", shift, 0.0), ("above", 0.0, height)] {
            let node = json!({ "name": name, "mesh": 0, "translation": [20.0 + x, 0, z] });
            nodes.as_array_mut().expect("nodes").push(node);
        }
        file(nodes)
    };
    let apart = read(&nodes(2.0, 0.01)).expect("squares edge to edge");
    assert_eq!((apart.repairs.copied_placements, apart.placements.len()), (1, 3 + 3));
    let overlapping = read(&nodes(1.9, 0.01)).expect("two overlapping squares");
    assert_eq!((overlapping.repairs.copied_placements, overlapping.contacts.len()), (1 + 2, 1));
    assert!(
        overlapping
            .repairs
            .messages
            .iter()
            .any(|m| m.contains("2 nodes place a shared mesh with faces in the plane"))
    );
}

#[test]
fn ten_million_nodes() {
    let text = file(json!([{ "mesh": 1 }])).to_string();
    let many = |count: usize| {
        text.replace("[{\"mesh\":1}]", &format!("[{}{{\"mesh\":1}}]", "{\"mesh\":1},".repeat(count - 1)))
    };
    let error = load_bytes("gltf", many(10_000_000).as_bytes()).expect_err("too many").to_string();
    assert!(error.contains("10000000 nodes, more than 2097152"), "{error}");
    let count = 200_000;
    let listed: Vec<usize> = (0..count).collect();
    let all = many(count).replace("\"nodes\":[0]", &format!("\"nodes\":{}", json!(listed)));
    let s = load_bytes("gltf", all.as_bytes()).expect("one tree");
    assert_eq!((s.placements.len(), s.triangles.len()), (0, 5));
}
