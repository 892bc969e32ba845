//! Opening: erosion, then expansion by as much. Regions smaller than a size vanish, others nearly keep their shape
//! [SD95 sec 2.4].

use super::erode::{erode_by, expand_by};
use super::{BitImage, Edt, Morphology, Outside};

/// Openings of one image by many sizes. Background lies outside the image: an object at the border is measured by its visible fraction.
///
/// With [`Morphology::Euclid`] the opening by size s (pixels) is the union of all discs of radius s/2 inside the
/// object, found by two distance transforms: the core {depth > s/2}, and the pixels no further than s/2 from the core.
/// The first transform does not depend on s and is kept. With the paper's modes the opening is ⌊s/2⌋ erosions and as
/// many expansions [SD95 sec 2.4].
#[derive(Clone, Debug)]
pub struct Opener {
    image: BitImage,
    mode: Morphology,
    depth: Vec<u32>,
    edt: Edt,
}

impl Opener {
    /// Prepares openings of `image`.
    pub fn new(image: BitImage, mode: Morphology) -> Self {
        let mut edt = Edt::new();
        let depth = match mode {
            Morphology::Euclid => edt.squared_distances(&image, Outside::Free).to_vec(),
            Morphology::Paper8 | Morphology::Paper4 => Vec::new(),
        };
        Opener { image, mode, depth, edt }
    }

    /// The opening by `size` pixels. Negative sizes and NaN count as zero, which leaves the image unchanged.
    pub fn open(&mut self, size: f64) -> BitImage {
        let size = size.max(0.0);
        match self.mode {
            Morphology::Euclid => self.open_by_disc(size / 2.0),
            Morphology::Paper8 | Morphology::Paper4 => {
                // More steps than the image has pixels across change nothing.
                let steps = ((size / 2.0) as usize).min(self.image.width() + self.image.height());
                expand_by(&self.core(size), steps, self.mode)
            }
        }
    }

    /// Centres of all discs of `size` pixels inside the object, for [`Morphology::Euclid`]; [`Opener::open`] expands
    /// them back. For the other modes: the image after ⌊size/2⌋ erosions.
    pub fn core(&self, size: f64) -> BitImage {
        let radius = size.max(0.0) / 2.0;
        let (width, height) = (self.image.width(), self.image.height());
        match self.mode {
            Morphology::Euclid => {
                let squared = (radius * radius) as u32;
                BitImage::from_fn(width, height, |x, y| self.depth[y * width + x] > squared)
            }
            Morphology::Paper8 | Morphology::Paper4 => {
                let steps = (radius as usize).min(width + height);
                erode_by(&self.image, steps, self.mode, Outside::Free).0
            }
        }
    }

    /// Size in pixels of the largest object: the opening by any smaller size is not empty.
    pub fn largest(&mut self) -> f32 {
        match self.mode {
            Morphology::Euclid => self.edt.max_inscribed_diameter(&self.image),
            counts => 2.0 * erode_by(&self.image, usize::MAX, counts, Outside::Free).1 as f32,
        }
    }

    fn open_by_disc(&mut self, radius: f64) -> BitImage {
        let (width, height) = (self.image.width(), self.image.height());
        // The cast saturates: a radius larger than every image gives an empty opening.
        let squared = (radius * radius) as u32;
        let outside_core = self.core(2.0 * radius).complement();
        if outside_core.count() == width * height {
            return BitImage::new(width, height);
        }
        let distance = self.edt.squared_distances(&outside_core, Outside::Blocked);
        BitImage::from_fn(width, height, |x, y| distance[y * width + x] <= squared)
    }
}

/// The opening of one image by one size in pixels; see [`Opener`].
#[cfg(test)]
fn opening(image: &BitImage, size: f64, mode: Morphology) -> BitImage {
    Opener::new(image.clone(), mode).open(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The union of all discs in the object, pixel by pixel.
    fn naive(image: &BitImage, size: f64) -> BitImage {
        let r = size / 2.0;
        let reach = r as i64;
        let disc: Vec<(i64, i64)> = (-reach..=reach)
            .flat_map(|y| (-reach..=reach).map(move |x| (x, y)))
            .filter(|&(x, y)| ((x * x + y * y) as f64) <= r * r)
            .collect();
        let at = |x: usize, dx: i64| usize::try_from(x as i64 + dx).unwrap_or(usize::MAX);
        let mut open = BitImage::new(image.width(), image.height());
        for y in 0..image.height() {
            for x in 0..image.width() {
                if disc.iter().all(|&(dx, dy)| image.get(at(x, dx), at(y, dy))) {
                    disc.iter().for_each(|&(dx, dy)| open.set(at(x, dx), at(y, dy), true));
                }
            }
        }
        open
    }

    proptest! {
        #[test]
        fn euclidean_opening_matches_the_definition(
            w in 1usize..70,
            h in 1usize..40,
            rectangles in prop::collection::vec((0usize..64, 0usize..40, 1usize..20, 1usize..20), 0..7),
            size in 0.0..14.0,
        ) {
            let image = BitImage::from_fn(w, h, |x, y| {
                rectangles.iter().any(|&(l, t, a, b)| (l..l + a).contains(&x) && (t..t + b).contains(&y))
            });
            prop_assert_eq!(opening(&image, size, Morphology::Euclid), naive(&image, size));
        }
    }

    #[test]
    fn size_zero_changes_nothing_and_a_huge_one_leaves_nothing() {
        let image = BitImage::from_fn(90, 50, |x, y| x * y % 5 == 1 || (x / 9 + y / 9) % 2 == 0);
        for mode in [Morphology::Euclid, Morphology::Paper8, Morphology::Paper4] {
            assert_eq!(opening(&image, 0.0, mode), image);
            assert_eq!(opening(&image, f64::NAN, mode), image);
            assert!(opening(&image, 1e9, mode).is_empty());
            assert!(opening(&BitImage::new(0, 0), 3.0, mode).is_empty());
        }
    }

    #[test]
    fn a_square_survives_smaller_sizes_only() {
        for a in 1..30usize {
            let image =
                BitImage::from_fn(100, 40, |x, y| (50..50 + a).contains(&x) && (4..4 + a).contains(&y));
            for mode in [Morphology::Euclid, Morphology::Paper8, Morphology::Paper4] {
                let mut opener = Opener::new(image.clone(), mode);
                let largest = f64::from(opener.largest());
                assert_eq!(largest, (a + a % 2) as f64, "{mode:?} {a}");
                assert!(!opener.open(largest - 0.01).is_empty());
                assert!(opener.open(largest).is_empty());
            }
        }
    }

    /// The Euclidean size does not depend on direction; the paper's counts differ by √2.
    #[test]
    fn a_turned_square_keeps_its_size() {
        let half = 20.0f64;
        let image = |turned: bool| {
            BitImage::from_fn(96, 96, |x, y| {
                let (x, y) = (x as f64 - 47.3, y as f64 - 47.6);
                let (u, v) = if turned { ((x + y) / 2f64.sqrt(), (x - y) / 2f64.sqrt()) } else { (x, y) };
                u.abs() < half && v.abs() < half
            })
        };
        let ratio =
            |mode| Opener::new(image(true), mode).largest() / Opener::new(image(false), mode).largest();
        assert!((ratio(Morphology::Euclid) - 1.0).abs() < 0.03);
        assert!((ratio(Morphology::Paper4) - 2f32.sqrt()).abs() < 0.05);
        assert!((ratio(Morphology::Paper8) - 0.5f32.sqrt()).abs() < 0.05);
    }
}
