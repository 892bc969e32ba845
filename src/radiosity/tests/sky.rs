//! Light of sky and suns at points and elements: closed forms, energy, and the path tracer.

use super::limits::{off, on_surfaces, truth};
use super::*;
use crate::sky::SkyOptions;
use std::f64::consts::PI;

/// The scene of these polygons, all of one grey, below a sky and a sun.
fn outdoors(reflectance: f32, polygons: &[Vec<DVec3>], sky: &str, sun: &str) -> Scene {
    let mut pieces = Pieces::empty();
    pieces.grey("ground", reflectance);
    polygons.iter().for_each(|corners| _ = pieces.polygon(corners));
    under(pieces, sky, sun)
}

/// A scene below a sky and a sun.
fn under(pieces: Pieces, sky: &str, sun: &str) -> Scene {
    let up = LoadOptions { up: Some(crate::scene::UpAxis::Z), ..LoadOptions::default() };
    let mut scene = pieces.scene_with(&up);
    let sky = SkyOptions::parse(sky).and_then(|sky| sky.with_sun(sun)).expect("a sky");
    scene.set_sky(&sky).expect("a sky of the scene");
    scene
}

fn rectangle(low: [f64; 2], high: [f64; 2], z: impl Fn(f64, f64) -> f64) -> Vec<DVec3> {
    let at = |x: f64, y: f64| DVec3::new(x, y, z(x, y));
    vec![at(low[0], low[1]), at(high[0], low[1]), at(high[0], high[1]), at(low[0], high[1])]
}

fn at(position: DVec3, normal: DVec3) -> Point {
    Point { position, normal }
}

/// Options for accurate light of a black scene.
fn accurate() -> Options {
    Options { audit: 0, error: 0.01, local_rays: Some(400_000), ..Options::default() }
}

/// Irradiance at points of a black scene, mean of the channels.
fn light_at(scene: &Scene, points: &[Point]) -> Vec<f64> {
    let options = Options { elements: false, ..accurate() };
    solved(scene, points, &options).irradiance.into_iter().map(mean).collect()
}

#[track_caller]
fn near(found: f64, want: f64, part: f64) {
    assert!((found - want).abs() <= part * want, "{found} instead of {want}");
}

#[test]
fn planes_under_the_open_sky_have_the_light_of_the_closed_form() {
    // Sky alone: (1 + cos β) / 2 of the horizontal irradiance. The back of a slope sees the lower part, which is black.
    for slope in [0.0f64, 0.5, 2.0] {
        let plane = rectangle([0.0, 0.0], [3.0, 2.0], |x, _| slope * x);
        let scene = outdoors(0.0, &[plane], "uniform:100", "none");
        let normal = DVec3::new(-slope, 0.0, 1.0).normalize();
        let points = [at(DVec3::new(1.0, 1.2, slope), normal), at(DVec3::new(1.0, 1.2, slope), -normal)];
        let found = light_at(&scene, &points);
        near(found[0], 100.0 * 0.5 * (1.0 + normal.z), 1e-4);
        assert!((found[1] - 50.0 * (1.0 - normal.z)).abs() < 0.01, "{}", found[1]);
        near(truth(&scene, &points, 4096)[0], 100.0 * 0.5 * (1.0 + normal.z), 2e-3);
    }
    // Sun alone, on elements and points: E cos θ.
    let plane = rectangle([0.0, 0.0], [3.0, 2.0], |x, _| 0.5 * x);
    let scene = outdoors(0.0, &[plane], "none", "0,0,2:800");
    let normal = DVec3::new(-0.5, 0.0, 1.0).normalize();
    let Outcome { irradiance, record, .. } =
        solved(&scene, &[at(DVec3::new(1.0, 1.2, 0.5), normal)], &accurate());
    near(mean(irradiance[0]), 800.0 * normal.z, 5e-4);
    near(mean(record.mean_irradiance), 800.0 * normal.z, 5e-4);
}

#[test]
fn streets_and_courtyards_see_their_part_of_the_sky() {
    // A street of width 2 and height 3 between long walls: the sine of half the angle of the opening.
    let upright = |y: f64, turned: bool| {
        let mut wall: Vec<DVec3> = [[-500.0, 0.0], [500.0, 0.0], [500.0, 3.0], [-500.0, 3.0]]
            .map(|[x, z]| DVec3::new(x, y, z))
            .to_vec();
        if turned {
            wall.reverse();
        }
        wall
    };
    let street =
        [rectangle([-500.0, -1.0], [500.0, 1.0], |_, _| 0.0), upright(1.0, false), upright(-1.0, true)];
    let scene = outdoors(0.0, &street, "uniform:100", "none");
    let middle = [at(DVec3::new(0.3, 0.0, 0.0), DVec3::Z), at(DVec3::new(-7.0, 0.4, 0.0), DVec3::Z)];
    let found = light_at(&scene, &middle);
    let part = |y: f64| 0.5 * ((1.0 - y) / (1.0 - y).hypot(3.0) + (1.0 + y) / (1.0 + y).hypot(3.0));
    near(found[0], 100.0 * part(0.0), 3e-3);
    near(found[1], 100.0 * part(0.4), 3e-3);
    // A round courtyard of radius 1 and height 2, of 64 walls: the middle of the floor sees r² / (r² + h²).
    let corner = |k: usize| {
        let turn = std::f64::consts::TAU * (k as f64 + 0.5) / 64.0;
        // As much area as the circle.
        let radius = (PI / (32.0 * (std::f64::consts::TAU / 64.0).sin())).sqrt();
        DVec3::new(radius * turn.cos(), radius * turn.sin(), 0.0)
    };
    let wall = |k: usize| {
        let (a, b, up) = (corner(k), corner(k + 1), 2.0 * DVec3::Z);
        vec![b, a, a + up, b + up]
    };
    let mut yard: Vec<Vec<DVec3>> = (0..64).map(wall).collect();
    yard.push((0..64).map(corner).collect());
    let scene = outdoors(0.0, &yard, "uniform:100", "none");
    let found = light_at(&scene, &[at(DVec3::new(0.0, 0.0, 0.0), DVec3::Z)]);
    near(found[0], 20.0, 3e-3);
}

#[test]
fn a_house_under_sun_and_sky_is_lit_as_paths_say_and_keeps_its_energy() {
    // A box of 2 by 2 by 3 on a square of 10 by 10. Mirrored, its faces are wound outward.
    let mut house = Pieces::empty();
    let (low, high) = (DVec3::new(6.0, 4.0, 0.0), DVec3::new(4.0, 6.0, 3.0));
    house.grey("house", 0.5).room_without(Wall::Floor, low, high);
    house.polygon(&facing_up([0.0, 10.0], [0.0, 10.0], 0.0));
    let scene = under(house, "perez:500,120", "160,35");
    let points = on_surfaces(&scene, 150);
    let options = Options { audit: 0, error: 0.04, ..Options::default() };
    let outcome = solved(&scene, &points, &options);
    let (rms, bias) = off(&outcome.irradiance, &truth(&scene, &points, 1024));
    assert!(rms < 0.015 && bias.abs() < 4e-3, "{rms} {bias}");
    let ledger = &outcome.record.ledger;
    // The plane and the roof are in one piece as seen from the sun.
    let sun = 500.0 * 35f64.to_radians().sin() * 100.0;
    assert!(ledger.sun > sun && ledger.sun < 1.2 * sun && ledger.sky > 0.5 * 120.0 * 100.0, "{ledger:?}");
    let known = ledger.absorbed + ledger.escaped;
    assert!((known - ledger.sky - ledger.sun).abs() < 2e-3 * known, "{ledger:?}");
    assert!((ledger.emitted - ledger.sky - ledger.sun).abs() < 1e-9 * known);
}

/// A box in a black yard: the mean light of the ground is that of the ground outside the box and its shadow.
#[test]
fn a_yard_has_the_mean_light_of_the_sun_with_all_options() {
    let mut yard = Pieces::empty();
    yard.grey("box", 0.0).room_without(Wall::Floor, DVec3::new(1.0, -1.0, 0.0), DVec3::new(-1.0, 1.0, 3.0));
    yard.grey("ground", 0.0).polygon(&facing_up([-10.0, 10.0], [-10.0, 10.0], 0.0));
    let height = 40f64.to_radians();
    let scene = under(yard, "none", &format!("0,{},{}:1000", height.cos(), height.sin()));
    let want = 1000.0 * height.sin() * (400.0 - 4.0 - 2.0 * 3.0 / height.tan());
    for (error, local_rays, seed) in
        [(0.02, None, 1), (0.1, None, 2), (0.02, Some(20_000), 3), (0.02, Some(0), 1)]
    {
        let options = Options { error, local_rays, seed, audit: 0, ..Options::default() };
        let outcome = solved(&scene, &[], &options);
        let ground = outcome.mesh.elements.iter().filter(|e| e.object == 1 && e.front);
        near(ground.map(|e| e.area * e.irradiance[0]).sum(), want, 0.02);
        let Ledger { emitted, created, .. } = outcome.record.ledger;
        assert!(created.abs() < 5e-3 * emitted, "created {created} of {emitted}");
    }
}

/// A room that the sky lights through a window of a fortieth of its walls, and the same room without it.
#[test]
fn windows_let_in_what_paths_say_and_closed_rooms_are_dark() {
    let room = |window: bool| {
        let (low, high) = (DVec3::ZERO, DVec3::new(4.0, 5.0, 3.0));
        let mut pieces = Pieces::empty();
        pieces.grey("walls", 0.5);
        if window {
            // A hole of 1.2 by 1 in the wall at y = 0.
            let edges = [3.0 * DVec3::Z, 4.0 * DVec3::X];
            pieces.room_without(Wall::LowY, low, high).pierced(low, edges, [[1.0, 1.4], [2.0, 2.6]]);
        } else {
            pieces.room(low, high);
        }
        let mut scene = pieces.scene();
        scene.set_sky(&SkyOptions::parse("overcast:10000").expect("a sky")).expect("a sky of the scene");
        scene
    };
    let points: Vec<Point> = (0..40)
        .map(|k| at(DVec3::new(0.4 + 0.8 * f64::from(k % 5), 0.5 + 0.55 * f64::from(k / 5), 0.0), DVec3::Z))
        .collect();
    let scene = room(true);
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let found = solved(&scene, &points, &options);
    let (rms, bias) = off(&found.irradiance, &truth(&scene, &points, 1 << 14));
    assert!(rms < 0.03 && bias.abs() < 0.01, "{rms} {bias}");
    let dark = solved(&room(false), &points, &quick());
    assert!(dark.irradiance.iter().flatten().all(|e| *e < 1e-4), "{:?}", dark.irradiance);
}

/// A skylight that is seen as a five-hundredth of the light of the open sky.
#[test]
fn small_openings_are_found_from_all_points() {
    let (size, low, high) = ([5.0, 4.0, 3.0], [2.0, 1.5], [2.3, 1.8]);
    let [wide, deep, tall] = size;
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.0).room_without(Wall::Ceiling, DVec3::ZERO, DVec3::from(size));
    pieces.pierced(tall * DVec3::Z, [wide * DVec3::X, deep * DVec3::Y], [low, high]);
    let scene = under(pieces, "uniform:1000", "none");
    let place = |k: u32| DVec3::new(0.3 + 0.55 * f64::from(k % 9), 0.3 + 0.56 * f64::from(k / 9), 0.0);
    let points: Vec<Point> = (0..63).map(|k| at(place(k), DVec3::Z)).collect();
    // 1/π ∫ cos² / r² dA over the opening.
    let factor = |p: DVec3| -> f64 {
        let patch = |k: u32| {
            let (u, v) = (f64::from(k % 16) + 0.5, f64::from(k / 16) + 0.5);
            let to = DVec3::new(low[0] + 0.3 * u / 16.0, low[1] + 0.3 * v / 16.0, tall) - p;
            to.z * to.z / to.length_squared().powi(2)
        };
        (0..256).map(patch).sum::<f64>() * 0.09 / 256.0 / PI
    };
    let outcome = solved(&scene, &points, &Options { audit: 0, elements: false, ..Options::default() });
    let found: Vec<f64> = outcome.irradiance.into_iter().map(mean).collect();
    let (all, want): (f64, f64) =
        (found.iter().sum(), points.iter().map(|p| 1000.0 * factor(p.position)).sum());
    assert!(found.iter().all(|e| *e > 0.0) && (all / want - 1.0).abs() < 0.06, "{all} {want}");
}

/// A room that sees the sky and much bright ground through a small window: its elements have a hundredth of the light outside, and are
/// traced for the points in it.
#[test]
fn a_room_beside_open_ground_has_the_daylight_of_paths() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room_without(Wall::LowX, DVec3::ZERO, DVec3::new(5.0, 4.0, 2.8));
    pieces.pierced(DVec3::ZERO, [4.0 * DVec3::Y, 2.8 * DVec3::Z], [[1.5, 1.0], [2.4, 1.9]]);
    pieces.polygon(&facing_up([-30.0, 0.0], [-28.0, 32.0], -0.5));
    let scene = under(pieces, "uniform:100", "none");
    let on_floor = |k: u32| DVec3::new(1.0 + f64::from(k % 4), 0.7 + 0.6 * f64::from(k / 4), 0.0);
    let points: Vec<Point> = (0..20)
        .flat_map(|k| [at(on_floor(k), DVec3::Z), at(on_floor(k) + 2.8 * DVec3::Z, DVec3::NEG_Z)])
        .collect();
    let truth = truth(&scene, &points, 4096);
    let options = Options { error: 0.02, audit: 0, elements: false, ..Options::default() };
    let (rms, bias) = off(&solved(&scene, &points, &options).irradiance, &truth);
    assert!(rms < 0.12 && bias.abs() < 0.03, "{rms} {bias}");
    // Elements as they are drawn: their errors count by the light of the room.
    let mesh = solved(&scene, &[], &Options { elements: true, ..options }).mesh;
    let centre = |e: &Element| {
        0.25 * e.corners.iter().map(|&k| mesh.vertices[k as usize].as_dvec3()).sum::<DVec3>() + mesh.origin
    };
    let nearest = |point: &Point| {
        let apart = |e: &&Element| (centre(e) - point.position).length_squared();
        mesh.elements.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("elements").irradiance
    };
    let (rms, bias) = off(&points.iter().map(nearest).collect::<Vec<Rgb>>(), &truth);
    assert!(rms < 0.35 && bias.abs() < 0.1, "{rms} {bias}");
}

/// A corner and a yard of bright walls under the open sky: elements of few rays, many of which leave the scene, send all their light, and
/// what they return is neither more nor less than they receive.
#[test]
fn open_corners_and_yards_have_the_daylight_of_paths() {
    let (x, y, z) = (10.0 * DVec3::X, 10.0 * DVec3::Y, 10.0 * DVec3::Z);
    let quad = |corner: DVec3, u: DVec3, v: DVec3| vec![corner, corner + u, corner + u + v, corner + v];
    let yard = [
        quad(DVec3::ZERO, x, y),
        quad(y, x, z),
        quad(DVec3::ZERO, z, x),
        quad(DVec3::ZERO, y, z),
        quad(x, z, y),
    ];
    let place = |k: u32| DVec3::new(2.0 + 1.5 * f64::from(k % 5), 2.0 + 1.5 * f64::from(k / 5), 0.0);
    let points: Vec<Point> = (0..25).map(|k| at(place(k), DVec3::Z)).collect();
    // The edges of a sunlit part of a wall are looked for.
    let cases = [
        (&yard[..2], "uniform:100", "none"),
        (&yard, "uniform:100", "none"),
        (&yard, "cie:12", "0.9,0,0.4:300"),
    ];
    for (k, (faces, sky, sun)) in cases.into_iter().enumerate() {
        let scene = outdoors(0.8, faces, sky, sun);
        let (samples, bounds) = if k < 2 { (4096, [0.025, 0.006]) } else { (8192, [0.045, 0.015]) };
        let truth = truth(&scene, &points, samples);
        let (mut rms, mut bias) = (0.0, 0.0);
        for seed in [1, 2] {
            let options = Options { seed, audit: 0, elements: false, ..Options::default() };
            let found = off(&solved(&scene, &points, &options).irradiance, &truth);
            (rms, bias) = (rms + 0.5 * found.0, bias + 0.5 * found.1);
        }
        assert!(rms < bounds[0] && bias.abs() < bounds[1], "case {k}: {rms} {bias}");
    }
}

/// Slats 2 cm apart at a height of 10 m, with gaps of this fraction between them.
fn slats(gap: f64) -> impl Iterator<Item = Vec<DVec3>> {
    let low = |k: i32| 0.02 * f64::from(k);
    (-50..50).map(move |k| rectangle([low(k), -1.0], [low(k) + (1.0 - gap) * 0.02, 1.0], |_, _| 10.0))
}

/// Points below slats with narrow gaps: a twenty-fifth of the sun's disc is seen, and the first sixteen rays of every other point all end
/// on slats. On the mean the points have the light of the gaps, and below narrow slats with wide gaps all but that of the slats.
#[test]
fn gaps_and_slats_before_the_sun_have_their_part_of_its_light() {
    for gap in [0.04, 0.96] {
        let scene = outdoors(0.0, &slats(gap).collect::<Vec<_>>(), "none", "0,0,1:1000");
        let place = |k: u32| {
            let [x, y] = [k % 64, k / 64].map(|at| 0.01 * f64::from(at) - 0.32);
            at(DVec3::new(x + 1e-3 * y, y, 0.0), DVec3::Z)
        };
        let points: Vec<Point> = (0..4096).map(place).collect();
        let options = Options { audit: 0, elements: false, ..Options::default() };
        let found = solved(&scene, &points, &options).irradiance;
        let found = found.into_iter().map(mean).sum::<f64>() / points.len() as f64 / 1000.0;
        assert!((found - gap).abs() < 0.08 * gap.min(1.0 - gap), "{gap}: {found}");
    }
}

/// The same for elements that keep the rays of their exchange: other rays to the sun find its light than those that tell where it is
/// partly visible.
#[test]
fn elements_below_gaps_and_slats_have_their_part_of_the_sun() {
    let pad = |k: u32| {
        let low = [k % 64, k / 64].map(|at| 0.01 * f64::from(at) - 0.32);
        rectangle(low, low.map(|at| at + 0.0095), |_, _| 0.0)
    };
    for gap in [0.04, 0.96] {
        let pieces: Vec<Vec<DVec3>> = slats(gap).chain((0..4096).map(pad)).collect();
        let light = |sun: &str| {
            let options = Options { audit: 0, error: 0.2, ..Options::default() };
            let Outcome { mesh, record, .. } =
                solved(&outdoors(0.0, &pieces, "uniform:500", sun), &[], &options);
            assert!(record.exact_rays < 20 * mesh.elements.len() as u64, "{} rays", record.exact_rays);
            let height = |e: &Element| f64::from(mesh.vertices[e.corners[0] as usize].z) + mesh.origin.z;
            let pads = mesh.elements.iter().filter(|e| height(e) < 1.0 && e.front);
            let (sum, area) =
                pads.fold((0.0, 0.0), |(s, a), e| (s + e.area * mean(e.irradiance), a + e.area));
            sum / area
        };
        let found = (light("0,0,1:1000") - light("none")) / 1000.0;
        // Windows of neighbours that happen to be dark differ least from each other: a fifth of the light of gaps goes to other elements.
        assert!((found - gap).abs() < 0.3 * gap.min(1.0 - gap), "{gap}: {found}");
    }
}

/// A sensor far below the only surface of a scene, outside its bounding box: the surface hides the sun and its part of the sky.
#[test]
fn points_outside_the_scene_are_in_its_shadow() {
    let roof = rectangle([-5.0, -5.0], [5.0, 5.0], |_, _| 10.0);
    let point = [at(DVec3::new(0.5, 0.0, -30.0), DVec3::Z)];
    let scene = outdoors(0.0, std::slice::from_ref(&roof), "none", "0,0,1:1000");
    assert_eq!(light_at(&scene, &point), [0.0]);
    let scene = outdoors(0.0, &[roof], "uniform:100", "none");
    // The view factor of a horizontal square at the height h over its middle; half a metre aside changes it by 1e-5.
    let ratio: f64 = 5.0 / 40.0;
    let hidden = 4.0 / PI * ratio / ratio.hypot(1.0) * (ratio / ratio.hypot(1.0)).atan();
    near(light_at(&scene, &point)[0], 100.0 * (1.0 - hidden), 1e-3);
}

/// Maps with a bright part: one texel, which the rays of a point in all directions miss, and one of 12° near the horizon, as large as a
/// few cells of its grid.
#[test]
fn bright_parts_of_a_map_light_points() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sky.exr");
    let ground = rectangle([-5.0, -5.0], [5.0, 5.0], |_, _| 0.0);
    let points: Vec<Point> = (0..5).map(|k| at(DVec3::new(f64::from(k) - 2.0, 0.3, 0.0), DVec3::Z)).collect();
    let step = PI / 256.0;
    let parts: [([u32; 2], [u32; 2], f32); 2] = [([384, 64], [1, 1], 1e5), ([100, 98], [17, 17], 300.0)];
    for ([x, y], [width, height], radiance) in parts {
        let is_bright = |u, v| (x..x + width).contains(&u) && (y..y + height).contains(&v);
        let value = |u, v| image::Rgb([if is_bright(u, v) { radiance } else { 1.0 }; 3]);
        image::Rgb32FImage::from_fn(512, 256, value).save(&path).expect("written");
        let scene = outdoors(0.0, std::slice::from_ref(&ground), path.to_str().expect("UTF-8"), "none");
        let angles = (y..y + height).map(|v| (f64::from(v) + 0.5) * step);
        let bright: f64 = angles.map(|angle| step * step * angle.sin() * angle.cos()).sum();
        let want = PI + f64::from(width) * f64::from(radiance - 1.0) * bright;
        for found in light_at(&scene, &points) {
            near(found, want, 0.01);
        }
    }
}

/// Half of the sky is red and half is blue: each channel of points in the open is that of its own closed form.
#[test]
fn points_have_the_colour_of_the_open_sky() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sky.exr");
    let value = |u, _| image::Rgb(if u < 64 { [2.0, 1.0, 0.2] } else { [0.2, 1.0, 2.0] });
    image::Rgb32FImage::from_fn(128, 64, value).save(&path).expect("written");
    let ground = rectangle([-5.0, -5.0], [5.0, 5.0], |_, _| 0.0);
    let scene = outdoors(0.0, &[ground], path.to_str().expect("UTF-8"), "none");
    let points: Vec<Point> = (0..5).map(|k| at(DVec3::new(f64::from(k) - 2.0, 0.3, 0.0), DVec3::Z)).collect();
    for light in solved(&scene, &points, &Options { elements: false, ..accurate() }).irradiance {
        light.into_iter().zip([1.1, 1.0, 1.1]).for_each(|(found, want)| near(found, want * PI, 1e-3));
    }
}

/// Points of the floor of a street have half the sum of the sines of the angles from the zenith to the roofs, those of a wall
/// (1 - sin e) / 2 with the elevation e of the opposite roof. At the rim of a valley they have (1 + cos (β + e)) / 2, on an open slope
/// (1 + cos β) / 2. The sky of the first three ends in strips thinner than a cell of a point's rays, and the horizon crosses cells of the
/// last two.
#[test]
fn points_of_streets_and_slopes_have_the_light_of_the_closed_form() {
    let (half, height, long, rise) = (5.0, 8.0, 3000.0, 0.7);
    let wall = |x: f64| vec![[x, -long, 0.0], [x, long, 0.0], [x, long, height], [x, -long, height]];
    let mut street = vec![rectangle([-half, -long], [half, long], |_, _| 0.0)];
    street.extend([-half, half].map(|x| wall(x).into_iter().map(DVec3::from).collect()));
    let part = |d: f64| d / d.hypot(height);
    let [foot, place, rim] = [0.5, 4.7, -4.8];
    let roof = f64::atan2(height - foot, 2.0 * half);
    let sides =
        [[-half, 0.0], [0.0, half]].map(|[a, b]| rectangle([a, -long], [b, long], |x, _| rise * x.abs()));
    let opposite = f64::atan2(rise * (half + rim), half - rim);
    let slope = rectangle([0.0, 0.0], [3.0, 2.0], |x, _| rise * x);
    let normal = |x: f64| DVec3::new(-rise * x.signum(), 0.0, 1.0).normalize();
    let options = Options { elements: false, audit: 0, ..Options::default() };
    for (polygons, point, want) in [
        (&street, at(DVec3::new(place, 0.0, 0.0), DVec3::Z), part(half - place) + part(half + place)),
        (&street, at(DVec3::new(half, 0.0, foot), -DVec3::X), 1.0 - roof.sin()),
        (
            &sides.to_vec(),
            at(DVec3::new(rim, 0.0, -rise * rim), normal(rim)),
            1.0 + (rise.atan() + opposite).cos(),
        ),
        (&vec![slope], at(DVec3::new(1.0, 1.2, 0.7), normal(1.0)), 1.0 + normal(1.0).z),
    ] {
        let scene = outdoors(0.0, polygons, "uniform:100", "none");
        let found = solved(&scene, &vec![point; 200], &options).irradiance;
        let errors: Vec<f64> = found.iter().map(|e| mean(*e) / (50.0 * want) - 1.0).collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / 200.0).sqrt();
        let bias = errors.iter().sum::<f64>() / 200.0;
        assert!(rms < 2e-3 && bias.abs() < 7e-4, "{want}: {rms:.5} {bias:.5}");
    }
}

/// A closed hut with walls of boxes below a roof with eaves, on a plain of 2 km: its walls and roof are smaller than the elements of the
/// plain.
#[test]
fn huts_on_a_plain_are_dark_inside() {
    let mut pieces = Pieces::empty();
    pieces.grey("plain", 0.3).polygon(&facing_up([-1e3, 1e3], [-1e3, 1e3], 0.0));
    for (name, from, to) in [
        ("south", [0.0, 0.0, 0.0], [4.0, 0.2, 2.5]),
        ("north", [-0.1, 3.0, 0.0], [4.1, 3.2, 2.5]),
        ("west", [0.05, -0.1, 0.0], [0.25, 3.1, 2.5]),
        ("east", [3.7, -0.1, 0.0], [3.9, 3.1, 2.5]),
        ("roof", [-0.2, -0.2, 2.5], [4.2, 3.5, 2.7]),
    ] {
        pieces.grey(name, 0.5).cuboid(from.into(), to.into());
    }
    let scene = under(pieces, "uniform:30", "none");
    let points = [
        at(DVec3::new(2.0, 1.5, 0.0), DVec3::Z),
        at(DVec3::new(0.25, 1.5, 1.0), DVec3::X),
        at(DVec3::new(2.0, 1.5, 2.5), -DVec3::Z),
    ];
    let found = solved(&scene, &points, &Options { audit: 0, ..Options::default() }).irradiance;
    assert!(found.iter().all(|light| mean(*light) < 1e-4), "{found:?}");
}

/// A hut of 4 by 3 by 2.5 with an open door, whose walls begin at this height; the light of points in it against that of paths, without
/// elements and with them.
fn check_open_hut(name: &str, ground: Pieces, foot: f64, points: &[Point], kinds: &[bool]) {
    let mut pieces = ground;
    pieces.grey("hut", 0.5).polygon(&facing_down([0.0, 4.0], [0.0, 3.0], 2.5));
    let mut wall = |x: f64, y: f64, z: f64, to: DVec3, turned: bool| {
        let sides = [(2.5 - z) * DVec3::Z, to];
        let [a, b] = if turned { [sides[1], sides[0]] } else { sides };
        pieces.rectangle(DVec3::new(x, y, z), a, b);
    };
    wall(0.0, 0.0, foot, 4.0 * DVec3::X, false);
    wall(0.0, 3.0, foot, 4.0 * DVec3::X, true);
    wall(0.0, 0.0, foot, 3.0 * DVec3::Y, true);
    // Beside and above the door.
    wall(4.0, 0.0, foot, DVec3::Y, false);
    wall(4.0, 2.0, foot, DVec3::Y, false);
    wall(4.0, 1.0, 2.0, DVec3::Y, false);
    let scene = under(pieces, "uniform:30", "none");
    let truth = traced(&scene, points, 1 << 16, 1);
    for &elements in kinds {
        let options = Options { audit: 0, elements, ..Options::default() };
        let Outcome { irradiance, record, mesh } = solved(&scene, points, &options);
        for (found, truth) in irradiance.iter().zip(&truth) {
            let (found, truth) = (mean(*found), mean(*truth));
            // Paths have a standard error of 1 %.
            assert!((found / truth - 1.0).abs() < 0.09, "{name}, {elements}: {found} instead of {truth}");
        }
        let Ledger { emitted, created, .. } = record.ledger;
        assert!(created.abs() < 2e-3 * emitted, "{name}: {created} of {emitted}");
        assert!(mesh.elements.iter().flat_map(|e| e.irradiance).all(|v| v >= 0.0), "{name}");
    }
}

/// A hut with an open door on a plain of 20 m, a plain of 2 km, and on hills below which its walls begin: the light of the points in it
/// depends neither on how little of the scene it is, nor on the noise of dark elements below the ground.
#[test]
fn open_huts_have_the_light_of_paths() {
    let at = |x: f64, y: f64, z: f64, normal: DVec3| Point { position: DVec3::new(x, y, z), normal };
    let points = [at(2.0, 1.5, 2.5, -DVec3::Z), at(0.0, 1.5, 1.7, DVec3::X), at(1.0, 3.0, 1.8, -DVec3::Y)];
    for half in [10.0, 1e3] {
        let mut plain = Pieces::empty();
        plain.grey("plain", 0.5).polygon(&facing_up([-half, half], [-half, half], 0.0));
        check_open_hut("plain", plain, 0.0, &points, &[false]);
    }
    let mut hills = Pieces::empty();
    hills.grey("hills", 0.5);
    let at = |i: i32, j: i32| {
        let [x, y] = [i, j].map(|k| 2.0 * f64::from(k));
        DVec3::new(x, y, 1.1 * (0.6 * x).sin() * (0.5 * y).cos())
    };
    for (i, j) in (-15..15).flat_map(|i| (-15..15).map(move |j| (i, j))) {
        hills.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        hills.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    check_open_hut("hills", hills, -1.5, &points, &[false, true]);
}
