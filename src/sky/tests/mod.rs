//! Skies against published values and other programs, and their geometry against brute force.

mod description;
mod geometry;
mod maps;
mod models;

use super::*;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The frame with +z up and +y north.
fn frame() -> Frame {
    Frame::upright(DVec3::Z).expect("a frame")
}

/// The environment of a sky and a sun as short texts, with +z up.
fn environment(sky: &str, sun: &str) -> Environment {
    let options = SkyOptions::parse(sky).and_then(|o| o.with_sun(sun)).expect("options");
    options.environment(DVec3::Z).expect("an environment")
}

/// Integral of a value over the directions above a height, 0 or −1, by solid angle: rows of equal angle.
fn integral(rows: usize, from: f64, value: impl Fn(DVec3) -> f64) -> f64 {
    let columns = 2 * rows;
    let height = |row: f64| (from.acos() * (1.0 - row / rows as f64)).cos();
    let mut sum = 0.0;
    for row in 0..rows {
        let (low, middle, high) = (height(row as f64), height(row as f64 + 0.5), height(row as f64 + 1.0));
        let along = (0..columns).map(|k| frame::spherical(middle, TAU * (k as f64 + 0.5) / columns as f64));
        sum += (high - low) * TAU / columns as f64 * along.map(&value).sum::<f64>();
    }
    sum
}

/// Integral of a density over the sphere, with rows of equal height like those of the tables of samples.
fn integral_of_density(value: impl Fn(DVec3) -> f64) -> f64 {
    let (rows, columns) = (1024, 1024);
    let part = |k: usize| (k as f64 + 0.5) / rows as f64;
    let cells =
        (0..rows * columns).map(|k| frame::spherical(2.0 * part(k / columns) - 1.0, TAU * part(k % columns)));
    cells.map(value).sum::<f64>() * 2.0 * TAU / (rows * columns) as f64
}

/// Unit vectors in all directions, by a golden spiral.
fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = PI * (3.0 - 5.0f64.sqrt());
    (0..count).map(move |k| {
        frame::spherical(1.0 - 2.0 * (k as f64 + 0.5) / count as f64, (golden * k as f64).rem_euclid(TAU))
    })
}

/// Points of the unit square: a Kronecker sequence with the powers of the plastic number.
fn square(count: usize) -> impl Iterator<Item = [f64; 2]> {
    let plastic = 1.324_717_957_244_746;
    (0..count).map(move |k| [1.0, 2.0].map(|power| (0.5 + k as f64 / f64::powf(plastic, power)).fract()))
}

#[track_caller]
fn assert_near(value: f64, wanted: f64, relative: f64) {
    let error = (value - wanted).abs();
    assert!(
        error <= relative * wanted.abs(),
        "{value}, not {wanted}: relative error {:.2e}",
        error / wanted.abs()
    );
}
