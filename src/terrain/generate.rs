//! Height fields made by formulas: a rough one, and those with known sky view factors.

use super::Grid;
use crate::math::parallel;
use crate::{Result, memory};

/// Memory of a sample, bytes: its height, and the same in the file that is written.
const BYTES_PER_SAMPLE: u64 = 8;

/// A grid of `columns × rows` samples at the distance `cell` in m, whose heights are a function of the distances from the middle
/// towards east and north, m.
pub fn of(columns: usize, rows: usize, cell: f64, height: impl Fn(f64, f64) -> f64 + Sync) -> Result<Grid> {
    super::grid::check_sides(columns, rows).map_err(crate::Error::arguments)?;
    let samples = (columns * rows) as u64;
    memory::check_room(BYTES_PER_SAMPLE * samples, || format!("{samples} samples of the terrain"))?;
    let (x0, y0) = (0.5 * (columns - 1) as f64, 0.5 * (rows - 1) as f64);
    let mut heights = vec![0.0f32; columns * rows];
    parallel::for_each_chunk_mut(&mut heights, columns, |r, line| {
        for (c, h) in line.iter_mut().enumerate() {
            *h = height((c as f64 - x0) * cell, (y0 - r as f64) * cell) as f32;
        }
    });
    Grid::new(columns, rows, [cell; 2], heights)
}

/// A square plane that falls towards `azimuth` (radians from north over east) with `inclination` (radians). Sky view factor of
/// all samples: (1 + cos inclination)/2.
#[cfg(test)]
pub fn plane(side: usize, cell: f64, inclination: f64, azimuth: f64) -> Result<Grid> {
    let fall = inclination.tan();
    of(side, side, cell, |x, y| -fall * (x * azimuth.sin() + y * azimuth.cos()))
}

/// A V-shaped valley from south to north, whose sides rise with `inclination` (radians) to the east and west borders. Sky view
/// factor of a sample of a side, from which the top of the other side has the elevation e across the valley: (1 + cos(inclination
/// + e))/2; at the bottom: cos inclination.
#[cfg(test)]
pub fn valley(columns: usize, rows: usize, cell: f64, inclination: f64) -> Result<Grid> {
    of(columns, rows, cell, |x, _| x.abs() * inclination.tan())
}

/// A street from south to north, `width` m wide, between walls of `height` m that rise within the distance of two samples; the
/// walls reach the border. Sky view factor on the floor, where the walls have elevations e and f across the street: (cos e + cos
/// f)/2.
#[cfg(test)]
pub fn canyon(columns: usize, rows: usize, cell: f64, width: f64, height: f64) -> Result<Grid> {
    // The wall's top edge is at half the width, also if rounding moves a sample.
    of(columns, rows, cell, |x, _| if x.abs() >= 0.5 * width * (1.0 - 1e-9) { height } else { 0.0 })
}

/// A round courtyard of `radius` m between walls of `height` m. Sky view factor in the middle of the floor: radius²/(radius² +
/// height²).
#[cfg(test)]
pub fn courtyard(side: usize, cell: f64, radius: f64, height: f64) -> Result<Grid> {
    of(side, side, cell, |x, y| if x.hypot(y) >= radius * (1.0 - 1e-9) { height } else { 0.0 })
}

/// Mountains and valleys on a square of `side × side` samples, 20 m apart: `fractal` whose slopes are mostly between 10 and 35 degrees.
pub fn mountains(side: usize, seed: u64) -> Result<Grid> {
    const CELL: f64 = 20.0;
    fractal(side, side, CELL, 0.5 * side as f64 * CELL, 0.45, seed)
}

/// Rough terrain: a sum of smooth noises, each with half the wavelength of the one before, down to two samples, and `roughness`
/// (0..1) times its amplitude. The longest wavelength is the shorter side, its amplitude `relief` m.
pub fn fractal(
    columns: usize,
    rows: usize,
    cell: f64,
    relief: f64,
    roughness: f64,
    seed: u64,
) -> Result<Grid> {
    let longest = columns.min(rows) as f64;
    of(columns, rows, cell, |x, y| {
        let (mut wavelength, mut amplitude, mut sum) = (longest, relief, 0.0);
        let mut octave = seed;
        while wavelength >= 2.0 {
            sum += amplitude * noise(x / cell / wavelength, y / cell / wavelength, octave);
            wavelength *= 0.5;
            amplitude *= roughness;
            octave = octave.wrapping_add(0x9e37_79b9);
        }
        sum
    })
}

/// Smooth noise in −1/2..1/2 with independent values at integer places, cubic between.
fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (smooth(x - i), smooth(y - j));
    let at = |di: i64, dj: i64| random(i as i64 + di, j as i64 + dj, seed);
    let line = |dj: i64| at(0, dj) + (at(1, dj) - at(0, dj)) * u;
    line(0) + (line(1) - line(0)) * v
}

/// A number in −1/2..1/2 that depends on a place: the finaliser of SplitMix64 (S. Vigna).
fn random(i: i64, j: i64, seed: u64) -> f64 {
    let mut z =
        (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (j as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    z = z.wrapping_add(seed.wrapping_mul(0x1656_67b1_9e37_79f9));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}
