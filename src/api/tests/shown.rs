//! What shows a solution agrees with its elements.

use crate::model::{Detail, testing::model};
use crate::progress::testing::stop_when;
use crate::scene::LoadOptions;
use crate::{Camera, Error, ImageOptions, MeshArrays, SceneBuilder, Solution, SolveOptions};

/// Light in a box of 2 m with a lamp in its ceiling.
fn solved() -> Solution {
    let mut builder = SceneBuilder::default();
    let white = builder.add_material("white", [0.7, 0.6, 0.5], [0.0; 3]).unwrap();
    let light = builder.add_material("light", [0.0; 3], [5.0; 3]).unwrap();
    let corners: Vec<[f64; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|axis| f64::from(i >> axis & 1) * 2.0)).collect();
    let walls = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3];
    let room = MeshArrays::new("room", &corners[..], &walls).polygon_sizes(&[4; 6]).material(white);
    builder.add_object(&room).unwrap();
    let lamp = [[0.8f32, 0.8, 1.9], [1.2, 0.8, 1.9], [1.2, 1.2, 1.9], [0.8, 1.2, 1.9]];
    let lamp = MeshArrays::new("lamp", &lamp[..], &[3, 2, 1, 0]).polygon_sizes(&[4]).material(light);
    builder.add_object(&lamp).unwrap();
    // The room is seen from inside.
    let scene = builder.finish(&LoadOptions { sides: Some(2), ..LoadOptions::default() }).unwrap();
    // The model does not outlive its solution.
    model(&scene, Detail::Clusters).solve(&SolveOptions { error: 0.1, ..SolveOptions::default() }).unwrap()
}

const DOWN: Camera =
    Camera { eye: [1.0, 1.0, 1.5], target: [1.0, 1.0, 0.0], up: [0.0, 1.0, 0.0], angle: 20.0 };

#[test]
fn elements_and_the_page_hold_the_light_of_the_surfaces() {
    let light = solved();
    let vertices: Vec<[f64; 3]> = light.vertices().collect();
    let names: Vec<&str> = light.model().scene().object_names().collect();
    let (mut area, mut received) = (0.0, [0.0; 3]);
    for e in light.elements() {
        let [a, b, c, d] = e.corners.map(|v| glam::DVec3::from_array(vertices[v as usize]));
        let normal = (c - a).cross(d - b) / 2.0;
        assert!((normal.length() / e.area - 1.0).abs() < 1e-3);
        if names[e.object as usize] == "lamp" && e.front {
            assert!(normal.z < 0.0, "corners turn counterclockwise from the lit side");
        }
        for (k, received) in received.iter_mut().enumerate() {
            let sent = e.exitance[k] + f64::from(e.albedo[k]) * e.irradiance[k];
            assert!((e.radiosity[k] - sent).abs() <= 1e-4 * sent + 1e-9, "{} {sent}", e.radiosity[k]);
            *received += e.area * e.irradiance[k];
        }
        area += e.area;
    }
    for (received, mean) in received.iter().zip(light.report().mean_irradiance) {
        assert!((received / area / mean - 1.0).abs() < 1e-3, "{} {mean}", received / area);
    }
    let record: serde_json::Value = serde_json::from_str(&light.json()).unwrap();
    assert_eq!(record["mean_irradiance"][0].as_f64(), Some(light.report().mean_irradiance[0]));
    assert!(record["versus"].is_null() && record["seconds"]["solve"].is_number());
    let page = light.page().unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("Where the light goes"));
    assert!(!page.contains("<pre>") && !page.contains("<link"));
}

#[test]
fn pictures_show_the_light_of_the_points_that_they_see() {
    let light = solved();
    let options = ImageOptions { size: [9, 7], ..ImageOptions::default() };
    let mut radiance = vec![0.0; 3 * 9 * 7];
    let floor = crate::SurfacePoint { position: [1.0, 1.0, 0.0], normal: [0.0, 0.0, 1.0] };
    let [e, ..] = light.irradiance(&[floor]).unwrap()[0];
    let want = 0.7 * e / std::f64::consts::PI;
    for (gather, tolerance) in [(false, 0.1), (true, 0.05)] {
        light.image(&DOWN, &ImageOptions { gather, ..options.clone() }, &mut radiance).unwrap();
        let centre = f64::from(radiance[3 * (3 * 9 + 4)]);
        assert!((centre / want - 1.0).abs() < tolerance, "{centre} instead of {want}");
    }
    let before = radiance.clone();
    let stopped = light.with_progress(stop_when(|_| true)).image(&DOWN, &options, &mut radiance);
    assert!(matches!(stopped, Err(Error::Cancelled(_))) && radiance == before);
    for (camera, buffer, part) in [
        (Camera { angle: 180.0, ..DOWN }, 189, "`camera.angle` 180"),
        (Camera { target: DOWN.eye, ..DOWN }, 189, "`camera.target`"),
        (Camera { up: [0.0; 3], ..DOWN }, 189, "`camera.up`"),
        (Camera { eye: [f64::NAN; 3], ..DOWN }, 189, "`camera.eye`"),
        (Camera { eye: [1e300; 3], ..DOWN }, 189, "`camera.eye`"),
        (DOWN, 188, "must have 189"),
    ] {
        let message = light.image(&camera, &options, &mut radiance[..buffer]).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    let huge = ImageOptions { size: [1 << 14, 1 << 14], ..ImageOptions::default() };
    assert!(light.image(&DOWN, &huge, &mut radiance).is_err());
    let inside = light.automatic_camera().unwrap().eye;
    assert!(inside.iter().all(|x| (0.0..=2.0).contains(x)), "{inside:?}");
}

#[test]
fn lightmaps_hold_the_light_of_all_sides() {
    let light = solved();
    let map = light.lightmap(4096).unwrap();
    assert!(map.note.is_some() && map.irradiance.len() == map.width * map.height);
    assert_eq!(map.triangles.len(), map.texcoords.len());
    // The floor from above, at its middle.
    let of_floor = |(t, _): &(&[u32; 3], &[[f32; 2]; 3])| {
        let [a, b, c] = t.map(|v| glam::DVec3::from_array(map.positions[v as usize]));
        [a, b, c].iter().all(|p| p.z == 0.0) && (b - a).cross(c - a).z > 0.0
    };
    let floor: Vec<_> = map.triangles.iter().zip(&map.texcoords).filter(of_floor).collect();
    assert_eq!(floor.len(), 2);
    // The longest edge of both is the diagonal.
    let corners = floor[0].1;
    let edges = [0, 1, 2].map(|k| (corners[k], corners[(k + 1) % 3]));
    let length = |(a, b): &([f32; 2], [f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
    let (a, b) = edges.into_iter().max_by(|s, t| length(s).total_cmp(&length(t))).unwrap();
    let [u, v] = [0, 1].map(|k| 0.5 * (a[k] + b[k]));
    let at = ((1.0 - v) * map.height as f32) as usize * map.width + (u * map.width as f32) as usize;
    let point = crate::SurfacePoint { position: [1.0, 1.0, 0.0], normal: [0.0, 0.0, 1.0] };
    let want = light.irradiance(&[point]).unwrap()[0][1];
    assert!((f64::from(map.irradiance[at][1]) / want - 1.0).abs() < 0.1, "{:?} {want}", map.irradiance[at]);
    assert!(light.lightmap(0).is_err() && light.lightmap(usize::MAX).is_err());
}
