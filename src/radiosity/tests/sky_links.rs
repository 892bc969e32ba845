//! Light of sky and suns along links alone: closed forms, the path tracer, and the ledger.

use super::*;
use crate::math::sampling::{numbers, point_on};
use crate::path_tracer;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::refinement::Ended;
use crate::sky::{Environment, Frame, Level, Shape, Sky, SkyOptions, Sun};
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
    for (k, [corner, u, v]) in quads.iter().enumerate() {
        let object = soup.object(&format!("quad {k}"));
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

/// Sky view factor of the floor of a street of width 1 between walls of height 1 and length 40: the mean of cos² of the elevation of the
/// horizon over all azimuths.
fn street(x: f64, y: f64) -> f64 {
    let of = |k: usize| {
        let (s, c) = (2.0 * PI * (k as f64 + 0.5) / 4096.0).sin_cos();
        let distance = if s > 0.0 { (0.5 - y) / s } else { (-0.5 - y) / s };
        let wall = (x + distance * c).abs() < 20.0;
        if wall { 1.0 - 1.0 / (1.0 + distance * distance) } else { 1.0 }
    };
    (0..4096).map(of).sum::<f64>() / 4096.0
}

#[test]
fn a_street_sees_its_part_of_the_sky() {
    let (half, wall) = (DVec3::X * 20.0, DVec3::Z);
    let [left, right] = [-0.5, 0.5].map(|y| -half + y * DVec3::Y);
    let floor = [left, 2.0 * half, DVec3::Y];
    let scene = quads(0.0, &[floor, [right, 2.0 * half, wall], [left, 2.0 * half, wall]]);
    for error in [0.05, 0.01, 0.002, 0.0005] {
        let start = std::time::Instant::now();
        let Outcome { mesh, record, .. } = solved(&lit(scene.clone(), uniform()), &[], &links(error));
        let (mut found, mut want, mut squares, mut n) = (0.0, 0.0, 0.0, 0);
        for element in mesh.elements.iter().filter(|e| e.object == 0 && normal_of(&mesh, e).z > 0.5) {
            let corners = element.corners.map(|k| mesh.vertices[k as usize].as_dvec3() + mesh.origin);
            let middle = corners.iter().sum::<DVec3>() / 4.0;
            if middle.x.abs() > 5.0 {
                continue;
            }
            let exact = street(middle.x, middle.y);
            let light = mean(element.irradiance) / PI;
            found += element.area * light;
            want += element.area * exact;
            squares += element.area * (light - exact).powi(2);
            n += 1;
        }
        println!(
            "{error}: {} want {want} rms {} floor {n} links {} elements {} {:?} {:?}",
            found / want - 1.0,
            (squares * 10.0).sqrt() / want,
            record.links,
            record.elements,
            record.ended,
            start.elapsed()
        );
        if error < 0.005 {
            assert!((found / want - 1.0).abs() < 0.01, "{found} instead of {want}");
        }
    }
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
    for k in 0..8 {
        let (mut n, mut sq, mut un) = (0, 0.0, 0.0);
        for (i, p) in points.iter().enumerate() {
            let z = p.position.z;
            let r = p.position.truncate().distance(glam::DVec2::splat(0.25));
            let class = if z > 1e-3 {
                if p.normal.z > 0.5 { 0 } else { 1 }
            } else if p.normal.z < 0.0 {
                2
            } else {
                3 + ((r / 0.8) as usize).min(4)
            };
            if class == k {
                n += 1;
                un += found[i] - want[i];
                sq += (found[i] - want[i]).powi(2);
            }
        }
        println!("  class {k}: {n} mean diff {:.4} rms {:.4}", un / n as f64, (sq / n as f64).sqrt());
    }
    println!("  mean {}", b / want.len() as f64);
    let squares: f64 = found.iter().zip(&want).map(|(a, b)| (a - b) * (a - b)).sum();
    [a / b - 1.0, (squares * want.len() as f64).sqrt() / b]
}

#[test]
fn a_yard_has_the_light_of_paths() {
    for (rho, environment, most) in
        [(0.0, uniform(), [0.01, 0.08]), (0.5, uniform(), [0.01, 0.08]), (0.5, sunny(40.0), [0.02, 0.25])]
    {
        let scene = lit(yard(rho), environment);
        let mut last = (0, f64::INFINITY);
        for error in [0.1, 0.02, 0.005] {
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

/// Under a sky that is brightest about the sun.
#[test]
fn uneven_skies_light_planes_as_their_integrals() {
    let mut options = SkyOptions::parse("perez:600,150").expect("a sky");
    options.sun = "130,35".parse().expect("a sun");
    let environment = options.environment(DVec3::Z).expect("a sky");
    for tilt in [0.0f64, 50.0, 90.0] {
        let (s, c) = tilt.to_radians().sin_cos();
        let normal = DVec3::new(s * 0.8, s * -0.6, c);
        let u = normal.any_orthonormal_vector();
        let scene = lit(quads(0.4, &[[DVec3::Z, u, normal.cross(u)]]), environment.clone());
        for error in [0.1, 0.02, 0.005] {
            let Outcome { mesh, record, .. } = solved(&scene, &[], &links(error));
            let found = mean_of(&mesh, |e| e.front);
            let want = mean(environment.irradiance(normal));
            println!("{tilt} {error}: {} {} {:?}", found / want - 1.0, record.links, record.ended);
            assert!(error > 0.02 || (found / want - 1.0).abs() < 3e-3, "{tilt}: {found} instead of {want}");
        }
    }
}

#[test]
fn forests_under_the_sky() {
    let scene = build(&Spec { trees: 16, leaves: 300, ..Spec::new("forest") }).expect("a forest");
    for environment in [uniform(), sunny(40.0)] {
        let scene = lit(scene.clone(), environment);
        for error in [0.2, 0.05, 0.02] {
            let start = std::time::Instant::now();
            let Outcome { mesh, record, .. } = solved(&scene, &[], &links(error));
            let seconds = start.elapsed();
            let outcome = Outcome { mesh, record, irradiance: Vec::new() };
            let [bias, rms] = against_paths(&scene, &outcome);
            println!(
                "{error}: {bias:.4} {rms:.4} links {} elements {} {seconds:?} {:?} {:?}",
                outcome.record.links, outcome.record.elements, outcome.record.ended, outcome.record.ledger
            );
        }
    }
}

/// Links of the insides of a closed room are all blocked; the outsides are lit.
#[test]
fn closed_rooms_stay_dark() {
    let scene = lit(room(false), sunny(50.0));
    let Outcome { mesh, record, .. } = solved(&scene, &[], &links(0.05));
    // The faces of the walls and of the box are wound towards the inside of the room.
    let (inside, outside) = (mean_of(&mesh, |e| e.front), mean_of(&mesh, |e| !e.front));
    println!("{inside} {outside} {}", record.links);
    assert!(inside < 1e-6 * outside && outside > 0.0, "{inside} {outside}");
}

#[test]
fn refinement_ends_at_limits_and_does_not_depend_on_threads() {
    let scene = lit(yard(0.5), sunny(40.0));
    let few = Options { max_links: 2000, ..links(0.005) };
    let record = solved(&scene, &[], &few).record;
    assert!(record.ended == Ended::Links && record.links <= 2000, "{:?} {}", record.ended, record.links);
    let hurried = Options { step_seconds: Some(0.01), max_seconds: Some(0.5), ..links(0.002) };
    let outcome = solved(&scene, &[], &hurried);
    println!(
        "{:?}",
        outcome.record.iterations.iter().map(|i| (i.links, i.elements, i.error_bound)).collect::<Vec<_>>()
    );
    let [bias, rms] = against_paths(&scene, &outcome);
    println!("{bias} {rms} {:?}", outcome.record.ended);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solved(&scene, &[], &links(0.05)))
    };
    assert_eq!(with(1).mesh.elements, with(3).mesh.elements);
}
