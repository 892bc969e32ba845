//! Light of sky and suns along links alone: closed forms, the path tracer, and the ledger.

use super::*;
use crate::math::sampling::{numbers, point_on};
use crate::path_tracer;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::refinement::Ended;
use crate::sky::{Environment, Frame, Level, Shape, Sky, Sun};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::Arc;

/// A radiance of 1 everywhere above the horizon.
fn uniform() -> Environment {
    let sky = Sky::new(Shape::Uniform, None, false, Level::Horizontal(PI)).expect("a sky");
    Environment::new(Frame::upright(DVec3::Z).expect("a frame"), Some(sky), Vec::new(), [0.0; 3])
}

/// The same with a sun of a normal irradiance of 8 and a ground.
fn sunny(elevation: f64) -> Environment {
    let sky = Sky::new(Shape::Uniform, None, false, Level::Horizontal(PI)).expect("a sky");
    let (s, c) = elevation.to_radians().sin_cos();
    let sun = Sun::new(DVec3::new(0.6 * c, 0.8 * c, s), [8.0; 3]);
    Environment::new(Frame::upright(DVec3::Z).expect("a frame"), Some(sky), vec![sun], [0.2; 3])
}

/// The sun alone.
fn sun(direction: DVec3) -> Environment {
    let sun = Sun::new(direction.normalize(), [8.0; 3]);
    Environment::new(Frame::upright(DVec3::Z).expect("a frame"), None, vec![sun], [0.0; 3])
}

/// Quads of one material, each with a corner and two edges, front side by the right hand rule.
fn quads(reflectance: f32, quads: &[[DVec3; 3]]) -> Scene {
    let mut soup = Soup::new("quads");
    let material = soup.material(SoupMaterial::diffuse("grey", [reflectance; 3]));
    for [corner, u, v] in quads {
        let object = soup.object("quad");
        soup.polygon(object, material, &[*corner, *corner + u, *corner + u + v, *corner + v]);
    }
    resolve(soup, &LoadOptions::default()).expect("a scene")
}

/// A box on a square.
fn yard(reflectance: f32) -> Scene {
    let mut soup = Soup::new("yard");
    let material = soup.material(SoupMaterial::diffuse("grey", [reflectance; 3]));
    let (ground, thing) = (soup.object("ground"), soup.object("box"));
    let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    soup.polygon(ground, material, &[corner(-3., -3.), corner(3., -3.), corner(3., 3.), corner(-3., 3.)]);
    // Mirrored, the faces are wound outward.
    inward(&mut soup, thing, material, DVec3::new(1.0, -0.5, 0.0), DVec3::new(-0.5, 1.0, 1.5));
    resolve(soup, &LoadOptions::default()).expect("a scene")
}

fn lit(mut scene: Scene, environment: Environment) -> Scene {
    scene.environment = Some(Arc::new(environment));
    scene
}

/// Links alone.
fn links(error: f64) -> Options {
    Options { error, audit: 0, local_rays: Some(0), ..Options::default() }
}

fn normal_of(mesh: &RadiosityMesh, element: &Element) -> DVec3 {
    let [a, b, c, _] = element.corners.map(|k| mesh.vertices[k as usize].as_dvec3());
    (b - a).cross(c - a).normalize()
}

/// Mean irradiance of the elements that a test selects.
fn mean_of(mesh: &RadiosityMesh, select: impl Fn(&Element) -> bool) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for element in mesh.elements.iter().filter(|e| select(e)) {
        sum += element.area * mean(element.irradiance);
        area += element.area;
    }
    assert!(area > 0.0);
    sum / area
}

#[test]
fn planes_have_the_light_of_closed_forms() {
    for tilt in [0.0f64, 30.0, 60.0, 90.0, 120.0] {
        let (s, c) = tilt.to_radians().sin_cos();
        let normal = DVec3::new(s * 0.8, s * 0.6, c);
        let u = normal.any_orthonormal_vector();
        let scene = quads(0.4, &[[DVec3::Z, u, normal.cross(u)]]);
        let Outcome { mesh, record, .. } = solved(&lit(scene.clone(), uniform()), &[], &links(0.02));
        for element in &mesh.elements {
            let facing = normal_of(&mesh, element).dot(DVec3::Z);
            let want = PI * (1.0 + facing) / 2.0;
            let found = mean(element.irradiance);
            assert!((found - want).abs() < 3e-3 * want + 1e-6, "{tilt}: {found} instead of {want}");
        }
        // Nothing is in the way: there is nothing to refine.
        assert!(record.ended == Ended::Error && record.links < 100, "{:?} {}", record.ended, record.links);
        let found = solved(&lit(scene, sun(DVec3::Z)), &[], &links(0.02)).mesh;
        for element in &found.elements {
            let want = 8.0 * normal_of(&found, element).dot(DVec3::Z).max(0.0);
            if want > 1e-6 {
                let found = mean(element.irradiance);
                assert!((found / want - 1.0).abs() < 5e-4, "{tilt}: {found} instead of {want}");
            }
        }
    }
}

/// Sky view factor of the middle of a street between walls that are as high as the street is wide, and 400 times as long.
#[test]
fn a_street_sees_its_part_of_the_sky() {
    let (half, wall) = (DVec3::X * 200.0, DVec3::Z);
    let scene = quads(
        0.0,
        &[
            [DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y],
            [-half + 0.5 * DVec3::Y, 2.0 * half, wall],
            [-half - 0.5 * DVec3::Y, 2.0 * half, wall],
        ],
    );
    let options = Options { min_area: 1e-7, ..links(0.005) };
    let start = std::time::Instant::now();
    let Outcome { mesh, record, .. } = solved(&lit(scene, uniform()), &[], &options);
    let (mut found, mut want, mut area) = (0.0, 0.0, 0.0);
    let mut worst: f64 = 0.0;
    for element in mesh.elements.iter().filter(|e| normal_of(&mesh, e).z > 0.5) {
        let y = element.corners.iter().map(|k| f64::from(mesh.vertices[*k as usize].y)).sum::<f64>() / 4.0
            + mesh.origin.y;
        let sine = |d: f64| d / d.hypot(1.0);
        let exact = 0.5 * (sine(0.5 - y) + sine(0.5 + y));
        found += element.area * mean(element.irradiance) / PI;
        want += element.area * exact;
        area += element.area;
        worst = worst.max((mean(element.irradiance) / PI / exact - 1.0).abs());
    }
    println!(
        "{} {want} area {area} worst {worst} links {} elements {} {:?} {:?}",
        found / want,
        record.links,
        record.elements,
        record.ended,
        start.elapsed()
    );
    assert!((found / want - 1.0).abs() < 0.01, "{found} instead of {want}");
}

/// Light on random points of elements, by links and by paths.
fn against_paths(scene: &Scene, outcome: &Outcome) -> [f64; 2] {
    let mesh = &outcome.mesh;
    let elements: Vec<&Element> = mesh.elements.iter().filter(|e| mean(e.irradiance) > 0.0).collect();
    let all: f64 = elements.iter().map(|e| e.area).sum();
    let (mut points, mut found) = (Vec::new(), Vec::new());
    let (mut sum, mut next) = (0.0, 0.5);
    for element in elements {
        sum += element.area;
        while next / 4000.0 * all < sum {
            let [u, v, ..] = numbers(7, next as u64);
            let corners = element.corners.map(|k| mesh.vertices[k as usize]);
            let normal = normal_of(mesh, element);
            let at: Vec3 = point_on(&corners, u, v);
            points.push(Point { position: at.as_dvec3() + mesh.origin, normal });
            found.push(mean(element.irradiance));
            next += 1.0;
        }
    }
    let settings = path_tracer::Settings { samples: 1024, direct_only: false, seed: 3 };
    let model = model_for(scene, &Options::default());
    let traced = path_tracer::irradiance(&model, &points, settings, &()).expect("irradiance").values;
    let want: Vec<f64> = traced.iter().map(|v| mean(*v)).collect();
    let (a, b): (f64, f64) = (found.iter().sum(), want.iter().sum());
    let squares: f64 = found.iter().zip(&want).map(|(a, b)| (a - b) * (a - b)).sum();
    [a / b - 1.0, (squares * want.len() as f64).sqrt() / b]
}

#[test]
fn a_yard_has_the_light_of_paths() {
    for (environment, most) in [(uniform(), [0.01, 0.08]), (sunny(40.0), [0.02, 0.25])] {
        let scene = lit(yard(0.5), environment);
        let mut last = (0, f64::INFINITY);
        for error in [0.1, 0.02] {
            let start = std::time::Instant::now();
            let outcome = solved(&scene, &[], &links(error));
            let seconds = start.elapsed();
            let [bias, rms] = against_paths(&scene, &outcome);
            let Ledger { emitted, sky, sun, absorbed, escaped, created, .. } = outcome.record.ledger;
            let links = outcome.record.links;
            println!(
                "{error}: {bias:.4} {rms:.4} links {links} elements {} {seconds:?} {:?} {emitted} {sky} {sun} {absorbed} {escaped} {created} {:?}",
                outcome.record.elements, outcome.record.ended, outcome.record.error_estimate
            );
            assert!((sky + sun - emitted).abs() < 1e-9 * emitted);
            assert!((absorbed + escaped - emitted).abs() < 2e-3 * emitted, "{absorbed} {escaped} {emitted}");
            assert!(created.abs() < 2e-3 * emitted, "{created}");
            assert!(outcome.record.ended == Ended::Error && links > last.0 && rms < last.1);
            last = (links, rms);
            if error == 0.02 {
                assert!(bias.abs() < most[0] && rms < most[1], "{bias} {rms}");
            }
        }
    }
}

#[test]
fn closed_rooms_stay_dark() {
    let scene = lit(room(true), sunny(50.0));
    let with = solved(&scene, &[], &links(0.05)).record;
    let without = solved(&room(true), &[], &links(0.05)).record;
    println!("{} {}", with.links, without.links);
    let Ledger { sky, sun, .. } = with.ledger;
    assert!(sky + sun > 0.0, "the outside is lit");
    let room = solved(&scene, &[], &links(0.05)).mesh;
    let dark = solved(&super::room(true), &[], &links(0.05)).mesh;
    let inside = |e: &Element| e.area > 0.0 && e.front;
    let (a, b) = (mean_of(&room, inside), mean_of(&dark, inside));
    assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
}
