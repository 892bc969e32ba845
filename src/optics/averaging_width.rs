//! Fit of extinction to a projection, and the width over which the fit must be averaged.
//!
//! The threshold of the traversal, b*(t) = s (1 - t) + e t (docs/method.md, Umbra criterion), is also the width of the
//! beam where it crosses the cluster. An aggregated cluster is right if its contents, averaged over that width,
//! transmit what its extinction states. The *averaging width* is the smallest width over which the differences between
//! silhouette and extinction average out to a tolerance (docs/method.md, Sizes of a cluster). It covers cases that
//! disc sizes miss: penumbra contrast, gaps beside clumps, contents that fill only part of their box, single thin
//! parts of high contrast.

use super::frame::Frame;
use crate::raster::BitImage;
use glam::{Vec2, Vec3};

/// Side of the smallest averaging window, pixels. 4 divides a 64-bit word, so that a row of a cell is one shift and
/// mask; windows of fewer pixels would measure the rounding of the raster.
pub(super) const CELL_PIXELS: usize = 4;

/// A projection divided into cells of [`CELL_PIXELS`] x [`CELL_PIXELS`] pixels, with path lengths through the box; row
/// by row.
#[derive(Default)]
pub(super) struct Cells {
    width: usize,
    height: usize,
    /// Number of pixels per cell inside the projected box, and how many of them are free.
    inside: Vec<f32>,
    free: Vec<f32>,
    /// Path length through the box times relative density, per cell: at the cell's centre, or the mean over its pixels
    /// inside if the outline crosses the cell; scene units.
    path: Vec<f32>,
    /// Measured minus modelled number of free pixels per cell; scratch memory of [`Cells::averaging_width`].
    residual: Vec<f32>,
}

impl Cells {
    /// Counts the pixels of `hull` (the projected box) per cell, takes the sum of their transmittances from `free(x,
    /// y)` for cell (x, y), and computes path lengths along the view through the box, in which density has a `slope`.
    pub fn fill(&mut self, hull: &BitImage, free: impl Fn(usize, usize) -> f32, frame: &Frame, slope: Vec3) {
        let Frame { view, bounds, pixel, size, .. } = *frame;
        // One pixel, and the world position of pixel corner (0, 0).
        let (u, v) = (pixel * pixel * frame.u, pixel * pixel * frame.v);
        let origin = bounds.center() - 0.5 * (size.x as f32 * u + size.y as f32 * v);
        self.width = hull.width().div_ceil(CELL_PIXELS);
        self.height = hull.height().div_ceil(CELL_PIXELS);
        self.inside.clear();
        self.free.clear();
        self.path.clear();
        let inverse = Vec3::from(view.to_array().map(|d| if d == 0.0 { 1e30 } else { 1.0 / d }));
        for y in 0..self.height {
            for x in 0..self.width {
                let n = count_in_cell(hull, x, y);
                if n == 0.0 {
                    self.inside.push(0.0);
                    self.free.push(0.0);
                    self.path.push(0.0);
                    continue;
                }
                self.inside.push(n);
                self.free.push(free(x, y));
                let path_at = |at: Vec2| {
                    let p = origin + at.x * u + at.y * v;
                    let (a, b) = ((bounds.min - p) * inverse, (bounds.max - p) * inverse);
                    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
                    // The density is linear along the line, so its mean is its value in the middle.
                    let density = 1.0 + slope.dot(p + 0.5 * (enter + leave) * view - bounds.center());
                    (leave - enter).max(0.0) * density.max(0.0)
                };
                let corner = Vec2::new((x * CELL_PIXELS) as f32, (y * CELL_PIXELS) as f32);
                self.path.push(if n == (CELL_PIXELS * CELL_PIXELS) as f32 {
                    path_at(corner + 0.5 * CELL_PIXELS as f32)
                } else {
                    // The outline crosses the cell: take the mean over the pixels inside. The path at the centre would
                    // stand for pixels without a path, and the fitted extinction would compensate for them.
                    let pixels = (0..CELL_PIXELS * CELL_PIXELS)
                        .map(|k| Vec2::new((k % CELL_PIXELS) as f32, (k / CELL_PIXELS) as f32) + 0.5);
                    pixels.map(|k| path_at(corner + k)).sum::<f32>() / n
                });
            }
        }
    }

    /// Extinction (1/length) whose mean transmittance over the projected box equals the free fraction
    /// (docs/method.md, Extinction).
    ///
    /// Newton's method from κ = 0 converges from below because the left side is convex and decreasing. The free
    /// fraction is bounded from below by 1e-3, so that closed silhouettes get a finite extinction. Stops at a relative
    /// step of 1e-3 or after 12 steps; a cell of 16 pixels resolves free
    /// fractions to 1/16, far more coarsely.
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

    /// Sum of the transmittances of all pixels: their number, if each is either blocked or free.
    pub fn free_pixels(&self) -> f32 {
        self.free.iter().sum()
    }

    /// Mean transmittance stated by extinction `kappa` minus the measured one, in [-1, 1].
    pub fn mean_error(&self, kappa: f32) -> f32 {
        let said: f32 = self.inside.iter().zip(&self.path).map(|(n, l)| n * decay(kappa * l)).sum();
        (said - self.free.iter().sum::<f32>()) / self.inside.iter().sum::<f32>().max(1.0)
    }

    /// Averaging width in pixels for extinction `kappa` and a `tolerance` (root mean square error of the
    /// transmittance).
    pub fn averaging_width(&mut self, kappa: f32, tolerance: f32) -> f32 {
        let total: f32 = self.inside.iter().sum();
        if total == 0.0 {
            return 0.0;
        }
        self.residual.clear();
        let cells = self.inside.iter().zip(&self.free).zip(&self.path);
        self.residual.extend(cells.map(|((n, free), l)| free - n * decay(kappa * l)));
        let (mut width, mut height) = (self.width, self.height);
        let mut window = CELL_PIXELS as f32;
        let mut inside = std::mem::take(&mut self.inside);
        let mut errors: [(f32, f32); 8] = [(0.0, 0.0); 8];
        let mut levels = 0;
        loop {
            let square: f32 =
                self.residual.iter().zip(&inside).map(|(r, n)| if *n > 0.0 { r * r / n } else { 0.0 }).sum();
            let mut error = (square / total).sqrt();
            let whole = width == 1 && height == 1;
            if let Some((_, before)) = errors[..levels].last().filter(|_| !whole) {
                // The error of independent parts halves with each doubling of the width. A faster decrease is due to
                // the alignment of windows with the contents; beams have no such alignment.
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
            // Even the mean is wrong: a beam wider than the box dilutes the error with the square of its width.
            return largest * (bias / tolerance).sqrt();
        }
        // The window that holds the whole box does not describe beams that cross a part of the box.
        let errors = &errors[..(levels - 1).max(1)];
        match errors.iter().rposition(|(_, error)| *error > tolerance) {
            Some(i) if i + 1 < errors.len() => {
                let ((w0, e0), (w1, e1)) = (errors[i], errors[i + 1]);
                w0 * (w1 / w0).powf((e0 / tolerance).ln() / (e0 / e1.max(1e-6)).ln())
            }
            // Outside the range of measured windows: the error of independent parts is inversely proportional to the
            // window's width.
            Some(i) => errors[i].0 * errors[i].1 / tolerance,
            None => errors[0].0 * errors[0].1 / tolerance,
        }
    }
}

/// Number of object pixels in cell (x, y).
pub(super) fn count_in_cell(image: &BitImage, x: usize, y: usize) -> f32 {
    let rows = y * CELL_PIXELS..((y + 1) * CELL_PIXELS).min(image.height());
    let shift = x * CELL_PIXELS % 64;
    rows.map(|row| (image.row(row)[x * CELL_PIXELS / 64] >> shift & 0xf).count_ones()).sum::<u32>() as f32
}

/// Sums blocks of 2 x 2 cells in place; cells outside the image count as 0.
fn halve(values: &mut Vec<f32>, width: usize, height: usize) {
    let (w, h) = (width.div_ceil(2), height.div_ceil(2));
    for y in 0..h {
        for x in 0..w {
            let at = |dx: usize, dy: usize| {
                let (x, y) = (2 * x + dx, 2 * y + dy);
                if x < width && y < height { values[y * width + x] } else { 0.0 }
            };
            // Writes never overtake reads: the output index is at most that of the cells read.
            values[y * w + x] = at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1);
        }
    }
    values.truncate(w * h);
}

/// exp(-x) for x >= 0 with an error below 1e-4, inlined: (1 + y + y²/2 + y³/6)^-32 with y = x/32.
#[inline(always)]
fn decay(x: f32) -> f32 {
    let y = x * (1.0 / 32.0);
    let mut p = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0)));
    for _ in 0..5 {
        p *= p;
    }
    1.0 / p
}
