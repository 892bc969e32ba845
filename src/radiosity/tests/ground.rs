//! Ground under skies: light by few rays, energy, and terrain that exchanges light by fewer triangles than it has cells.

use super::limits::truth;
use super::*;
use crate::sky::SkyOptions;
use std::collections::HashMap;

/// Mountains of 65 x 65 samples under a sky and a sun, of at most `triangles` triangles.
fn mountains(triangles: usize) -> (crate::terrain::Grid, Scene) {
    let grid = crate::terrain::mountains(65, 3).expect("a grid");
    let mut soup = Soup::new("ground");
    let grey = soup.material(SoupMaterial::diffuse("grey", [0.5; 3]));
    let object = soup.object("ground");
    crate::scene::add_coarse(&mut soup, &grid, object, grey, triangles).expect("a ground");
    let options = LoadOptions { up: Some(crate::scene::UpAxis::Z), ..LoadOptions::default() };
    let mut scene = resolve(soup, &options).expect("a scene");
    let sky = SkyOptions::parse("uniform:300").and_then(|sky| sky.with_sun("120,30:700")).expect("a sky");
    scene.set_sky(&sky).expect("a sky of the scene");
    (grid, scene)
}

/// Where the rays of the exchange leave little noise, elements trace no rays of their own but those in partial shadow, and have the light
/// of many rays.
#[test]
fn elements_keep_the_rays_of_the_exchange_where_these_suffice() {
    let scene = mountains(1 << 20).1;
    let of = |error: f64| solved(&scene, &[], &Options { error, audit: 0, ..Options::default() });
    let [few, many] = [0.1, 0.02].map(of);
    let light = |of: &Outcome| -> f64 { of.mesh.elements.iter().map(|e| e.area * mean(e.irradiance)).sum() };
    let leaves = few.mesh.elements.len() as u64;
    assert!(few.record.exact_rays < 9 * leaves, "{} rays of {leaves}", few.record.exact_rays);
    let bias = light(&few) / light(&many) - 1.0;
    assert!(bias.abs() < 2e-3, "{bias}");
    // Elements that were split have the mean of their parts.
    let by_face = |of: &Outcome| {
        let mut faces = HashMap::<_, [f64; 2]>::new();
        for e in &of.mesh.elements {
            let [power, area] = faces.entry((e.triangle, e.front)).or_default();
            (*power, *area) = (*power + e.area * mean(e.irradiance), *area + e.area);
        }
        faces
    };
    let (found, wanted) = (by_face(&few), by_face(&many));
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for (face, [power, area]) in wanted {
        let of = power / area;
        squares += (found[&face][0] / found[&face][1] - of).powi(2);
        (sum, count) = (sum + of, count + 1.0);
    }
    let error = (squares * count).sqrt() / sum;
    assert!(error < 0.1, "{error}");
}

/// A height field with sixteen cells for each triangle that light is exchanged with: points and paths meet the cells, and have the light
/// that they have where all of them exchange light.
#[test]
fn fine_ground_gives_points_the_light_of_all_its_cells() {
    let ((grid, whole), (_, coarse)) = (mountains(1 << 20), mountains(512));
    let (columns, place) = (grid.columns(), |c: usize, r: usize| {
        let [x, y] = grid.georeference().position(c, r);
        DVec3::new(x, y, grid.height(c, r).into())
    });
    let points: Vec<Point> = (0..60)
        .map(|k| {
            let (c, r) = (2 + (17 * k) % (columns - 4), 2 + (29 * k) % (columns - 4));
            let [a, b, c] = [place(c, r + 1), place(c + 1, r + 1), place(c + 1, r)];
            Point { position: (a + b + c) / 3.0, normal: (b - a).cross(c - a).normalize() }
        })
        .collect();
    assert!(8 * coarse.triangles.len() < whole.triangles.len(), "{} faces", coarse.triangles.len());
    let wanted = truth(&whole, &points, 4096);
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let by_paths = truth(&coarse, &points, 4096);
    let by_points: Vec<f64> = solved(&coarse, &points, &options).irradiance.into_iter().map(mean).collect();
    let part = |found: &[f64]| {
        let squares: f64 = found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2)).sum();
        (squares * wanted.len() as f64).sqrt() / wanted.iter().sum::<f64>()
    };
    for found in [by_paths, by_points] {
        assert!(part(&found) < 0.02, "{}: {found:?} instead of {wanted:?}", part(&found));
    }
    // Many faces lie below the ground in part: their points have the light of the ground above them.
    let origin = coarse.origin;
    let middle = |t: u32| {
        let middle: DVec3 = coarse.corners(t).iter().map(|p| p.as_dvec3()).sum::<DVec3>() / 3.0;
        Point { position: origin + middle, normal: coarse.face_normal(t).as_dvec3() }
    };
    let middles: Vec<Point> = (0..coarse.triangles.len() as u32).map(middle).collect();
    let darkest =
        solved(&coarse, &middles, &options).irradiance.into_iter().map(mean).fold(f64::MAX, f64::min);
    assert!(darkest > 100.0, "{darkest}");
    // Points below the ground are on it.
    let model = Model::prepare(coarse, &crate::PrepareOptions::default()).expect("a model");
    let mut lifted = 0;
    for Point { position, normal } in points {
        let (at, normal) = ((position - model.scene().origin).as_vec3(), normal.as_vec3());
        if let Some((place, _)) = model.ground_above(at - 0.2 * normal, normal) {
            assert!(place.distance(at) < 1e-2, "{place} instead of {at}");
            lifted += 1;
        }
        let deep = 2.0 * model.scene().fine_ground.as_ref().map_or(0.0, |ground| ground.highest);
        assert!(model.ground_above(at - deep * normal, normal).is_none());
    }
    assert!(lifted > 30, "{lifted}");
    let error = model.check_clusters("the benchmark").expect_err("too fine").to_string();
    assert!(error.contains("262144 samples") && error.contains("4225"), "{error}");
}

/// Slopes over bright ground, seen from below by rays that meet other slopes: estimates of their light may be negative, and none is
/// created by this.
#[test]
fn ground_below_slopes_creates_no_light() {
    let at_corner = |i: i32, j: i32| {
        let (x, y) = (0.5 * f64::from(i), 0.5 * f64::from(j));
        DVec3::new(x, y, (1.3 * x).sin() * (1.1 * y).cos())
    };
    let mut pieces = Pieces::empty();
    pieces.grey("hills", 0.2).field(0..30, at_corner);
    let mut sky = SkyOptions::parse("uniform:150").expect("a sky");
    sky.ground = Some(crate::sky::Amount::Grey(0.5));
    let mut scene = pieces.scene();
    scene.set_sky(&sky).expect("a sky of the scene");
    let options = Options { elements: false, audit: 0, ..Options::default() };
    let ledger = solved(&scene, &[Point { position: DVec3::new(7.0, 7.0, 5.0), normal: DVec3::Z }], &options)
        .record
        .ledger;
    assert!(ledger.created.abs() < 1e-3 * ledger.emitted, "{ledger:?}");
}
