//! Largest distance to the background in a small image, without computing a distance per pixel.
//!
//! A pixel lies further than √n from the background exactly if the whole disc {o : |o|² ≤ n} around the pixel is
//! object. In an image of at most 64 x 64 pixels a row is one word, so the existence of such a pixel is decided by an
//! AND of a few words per row: row y of the image eroded by the disc is the AND over dy of row y + dy eroded
//! horizontally by the disc's half width at dy. Counts of 4- and 8-neighbour erosions bracket the squared distance to
//! a factor of two; bisection finds it. [`crate::optics`] measures up to millions of such images per scene.

use super::BitImage;

/// Largest number of columns and rows that [`Discs`] accepts.
pub(super) const MAX_SIDE: usize = 64;

/// Rows of an image, with a row of background above and below.
type Plane = [u64; MAX_SIDE + 2];

/// Working memory: the rows eroded horizontally by 0, 1, 2, … pixels, and the half widths of the disc.
#[derive(Clone, Debug, Default)]
pub(super) struct Discs {
    eroded: Vec<u64>,
    half_widths: Vec<u32>,
}

impl Discs {
    /// Largest squared distance from an object pixel to the nearest background pixel, pixels²; 0 without object pixels. Outside of the
    /// image, which has at most [`MAX_SIDE`] columns and rows, is background.
    pub(super) fn max_squared_distance(&mut self, image: &BitImage) -> u32 {
        if image.is_empty() {
            return 0;
        }
        let height = image.height();
        let mut plane = [0; MAX_SIDE + 2];
        plane[1..=height].copy_from_slice(image.words());
        // Chebyshev radius c and city-block radius k bound the Euclidean radius d of the innermost pixel:
        // c ≤ d ≤ √2·c and k/√2 ≤ d ≤ k.
        let c = erosions(&plane, height, SQUARE);
        let k = erosions(&plane, height, DIAMOND);
        let (mut low, mut high) = ((c * c).max((k * k).div_ceil(2)), (2 * c * c).min(k * k));
        if low < high {
            self.erode_rows(&plane[1..=height], (high - 1).isqrt());
        }
        // Find the least n for which no disc of squared radius n fits.
        while low < high {
            let n = low.midpoint(high);
            if self.disc_fits(n, height) {
                low = n + 1;
            } else {
                high = n;
            }
        }
        low
    }

    /// Fills `eroded` with the rows eroded horizontally by 0..=`widest` pixels to each side.
    fn erode_rows(&mut self, rows: &[u64], widest: u32) {
        let height = rows.len();
        self.eroded.clear();
        self.eroded.resize(height * (widest as usize + 1), 0);
        self.eroded[..height].copy_from_slice(rows);
        for w in 1..=widest as usize {
            let (done, next) = self.eroded.split_at_mut(w * height);
            for (out, &row) in next[..height].iter_mut().zip(&done[(w - 1) * height..]) {
                *out = thin(row);
            }
        }
    }

    /// Whether a disc of squared radius n fits into the object, centred on some pixel of the image.
    fn disc_fits(&mut self, n: u32, height: usize) -> bool {
        let radius = n.isqrt();
        self.half_widths.clear();
        let mut w = radius;
        for dy in 0..=radius {
            while w * w + dy * dy > n {
                w -= 1;
            }
            self.half_widths.push(w);
        }
        let radius = radius as usize;
        let eroded = |dy: usize| &self.eroded[self.half_widths[dy] as usize * height..][..height];
        // The disc must lie entirely inside the image.
        (radius..height.saturating_sub(radius)).any(|y| {
            let mut fits = eroded(0)[y];
            // Test the largest dy first: after the widest row these reject most positions.
            for dy in (1..=radius).rev() {
                if fits == 0 {
                    break;
                }
                let row = eroded(dy);
                fits &= row[y - dy] & row[y + dy];
            }
            fits != 0
        })
    }
}

/// One erosion step of a row: from the rows above and below, and from the horizontally eroded rows above, here, below.
type Step = fn([u64; 2], [u64; 3]) -> u64;
/// 8 neighbours.
const SQUARE: Step = |_, [above, here, below]| above & here & below;
/// 4 neighbours.
const DIAMOND: Step = |[above, below], [_, here, _]| above & here & below;

/// Erodes a row horizontally by one pixel.
#[inline]
fn thin(row: u64) -> u64 {
    row & row << 1 & row >> 1
}

/// Number of erosions until no pixel of the image is object.
#[inline(always)]
fn erosions(plane: &Plane, height: usize, step: Step) -> u32 {
    let (mut from, mut to, mut thinned) = (*plane, [0; MAX_SIDE + 2], [0; MAX_SIDE + 2]);
    let mut count = 0;
    loop {
        count += 1;
        for (t, &row) in thinned[1..=height].iter_mut().zip(&from[1..=height]) {
            *t = thin(row);
        }
        let mut left = 0;
        for y in 1..=height {
            to[y] = step([from[y - 1], from[y + 1]], [thinned[y - 1], thinned[y], thinned[y + 1]]);
            left |= to[y];
        }
        if left == 0 {
            return count;
        }
        std::mem::swap(&mut from, &mut to);
    }
}
