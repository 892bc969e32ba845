//! Binary images with one bit per pixel.

/// A binary image: one bit per pixel, rows of 64-bit words; column x is bit `x % 64` of word `x / 64`.
///
/// A set bit is *object*. Bits of a row's last word beyond the width are always zero.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BitImage {
    width: usize,
    height: usize,
    stride: usize,
    words: Vec<u64>,
}

impl BitImage {
    /// An image of background only, `width` x `height` pixels. Both may be zero.
    pub fn new(width: usize, height: usize) -> Self {
        let stride = width.div_ceil(64);
        BitImage { width, height, stride, words: vec![0; stride * height] }
    }

    /// The image whose pixel (x, y) is object where `object(x, y)` holds.
    pub fn from_fn(width: usize, height: usize, mut object: impl FnMut(usize, usize) -> bool) -> Self {
        let mut image = BitImage::new(width, height);
        for y in 0..height {
            for x in 0..width {
                if object(x, y) {
                    image.words[y * image.stride + x / 64] |= 1 << (x % 64);
                }
            }
        }
        image
    }

    /// Resizes to `width` x `height` pixels of background, keeping the allocated memory.
    pub fn reset(&mut self, width: usize, height: usize) {
        let stride = width.div_ceil(64);
        (self.width, self.height, self.stride) = (width, height, stride);
        self.words.clear();
        self.words.resize(stride * height, 0);
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Words of row y, `width / 64` rounded up. Panics when y is not a row of the image.
    #[inline]
    pub fn row(&self, y: usize) -> &[u64] {
        &self.words[y * self.stride..(y + 1) * self.stride]
    }

    /// Whether pixel (x, y) is object; pixels outside the image are not.
    #[inline]
    pub fn get(&self, x: usize, y: usize) -> bool {
        x < self.width && y < self.height && self.words[y * self.stride + x / 64] >> (x % 64) & 1 == 1
    }

    /// Makes pixel (x, y) object or background; does nothing outside the image.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, object: bool) {
        if x < self.width && y < self.height {
            let word = &mut self.words[y * self.stride + x / 64];
            let bit = 1 << (x % 64);
            *word = if object { *word | bit } else { *word & !bit };
        }
    }

    /// Sets the pixels `from..to` of row y to object, whole words at a time; the part outside the image is ignored.
    #[inline]
    pub fn set_span(&mut self, y: usize, from: usize, to: usize) {
        let to = to.min(self.width);
        if y >= self.height || from >= to {
            return;
        }
        let row = &mut self.words[y * self.stride..(y + 1) * self.stride];
        let (first, last) = (from / 64, (to - 1) / 64);
        let (head, tail) = (!0 << (from % 64), !0 >> (63 - (to - 1) % 64));
        if first == last {
            row[first] |= head & tail;
        } else {
            row[first] |= head;
            row[first + 1..last].fill(!0);
            row[last] |= tail;
        }
    }

    /// Number of object pixels.
    pub fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Whether no pixel is object.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&w| w == 0)
    }

    /// Exchanges object and background.
    pub fn invert(&mut self) {
        let last = self.last_word_mask();
        for row in self.words.chunks_exact_mut(self.stride.max(1)) {
            row.iter_mut().for_each(|w| *w = !*w);
            *row.last_mut().expect("a stride is at least one word") &= last;
        }
    }

    /// The image with object and background exchanged.
    pub fn complement(&self) -> BitImage {
        let mut image = self.clone();
        image.invert();
        image
    }

    /// Adds the object pixels of `other`. Pixels outside the common area are unchanged.
    pub fn unite(&mut self, other: &BitImage) {
        self.join(other, |own, other| own | other);
    }

    /// Removes the object pixels of `other`. Pixels outside the common area are unchanged.
    pub fn subtract(&mut self, other: &BitImage) {
        self.join(other, |own, other| own & !other);
    }

    /// Replaces words in the common area by what `join` makes of both.
    fn join(&mut self, other: &BitImage, join: impl Fn(u64, u64) -> u64) {
        let last = self.last_word_mask();
        for y in 0..self.height.min(other.height) {
            let row = &mut self.words[y * self.stride..(y + 1) * self.stride];
            row.iter_mut().zip(other.row(y)).for_each(|(word, other)| *word = join(*word, *other));
            if let Some(word) = row.last_mut() {
                *word &= last;
            }
        }
    }

    /// Mask of the used bits of a row's last word.
    pub(super) fn last_word_mask(&self) -> u64 {
        match self.width % 64 {
            0 => !0,
            used => (1 << used) - 1,
        }
    }

    /// All words, row by row, for the operators of this room.
    pub(super) fn words(&self) -> &[u64] {
        &self.words
    }

    /// All words, row by row. The caller must keep the bits beyond the width zero.
    pub(super) fn words_mut(&mut self) -> &mut [u64] {
        &mut self.words
    }

    /// Number of words per row.
    pub(super) fn stride(&self) -> usize {
        self.stride
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_and_pixels_agree() {
        for (from, to) in [(0, 0), (0, 1), (3, 64), (63, 65), (10, 200), (64, 128), (5, 130)] {
            let mut image = BitImage::new(130, 2);
            image.set_span(1, from, to);
            assert_eq!(
                image,
                BitImage::from_fn(130, 2, |x, y| y == 1 && x >= from && x < to),
                "{from}..{to}"
            );
        }
    }

    #[test]
    fn complement_keeps_the_padding_clear() {
        for width in [0, 1, 63, 64, 65, 130] {
            let image = BitImage::from_fn(width, 3, |x, y| (x + y) % 3 == 0);
            assert_eq!(image.complement().count() + image.count(), width * 3);
            assert_eq!(image.complement().complement(), image);
        }
    }

    #[test]
    fn outside_is_never_touched() {
        let mut image = BitImage::new(10, 10);
        image.set(10, 0, true);
        image.set(0, 10, true);
        image.set_span(10, 0, 5);
        assert!(image.is_empty() && !image.get(10, 0));
    }
}
