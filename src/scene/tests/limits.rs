//! Textures that are shared, polygons of many corners, and what is left out with a note.

use super::*;
use base64::{Engine, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

/// A PNG of one colour.
fn png(side: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_pixel(side, side, image::Rgba([188, 188, 188, 255]));
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG");
    bytes.into_inner()
}

/// One triangle with the last of `count` materials, which all have the same texture.
fn textured(count: usize, side: u32) -> Value {
    let numbers = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut data: Vec<u8> = bytemuck::cast_slice(&numbers).to_vec();
    let image = png(side);
    data.extend_from_slice(&image);
    let material = |i: usize| json!({ "name": format!("m{i}"), "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } });
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": count - 1 }] }],
        "materials": (0..count).map(material).collect::<Vec<_>>(),
        "textures": [{ "source": 0 }], "images": [{ "bufferView": 2, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 }, { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 60, "byteLength": image.len() },
        ],
        "buffers": [{
            "byteLength": data.len(),
            "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(&data)),
        }],
    })
}

/// 300 entries of the same image take its memory once: entries of the same buffer view, of the same bytes in other views, of the same
/// `data:` URI, and of the same file under several names.
#[test]
fn equal_images_are_decoded_once() {
    let folder = tempfile::tempdir().expect("scratch folder");
    std::fs::create_dir(folder.path().join("sub")).expect("made");
    std::fs::write(folder.path().join("t.png"), png(1024)).expect("written");
    let data = format!("data:image/png;base64,{}", STANDARD.encode(png(1024)));
    let names = ["t.png", "./t.png", "%74.png", "sub/../t.png"];
    let entries: [(&str, &dyn Fn(usize) -> Value); 4] = [
        ("view", &|_| json!({ "bufferView": 2, "mimeType": "image/png" })),
        ("equal views", &|i| json!({ "bufferView": 2 + i, "mimeType": "image/png" })),
        ("data", &|_| json!({ "uri": data })),
        ("file", &|i| json!({ "uri": names[i % names.len()] })),
    ];
    for (what, entry) in entries {
        let mut file = textured(300, 1024);
        file["images"] = (0..300).map(entry).collect();
        file["textures"] = (0..300).map(|i| json!({ "source": i })).collect();
        for i in 0..300 {
            file["materials"][i]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(i);
        }
        let views = file["bufferViews"].as_array_mut().expect("views");
        views.extend(vec![views[2].clone(); 299]);
        // One texture takes 4 MB, and 21 MB while it is decoded.
        let options = LoadOptions { max_memory: Some(32 << 20), ..LoadOptions::default() };
        let bytes = file.to_string();
        let read = |options| read_from_memory(Some(folder.path()), "gltf", bytes.as_bytes(), &options);
        let tight = LoadOptions { max_memory: Some(8 << 20), ..options.clone() };
        let scene = read(options).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert!((scene.triangle_reflectance[0][0] - 0.5029).abs() < 1e-3, "{what}");
        let error = read(tight).expect_err("too large");
        assert!(matches!(error, crate::Error::OutOfMemory(_)), "{what}: {error}");
    }
}

/// A star of 12,000 corners does not cross itself.
#[test]
fn stars_of_many_corners_keep_their_area() {
    let n = 12_000;
    let corner = |i: usize| {
        let radius = if i.is_multiple_of(2) { 1.0 } else { 0.4 };
        let (sin, cos) = (i as f64 / n as f64 * std::f64::consts::TAU).sin_cos();
        (radius * cos, radius * sin)
    };
    let mut obj = String::new();
    for (x, y) in (0..n).map(corner) {
        obj += &format!("v {x} {y} 0\n");
    }
    obj += "f";
    (1..=n).for_each(|i| obj += &format!(" {i}"));
    let scene = load(&obj).expect("a star");
    // Half the sum of the cross products of neighbours.
    let want = 0.5 * n as f64 * 0.4 * (std::f64::consts::TAU / n as f64).sin();
    assert!((area(&scene) / want - 1.0).abs() < 1e-3, "{} instead of {want}", area(&scene));
    assert_eq!(scene.repairs.broken_polygons, 0);
}

/// What is not supported is counted in a note.
#[test]
fn lights_and_maps_that_are_not_read_are_noted() {
    let mut file = textured(1, 2);
    file["nodes"][0]["extensions"] = json!({ "KHR_lights_punctual": { "light": 0 } });
    file["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    file["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    file["nodes"][0]["translation"] = json!([0, 0, 1e30]);
    let far = load_bytes("gltf", file.to_string().as_bytes()).expect_err("beyond all scenes").to_string();
    assert!(far.contains("scene.gltf: light"), "{far}");
    file["nodes"][0]["translation"] = json!([0, 0, 1]);
    let scene = load_bytes("gltf", file.to_string().as_bytes()).expect("a scene");
    let noted = |s: &Scene, what: &str| s.repairs.messages.iter().any(|m| m.contains(what));
    assert!(
        noted(&scene, "1 light of KHR_lights_punctual made into emitters"),
        "{:?}",
        scene.repairs.messages
    );
    let obj = "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let maps: &[(&str, &[u8])] = &[("a.mtl", b"newmtl a\nKe 1 1 1\nmap_Ke e.png\nmap_d d.png\n")];
    let scene = load_with(obj, maps, &LoadOptions::default()).expect("a scene");
    assert!(noted(&scene, "1 map_Ke") && noted(&scene, "1 map_d"), "{:?}", scene.repairs.messages);
}

/// A library with 50,000 unreadable textures gives a few messages and the count; so do 150,000 names of libraries (minutes if each is
/// compared with all others).
#[test]
fn missing_files_give_few_messages() {
    let library: String = (0..50_000).map(|i| format!("newmtl m{i}\nmap_Kd {i}.png\n")).collect();
    let obj = "mtllib a.mtl\nusemtl m1\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = load_with(obj, &[("a.mtl", library.as_bytes())], &LoadOptions::default()).expect("a scene");
    assert!(scene.repairs.missing_files == 50_000 && scene.repairs.messages.len() < 30);
    // The same of material libraries, named in one line.
    let names: Vec<String> = (0..150_000).map(|i| format!("a{i}.mtl")).collect();
    let scene = load(&format!("mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", names.join(" ")));
    let notes = scene.expect("a scene").repairs.messages.clone();
    let has = |what: &str| notes.iter().any(|note| note.contains(what));
    assert!(has("a0.mtl: ") && has("149980 more files could not be read") && notes.len() < 30, "{notes:?}");
}
