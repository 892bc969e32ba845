//! Numbers of exact corrections per class of answers that minimise time at equal error.

use crate::ray::LANES;
use crate::visibility::Correction;

/// Smallest probability of a correction. A correction is divided by it, so that no single one counts more than 32
/// times; rarer ones would mostly not occur in a run, and their error would not be observed.
const MIN_PROBABILITY: f32 = 1.0 / 32.0;
/// Fewest pairs of a class whose own statistics are used: the relative error of a variance of 16 samples is √(2/15) =
/// 36 %.
const MIN_CLASS_PAIRS: f64 = 16.0;
/// Number of classes of answers.
pub(super) const CLASSES: usize = Correction::CLASSES;

/// Differences of exact and averaged packets, summed over the pairs of one class.
#[derive(Clone, Debug, Default)]
pub(super) struct Class {
    count: f64,
    /// Sums over pairs: variance of the mean of 1, 2, 4, ... random packets about the mean of all packets of the
    /// pair.
    left: Vec<f64>,
    /// Sum over pairs of the squared mean difference.
    square: f64,
}

impl Class {
    pub(super) fn add(&mut self, clear: &[f32], sums: &[f32]) {
        let differences: Vec<f64> =
            clear.iter().zip(sums).map(|(c, t)| f64::from(c - t) / LANES as f64).collect();
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        self.count += 1.0;
        self.square += mean * mean;
        for (j, left) in sizes(clear.len()).enumerate() {
            let parts = differences.chunks(left);
            let n = parts.len() as f64;
            let error = |part: &[f64]| (part.iter().sum::<f64>() / part.len() as f64 - mean).powi(2);
            self.left.resize(self.left.len().max(j + 1), 0.0);
            self.left[j] += parts.map(error).sum::<f64>() / n;
        }
    }

    fn join(mut self, other: &Class) -> Class {
        self.left.resize(self.left.len().max(other.left.len()), 0.0);
        self.left.iter_mut().zip(&other.left).for_each(|(a, b)| *a += b);
        Class { count: self.count + other.count, square: self.square + other.square, ..self }
    }

    /// Candidate numbers of correcting packets (a number below 1 is a probability) and the summed variance that each
    /// leaves.
    fn choices(&self) -> impl Iterator<Item = (f32, f64)> {
        let one = self.left.first().copied().unwrap_or(0.0);
        let rare = (1..=MIN_PROBABILITY.log2().abs() as i32).rev().map(move |k| {
            let q = 0.5f64.powi(k);
            (q as f32, (one + self.square) / q - self.square)
        });
        rare.chain(self.left.iter().enumerate().map(|(j, &left)| ((1usize << j) as f32, left)))
    }
}

/// Powers of two that divide `packets`.
fn sizes(packets: usize) -> impl Iterator<Item = usize> {
    (0..=packets.trailing_zeros()).map(|j| 1 << j)
}

/// Numbers of packets per class that minimise `work(variance, packets)`, both means over all `pairs`: each class
/// minimises variance + price · packets (Lagrange multiplier), and the price is searched.
pub(super) fn allocate(classes: &[Class], pairs: usize, work: impl Fn(f64, f64) -> f64) -> (Correction, f64) {
    let n = pairs.max(1) as f64;
    let whole = classes.iter().fold(Class::default(), Class::join);
    let choice = |price: f64| {
        let (mut packets, mut variance, mut asked) = ([1.0; CLASSES], 0.0, 0.0);
        for (class, packets) in classes.iter().zip(&mut packets) {
            // Classes with few pairs in the pilot use the statistics of all classes.
            let believed = if class.count < MIN_CLASS_PAIRS { &whole } else { class };
            let price = price * believed.count;
            let best = believed
                .choices()
                .min_by(|a, b| (a.1 + price * f64::from(a.0)).total_cmp(&(b.1 + price * f64::from(b.0))));
            let Some((m, left)) = best else { continue };
            *packets = m;
            let part = class.count / believed.count.max(1.0);
            (variance, asked) = (variance + left * part, asked + class.count * f64::from(m));
        }
        (Correction { packets }, work(variance / n, asked / n))
    };
    let prices = (-60..=4).map(|k| f64::from(k as f32 * 0.5).exp2());
    prices.map(choice).min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are prices")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A class of `count` pairs with independent differences of this variance per packet, out of `all` packets.
    fn class(count: f64, variance: f64, all: usize) -> Class {
        let left = sizes(all).map(|m| count * variance * (1.0 / m as f64 - 1.0 / all as f64)).collect();
        Class { count, left, square: 0.0 }
    }

    #[test]
    fn corrections_go_where_the_answers_vary() {
        let mut classes = vec![Class::default(); CLASSES];
        (classes[2], classes[11]) = (class(100.0, 0.0001, 64), class(100.0, 0.01, 64));
        let work = |variance: f64, packets: f64| (1e-5 + variance) * (1.0 + packets);
        let (correction, least) = allocate(&classes, 200, work);
        let [rare, often] = [2, 11].map(|c| f64::from(correction.packets[c]));
        assert!((4.0..=32.0).contains(&(often / rare)), "about in proportion: {rare} {often}");
        // No uniform number of packets is better.
        for ((m, a), (_, b)) in classes[2].choices().zip(classes[11].choices()) {
            assert!(work((a + b) / 200.0, m.into()) > 0.999 * least, "{m}");
        }
    }

    #[test]
    fn costly_corrections_are_rare_and_never_left_out() {
        let mut classes = vec![Class::default(); CLASSES];
        (classes[0], classes[11]) = (class(1000.0, 1e-9, 16), class(50.0, 0.02, 16));
        let (correction, _) = allocate(&classes, 1050, |v, p| (0.01 + v) * (1.0 + 100.0 * p));
        assert!(correction.packets.iter().all(|&m| m >= MIN_PROBABILITY));
        assert_eq!(correction.packets[0], MIN_PROBABILITY);
    }

    #[test]
    fn all_packets_leave_nothing() {
        let mut one = Class::default();
        one.add(&[16.0, 0.0, 8.0, 8.0], &[8.0; 4]);
        assert_eq!((one.left.len(), one.left[2], one.square), (3, 0.0, 0.0));
        // Differences of neighbours that cancel leave no variance.
        assert!(one.left[0] > 0.1 && one.left[1] == 0.0);
        let left: Vec<f64> = one.choices().map(|c| c.1).collect();
        assert!(left.windows(2).all(|w| w[0] > w[1] || w[1] == 0.0), "{left:?}");
    }
}
