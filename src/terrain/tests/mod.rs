//! Sky view factors with closed forms and from exact horizons, files, and adaptive triangles.

mod closed_forms;
mod coarse;
mod files;
mod light;

use super::*;

/// Flat earth.
fn flat() -> SweepOptions {
    SweepOptions::default()
}

/// Sky view factors in 32 azimuths.
fn sky_view(grid: &Grid) -> Vec<f32> {
    sky_view_factor(grid, 32, &flat()).expect("sky view factors")
}

/// Some samples of a grid, spread by multiples of primes.
fn spread(grid: &Grid, count: usize) -> impl Iterator<Item = [usize; 2]> {
    let (columns, rows) = (grid.columns(), grid.rows());
    (0..count).map(move |i| [(i * 7919 + 5) % columns, (i * 104_729 + 13) % rows])
}

/// Height of the surface at a place in columns and rows; none outside the grid.
fn surface(grid: &Grid, [x, y]: [f64; 2]) -> Option<f64> {
    let last = [grid.columns() - 1, grid.rows() - 1];
    if !(0.0..=last[0] as f64).contains(&x) || !(0.0..=last[1] as f64).contains(&y) {
        return None;
    }
    let (c, r) = ((x as usize).min(last[0] - 1), (y as usize).min(last[1] - 1));
    let at = |i: usize, j: usize| f64::from(grid.height(c + i, r + j));
    let (u, v) = (x - c as f64, y - r as f64);
    Some(match u + v <= 1.0 {
        true => at(0, 0) + (at(1, 0) - at(0, 0)) * u + (at(0, 1) - at(0, 0)) * v,
        false => at(1, 1) + (at(0, 1) - at(1, 1)) * (1.0 - u) + (at(1, 0) - at(1, 1)) * (1.0 - v),
    })
}

/// Tangent of the horizon of a sample in an azimuth: the largest at all places where a line crosses edges of triangles, which are
/// columns, rows and diagonals of cells.
fn exact_tangent(grid: &Grid, [c, r]: [usize; 2], azimuth: f64) -> f64 {
    let [dx, dy] = grid.cell();
    let rates = [azimuth.sin() / dx, -azimuth.cos() / dy];
    let own = f64::from(grid.height(c, r));
    let mut highest = 0.0f64;
    for rate in [rates[0], rates[1], rates[0] + rates[1]] {
        let distances = (1..).map(|k| f64::from(k) / rate.abs());
        let heights = distances.map_while(|d| {
            let place = [c as f64 + d * rates[0], r as f64 + d * rates[1]];
            Some((surface(grid, place)? - own) / d)
        });
        highest = heights.fold(highest, f64::max);
    }
    highest
}

/// How a sample is tilted in an azimuth.
fn tilt(grid: &Grid, [c, r]: [usize; 2], azimuth: f64) -> Tilt {
    Tilt::new(Slopes::new(grid, r).at(c), [azimuth.sin() as f32, -azimuth.cos() as f32])
}

/// Sky view factor of a sample from exact horizons in 256 azimuths.
fn exact_sky_view(grid: &Grid, sample: [usize; 2]) -> f64 {
    let azimuths = (0..256).map(|k| std::f64::consts::TAU * (f64::from(k) + 0.5) / 256.0);
    let seen = azimuths.map(|a| tilt(grid, sample, a).seen(exact_tangent(grid, sample, a) as f32));
    seen.map(f64::from).sum::<f64>() / 256.0
}

/// 10 million samples within 2 GiB. Counts all of the process: run it alone.
#[test]
#[ignore = "takes a minute in a release build"]
#[cfg(target_os = "linux")]
fn ten_million_samples_fit_two_gibibytes() {
    let grid = fractal(3163, 3163, 10.0, 3000.0, 0.5, 7).expect("a grid");
    let values = sky_view(&grid);
    let status = std::fs::read_to_string("/proc/self/status").expect("status");
    let line = status.lines().find(|l| l.starts_with("VmHWM")).expect("a line");
    let peak: u64 = line.split_ascii_whitespace().nth(1).and_then(|v| v.parse().ok()).expect("kB");
    println!("{} values, {} MiB", values.len(), peak >> 10);
    assert!(peak < 2 << 20);
}
