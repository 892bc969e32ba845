//! Histogram of link errors [SD95 sec 6.2]: the number of links that exceed each error.

/// Four bins an octave over errors from 2^-40 to 2^24.
const BINS: usize = 256;

/// Counts of links by the logarithm of their error.
pub struct Histogram {
    counts: [usize; BINS],
}

impl Histogram {
    /// The histogram of errors relative to the mean irradiance.
    pub fn new(errors: impl Iterator<Item = f32>) -> Histogram {
        let mut counts = [0; BINS];
        for e in errors {
            counts[bin(e)] += 1;
        }
        Histogram { counts }
    }

    /// The smallest error that at most `count` links exceed, not below `min`.
    pub fn threshold(&self, count: usize, min: f32) -> f32 {
        let mut sum = 0;
        for k in (0..BINS).rev() {
            sum += self.counts[k];
            if sum > count {
                // Counts include the whole bin, so that the threshold is its upper edge, except for the first bin: at least one bin is
                // refined.
                let edge = if sum == self.counts[k] { k } else { k + 1 };
                // Errors on the edge must exceed the threshold.
                return (lower(edge) * (1.0 - 1e-6)).max(min);
            }
        }
        min
    }
}

fn bin(error: f32) -> usize {
    if error.is_nan() || error <= 0.0 {
        0
    } else {
        ((error.log2() + 40.0) * 4.0).clamp(0.0, BINS as f32 - 1.0) as usize
    }
}

fn lower(bin: usize) -> f32 {
    (bin as f32 / 4.0 - 40.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_leave_as_many_as_asked() {
        let errors: Vec<f32> = (1..=1000).map(|i| i as f32 * 1e-3).collect();
        let histogram = Histogram::new(errors.iter().copied());
        for count in [10, 100, 400] {
            let threshold = histogram.threshold(count, 0.0);
            let above = errors.iter().filter(|&&e| e > threshold).count();
            // A bin is a fifth of its error wide.
            assert!(above <= count.max(170) && above > 0, "{count}: {above}");
        }
        assert_eq!(histogram.threshold(2000, 0.01), 0.01);
        assert!(histogram.threshold(1, 0.0) < 1.0, "one bin at least");
    }
}
