//! What is shown stands upright, whichever axis the file calls up.

use crate::run::Scratch;

/// A floor of 8 by 8 that a lamp lights, with the third coordinate up, or with the second.
fn scene(scratch: &Scratch, up: &str) {
    let vertex = |[x, y, z]: [f64; 3]| match up {
        "z" => format!("v {x} {y} {z}\n"),
        _ => format!("v {x} {z} {}\n", -y),
    };
    let floor = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 8.0, 0.0], [0.0, 8.0, 0.0]].map(vertex).concat();
    let lamp = [[4.0, 4.0, 3.0], [4.0, 5.0, 3.0], [5.0, 4.0, 3.0]].map(vertex).concat();
    scratch.write("s.mtl", "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl light\nKd 0 0 0\nKe 10 10 10\n");
    scratch.write(
        "s.obj",
        format!(
            "mtllib s.mtl\no floor\nusemtl grey\n{floor}f 1 2 3 4\no lamp\nusemtl light\n{lamp}f 5 6 7\n"
        ),
    );
}

fn solve(scratch: &Scratch, up: &str, output: &str) {
    scratch
        .mrvis(&format!("solve s.obj --up {up} --out o --audit 0 --max-seconds 5 --output {output}"))
        .exits(0);
}

/// glTF is y-up: the node of the GLB turns the scene so that its lamp is 3 above its floor.
#[test]
fn meshes_stand_upright_in_gltf() {
    for up in ["y", "z"] {
        let scratch = Scratch::new();
        scene(&scratch, up);
        solve(&scratch, up, "glb");
        let bytes = std::fs::read(scratch.path("o/solution.glb")).expect("a GLB");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("a length")) as usize;
        let root: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
        let numbers = |value: &serde_json::Value| -> Vec<f32> {
            value.as_array().map_or(Vec::new(), |list| {
                list.iter().map(|v| v.as_f64().expect("a number") as f32).collect()
            })
        };
        let rotation = match numbers(&root["nodes"][0]["rotation"])[..] {
            [x, y, z, w] => glam::Quat::from_xyzw(x, y, z, w),
            _ => glam::Quat::IDENTITY,
        };
        let [low, high] =
            ["min", "max"].map(|end| glam::Vec3::from_slice(&numbers(&root["accessors"][0][end])));
        let size = (rotation * (high - low)).abs();
        assert!((size - glam::Vec3::new(8.0, 3.0, 8.0)).length() < 1e-3, "{up}: {size}");
        let upward = if up == "z" { glam::Vec3::Z } else { glam::Vec3::Y };
        assert!((rotation * upward - glam::Vec3::Y).length() < 1e-5, "{up}");
    }
}

/// A camera that looks across the floor: the floor is at the bottom of the picture, and both sides are alike.
#[test]
fn cameras_are_not_rolled() {
    for (up, camera) in [("z", "4,-4,1,4,4,1,60"), ("y", "4,1,4,4,1,-4,60")] {
        let scratch = Scratch::new();
        scene(&scratch, up);
        solve(&scratch, up, &format!("image --image-size 80x60 --camera {camera}"));
        let image = image::open(scratch.path("o/view.png")).expect("a picture").to_luma8();
        let mean = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| {
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
            let values: Vec<f64> = pixels.map(|(x, y)| f64::from(image.get_pixel(x, y)[0])).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        let (top, bottom) = (mean(0..80, 0..5), mean(20..60, 33..42));
        assert!(bottom > 20.0 && bottom > 10.0 * top, "{up}: {top} above {bottom}");
        let (left, right) = (mean(0..40, 31..60), mean(40..80, 31..60));
        assert!((left / right - 1.0).abs() < 0.2, "{up}: {left} beside {right}");
    }
}
