use super::*;
use crate::form_factors::analytic::point_to_polygon;
use crate::form_factors::testing::{obstructed, opposed_rectangles};
use crate::model::{Detail, testing::model};
use crate::scene::testing::{Pieces, on_threads};
use crate::scene::{Scene, SoupMaterial};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

/// A closed box whose faces point inwards.
fn room(size: DVec3, reflectance: [f32; 3], radiance: [f32; 3]) -> Scene {
    let material = SoupMaterial { reflectance, ..SoupMaterial::light("walls", radiance) };
    let mut pieces = Pieces::empty();
    pieces.made_of("room", material).room(DVec3::ZERO, size);
    pieces.scene()
}

fn at(x: f64, y: f64, z: f64, normal: DVec3) -> Point {
    Point { position: dvec3(x, y, z), normal }
}

/// Points on the unit square at height `z`, at the centres of an n x n grid.
fn grid(n: usize, z: f64, normal: DVec3) -> Vec<Point> {
    let c = |i: usize| (i as f64 + 0.5) / n as f64;
    (0..n * n).map(|k| at(c(k % n), c(k / n), z, normal)).collect()
}

fn run(scene: &Scene, points: &[Point], samples: u32, direct_only: bool) -> Irradiance {
    irradiance(&model(scene, Detail::Rays), points, Settings { samples, direct_only, seed: 1 }, &())
        .expect("irradiance")
}

/// Mean over the points and its standard error; first channel.
fn mean(e: &Irradiance) -> (f64, f64) {
    let n = e.values.len() as f64;
    let variance: f64 = e.standard_errors.iter().map(|s| s[0] * s[0]).sum();
    (e.values.iter().map(|v| v[0]).sum::<f64>() / n, variance.sqrt() / n)
}

/// Every estimate is within 6 of its standard errors (8 groups: t distribution with 7 degrees of freedom) and 1e-4 of
/// the expected value; the relative standard errors are at most `largest`.
fn check(e: &Irradiance, want: impl Fn(usize) -> [f64; 3], largest: f64) {
    for (i, (v, s)) in e.values.iter().zip(&e.standard_errors).enumerate() {
        let want = want(i);
        for c in 0..3 {
            assert!(s[c] <= largest * want[c].max(1e-9), "point {i}: {} ± {}", v[c], s[c]);
            let allowed = 6.0 * s[c] + 1e-4 * want[c];
            assert!((v[c] - want[c]).abs() <= allowed, "point {i}: {} ± {}, not {}", v[c], s[c], want[c]);
        }
    }
}

#[test]
fn furnace() {
    // All faces emit radiance L and reflect ρ: E = π L / (1 − ρ) everywhere.
    let (rho, radiance) = ([0.2, 0.5, 0.95], [1.0, 2.0, 0.5]);
    let scene = room(dvec3(2.0, 1.0, 3.0), rho, radiance);
    let points = [
        at(0.3, 0.2, 0.0, DVec3::Z),
        at(1e-3, 1e-3, 0.0, DVec3::Z),
        at(2.0, 0.5, 2.9, -DVec3::X),
        at(1.0, 1.0, 0.1, -DVec3::Y),
    ];
    let want = |_| std::array::from_fn(|c| PI * f64::from(radiance[c]) / (1.0 - f64::from(rho[c])));
    check(&run(&scene, &points, 4096, false), want, 0.05);
    let first = |_| radiance.map(|l| PI * f64::from(l));
    check(&run(&scene, &points, 1024, true), first, 0.01);
}

#[test]
fn direct_light_is_lamberts_formula() {
    let lamp = [dvec3(0.2, 0.3, 1.0), dvec3(0.2, 0.9, 1.0), dvec3(0.8, 0.9, 1.0), dvec3(0.8, 0.3, 1.0)];
    let mut quads = Pieces::empty();
    quads.grey("quad", 0.5).rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
    quads.made_of("lamp", SoupMaterial::light("light", [1.0, 2.0, 3.0])).polygon(&lamp);
    let mut points = grid(4, 0.0, DVec3::Z);
    // A point whose horizon cuts the emitter, one very close to the emitter, and one behind it.
    points.push(at(0.5, 0.5, 0.5, dvec3(1.0, 0.0, 0.2).normalize()));
    points.push(at(0.4, 0.4, 0.99, DVec3::Z));
    points.push(at(0.5, 0.5, 1.5, -DVec3::Z));
    let scene = quads.scene();
    let want = |i: usize| {
        let f = point_to_polygon(points[i].position, points[i].normal, &lamp).max(0.0);
        [PI * f, 2.0 * PI * f, 3.0 * PI * f]
    };
    let found = run(&scene, &points, 4096, true);
    check(&found, want, 5e-3);
    assert_eq!(found.values.last(), Some(&[0.0; 3]), "emission is on the front only");
}

#[test]
fn point_files_far_from_zero_keep_their_digits() {
    let far = dvec3(5e5, -4e6, 300.0);
    let mut quads = Pieces::empty();
    quads.grey("quad", 0.0).rectangle(far, DVec3::X, DVec3::Y);
    quads.glowing("lamp", 1.0).rectangle(far + DVec3::Z, DVec3::Y, DVec3::X);
    let scene = quads.scene();
    let points: Vec<Point> =
        grid(8, 0.0, DVec3::Z).into_iter().map(|p| Point { position: p.position + far, ..p }).collect();
    let (value, error) = mean(&run(&scene, &points, 256, false));
    let want = PI * opposed_rectangles([1.0; 2], 1.0);
    // 64 midpoints approximate the mean over the area.
    assert!((value - want).abs() < 4.0 * error + 2e-3 * want, "{value} ± {error} instead of {want}");
}

#[test]
fn one_bounce_between_parallel_squares() {
    // Only the lower square reflects: its irradiance comes from the emitter alone, and the upper square, which is
    // black, receives exactly one bounce.
    let mut quads = Pieces::empty();
    quads.grey("quad", 0.5).rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
    quads.glowing("lamp", 1.0).rectangle(DVec3::Z, DVec3::Y, DVec3::X);
    let scene = quads.scene();
    let points = grid(12, 1.0, -DVec3::Z);
    let found = run(&scene, &points, 1024, false);
    // Σ over the floor of E(x) ρ F, integrated with the point formula on a fine grid.
    let lamp = [DVec3::Z, dvec3(0.0, 1.0, 1.0), DVec3::ONE, dvec3(1.0, 0.0, 1.0)];
    let cells = grid(60, 0.0, DVec3::Z);
    let floor: Vec<f64> =
        cells.iter().map(|p| 0.5 * PI * point_to_polygon(p.position, p.normal, &lamp)).collect();
    let want = |i: usize| {
        let p = points[i].position;
        let sum: f64 = cells
            .iter()
            .zip(&floor)
            .map(|(q, b)| {
                let d = p - q.position;
                // cos² / (π r²); both cosines are z/r with z = 1.
                b / (PI * d.length_squared().powi(2))
            })
            .sum();
        [sum / cells.len() as f64; 3]
    };
    check(&found, want, 0.1);
}

/// Mean irradiance of a unit square at `z = 0` from a unit square at `z = 1` of radiance 1/π with a black plate
/// between: the form factor.
fn blocked_squares(low: [f64; 2], high: [f64; 2], height: f64) -> (f64, f64) {
    let mut quads = Pieces::empty();
    quads.glowing("lamp", 1.0 / PI as f32).rectangle(DVec3::Z, DVec3::Y, DVec3::X);
    let (u, v) = ((high[0] - low[0]) * DVec3::X, (high[1] - low[1]) * DVec3::Y);
    quads.grey("quad", 0.0).rectangle(dvec3(low[0], low[1], height), u, v);
    mean(&run(&quads.scene(), &grid(100, 0.0, DVec3::Z), 128, true))
}

#[test]
fn published_obstructed_pairs() {
    let case = |id, quantity, low, high, height| {
        let (want, (value, error)) = (obstructed(id, quantity), blocked_squares(low, high, height));
        assert!(error < 2e-3 * want.max(1e-3), "{id}: {value} ± {error}");
        assert!(
            (value - want).abs() <= 5.0 * error + 1e-4 * want,
            "{id}: {value} ± {error} instead of {want}"
        );
    };
    case("view3d_square_obstruction", "F(z=0 -> z=1)", [0.0, 0.0], [0.5, 0.5], 0.5);
    case("centred_half_obstruction", "F12", [0.25, 0.25], [0.75, 0.75], 0.5);
    case("facet_shapiro", "F(y=1 -> y=0)", [0.25, 0.25], [0.75, 0.75], 0.25);
    case("fully_blocked", "F12", [-0.1, -0.1], [1.1, 1.1], 0.5);
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let scene = room(DVec3::ONE, [0.7, 0.5, 0.3], [1.0; 3]);
    let points = grid(5, 0.0, DVec3::Z);
    let on = |threads| on_threads(threads, || run(&scene, &points, 600, false));
    assert_eq!(on(1), on(3));
}

#[test]
fn standard_errors_tell_the_truth() {
    // The spread of estimates with different seeds agrees with their stated standard errors.
    let scene = room(DVec3::ONE, [0.6; 3], [1.0; 3]);
    let point = [at(0.3, 0.4, 0.0, DVec3::Z)];
    let runs: Vec<(f64, f64)> = (0..200)
        .map(|seed| {
            let settings = Settings { samples: 64, direct_only: false, seed };
            let e = irradiance(&model(&scene, Detail::Rays), &point, settings, &()).expect("irradiance");
            (e.values[0][0], e.standard_errors[0][0])
        })
        .collect();
    let n = runs.len() as f64;
    let mean = runs.iter().map(|r| r.0).sum::<f64>() / n;
    let spread = (runs.iter().map(|r| (r.0 - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let stated = (runs.iter().map(|r| r.1 * r.1).sum::<f64>() / n).sqrt();
    assert!((stated / spread - 1.0).abs() < 0.25, "stated {stated}, found {spread}");
    assert!((mean - PI / 0.4).abs() < 4.0 * spread / n.sqrt(), "{mean} instead of {}", PI / 0.4);
}

#[test]
fn no_light_no_irradiance() {
    let scene = room(DVec3::ONE, [0.5; 3], [0.0; 3]);
    let e = run(&scene, &grid(2, 0.0, DVec3::Z), 16, false);
    assert!(e.values.iter().chain(&e.standard_errors).all(|v| *v == [0.0; 3]));
    let one = Settings { samples: 1, direct_only: false, seed: 1 };
    assert!(irradiance(&model(&scene, Detail::Rays), &[], one, &()).is_err());
}
