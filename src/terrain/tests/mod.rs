//! Sky view factors with closed forms, exact rays against all triangles, files, and adaptive triangles.

mod closed_forms;
mod coarse;
mod files;
mod light;
mod memory;
mod rays;

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

/// Sky view factor of a sample by `side`² rays, stratified with the density of the cosine.
fn by_rays(grid: &Grid, pyramid: &Pyramid, [c, r]: [usize; 2], side: usize) -> f64 {
    let normal = grid.normal(c, r).as_dvec3();
    let (x, y) = normal.any_orthonormal_pair();
    let mut seen = 0;
    for k in 0..side * side {
        let (u, v) = ((k / side) as f64 + 0.5, (k % side) as f64 + 0.5);
        let (radius, angle) = ((u / side as f64).sqrt(), std::f64::consts::TAU * v / side as f64);
        let across = radius * (x * angle.cos() + y * angle.sin());
        let direction = across + normal * (1.0 - radius * radius).sqrt();
        let is_up = direction.z > 0.0;
        let origin = grid.position(c, r);
        seen += usize::from(is_up && !pyramid.occluded(origin, direction, f64::INFINITY).expect("a ray"));
    }
    seen as f64 / (side * side) as f64
}
