//! How well extinction stands for the contents of a projection, and over which width it must be averaged.
//!
//! The threshold of the traversal, b*(t) = s (1 - t) + e t, is the width of the beam where it crosses the cluster:
//! the emitter as seen from the receiver point and the feature size as seen from the emitter, laid end to end. The
//! answer is right if the contents, averaged over that width, transmit what extinction says. So beside the paper's
//! BSIZE (the largest blocked disc) each cluster gets its *grain*: the smallest width over which the differences
//! between its silhouette and its extinction average out to a tolerance. It catches what BSIZE cannot: penumbra
//! contrast (method D.9), gaps beside clumps, contents that fill only part of their box (D.12), single thin
//! parts of high contrast.

use crate::math::Aabb;
use crate::raster::BitImage;
use glam::{Vec2, Vec3};

/// Side of the smallest window in pixels.
const CELL: usize = 4;

/// Cells of a projection and the paths through the box behind them.
#[derive(Default)]
pub(super) struct Cells {
    width: usize,
    height: usize,
    /// Pixels of the projected box, and of them the free ones.
    inside: Vec<f32>,
    free: Vec<f32>,
    /// Length of the view line through the box at the cell's centre, times the relative density there.
    path: Vec<f32>,
    residual: Vec<f32>,
}

impl Cells {
    /// Counts pixels of `hull` (the projected box) and `gaps` (its free part) cell by cell. `origin` is the world
    /// position of pixel (0, 0) projected, with `u` and `v` one pixel wide.
    pub fn fill(
        &mut self,
        (hull, gaps): (&BitImage, &BitImage),
        (bounds, slope): (Aabb, Vec3),
        view: Vec3,
        (origin, u, v): (Vec3, Vec3, Vec3),
    ) {
        self.width = hull.width().div_ceil(CELL);
        self.height = hull.height().div_ceil(CELL);
        self.inside.clear();
        self.free.clear();
        self.path.clear();
        let inverse = Vec3::from(view.to_array().map(|d| if d == 0.0 { 1e30 } else { 1.0 / d }));
        for y in 0..self.height {
            for x in 0..self.width {
                let count = |image: &BitImage| {
                    let rows = y * CELL..((y + 1) * CELL).min(image.height());
                    let shift = x * CELL % 64;
                    rows.map(|row| (image.row(row)[x * CELL / 64] >> shift & 0xf).count_ones()).sum::<u32>()
                        as f32
                };
                let n = count(hull);
                if n == 0.0 {
                    self.inside.push(0.0);
                    self.free.push(0.0);
                    self.path.push(0.0);
                    continue;
                }
                self.inside.push(n);
                self.free.push(count(gaps));
                let path_at = |at: Vec2| {
                    let p = origin + at.x * u + at.y * v;
                    let (a, b) = ((bounds.min - p) * inverse, (bounds.max - p) * inverse);
                    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
                    // Linear along the line, so its mean is that in the middle.
                    let density = 1.0 + slope.dot(p + 0.5 * (enter + leave) * view - bounds.center());
                    (leave - enter).max(0.0) * density.max(0.0)
                };
                let corner = Vec2::new((x * CELL) as f32, (y * CELL) as f32);
                self.path.push(if n == (CELL * CELL) as f32 {
                    path_at(corner + 0.5 * CELL as f32)
                } else {
                    // The outline crosses the cell: the mean over the pixels inside, or extinction would have to
                    // make up for paths that are not there.
                    let pixels =
                        (0..CELL * CELL).map(|k| Vec2::new((k % CELL) as f32, (k / CELL) as f32) + 0.5);
                    pixels.map(|k| path_at(corner + k)).sum::<f32>() / n
                });
            }
        }
    }

    /// Extinction whose mean transmission over the projection is the measured one (method D.1).
    ///
    /// Newton's method on a convex, falling function, from below: it cannot overshoot. Nearly closed silhouettes
    /// get the extinction of 99.9 % coverage.
    pub fn fitted_extinction(&self) -> f32 {
        let inside: f32 = self.inside.iter().sum();
        let free = self.free.iter().sum::<f32>().max(1e-3 * inside);
        let mut kappa = 0.0f32;
        for _ in 0..12 {
            let (mut value, mut slope) = (0.0, 0.0);
            for (n, l) in self.inside.iter().zip(&self.path) {
                let passed = n * decay(kappa * l);
                value += passed;
                slope += passed * l;
            }
            let step = (value - free) / slope.max(f32::MIN_POSITIVE);
            kappa += step.max(0.0);
            if step <= 1e-3 * kappa {
                break;
            }
        }
        kappa
    }

    /// Mean transmission that an extinction says less the one that is there.
    pub fn mean_error(&self, kappa: f32) -> f32 {
        let said: f32 = self.inside.iter().zip(&self.path).map(|(n, l)| n * decay(kappa * l)).sum();
        (said - self.free.iter().sum::<f32>()) / self.inside.iter().sum::<f32>().max(1.0)
    }

    /// The grain, in pixels, for an extinction and a tolerance (root mean square of the transmission's error).
    pub fn averaging_width(&mut self, kappa: f32, tolerance: f32) -> f32 {
        let total: f32 = self.inside.iter().sum();
        if total == 0.0 {
            return 0.0;
        }
        self.residual.clear();
        let cells = self.inside.iter().zip(&self.free).zip(&self.path);
        self.residual.extend(cells.map(|((n, free), l)| free - n * decay(kappa * l)));
        let (mut width, mut height) = (self.width, self.height);
        let mut window = CELL as f32;
        let mut inside = std::mem::take(&mut self.inside);
        let mut errors: [(f32, f32); 8] = [(0.0, 0.0); 8];
        let mut levels = 0;
        loop {
            let square: f32 =
                self.residual.iter().zip(&inside).map(|(r, n)| if *n > 0.0 { r * r / n } else { 0.0 }).sum();
            let mut error = (square / total).sqrt();
            let whole = width == 1 && height == 1;
            if let Some((_, before)) = errors[..levels].last().filter(|_| !whole) {
                // Parts that are independent average out as the width grows. What falls faster does so because the
                // windows happen to lie as the parts do; beams lie anywhere.
                error = error.max(0.5 * before);
            }
            errors[levels] = (window, error);
            levels += 1;
            if (width == 1 && height == 1) || levels == errors.len() {
                break;
            }
            halve(&mut self.residual, width, height);
            halve(&mut inside, width, height);
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            window *= 2.0;
        }
        self.inside = inside;
        let (largest, bias) = errors[levels - 1];
        if bias > tolerance {
            // Even the mean is off: beams wider than the box dilute the error with the square of their width.
            return largest * (bias / tolerance).sqrt();
        }
        // The window that holds the whole box says nothing about beams that hold part of it.
        let errors = &errors[..(levels - 1).max(1)];
        match errors.iter().rposition(|(_, error)| *error > tolerance) {
            Some(i) if i + 1 < errors.len() => {
                let ((w0, e0), (w1, e1)) = (errors[i], errors[i + 1]);
                w0 * (w1 / w0).powf((e0 / tolerance).ln() / (e0 / e1.max(1e-6)).ln())
            }
            // Beyond the windows measured, errors of independent parts fall and rise as the window grows and
            // shrinks.
            Some(i) => errors[i].0 * errors[i].1 / tolerance,
            None => errors[0].0 * errors[0].1 / tolerance,
        }
    }
}

/// Sums two by two cells in place.
fn halve(values: &mut Vec<f32>, width: usize, height: usize) {
    let (w, h) = (width.div_ceil(2), height.div_ceil(2));
    for y in 0..h {
        for x in 0..w {
            let at = |dx: usize, dy: usize| {
                let (x, y) = (2 * x + dx, 2 * y + dy);
                if x < width && y < height { values[y * width + x] } else { 0.0 }
            };
            // Writes never overtake reads: cell (x, y) lies at or before the cells it sums.
            values[y * w + x] = at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1);
        }
    }
    values.truncate(w * h);
}

/// exp(-x) for x >= 0 within 1e-4, without a call: (1 + y + y²/2)^-32 with y = x/32.
#[inline(always)]
fn decay(x: f32) -> f32 {
    let y = x * (1.0 / 32.0);
    let mut p = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0)));
    for _ in 0..5 {
        p *= p;
    }
    1.0 / p
}
