//! Erosion and expansion by one pixel, 64 pixels per operation [SD95 sec 2.4].
//!
//! The paper modifies the image in place, so that the result depends on the scan order; here the result goes to a
//! second bit plane.

use super::{BitImage, Morphology, Outside};

/// Erodes `from` into `to` by one step: an object pixel with a background neighbour (4 of them, or 8 for
/// [`Morphology::Paper8`]) becomes background. The images have the same sides.
pub(super) fn erode(from: &BitImage, to: &mut BitImage, mode: Morphology, outside: Outside) {
    let (stride, height) = (from.stride(), from.height());
    let fill = match outside {
        Outside::Free => 0,
        Outside::Blocked => !0u64,
    };
    let last = from.last_word_mask();
    // Bits beyond the width are zero in memory; with Blocked they count as object.
    let read = |y: isize, i: isize| -> u64 {
        if y < 0 || y >= height as isize || i < 0 || i >= stride as isize {
            return fill;
        }
        let word = from.words()[y as usize * stride + i as usize];
        if i as usize + 1 == stride { word | (fill & !last) } else { word }
    };
    // A word eroded horizontally: object only where the pixel and its left and right neighbours are.
    let horizontal = |y: isize, i: isize| -> u64 {
        let word = read(y, i);
        word & (word << 1 | read(y, i - 1) >> 63) & (word >> 1 | read(y, i + 1) << 63)
    };
    for y in 0..height as isize {
        for i in 0..stride as isize {
            let column = match mode {
                Morphology::Paper4 => read(y - 1, i) & read(y + 1, i),
                Morphology::Paper8 | Morphology::Euclid => horizontal(y - 1, i) & horizontal(y + 1, i),
            };
            let mask = if i as usize + 1 == stride { last } else { !0 };
            to.words_mut()[y as usize * stride + i as usize] = horizontal(y, i) & column & mask;
        }
    }
}

/// Erodes `image` by at most `max_steps` steps, until no object pixel is left; with the number of steps.
pub(super) fn erode_by(
    image: &BitImage,
    max_steps: usize,
    mode: Morphology,
    outside: Outside,
) -> (BitImage, usize) {
    let (mut a, mut b) = (image.clone(), BitImage::new(image.width(), image.height()));
    let mut steps = 0;
    while steps < max_steps && !a.is_empty() {
        erode(&a, &mut b, mode, outside);
        std::mem::swap(&mut a, &mut b);
        steps += 1;
    }
    (a, steps)
}

/// Expands `image` by `steps` steps: an erosion of the background. Pixels outside the image count as background.
pub fn expand_by(image: &BitImage, steps: usize, mode: Morphology) -> BitImage {
    let (mut result, _) = erode_by(&image.complement(), steps, mode, Outside::Blocked);
    result.invert();
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Erosion pixel by pixel from the definition.
    fn naive(image: &BitImage, mode: Morphology, outside: Outside) -> BitImage {
        let (w, h) = (image.width() as isize, image.height() as isize);
        let object = |x: isize, y: isize| match (0..w).contains(&x) && (0..h).contains(&y) {
            true => image.get(x as usize, y as usize),
            false => outside == Outside::Blocked,
        };
        BitImage::from_fn(image.width(), image.height(), |x, y| {
            (-1..=1).all(|dx: isize| {
                (-1..=1).all(|dy: isize| {
                    let neighbour = mode == Morphology::Paper8 || dx == 0 || dy == 0;
                    !neighbour || object(x as isize + dx, y as isize + dy)
                })
            })
        })
    }

    proptest! {
        #[test]
        fn one_step_matches_the_definition(w in 1usize..140, h in 1usize..12, seed: u64) {
            let image = BitImage::from_fn(w, h, |x, y| {
                (seed ^ (x * 31 + y * 17) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 61 != 0
            });
            for mode in [Morphology::Paper4, Morphology::Paper8] {
                for outside in [Outside::Free, Outside::Blocked] {
                    let mut out = BitImage::new(w, h);
                    erode(&image, &mut out, mode, outside);
                    prop_assert_eq!(&out, &naive(&image, mode, outside));
                }
            }
        }
    }
}
