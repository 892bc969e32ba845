//! OBJ dialects, PLY and glTF.

use super::*;
use std::path::Path;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn obj_in_many_hands() {
    let check = |obj: &str| {
        let s = load(obj).expect(obj);
        check_consistent(&s);
        assert!((area(&s) - 1.0).abs() < 1e-6, "{obj}: {}", area(&s));
        s
    };
    assert_eq!(check(&format!("{SQUARE}f 1 2 3 4")).objects[0].name, "scene", "named after the file");
    check(&format!("{SQUARE}f -4 -3 -2 -1\n"));
    check(&format!("{SQUARE}f 1//1 2//7 3//-9 4//1\n"));
    check(&format!("{SQUARE}vt 0 0\nf 1/1/1 2/99/2 3/-9/3 4/1/4\n"));
    check(&format!("{SQUARE}f 1 2 3 4 # the square\n"));
    check(&format!("\u{feff}{SQUARE}\tf\t1 2 3 4\nl 1 2 3\np 1\nvn 0 0\ns off\ncurv2 x\n"));
    check("f 1 2 3 4\nv 0 0 0 1 0 0\nv 1 0 0 0.5 0.5 0.5 1\nv 2 2 0 2\nv 0 1 0\n");
    let s = check(&format!("{SQUARE}g a\nusemtl x\nf 1 2 3\ng b\nf 1 3 4\ng a\nusemtl y\n"));
    assert_eq!(s.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    let s = check(&format!("{SQUARE}o Schöner Stuhl\nf 1 2 3\no b\nf 1 3 4\n"));
    assert_eq!(s.objects[0].name, "Schöner Stuhl");
    let s = check(&format!("{SQUARE}o a\nf 1 2 3\no b\nv 9 9 9\no a\nf 1 3 4\n"));
    assert_eq!((s.objects.len(), s.repairs.unused_vertices), (1, 1));
}

/// Lines end with LF, CR LF or, in old files, CR.
#[test]
fn lines_may_end_in_three_ways() {
    let obj = format!("# c\n\nmtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 \\\n  3 4\n");
    let mtl = "# c\nnewmtl red\nKd 0.5 0.1 0\nKe 1 2 3\n";
    for end in ["\n", "\r\n", "\r"] {
        let [obj, mtl] = [&obj[..], mtl].map(|text| text.replace('\n', end));
        let s = load_with(&obj, &[("a.mtl", mtl.as_bytes())], &LoadOptions::default()).expect("a square");
        assert!((area(&s) - 1.0).abs() < 1e-6, "{end:?}: {}", area(&s));
        assert_eq!(s.emitters[0].emission, [1.0, 2.0, 3.0], "{end:?}");
        assert!(s.repairs.messages.is_empty(), "{end:?}: {:?}", s.repairs.messages);
        let wrong = format!("# c{end}{end}v 0 0 0{end}v 0 a 0{end}");
        assert!(message(load(&wrong)).starts_with(":4: `a` is not a number"), "{end:?}");
    }
}

#[test]
fn obj_errors_name_the_line() {
    let check = |obj: &str, want: &str| {
        let text = message(load(obj));
        assert!(text.starts_with(want), "{obj}\n  {text}\n  {want}");
    };
    check(&format!("{SQUARE}v 0 nan 0\nf 1 2 3\n"), ":5: the coordinate NaN is not finite");
    check("# c\n\nv 1e30 0 0\n", ":3: the coordinate 1e30 is not finite or beyond");
    check("v 1e999 0 0\n", ":1: the coordinate inf is not finite");
    check("v 1 0 0 0\n", ":1: the coordinate inf");
    check("v 1 0\n", ":1: `v 1 0`: a vertex has three coordinates");
    check("v 1 a 0\n", ":1: `a` is not a number");
    check(&format!("{SQUARE}f 1 2 5\n# end\n"), ":5: there is no vertex 5, the file has 4");
    check(&format!("{SQUARE}f 1 2 0\n"), ":5: there is no vertex 0");
    check(&format!("{SQUARE}f 1 2 -5\n"), ":5: there is no vertex -5");
    check(&format!("{SQUARE}f 1 2 99999999999\n"), ":5: there is no vertex 99999999999");
    check(
        &format!("{SQUARE}f 1 2 99999999999999999999999\n"),
        ":5: `99999999999999999999999` is not a corner",
    );
    check(&format!("{SQUARE}f 1 2 -9223372036854775808\n"), ":5: there is no vertex");
    check(&format!("{SQUARE}f 1 2 c\n"), ":5: `c` is not a corner of a face");
    check("", ": no face with an area; is it a scene");
    check(SQUARE, ": no face with an area");
    check(&format!("{SQUARE}f 1 1 1\n"), ": no face with an area (1 unusable");
    check("v 0 0 0\nv 1e-20 0 0\nv 0 1e-20 0\nf 1 2 3\n", ": all vertices lie within 1e-20 units");
    let mtl = [("a.mtl", "newmtl a\nKe inf 0 0\n".as_bytes())];
    let text = load_with(&format!("mtllib a.mtl\n{SQUARE}f 1 2 3\n"), &mtl, &LoadOptions::default());
    assert!(text.expect_err("infinite").to_string().ends_with("a.mtl:2: `inf 0 0` is not a finite number"));
    // Light that leaves single precision.
    let with = |emission: &str, emitters: &[&str]| {
        let mtl = format!("newmtl a\nKe {emission} 0 0\n");
        let emitters =
            emitters.iter().map(|text| crate::scene::parse_emitter(text).expect("an emitter")).collect();
        let options = LoadOptions { emitters, ..LoadOptions::default() };
        let text = format!("mtllib a.mtl\n{SQUARE}usemtl a\nf 1 2 3\n");
        load_with(&text, &[("a.mtl", mtl.as_bytes())], &options).map_err(|e| e.to_string())
    };
    assert!(with("1e15", &[]).is_ok());
    assert!(with("1e16", &[]).is_err_and(|e| e.contains("from 0 to 1e15; mend its Kd and Ke")));
    assert!(with("1", &["a=1e20"]).is_err_and(|e| e.contains("must be at most 1e15")));
}

#[test]
fn paths_that_are_no_scenes() {
    let check = |path: &str, want: &str| {
        let text = Scene::load_with(Path::new(path), &LoadOptions::default()).expect_err(path).to_string();
        assert!(text.contains(want), "{text}");
    };
    check("/nowhere/a.obj", "No such file");
    check("/nowhere/a.glb", "No such file");
    check("/nowhere/a.ply", "No such file");
    check("/nowhere/a.txt", "No such file");
    check("/dev/null", "unknown kind of scene");
    check("", "");
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = folder.path().join("a.obj");
    fs::create_dir(&path).expect("folder");
    check(&path.to_string_lossy(), "directory");
}

const PLY_HEAD: &str = "element vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
    property uchar red\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n";

/// A unit square as two triangles in binary PLY.
fn binary_ply() -> Vec<u8> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\ncomment x\n{PLY_HEAD}").into_bytes();
    for (x, y) in [(0f32, 0f64), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        bytes.extend(x.to_le_bytes());
        bytes.extend(y.to_le_bytes());
        bytes.extend(0f32.to_le_bytes());
        bytes.push(200);
    }
    for face in [[0i32, 1, 2], [0, 2, 3]] {
        bytes.push(3);
        face.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    }
    bytes
}

#[test]
fn ply_text_and_binary() {
    let text =
        format!("ply\nformat ascii 1.0\n{PLY_HEAD}0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 0 1\n3 0 1 2\n3 0 2 3\n");
    for bytes in [text.clone().into_bytes(), binary_ply()] {
        let s = load_bytes("ply", &bytes).expect("a square");
        check_consistent(&s);
        assert_eq!((s.triangles.len(), s.objects[0].name.as_str()), (2, "scene"));
        assert!((area(&s) - 1.0).abs() < 1e-6);
    }
    let check = |from: &str, to: &str, want: &str| {
        let text = load_bytes("ply", text.replace(from, to).as_bytes()).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check("3 0 2 3", "3 0 2 4", ":16: face 1 uses vertex 4, the file has 4");
    check("3 0 2 3", "3 0 -2 3", "face 1 uses vertex 4294967295");
    check("1 1 0 1", "1 nan 0 1", ":13: not a usable PLY file");
    check("face 2", "face 3", "not a usable PLY file");
    check("vertex 4", "vertex 999999999999", "cannot fit into");
    check("ply\nformat", "plx\nformat", "not a usable PLY file");
}

/// A triangle strip of a unit square under a node that scales by (-2, 1, 1), as GLB.
fn glb(edit: impl Fn(String) -> String) -> Vec<u8> {
    let mut data = Vec::new();
    for p in [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]] {
        p.iter().for_each(|v| data.extend(v.to_le_bytes()));
    }
    [0u16, 1, 2, 3].iter().for_each(|i| data.extend(i.to_le_bytes()));
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"name":"top","children":[1],"scale":[-2,1,1]},{"name":"leaf","mesh":0,"translation":[0,0,3]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5,"material":0}]}],
        "materials":[{"name":"glow","pbrMetallicRoughness":{"baseColorFactor":[0.2,0.3,0.4,1]},
            "emissiveFactor":[1,1,0.5],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4}}}],
        "accessors":[
            {"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
            {"bufferView":1,"componentType":5123,"count":4,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":8}],
        "buffers":[{"byteLength":56}],"extensionsUsed":["KHR_materials_emissive_strength"]}"#;
    // The writer finds the length.
    let header = gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 };
    let json = edit(json.to_owned()).into_bytes();
    gltf::Glb { header, json: json.into(), bin: Some(data.into()) }.to_vec().expect("a file in memory")
}

#[test]
fn gltf_nodes_and_materials() {
    let s = load_bytes("glb", &glb(|j| j)).expect("a square");
    check_consistent(&s);
    assert_eq!((s.triangles.len(), s.objects[0].name.as_str()), (2, "leaf"));
    assert!((area(&s) - 2.0).abs() < 1e-6);
    let corner = |p: Vec3| s.origin + p.as_dvec3();
    assert_eq!(
        (corner(s.bounds.min), corner(s.bounds.max)),
        (DVec3::new(-2.0, 0.0, 3.0), DVec3::new(0.0, 1.0, 3.0))
    );
    assert_eq!(s.triangle_reflectance[0], [0.2, 0.3, 0.4]);
    // The mirrored strip still faces +z.
    let e = &s.emitters[0];
    assert_eq!((e.emission, e.normal), ([4.0, 4.0, 2.0], Vec3::Z));
    assert!(s.cameras.is_empty());
    let glass = |factor: &str| {
        let transmission =
            format!(r#""extensions":{{"KHR_materials_transmission":{{"transmissionFactor":{factor}}},"#);
        let file = glb(|j| j.replacen(r#""extensions":{"#, &transmission, 1));
        let messages = load_bytes("glb", &file).expect("a square").repairs.messages;
        messages.iter().any(|m| m.starts_with("1 materials transmit light"))
    };
    assert!(glass("0.9") && !glass("0"));
    let seen = glb(|j| {
        let lens = r#""cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":1}}],"accessors""#;
        j.replace(r#""mesh":0,"#, r#""mesh":0,"camera":0,"#).replace("\"accessors\"", lens)
    });
    let cameras = load_bytes("glb", &seen).expect("a square and a camera").cameras;
    assert_eq!(
        (cameras.len(), cameras[0].name.as_str(), cameras[0].eye),
        (1, "leaf", DVec3::new(0.0, 0.0, 3.0))
    );
    assert_eq!((cameras[0].forward, cameras[0].up, cameras[0].angle as f32), (DVec3::NEG_Z, DVec3::Y, 0.7));
    let check = |from: &str, to: &str, want: &str| {
        let text = load_bytes("glb", &glb(|j| j.replace(from, to))).expect_err(want).to_string();
        assert!(text.contains(want), "{text}");
    };
    check("\"count\":4,\"type\":\"S", "\"count\":5,\"type\":\"S", "lies outside its buffer view");
    check("\"count\":4,\"type\":\"S", "\"count\":0,\"type\":\"S", "");
    check("\"byteOffset\":48", "\"byteOffset\":4294967290", "lies outside its buffer");
    check("\"indices\":1", "\"indices\":7", "not a usable glTF");
    check("\"type\":\"SCALAR\"", "\"type\":\"VEC2\"", "");
    let cyclic = glb(|j| j.replace("\"mesh\":0,", "\"mesh\":0,\"children\":[0],"));
    assert!(load_bytes("glb", &cyclic).is_ok(), "a cycle ends");
    let mut cut = glb(|j| j);
    cut.truncate(cut.len() - 20);
    assert!(load_bytes("glb", &cut).expect_err("cut off").to_string().contains("cut off"));
}
