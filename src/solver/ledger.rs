//! Where the energy went.

use super::field::{Neighbours, Rgb};
use super::{Solver, mean};
use crate::element::Shape;

/// Powers in W for scenes in metres (W/m² times scene units squared otherwise), means of the channels; sums over all
/// surfaces.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Ledger {
    /// Emitted.
    pub emitted: f64,
    /// Absorbed.
    pub absorbed: f64,
    /// Left the scene, or was not followed any further: what elements send out along no link.
    pub escaped: f64,
    /// Received less sent.
    pub created: f64,
    /// Mean difference of the two factors that a link's coupling is used with, as part of it.
    pub reciprocity_residual: f64,
    /// Least and greatest sum of the form factors of an element that sees no way out of the scene.
    pub row_sums: Option<[f64; 2]>,
    /// The same before they were made 1: what sampling and refinement leave.
    pub row_sums_sampled: Option<[f64; 2]>,
    /// Part of the scene's area whose elements see no way out.
    pub closed_area: f64,
}

impl Solver<'_> {
    /// The ledger of the present solution.
    pub(super) fn ledger(&self, neighbours: &Neighbours) -> Ledger {
        let sums = self.row_sums(neighbours);
        let mut ledger = Ledger::default();
        let (mut received, mut sent, mut closed) = (0.0, 0.0, 0.0);
        let mut closure = vec![0.0; self.elements.len()];
        let widen = |range: &mut Option<[f64; 2]>, v: f64| {
            let [low, high] = range.unwrap_or([v, v]);
            *range = Some([low.min(v), high.max(v)]);
        };
        for (e, element) in self.elements.elements.iter().enumerate() {
            let Shape::Surface { side, .. } = element.shape else { continue };
            if !element.is_leaf() {
                continue;
            }
            let s = &self.elements.sides[side as usize];
            let power = |v: Rgb| element.area * mean(v);
            let absorbed: Rgb =
                std::array::from_fn(|k| (1.0 - f64::from(s.reflectance[k])) * self.incident[e][k]);
            let row = sums[e] * f64::from(self.closure[e]);
            ledger.emitted += power(s.exitance);
            ledger.absorbed += power(absorbed);
            received += power(self.incident[e]);
            sent += power(self.outgoing.radiosity[e]) * row.min(1.0);
            ledger.escaped += power(self.outgoing.radiosity[e]) * (1.0 - row).max(0.0);
            closure[e] = f64::from(self.closure[e]);
            if self.probe.closed[side as usize] {
                closed += element.area;
                widen(&mut ledger.row_sums, row);
                widen(&mut ledger.row_sums_sampled, sums[e]);
            }
        }
        for e in (0..self.elements.len()).rev() {
            let element = &self.elements.elements[e];
            if !element.is_leaf() && element.area > 0.0 {
                let parts = element.child_range();
                closure[e] =
                    parts.map(|c| self.elements.elements[c].area * closure[c]).sum::<f64>() / element.area;
            }
        }
        let (mut off, mut all) = (0.0, 0.0);
        for l in &self.links {
            let (a, b, c) = (closure[l.a as usize], closure[l.b as usize], f64::from(l.coupling));
            off += c * (a - b).abs();
            all += 0.5 * c * (a + b);
        }
        ledger.created = received - sent;
        ledger.reciprocity_residual = if all > 0.0 { off / all } else { 0.0 };
        ledger.closed_area = if self.elements.area > 0.0 { closed / self.elements.area } else { 0.0 };
        ledger
    }
}
