//! Sky view factors of a height field by sweeps against horizons found by Embree rays, at the same error: `cargo bench --features reports
//! --bench terrain -- 3000` for 3,000 × 3,000 samples.
//!
//! Embree's rays search the horizon of a sample in each azimuth by bisection of the elevation, sixteen azimuths in a packet. It is timed on
//! evenly spread samples, and its time is that of as many rays for all samples; both use all cores. The error of both is the RMS
//! difference to Embree's horizons in 512 azimuths, at the same samples.

use mrvis::internals::ray::{LANES, Occluder, Packet};
use mrvis::internals::terrain::{Grid, Layer, SweepOptions, mountains, sky_view_factor, write_geotiff};
use mrvis::{Detail, Model, PrepareOptions, Scene};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::time::Instant;

/// Samples at which horizons are found by rays.
const TESTED: usize = 20_000;
/// Azimuths of the reference.
const REFERENCE: usize = 512;
/// Halvings of the elevation: to 0.09 degrees, which changes sky view factors by less than 0.001.
const HALVINGS: usize = 10;
/// The error that is asked for.
const ERROR: f64 = 0.005;

fn main() {
    let side = std::env::args().filter_map(|word| word.parse().ok()).next().unwrap_or(1000);
    let grid = mountains(side, 1).expect("a grid");
    let file = std::env::temp_dir().join(format!("mrvis-terrain-{}.tif", std::process::id()));
    write_geotiff(&file, &grid, &[Layer { name: "height", values: grid.heights() }]).expect("a file");
    let start = Instant::now();
    let scene = Scene::load(&file).expect("a scene");
    std::fs::remove_file(&file).expect("removed");
    let mut options = PrepareOptions::default();
    options.detail = Detail::Rays;
    let model = Model::prepare(scene, &options).expect("a model");
    println!("{side} x {side} samples; scene and tree of Embree in {:.1} s", start.elapsed().as_secs_f64());
    let tested: Vec<usize> = (0..side * side).step_by((side * side / TESTED).max(1)).collect();
    let by_rays = |azimuths| -> Vec<f64> {
        tested.par_iter().map(|&sample| sky_view_by_rays(&model, &grid, sample, azimuths)).collect()
    };
    let reference = by_rays(REFERENCE);
    let error = |values: &dyn Fn(usize) -> f64| {
        let squares = reference.iter().enumerate().map(|(k, r)| (values(k) - r).powi(2));
        (squares.sum::<f64>() / reference.len() as f64).sqrt()
    };
    println!("azimuths  sweeps: s  RMS      rays: s    RMS      ratio");
    let mut enough = [None; 2];
    for azimuths in [4, 8, 16, 32, 64] {
        let start = Instant::now();
        let swept = sky_view_factor(&grid, azimuths, &SweepOptions::default()).expect("factors");
        let sweeps = (start.elapsed().as_secs_f64(), error(&|k| f64::from(swept[tested[k]])));
        let start = Instant::now();
        let found = by_rays(azimuths);
        let all = (side * side) as f64 / tested.len() as f64;
        let rays = (all * start.elapsed().as_secs_f64(), error(&|k| found[k]));
        println!(
            "{azimuths:8}  {:9.2}  {:.5}  {:9.1}  {:.5}  {:5.1}",
            sweeps.0,
            sweeps.1,
            rays.0,
            rays.1,
            rays.0 / sweeps.0
        );
        for (enough, (seconds, error)) in enough.iter_mut().zip([sweeps, rays]) {
            *enough = enough.or((error <= ERROR).then_some(seconds));
        }
    }
    if let [Some(sweeps), Some(rays)] = enough {
        println!(
            "to an RMS of {ERROR}: {sweeps:.2} s by sweeps, {rays:.1} s by rays, {:.1} times",
            rays / sweeps
        );
    }
}

/// The sky view factor of a sample from its horizon in so many azimuths.
fn sky_view_by_rays(model: &Model, grid: &Grid, sample: usize, azimuths: usize) -> f64 {
    let (column, row) = (sample % grid.columns(), sample / grid.columns());
    let [x, y] = grid.georeference().position(column, row);
    let height = |c: usize, r: usize| f64::from(grid.height(c, r));
    let ([dx, dy], [columns, rows]) = (grid.cell(), [grid.columns(), grid.rows()]);
    let (west, east) = (column.saturating_sub(1), (column + 1).min(columns - 1));
    let (north, south) = (row.saturating_sub(1), (row + 1).min(rows - 1));
    let slope_x = (height(east, row) - height(west, row)) / ((east - west) as f64 * dx);
    let slope_y = (height(column, north) - height(column, south)) / ((south - north) as f64 * dy);
    let up = 1.0 / (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
    let exact = model.exact();
    let mut sum = 0.0;
    for first in (0..azimuths).step_by(LANES) {
        let count = LANES.min(azimuths - first);
        let direction = |k: usize| ((first + k) as f64 + 0.5) / azimuths as f64 * TAU;
        let mut range = [[0.0, FRAC_PI_2]; LANES];
        for _ in 0..HALVINGS {
            let mut packet = Packet::EMPTY;
            for (lane, [low, high]) in range.iter().enumerate().take(count) {
                let (azimuth, elevation) = (direction(lane), 0.5 * (low + high));
                let way = [azimuth.sin() * elevation.cos(), azimuth.cos() * elevation.cos(), elevation.sin()];
                // A centimetre above the ground.
                let at = [x, y, height(column, row) + 0.01];
                packet.set_ray(lane, at.map(|v| v as f32).into(), way.map(|v| v as f32).into());
            }
            let mut blocked = [0];
            exact.occluded(&[packet], &mut blocked);
            for (lane, range) in range.iter_mut().enumerate().take(count) {
                let middle = 0.5 * (range[0] + range[1]);
                range[usize::from(blocked[0] & 1 << lane == 0)] = middle;
            }
        }
        for (lane, [low, high]) in range.iter().enumerate().take(count) {
            let along = -up * (slope_x * direction(lane).sin() + slope_y * direction(lane).cos());
            sum += seen_above(0.5 * (low + high), along, up);
        }
    }
    2.0 * sum / azimuths as f64
}

/// ∫ max(0, along · cos φ + up · sin φ) cos φ dφ from an elevation to the zenith.
fn seen_above(elevation: f64, along: f64, up: f64) -> f64 {
    let low = elevation.max((-along / up).atan());
    let whole = |phi: f64| along * (0.5 * phi + 0.25 * (2.0 * phi).sin()) + 0.5 * up * phi.sin().powi(2);
    whole(FRAC_PI_2) - whole(low)
}
