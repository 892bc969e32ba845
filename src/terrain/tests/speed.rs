use super::*;
use rayon::prelude::*;
use std::time::Instant;

/// Times and errors on 3,000 × 3,000: `cargo test --release terrain::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes and 1 GiB; states figures for a release build"]
fn three_thousand_squared() {
    let grid = fractal(3000, 3000, 10.0, 3000.0, 0.5, 7).expect("a grid");
    let pyramid = Pyramid::new(&grid);
    let samples: Vec<[usize; 2]> = spread(&grid, 400).collect();
    let expected: Vec<f64> = samples.par_iter().map(|s| by_rays(&grid, &pyramid, *s, 96)).collect();
    let mean_error = |value: &(dyn Fn(usize) -> f64 + Sync)| {
        (0..samples.len()).map(|i| (value(i) - expected[i]).abs()).sum::<f64>() / samples.len() as f64
    };
    for azimuths in [8, 16, 32, 64] {
        let start = Instant::now();
        let values = sky_view_factor(&grid, azimuths, &flat()).expect("sky view factors");
        let error = mean_error(&|i| f64::from(values[samples[i][1] * 3000 + samples[i][0]]));
        println!("sweep, {azimuths} azimuths: {:.1?}, mean error {error:.5}", start.elapsed());
    }
    for azimuths in [4, 8, 16, 32] {
        let start = Instant::now();
        let values: Vec<f64> =
            samples.par_iter().map(|s| by_horizon_rays(&grid, &pyramid, *s, azimuths)).collect();
        let all = start.elapsed() * (grid.heights().len() / samples.len()) as u32;
        println!("rays, {azimuths} azimuths: {all:.0?}, mean error {:.5}", mean_error(&|i| values[i]));
    }
    let start = Instant::now();
    let sun = Sun { azimuth: 2.0, elevation: 0.4, half_angle: 0.00465 };
    sunlit(&grid, &sun, &flat()).expect("sunlit");
    println!("sunlit: {:.1?}", start.elapsed());
    let light = Light { sun, direct_normal: 800.0, sky: &|d| 30.0 + 20.0 * d.z };
    let start = Instant::now();
    irradiance(&grid, &light, 32, &flat()).expect("irradiance");
    println!("irradiance, 32 azimuths: {:.1?}", start.elapsed());
}

/// 10 million samples within 2 GiB, the pyramid and a copy of all values included. Counts all of the process: run it alone.
#[test]
#[ignore = "takes a minute in a release build"]
#[cfg(target_os = "linux")]
fn ten_million_samples_fit_two_gibibytes() {
    let grid = fractal(3163, 3163, 10.0, 3000.0, 0.5, 7).expect("a grid");
    let _pyramid = Pyramid::new(&grid);
    let start = Instant::now();
    let values = sky_view(&grid);
    let time = start.elapsed();
    let status = std::fs::read_to_string("/proc/self/status").expect("status");
    let line = status.lines().find(|l| l.starts_with("VmHWM")).expect("a line");
    let peak: u64 = line.split_ascii_whitespace().nth(1).and_then(|v| v.parse().ok()).expect("kB");
    println!("{} values, {time:.1?}, {} MiB", values.len(), peak >> 10);
    assert!(peak < 2 << 20);
}

/// Sky view factor from the horizon in some azimuths, each found by rays whose elevations halve an interval down to 1/1024 of a
/// right angle.
fn by_horizon_rays(grid: &Grid, pyramid: &Pyramid, [c, r]: [usize; 2], azimuths: usize) -> f64 {
    let (normal, origin) = (grid.normal(c, r).as_dvec3(), grid.position(c, r));
    let mut sum = 0.0;
    for i in 0..azimuths {
        let (east, north) = (std::f64::consts::TAU * (i as f64 + 0.5) / azimuths as f64).sin_cos();
        let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
        for _ in 0..10 {
            let middle: f64 = 0.5 * (low + high);
            let direction = glam::DVec3::new(east * middle.cos(), north * middle.cos(), middle.sin());
            match pyramid.occluded(origin, direction, f64::INFINITY).expect("a ray") {
                true => low = middle,
                false => high = middle,
            }
        }
        let tilt = local::Tilt { up: normal.z as f32, along: (normal.x * east + normal.y * north) as f32 };
        sum += f64::from(tilt.seen((0.5 * (low + high)).tan() as f32));
    }
    sum / azimuths as f64
}
