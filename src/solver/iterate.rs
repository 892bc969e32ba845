//! Sweeps until the light no longer changes.

use super::field::{Outgoing, Rgb, add, irradiance};
use super::{Neighbours, Solver};
use crate::element::Shape;

/// A leaf in a closed scene that gathers more than this many times too much or too little is not mended.
const MENDED: f64 = 3.0;

impl Solver<'_> {
    /// What is emitted, without any link.
    pub(super) fn start(&mut self) {
        let emitted = self.emitted();
        self.outgoing = Outgoing::pull(&self.elements, emitted);
        self.incident = vec![[0.0; 3]; self.elements.len()];
        self.closure = vec![1.0; self.elements.len()];
        self.look();
    }

    fn emitted(&self) -> Vec<Rgb> {
        let of = |e: &crate::element::Element| match e.shape {
            Shape::Cluster(_) => [0.0; 3],
            Shape::Surface { side, .. } => self.elements.sides[side as usize].exitance,
        };
        self.elements.elements.iter().map(of).collect()
    }

    /// The part of each element's view that its links cover: the irradiance that radiosity 1 everywhere would cause.
    pub(super) fn row_sums(&self, neighbours: &Neighbours) -> Vec<f64> {
        let ones = Outgoing::pull(&self.elements, vec![[1.0; 3]; self.elements.len()]);
        irradiance(&self.elements, neighbours, &ones).into_iter().map(|e| e[0]).collect()
    }

    /// Makes the row sums of leaves that see no way out 1, and those of the others at most 1: rows of closed scenes sum up
    /// to 1 (method E.7), and what sampling errors add or take away would be multiplied by every bounce.
    pub(super) fn close(&mut self, neighbours: &Neighbours) {
        let sums = self.row_sums(neighbours);
        for (e, &sum) in sums.iter().enumerate() {
            let Shape::Surface { side, .. } = self.elements.elements[e].shape else { continue };
            let close = self.probe.closed[side as usize] && sum > 1.0 / MENDED;
            self.closure[e] = if close || sum > 1.0 { (1.0 / sum) as f32 } else { 1.0 };
        }
    }

    /// Sweeps until the radiosity changes by less than `tolerance` of itself (area-weighted mean), `most` times at most.
    /// Returns the last change.
    ///
    /// Every sweep gathers from the last one's radiosity (Jacobi), so that threads do not matter; the two last residuals
    /// are combined to make the next start better (Anderson 1965, depth 1, by channel), which takes out the slow even
    /// mode of bright scenes.
    pub(super) fn settle(&mut self, neighbours: &Neighbours, tolerance: f64, most: usize) -> f64 {
        let emitted = self.emitted();
        let n = self.elements.len();
        let mut last: Option<(Vec<Rgb>, Vec<Rgb>)> = None;
        let mut change = 0.0;
        for _ in 0..most {
            let incident = irradiance(&self.elements, neighbours, &self.outgoing);
            let mut next = emitted.clone();
            let (mut moved, mut total) = (0.0, 0.0);
            let mut products = [[0.0; 2]; 3];
            for e in 0..n {
                let element = &self.elements.elements[e];
                let Shape::Surface { side, .. } = element.shape else { continue };
                self.incident[e] = incident[e].map(|v| v * f64::from(self.closure[e]));
                if !element.is_leaf() {
                    continue;
                }
                let reflectance = self.elements.sides[side as usize].reflectance;
                for k in 0..3 {
                    next[e][k] += f64::from(reflectance[k]) * self.incident[e][k];
                    let residual = next[e][k] - self.outgoing.radiosity[e][k];
                    moved += element.area * residual.abs();
                    total += element.area * next[e][k];
                    if let Some((then, made)) = &last {
                        let difference = residual - (made[e][k] - then[e][k]);
                        products[k][0] += element.area * residual * difference;
                        products[k][1] += element.area * difference * difference;
                    }
                }
            }
            change = if total > 0.0 { moved / total } else { 0.0 };
            let mut mixed = next.clone();
            if let Some((_, made)) = &last {
                let share = products.map(|[a, b]| if b > 0.0 { (a / b).clamp(-50.0, 0.9) } else { 0.0 });
                for e in (0..n).filter(|&e| self.elements.elements[e].is_leaf()) {
                    for k in 0..3 {
                        mixed[e][k] = (next[e][k] - share[k] * (next[e][k] - made[e][k])).max(0.0);
                    }
                }
            }
            let done = change < tolerance;
            let used = if done { next.clone() } else { mixed };
            let before = std::mem::replace(&mut self.outgoing, Outgoing::pull(&self.elements, used));
            last = Some((before.radiosity, next));
            if done {
                break;
            }
        }
        self.pull_incident();
        change
    }

    /// Irradiance of surfaces that are split: the mean of their parts.
    fn pull_incident(&mut self) {
        for e in (0..self.elements.len()).rev() {
            let element = &self.elements.elements[e];
            if element.is_leaf() || element.is_cluster() {
                continue;
            }
            let mut sum = [0.0; 3];
            for c in element.child_range() {
                add(&mut sum, self.elements.elements[c].area / element.area, self.incident[c]);
            }
            self.incident[e] = sum;
        }
    }
}
