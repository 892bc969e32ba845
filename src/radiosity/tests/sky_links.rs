//! Light of sky and suns along links alone: closed forms, the path tracer, and the ledger.

use super::*;
use crate::math::sampling::{numbers, point_on};
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::refinement::StopReason;
use crate::scene::testing::forest;
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
    let mut pieces = Pieces::empty();
    for (k, &[corner, u, v]) in quads.iter().enumerate() {
        pieces.grey(&format!("quad {k}"), reflectance).rectangle(corner, u, v);
    }
    pieces.scene()
}

/// A box on a square.
fn yard(reflectance: f32) -> Scene {
    let mut pieces = Pieces::empty();
    pieces.grey("ground", reflectance).polygon(&facing_up([-3.0, 3.0], [-3.0, 3.0], 0.0));
    // Mirrored, the faces are wound outward.
    pieces.grey("box", reflectance).room(DVec3::new(1.0, -0.5, 0.0), DVec3::new(-0.5, 1.0, 1.5));
    pieces.scene()
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
        assert!(
            record.ended == StopReason::Error && record.links < 100,
            "{:?} {}",
            record.ended,
            record.links
        );
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
    let scene = lit(quads(0.0, &[floor, [right, 2.0 * half, wall], [left, 2.0 * half, wall]]), uniform());
    let mut last = (0, f64::INFINITY);
    for (error, most) in [(0.01, [0.03, 0.1]), (0.002, [0.003, 0.04])] {
        let Outcome { mesh, record, .. } = solved(&scene, &[], &links(error));
        let (mut found, mut want, mut squares, mut area) = (0.0, 0.0, 0.0, 0.0);
        for element in mesh.elements.iter().filter(|e| e.object == 0 && normal_of(&mesh, e).z > 0.5) {
            let corners = element.corners.map(|k| mesh.vertices[k as usize].as_dvec3() + mesh.origin);
            let middle = corners.iter().sum::<DVec3>() / 4.0;
            if middle.x.abs() > 5.0 {
                continue;
            }
            let (light, exact) = (mean(element.irradiance) / PI, street(middle.x, middle.y));
            found += element.area * light;
            want += element.area * exact;
            squares += element.area * (light - exact).powi(2);
            area += element.area;
        }
        let [bias, rms] = [found / want - 1.0, (squares * area).sqrt() / want];
        assert!(bias.abs() < most[0] && rms < most[1], "{error}: {bias} {rms}");
        assert!(record.links > last.0 && rms < last.1, "{} {rms} after {last:?}", record.links);
        last = (record.links, rms);
    }
}

/// Sky view factors of whole sides: of the floor and a wall of a street, whose ends add .1 % to those of an infinite one, of a valley,
/// and of the floor of a cylinder.
#[test]
fn floors_and_walls_have_the_mean_light_of_closed_forms() {
    let (half, width, wall) = (DVec3::X * 3000.0, 10.0 * DVec3::Y, 8.0 * DVec3::Z);
    let [left, right] = [-0.5, 0.5].map(|y| -half + y * width);
    let street =
        quads(0.0, &[[left, 2.0 * half, width], [right, 2.0 * half, wall], [left, 2.0 * half, wall]]);
    let slope = DVec3::new(0.0, 0.8, 0.6) * 10.0;
    let valley =
        quads(0.0, &[[-half, 2.0 * half, slope], [half, -2.0 * half, slope * DVec3::new(1.0, -1.0, 1.0)]]);
    let mut court = Pieces::empty();
    let corner =
        |k: u32| 5.0 * DVec3::new((f64::from(k) * PI / 64.0).cos(), (f64::from(k) * PI / 64.0).sin(), 0.0);
    court.grey("floor", 0.0).polygon(&(0..128).map(corner).collect::<Vec<_>>());
    court.grey("wall", 0.0);
    for k in 0..128 {
        court.rectangle(corner(k), 6.0 * DVec3::Z, corner(k + 1) - corner(k));
    }
    let of_cylinder = 1.0 + (6.0f64 / 5.0).powi(2) / 2.0;
    let diagonal = 1.64f64.sqrt();
    let forms = [
        (street.clone(), 0, DVec3::Z, (diagonal - 0.8) * 1.001),
        (street, 1, -DVec3::Y, (1.8 - diagonal) / 1.6 * 1.001),
        (valley, 0, DVec3::Z, 0.8),
        (court.scene(), 0, DVec3::Z, of_cylinder - (of_cylinder * of_cylinder - 1.0).sqrt()),
    ];
    for (k, (scene, object, normal, want)) in forms.into_iter().enumerate() {
        let scene = lit(scene, uniform());
        let square = |seed| {
            let mesh = solved(&scene, &[], &Options { seed, ..links(0.02) }).mesh;
            let found = mean_of(&mesh, |e| e.object == object && normal_of(&mesh, e).dot(normal) > 0.5) / PI;
            (found / want - 1.0).powi(2)
        };
        let rms = (1..=4).map(square).sum::<f64>().sqrt() / 2.0;
        assert!(rms < 3e-3, "{k}: {rms}");
    }
}

/// Mean difference and root mean square difference of the light on random points of elements from that of paths, relative to its mean.
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
    let want = limits::truth(scene, &points, 128);
    let (a, b): (f64, f64) = (found.iter().sum(), want.iter().sum());
    let squares: f64 = found.iter().zip(&want).map(|(a, b)| (a - b) * (a - b)).sum();
    [a / b - 1.0, (squares * want.len() as f64).sqrt() / b]
}

#[test]
fn a_yard_has_the_light_of_paths() {
    for (reflectance, environment) in [(0.0, uniform()), (0.5, uniform()), (0.5, sunny(40.0))] {
        let scene = lit(yard(reflectance), environment);
        let mut last = (0, f64::INFINITY);
        for error in [0.1, 0.01] {
            let outcome = solved(&scene, &[], &links(error));
            let [bias, rms] = against_paths(&scene, &outcome);
            let Ledger { emitted, sky, sun, absorbed, escaped, created, .. } = outcome.record.ledger;
            assert!((sky + sun - emitted).abs() < 1e-9 * emitted);
            assert!((absorbed + escaped - emitted).abs() < 2e-3 * emitted, "{absorbed} {escaped} {emitted}");
            assert!(created.abs() < 2e-3 * emitted, "{created}");
            let links = outcome.record.links;
            assert!(
                outcome.record.ended == StopReason::Error && links > last.0 && rms < last.1,
                "{links} {rms}"
            );
            // Compared at one place of each element.
            assert!(bias.abs() < 0.01 && rms < 0.12, "{reflectance} {error}: {bias} {rms}");
            last = (links, rms);
        }
    }
}

/// Links are only the first guess of a local pass.
#[test]
fn a_local_pass_after_links_has_the_light_of_paths() {
    let scene = lit(yard(0.5), sunny(40.0));
    let [bias, rms] = against_paths(&scene, &solved(&scene, &[], &quick()));
    assert!(bias.abs() < 0.01 && rms < 0.15, "{bias} {rms}");
}

/// A closed room but for a hole in its ceiling; sky and sun on the outsides stay outside.
#[test]
fn a_hole_in_a_roof_lights_a_room() {
    let (x, y, z) = (3.0 * DVec3::X, 4.0 * DVec3::Y, 2.5 * DVec3::Z);
    let at = |x: f64, y: f64| z + DVec3::new(x, y, 0.0);
    // The hole is the square from 1 to 2 in x and from 1.5 to 2.5 in y. Fronts are inside.
    let faces = [
        [DVec3::ZERO, x, y],
        [DVec3::ZERO, y, z],
        [y, x, z],
        [x + y, -y, z],
        [x, -x, z],
        [z, 1.5 * DVec3::Y, x],
        [at(0.0, 2.5), 1.5 * DVec3::Y, x],
        [at(0.0, 1.5), DVec3::Y, DVec3::X],
        [at(2.0, 1.5), DVec3::Y, DVec3::X],
    ];
    let scene = lit(quads(0.5, &faces), sunny(60.0));
    let mut outcome = solved(&scene, &[], &links(0.01));
    let [bias, rms] = against_paths(&scene, &outcome);
    outcome.mesh.elements.retain(|e| e.front);
    let inside = against_paths(&scene, &outcome);
    assert!(bias.abs() < 0.01 && inside[0].abs() < 0.03, "{bias} {rms} {inside:?}");
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
        let Outcome { mesh, record, .. } = solved(&scene, &[], &links(0.1));
        let (found, want) = (mean_of(&mesh, |e| e.front), mean(environment.irradiance(normal)));
        assert!((found / want - 1.0).abs() < 1e-5, "{tilt}: {found} instead of {want}");
        assert!(record.links < 100, "{}", record.links);
    }
}

#[test]
fn forests_have_the_light_of_paths() {
    let scene = lit(forest(9, 200), sunny(40.0));
    for engine in [Engine::Exact, Engine::MultiResolution] {
        let options = Options { engine, ..links(0.05) };
        let [bias, rms] = against_paths(&scene, &solved(&scene, &[], &options));
        assert!(bias.abs() < 0.03 && rms < 0.5, "{engine:?}: {bias} {rms}");
    }
}

/// Links of the insides of a closed room are all blocked; the outsides are lit.
#[test]
fn closed_rooms_stay_dark() {
    let mesh = solved(&lit(room(false), sunny(50.0)), &[], &links(0.05)).mesh;
    // The faces of the walls and of the box are wound towards the inside of the room.
    let (inside, outside) = (mean_of(&mesh, |e| e.front), mean_of(&mesh, |e| !e.front));
    assert!(inside < 1e-6 * outside && outside > 0.0, "{inside} {outside}");
}

#[test]
fn refinement_ends_at_limits_and_does_not_depend_on_threads() {
    let scene = lit(yard(0.5), sunny(40.0));
    let few = Options { max_links: 2000, ..links(0.005) };
    let record = solved(&scene, &[], &few).record;
    assert!(record.ended == StopReason::Links && record.links <= 2000, "{:?} {}", record.ended, record.links);
    let hurried = Options { step_seconds: Some(0.01), max_seconds: Some(0.5), ..links(0.002) };
    let [bias, rms] = against_paths(&scene, &solved(&scene, &[], &hurried));
    assert!(bias.abs() < 0.05 && rms < 0.5, "{bias} {rms}");
    let with = |threads| on_threads(threads, || solved(&scene, &[], &links(0.05)));
    assert_eq!(with(1).mesh.elements, with(3).mesh.elements);
}
