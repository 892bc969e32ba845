//! Exact Euclidean distance transform.
//!
//! Two passes over the columns, then per row the lower envelope of the parabolas (x − i)² + g(i)², as in
//! P. Felzenszwalb and D. Huttenlocher, *Distance transforms of sampled functions*, Theory of Computing 8 (2012), in
//! integers (A. Meijster, J. Roerdink, W. Hesselink 2000). Linear time in the number of pixels.

use super::disc::{Discs, MAX_SIDE};
use super::{BitImage, NO_BACKGROUND, Outside};

/// Euclidean distance transform with its working memory: make one per thread and reuse it.
///
/// Distances are between pixel centres, squared, in pixels². Images may have up to 46,340 columns and rows, so that
/// every squared distance fits in a `u32`; in larger images distances saturate.
#[derive(Clone, Debug, Default)]
pub struct Edt {
    discs: Discs,
    columns: Vec<u32>,
    sites: Vec<(usize, usize)>,
    squared: Vec<u32>,
}

impl Edt {
    /// A transform without allocated memory.
    pub fn new() -> Self {
        Edt::default()
    }

    /// Squared distance of each pixel (row by row, width × height values) to the nearest background pixel:
    /// 0 for background, [`NO_BACKGROUND`] everywhere if there is none.
    pub fn squared_distances(&mut self, image: &BitImage, outside: Outside) -> &[u32] {
        let (width, height) = (image.width(), image.height());
        self.column_distances(image, outside);
        self.squared.clear();
        self.squared.resize(width * height, 0);
        if width > 0 {
            for (g, out) in self.columns.chunks_exact(width).zip(self.squared.chunks_exact_mut(width)) {
                envelope(g, out, &mut self.sites);
                if outside == Outside::Free {
                    for (x, d) in out.iter_mut().enumerate() {
                        let border = (x + 1).min(width - x);
                        *d = (*d).min((border * border).min(NO_BACKGROUND as usize) as u32);
                    }
                }
            }
        }
        &self.squared
    }

    /// The largest of [`Edt::squared_distances`] where outside of the image is background. Images of at most 64 x 64 pixels take a faster
    /// algorithm that allocates no memory after its first use.
    pub fn max_squared_distance(&mut self, image: &BitImage) -> u32 {
        if image.width() <= MAX_SIDE && image.height() <= MAX_SIDE {
            return self.discs.max_squared_distance(image);
        }
        self.squared_distances(image, Outside::Free).iter().copied().max().unwrap_or(0)
    }

    /// Diameter in pixels, 2·√d², of the largest disc in an object whose innermost pixel has this squared distance; 0 without object. The
    /// [room](super) states the accuracy.
    pub fn max_inscribed_diameter(&mut self, image: &BitImage) -> f32 {
        2.0 * (self.max_squared_distance(image) as f32).sqrt()
    }

    /// Fills `columns` with the distance of each pixel to the nearest background pixel of its column,
    /// [`NO_COLUMN`] where the column has none.
    fn column_distances(&mut self, image: &BitImage, outside: Outside) {
        let (width, height) = (image.width(), image.height());
        self.columns.clear();
        self.columns.resize(width * height, 0);
        let beyond = if outside == Outside::Free { 0 } else { NO_COLUMN };
        let step = |object: bool, previous: u32| match (object, previous) {
            (false, _) => 0,
            (true, NO_COLUMN) => NO_COLUMN,
            (true, d) => d + 1,
        };
        for y in 0..height {
            let row = image.row(y);
            let (above, here) = self.columns.split_at_mut(y * width);
            for x in 0..width {
                let previous = if y == 0 { beyond } else { above[(y - 1) * width + x] };
                here[x] = step(row[x / 64] >> (x % 64) & 1 == 1, previous);
            }
        }
        for y in (0..height).rev() {
            let (here, below) = self.columns.split_at_mut((y + 1) * width);
            for x in 0..width {
                let previous = if y + 1 == height { beyond } else { below[x] };
                let d = &mut here[y * width + x];
                *d = (*d).min(step(*d > 0, previous));
            }
        }
    }
}

/// Marks a column without background.
const NO_COLUMN: u32 = u32::MAX;

/// Lower envelope of the parabolas (x − i)² + g(i)² at every x. `sites` holds the envelope's parabolas from left to
/// right, each with the first x where it is the lowest.
fn envelope(g: &[u32], out: &mut [u32], sites: &mut Vec<(usize, usize)>) {
    let value = |x: usize, i: usize| {
        let dx = x.abs_diff(i) as u64;
        dx * dx + u64::from(g[i]) * u64::from(g[i])
    };
    sites.clear();
    for u in 0..g.len() {
        if g[u] == NO_COLUMN {
            continue;
        }
        while let Some(&(i, start)) = sites.last() {
            if value(start, i) <= value(start, u) {
                break;
            }
            sites.pop();
        }
        match sites.last() {
            None => sites.push((u, 0)),
            Some(&(i, _)) => {
                let square = |v: usize| (v * v) as i64;
                let rise = square(u) - square(i) + square(g[u] as usize) - square(g[i] as usize);
                let start = 1 + rise / (2 * (u - i) as i64);
                if (start as usize) < g.len() {
                    sites.push((u, start as usize));
                }
            }
        }
    }
    let Some(mut k) = sites.len().checked_sub(1) else {
        out.fill(NO_BACKGROUND);
        return;
    };
    for x in (0..g.len()).rev() {
        while sites[k].1 > x {
            k -= 1;
        }
        out[x] = value(x, sites[k].0).min(u64::from(NO_BACKGROUND)) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance of each pixel by a search over all background pixels, with a ring of them outside if free.
    fn naive(image: &BitImage, outside: Outside) -> Vec<u32> {
        let (w, h) = (image.width() as i64, image.height() as i64);
        let ring = i64::from(outside == Outside::Free);
        let object = |x: i64, y: i64| x >= 0 && y >= 0 && image.get(x as usize, y as usize);
        let background: Vec<_> = (-ring..h + ring)
            .flat_map(|y| (-ring..w + ring).map(move |x| (x, y)))
            .filter(|&(x, y)| !object(x, y))
            .collect();
        let nearest =
            |x: i64, y: i64| background.iter().map(|&(u, v)| ((x - u).pow(2) + (y - v).pow(2)) as u32).min();
        (0..h)
            .flat_map(|y| (0..w).map(move |x| (x, y)))
            .map(|(x, y)| nearest(x, y).unwrap_or(NO_BACKGROUND))
            .collect()
    }

    /// Unions of random rectangles: larger regions than noise.
    fn blobs(w: usize, h: usize, rectangles: &[(usize, usize, usize, usize)], inverted: bool) -> BitImage {
        BitImage::from_fn(w, h, |x, y| {
            rectangles.iter().any(|&(l, t, a, b)| (l..l + a).contains(&x) && (t..t + b).contains(&y))
                != inverted
        })
    }

    proptest! {
        #[test]
        fn agrees_with_the_naive_transform(
            w in 1usize..66,
            h in 1usize..66,
            rectangles in prop::collection::vec((0usize..64, 0usize..64, 1usize..30, 1usize..30), 0..8),
            inverted: bool,
        ) {
            let image = blobs(w, h, &rectangles, inverted);
            let mut edt = Edt::new();
            for outside in [Outside::Free, Outside::Blocked] {
                let expected = naive(&image, outside);
                prop_assert_eq!(edt.squared_distances(&image, outside), &expected[..]);
                if outside == Outside::Free {
                    prop_assert_eq!(edt.max_squared_distance(&image), expected.into_iter().max().unwrap());
                }
            }
        }
    }

    #[test]
    fn empty_images_have_no_size() {
        let mut edt = Edt::new();
        for (w, h) in [(0, 0), (0, 5), (5, 0), (5, 5), (100, 3)] {
            assert_eq!(edt.max_inscribed_diameter(&BitImage::new(w, h)), 0.0);
        }
        let full = BitImage::new(9, 70).complement();
        assert_eq!(edt.max_inscribed_diameter(&full), 10.0);
    }

    #[test]
    fn squares_turned_squares_and_discs_have_their_size() {
        let mut edt = Edt::new();
        let mut check = |expect: f32, tolerance: f32, object: &dyn Fn(f64, f64) -> bool| {
            // Several positions of the shape relative to the pixel grid; the image is sampled at pixel centres.
            for (ox, oy) in [(0.01, 0.01), (0.47, 0.47), (0.25, 0.01), (0.4, 0.1), (0.13, 0.77)] {
                let image =
                    BitImage::from_fn(64, 64, |x, y| object(x as f64 - 31.0 + ox, y as f64 - 31.0 + oy));
                let size = edt.max_inscribed_diameter(&image);
                assert!((size - expect).abs() < tolerance, "{size} for {expect} at {ox} {oy}");
            }
        };
        for a in 3..40 {
            let half = a as f64 / 2.0;
            check(a as f32, 1.5, &|x, y| x.abs() < half && y.abs() < half);
            check(a as f32, 1.5, &|x, y| x.hypot(y) < half);
            check(a as f32, 1.5, &|x, y| {
                (x + y).abs() < half * 2f64.sqrt() && (x - y).abs() < half * 2f64.sqrt()
            });
        }
        for a in 1..60usize {
            let image = BitImage::from_fn(64, 64, |x, y| (2..2 + a).contains(&x) && (1..1 + a).contains(&y));
            assert_eq!(edt.max_inscribed_diameter(&image), (a + a % 2) as f32);
        }
    }
}
