//! Scenes from the bytes of files.

use crate::scene::{LoadOptions, Scene};
use std::path::Path;

const OBJ: &str = "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn read(data: &str, format: &str, folder: Option<&Path>) -> crate::Result<Scene> {
    Scene::from_memory(data.as_bytes(), format, folder, &LoadOptions::default())
}

#[test]
fn files_are_looked_for_in_the_folder_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.mtl"), "newmtl red\nKd 0.9 0.1 0.1\n").unwrap();
    let scene = read(OBJ, "obj", Some(folder.path())).unwrap();
    assert_eq!(scene.materials[0].reflectance, [0.9, 0.1, 0.1]);
    assert_eq!(scene.files, [folder.path().join("a.mtl")]);
    assert!(scene.unread_files.is_empty());
    // As for files, a library that is missing is a repair.
    let without = read(OBJ, "obj", Some(&folder.path().join("b"))).unwrap();
    assert!(!without.repairs().is_empty() && without.files.is_empty());
    assert_eq!(without.unread_files, [folder.path().join("b/a.mtl")]);
}

#[test]
fn without_a_folder_a_name_of_a_file_is_an_error() {
    let gltf = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"a.bin","byteLength":4}]}"#;
    let texture = r#"{"asset":{"version":"2.0"},"images":[{"uri":"a.png"}],"textures":[{"source":0}],
        "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]}"#;
    for (data, format, name) in [(OBJ, "obj", "a.mtl"), (gltf, "gltf", "a.bin"), (texture, "gltf", "a.png")] {
        let message = read(data, format, None).expect_err(name).to_string();
        assert!(message.contains(name) && message.contains("give `folder`"), "{message}");
    }
}

#[test]
fn all_formats_are_read_and_others_refused() {
    let alone = OBJ.split_once('\n').unwrap().1;
    assert_eq!(read(alone, "obj", None).unwrap().triangle_count(), 1);
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    assert_eq!(read(ply, "ply", None).unwrap().triangle_count(), 1);
    for format in ["", "OBJ", "stl"] {
        let message = read(alone, format, None).expect_err(format).to_string();
        assert!(message.contains("must be obj, gltf, glb or ply"), "{message}");
    }
    for format in ["obj", "gltf", "glb", "ply"] {
        assert!(read("", format, None).is_err());
    }
}
