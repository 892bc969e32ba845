//! Lamp shades: light that white walls around a lamp send to each other many times.

use super::*;

/// A deep white shade, open below, with a lamp below its closed top, in a black room.
fn shade() -> Scene {
    let mut pieces = Pieces::empty();
    let at = DVec3::new(2.94, 1.94, 2.3);
    let (x, y, z) = (0.12 * DVec3::X, 0.12 * DVec3::Y, 0.31 * DVec3::Z);
    pieces.grey("room", 0.0).room(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0));
    pieces.grey("shade", 0.8);
    for (at, a, b) in [(at, x, z), (at, y, z), (at + x, y, z), (at + y, x, z), (at + z, x, y)] {
        pieces.rectangle(at, a, b);
    }
    pieces.glowing("lamp", 1000.0).polygon(&facing_down([2.95, 3.05], [1.95, 2.05], 2.6));
    pieces.scene()
}

/// A thousandth of the rays of a point meet the inside of the shade, and elements that only points need have few rays: at mirrored places
/// the light is the same. By the rays of points alone one had none and another five times too much. The light at the points is that of 8
/// million paths, which end on them within 0.04 %; the lamp is hidden from them, and all of it has been reflected.
#[test]
fn few_rays_leave_no_more_light_in_a_shade_than_there_is() {
    let scene = shade();
    let place = |k: u32| {
        let [x, y] = if k < 4 { [1.4, 0.5] } else { [0.5, 1.4] };
        let sign = |bit: u32| if k & bit == 0 { 1.0 } else { -1.0 };
        DVec3::new(3.0 + sign(1) * x, 2.0 + sign(2) * y, 0.0)
    };
    let points: Vec<Point> = (0..8).map(|k| Point { position: place(k), normal: DVec3::Z }).collect();
    let (seeds, mut sums) = (6, [0.0; 8]);
    for seed in 1..=seeds {
        let options = Options { elements: false, seed, audit: 0, ..Options::default() };
        let Outcome { irradiance, record, .. } = solved(&scene, &points, &options);
        sums.iter_mut().zip(&irradiance).for_each(|(sum, e)| *sum += e[0]);
        assert!(record.ledger.created.abs() < 1e-3 * record.ledger.emitted, "{seed}: {:?}", record.ledger);
    }
    let ratio = sums.iter().sum::<f64>() / 8.0 / 0.1171 / seeds as f64;
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
    let level = sums.iter().sum::<f64>() / 8.0;
    assert!(sums.iter().all(|sum| (sum / level - 1.0).abs() < 0.25), "{sums:?}");
}

/// The bright inside of a sheet lies in the plane of points on its outside, which sees black walls alone.
#[test]
fn no_light_comes_through_the_sheets_of_a_shade() {
    let at = |k: u32| DVec3::new(2.94, 1.943 + 0.0073 * f64::from(k % 16), 2.313 + 0.071 * f64::from(k / 16));
    let points: Vec<Point> = (0..64).map(|k| Point { position: at(k), normal: -DVec3::X }).collect();
    let options = Options { elements: false, audit: 0, ..Options::default() };
    let found = solved(&shade(), &points, &options).irradiance;
    assert!(found.iter().all(|e| e[0] < 1e-9), "{found:?}");
}

/// A lamp closes a small box between its top and its open bottom: no light reaches the inside above it, although elements of the sides
/// reach across the lamp.
#[test]
fn no_light_passes_the_edges_of_a_lamp_that_closes_a_small_box() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(10.0, 8.0, 5.0));
    let (low, size) = (DVec3::new(3.1, 2.7, 1.5), 0.3);
    pieces.grey("box", 0.5).room_without(Wall::Floor, low, low + size);
    pieces.glowing("lamp", 10.0).polygon(&facing_down([3.1, 3.4], [2.7, 3.0], 1.631));
    let at = |place, normal| Point { position: low + size * place, normal };
    let points = [
        at(DVec3::new(0.0, 0.5, 0.8), DVec3::X),
        at(DVec3::new(0.4, 0.4, 1.0), -DVec3::Z),
        at(DVec3::new(0.0, 0.5, 0.3), DVec3::X),
    ];
    let found = solved(&pieces.scene(), &points, &quick()).irradiance;
    assert!(found[0][0] == 0.0 && found[1][0] == 0.0 && found[2][0] > 10.0, "{found:?}");
}

/// A lamp two centimetres below the ceiling, facing it: most rays of elements miss the bright spot, which sends nearly all light of the
/// room. Without shadow rays to it the elements of the middle of the floor deviate by half of their mean and more.
#[test]
fn elements_have_the_light_of_a_bright_spot() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.6).room(DVec3::ZERO, DVec3::new(4.0, 6.0, 3.0));
    pieces.glowing("lamp", 1000.0).polygon(&facing_up([1.8, 2.2], [2.8, 3.2], 2.98));
    let options = Options { error: 0.1, audit: 0, ..Options::default() };
    let Outcome { mesh, record, .. } = solved(&pieces.scene(), &[], &options);
    let centre = |e: &Element| e.corners.map(|v| mesh.vertices[v as usize].as_dvec3() + mesh.origin);
    let in_middle = |e: &&Element| {
        centre(e).iter().all(|p| p.z == 0.0 && (p.x - 2.0).abs() < 0.7 && (p.y - 3.0).abs() < 0.7)
    };
    let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
        mesh.elements.iter().filter(in_middle).map(|e| e.area * of(e.irradiance[0])).sum()
    };
    let (area, light, squares) = (sum(&|_| 1.0), sum(&|e| e), sum(&|e| e * e));
    let deviation = (squares * area / (light * light) - 1.0).sqrt();
    assert!(area > 1.0 && deviation < 0.4, "{area} {deviation}");
    assert!(record.ledger.created.abs() < 5e-3 * record.ledger.emitted, "{:?}", record.ledger);
}

/// Points at the eight places that mirror (x, y) in a square with this side and its diagonals, at this height.
fn mirrored(side: f64, [x, y]: [f64; 2], height: f64) -> Vec<Point> {
    let place = |k: u32| {
        let [a, b] = if k < 4 { [x, y] } else { [y, x] };
        let at = |bit: u32, v: f64| if k & bit == 0 { v } else { side - v };
        DVec3::new(at(1, a), at(2, b), height)
    };
    (0..8).map(|k| Point { position: place(k), normal: DVec3::Z }).collect()
}

/// Standard deviation of the light at points over its mean.
fn scatter(irradiance: &[Rgb]) -> f64 {
    let level = mean_at(irradiance);
    let squares: f64 = irradiance.iter().map(|e| (e[0] / level - 1.0).powi(2)).sum();
    (squares / irradiance.len() as f64).sqrt()
}

/// Thirty-six lamps in shades open above and below: the insides of the shades send some ten times the mean light. At mirrored places the
/// light is the same, and that of paths, whose mean has a standard error of 1.2 %. By the rays of points alone it scatters by 10 %.
#[test]
fn points_below_many_lamp_shades_have_little_noise() {
    let (side, depth) = (12.0, 0.3 * DVec3::Z);
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(side, side, 3.0));
    let at = |k: u32| DVec3::new(f64::from(2 * (k / 6) + 1), f64::from(2 * (k % 6) + 1), 2.2);
    let shades = pieces.grey("shade", 0.8);
    for corner in (0..36).map(|k| at(k) - DVec3::new(0.15, 0.15, 0.0)) {
        let [x, y] = [0.3 * DVec3::X, 0.3 * DVec3::Y];
        shades.rectangle(corner, x, depth).rectangle(corner + y, x, depth);
        shades.rectangle(corner, y, depth).rectangle(corner + x, y, depth);
    }
    let lamps = pieces.glowing("lamp", 1000.0);
    for (x, y) in (0..36).map(|k| (at(k).x, at(k).y)) {
        let sides = [[x - 0.04, x + 0.04], [y - 0.04, y + 0.04]];
        lamps.polygon(&facing_down(sides[0], sides[1], 2.34)).polygon(&facing_up(sides[0], sides[1], 2.36));
    }
    let scene = pieces.scene();
    let points = mirrored(side, [2.1, 3.3], 0.8);
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let found = solved(&scene, &points, &options).irradiance;
    assert!(scatter(&found) < 0.06, "{found:?}");
    let [level, truth] = [&found, &traced(&scene, &points, 1 << 16, 1)].map(|light| mean_at(light));
    assert!((level / truth - 1.0).abs() < 0.06, "{level} instead of {truth}");
}

/// Direct light through a louvre, which lets a fraction of the light through to all points, is as certain relative to the light of the
/// points as that of an open lamp: with a standard error of 3 % of the light without the louvre it scattered by 10 %. Its mean is that of
/// paths within 1 %.
#[test]
fn light_through_a_louvre_has_little_noise() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.0).room(DVec3::ZERO, DVec3::new(6.0, 6.0, 3.0));
    let blades = pieces.grey("blade", 0.0);
    for k in 0..7 {
        let at = 2.7 + 0.1 * f64::from(k);
        let (corner, height) = (DVec3::new(2.7, 2.7, 2.8), 0.12 * DVec3::Z);
        blades.rectangle(corner.with_x(at), 0.6 * DVec3::Y, height);
        blades.rectangle(corner.with_y(at), 0.6 * DVec3::X, height);
    }
    pieces.glowing("lamp", 500.0).polygon(&facing_down([2.7, 3.3], [2.7, 3.3], 2.95));
    let scene = pieces.scene();
    let points: Vec<Point> = [[2.5, 2.9], [2.0, 2.6], [1.6, 2.2], [2.2, 2.3], [1.9, 2.9]]
        .into_iter()
        .flat_map(|place| mirrored(6.0, place, 1.0))
        .collect();
    let options = Options { audit: 0, elements: false, direct_only: true, ..Options::default() };
    let found = solved(&scene, &points, &options).irradiance;
    found.chunks(8).for_each(|alike| assert!(scatter(alike) < 0.05, "{alike:?}"));
    let [level, truth] = [&found, &traced(&scene, &points, 1 << 15, 1)].map(|light| mean_at(light));
    assert!((level / truth - 1.0).abs() < 0.01, "{level} instead of {truth}");
}

/// Two closed rooms, one red and one green, with bright places on their walls: no light of the other colour comes through the wall
/// between them.
#[test]
fn light_keeps_its_colour() {
    let mut pieces = Pieces::empty();
    for (name, x, reflectance) in [("red", 0.0, [0.8, 0.05, 0.05]), ("green", 4.0, [0.05, 0.8, 0.05])] {
        let material = SoupMaterial::diffuse(name, reflectance);
        pieces.made_of(name, material).room(DVec3::new(x, 0.0, 0.0), DVec3::new(x + 3.9, 4.0, 3.0));
        let lamp = pieces.glowing(&format!("lamp of {name}"), 1000.0);
        lamp.polygon(&facing_up([x + 1.9, x + 2.0], [1.9, 2.0], 2.8));
    }
    let scene = pieces.scene();
    let at = |k: u32| DVec3::new(0.5 + 0.7 * f64::from(k % 4), 0.6 + 0.9 * f64::from(k / 4), 0.0);
    let of = |x: f64| (0..16).map(move |k| Point { position: at(k) + x * DVec3::X, normal: DVec3::Z });
    let points: Vec<Point> = of(0.0).chain(of(4.0)).collect();
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let found = solved(&scene, &points, &options).irradiance;
    let sum = |room: &[Rgb], k: usize| room.iter().map(|e| e[k]).sum::<f64>();
    let [red, green] = [&found[..16], &found[16..]];
    assert!((sum(red, 1) / sum(red, 2) - 1.0).abs() < 0.1, "green light among red walls: {red:?}");
    assert!((sum(green, 0) / sum(green, 2) - 1.0).abs() < 0.1, "red light among green walls: {green:?}");
}
