//! Row sums of the form factors along links: what they are, what they must be, and how they are made so.

use super::Solver;
use super::clock::Clock;
use super::cut::{Closure, Cut};
use super::field::{Incoming, Outgoing, Rgb, gather};
use super::options::Rows;
use crate::radiosity::elements::Shape;

/// A leaf without a way out that sees hardly anything along its links is not mended: nothing is known of it.
const NOTHING: f64 = 0.1;
/// Row sums of other leaves above this are wrong.
const TOO_MUCH: f64 = 1.25;
/// Leaves without a way out whose row sum is below this are looked at: part of them may lie under something.
const SHORT: f64 = 0.8;
/// Most rounds of balancing, and the root mean square error of the row sums (by area) at which it ends.
const ROUNDS: usize = 20;
const BALANCED: f64 = 3e-5;
/// Rounds before the clock is looked at.
const LEAST_ROUNDS: usize = 1;
/// Part of the light that a row sum above 1 gives back of what it gets, beyond which it is cut down.
const GROWS: f64 = 0.98;
/// Least and largest factor of a leaf.
const LEAST: f32 = 1e-4;
const MOST: f32 = 2.0;

impl Solver {
    /// The sum of each surface element's form factors along its links, before it is multiplied by its own closure: the
    /// irradiance that radiosity 1 everywhere would cause.
    pub(super) fn row_sums(&self, cut: &Cut) -> Vec<f64> {
        let of = |&e: &u32| [f64::from(self.closure[e as usize].sends); 3];
        let surfaces: Vec<Rgb> = cut.elements[cut.clusters..].iter().map(of).collect();
        let ones = Outgoing::pull(&self.elements, cut, &surfaces, |_, r| cut.responses[r].ones);
        let Incoming { clusters, surfaces } = gather(&self.elements, cut, &ones);
        cut.expand(&self.elements, &clusters, &surfaces).into_iter().map(|e| e[0]).collect()
    }

    /// Makes the row sums of leaves that see no way out 1: rows of closed scenes sum up to 1 (method E.7), and what
    /// sampling errors add or take away would be multiplied by every bounce. (Rows of open scenes could be brought to what
    /// rays say; tried, it scales what is right for what is dim and not refined, and adds the noise of the rays.)
    ///
    /// Returns the row sums there were, and the number of leaves that would have made light grow without end (see
    /// [`Solver::bound`]). When it is late less is balanced.
    pub(super) fn close(&mut self, clock: &Clock) -> (Vec<f64>, usize) {
        self.closure.fill(Closure::NONE);
        let mut cut = self.cut();
        let sampled = self.row_sums(&cut);
        self.doubt(&sampled);
        let mut sums = sampled.clone();
        for round in 0..if self.rows == Rows::Balanced { ROUNDS } else { 1 } {
            let (mut off, mut all) = (0.0, 0.0);
            for (e, &sum) in sums.iter().enumerate() {
                let before = self.closure[e].gathers;
                let missing = self.missing(e, f64::from(before) * sum);
                self.closure[e] = match self.rows {
                    Rows::Sampled => Closure::NONE,
                    Rows::Closed => Closure { gathers: missing as f32, sends: 1.0 },
                    Rows::Balanced => {
                        let factor = (before * missing.sqrt() as f32).clamp(LEAST, MOST);
                        Closure { gathers: factor, sends: factor }
                    }
                };
                let element = &self.elements.elements[e];
                if element.is_leaf() && self.closure[e].gathers < MOST && missing != 1.0 {
                    off += element.area * (1.0 / missing - 1.0).powi(2);
                    all += element.area;
                }
            }
            if off <= BALANCED * BALANCED * all || (round >= LEAST_ROUNDS && clock.late()) {
                break;
            }
            cut.reclose(&self.elements, &self.closure);
            sums = self.row_sums(&cut);
        }
        // What balancing has left is made up where it is gathered.
        for (e, &sum) in sums.iter().enumerate().filter(|_| self.rows == Rows::Balanced) {
            let row = f64::from(self.closure[e].gathers) * sum;
            self.closure[e].gathers *= self.missing(e, row) as f32;
        }
        (sampled, self.bound(&sums))
    }

    /// Lets leaves whose row sum is above 1 gather as if it were 1: rows of a few coarse links may sum up to several times 1,
    /// and the light that they make all others would be refined for.
    pub(super) fn tame(&mut self, cut: &mut Cut) {
        self.closure.fill(Closure::NONE);
        let at_most_one = |sum: f64| Closure { gathers: (1.0 / sum).min(1.0) as f32, ..Closure::NONE };
        self.closure = self.row_sums(cut).into_iter().map(at_most_one).collect();
        cut.reclose(&self.elements, &self.closure);
    }

    /// Leaves whose row sum (before closure) is above 1, which no form factors have, and so far that light which is reflected
    /// again and again would hardly lose or even gain, gather as if it were 1. Returns their number.
    fn bound(&mut self, sums: &[f64]) -> usize {
        let mut bounded = 0;
        for (e, &sum) in sums.iter().enumerate() {
            let Shape::Surface { side, .. } = self.elements.elements[e].shape else { continue };
            let reflectance = self.elements.sides[side as usize].reflectance.into_iter().fold(0.0, f32::max);
            let row = f64::from(self.closure[e].gathers) * sum;
            if row > 1.0 && row * f64::from(reflectance) > GROWS {
                self.closure[e].gathers = (1.0 / sum) as f32;
                bounded += usize::from(self.elements.elements[e].is_leaf());
            }
        }
        bounded
    }

    /// Looks what the rows of leaves without a way out must be where links say that they are short: what touches the
    /// leaf covers part of it, or links have missed something.
    fn doubt(&mut self, sums: &[f64]) {
        let is_short = |&e: &u32| match self.elements.elements[e as usize].shape {
            Shape::Surface { side, .. } => {
                let leaf = self.elements.elements[e as usize].is_leaf();
                leaf && self.probe.closed[side as usize] && sums[e as usize] < SHORT
            }
            Shape::Cluster(_) => false,
        };
        let short: Vec<u32> = (0..sums.len() as u32).filter(is_short).collect();
        self.whole = vec![1.0; sums.len()];
        for (e, part) in short.iter().zip(self.received(&short)) {
            self.whole[*e as usize] = part as f32;
        }
    }

    /// What a leaf must gather more, by its row sum.
    fn missing(&self, e: usize, sum: f64) -> f64 {
        let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return 1.0 };
        let closed = self.probe.closed[side as usize] && sum > NOTHING;
        if closed || sum > TOO_MUCH { f64::from(self.whole[e]) / sum } else { 1.0 }
    }
}
