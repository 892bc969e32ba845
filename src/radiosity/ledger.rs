//! Where the energy went.

use super::cut::Closure;
use super::field::Rgb;
use super::{Solver, mean};
use crate::radiosity::elements::Shape;
use crate::scene::unit_in_metres;

/// Powers, means of the channels; sums over all surfaces.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Ledger {
    /// What powers are given in: W, or W/m² times scene units squared where it is not known how long one is.
    pub unit: String,
    /// Emitted.
    pub emitted: f64,
    /// Absorbed.
    pub absorbed: f64,
    /// Left the scene, or was not followed any further: what elements send out along no link.
    pub escaped: f64,
    /// Received less sent.
    pub created: f64,
    /// Mean difference, by area, of the factors with which a leaf gathers and sends, as part of them: a link has one
    /// coupling for both directions, so nothing else sets `A_a F(a→b)` and `A_b F(b→a)` apart.
    /// After a local pass the same, each as part of what the leaf exchanges.
    pub reciprocity_residual: f64,
    /// Least and greatest sum of the form factors of an element that sees no way out of the scene, with the part that meets
    /// dark insides.
    pub row_sums: Option<[f64; 2]>,
    /// Root mean square difference of the row sums from 1 by area, before they were made 1: what sampling and refinement
    /// leave.
    pub row_sum_error_sampled: f64,
    /// The same of the row sums used.
    pub row_sum_error: f64,
    /// Part of the scene's area whose elements see no way out.
    pub closed_area: f64,
}

impl Solver {
    /// The ledger of the present solution in a scene with this unit of length. `row_sums` along the links: before they were made 1, and after; none after a
    /// local pass, whose rows are shares of rays.
    pub(super) fn ledger(&self, unit: &str, row_sums: Option<[&[f64]; 2]>) -> Ledger {
        let row_of = |e: usize| match (row_sums, &self.local) {
            (Some([before, after]), _) => [before[e], after[e] * f64::from(self.closure[e].gathers)],
            (None, Some(local)) => [f64::from(local.kept[e]); 2],
            (None, None) => [0.0; 2],
        };
        // What meets the dark side of a face is not sent to anybody either.
        let sent_of = |e: usize, row: f64| self.local.as_ref().map_or(row, |local| f64::from(local.row[e]));
        let mut ledger = Ledger::default();
        let (mut received, mut sent, mut closed) = (0.0, 0.0, 0.0);
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
            let Closure { gathers, sends } = self.closure[e];
            ledger.reciprocity_residual += element.area * f64::from(gathers / sends - 1.0).abs();
            let [sampled, row] = row_of(e);
            ledger.emitted += power(s.exitance);
            ledger.absorbed += power(absorbed);
            received += power(self.incident[e]);
            sent += power(self.radiosity[e]) * sent_of(e, row).min(1.0);
            ledger.escaped += power(self.radiosity[e]) * (1.0 - sent_of(e, row)).max(0.0);
            if self.probe.closed[side as usize] {
                closed += element.area;
                let covered = 1.0 - self.whole.get(e).map_or(1.0, |&whole| f64::from(whole));
                let [sampled, row] = [sampled + covered, row + covered];
                widen(&mut ledger.row_sums, row);
                ledger.row_sum_error += element.area * (row - 1.0).powi(2);
                ledger.row_sum_error_sampled += element.area * (sampled - 1.0).powi(2);
            }
        }
        for error in [&mut ledger.row_sum_error, &mut ledger.row_sum_error_sampled] {
            *error = if closed > 0.0 { (*error / closed).sqrt() } else { 0.0 };
        }
        ledger.reciprocity_residual /= self.elements.area.max(f64::MIN_POSITIVE);
        if let Some(local) = &self.local {
            ledger.reciprocity_residual = local.reciprocity;
        }
        ledger.created = received - sent;
        let (metres, unit) = match unit_in_metres(unit) {
            Some(metres) => (metres, "W".into()),
            None => (1.0, format!("W/m\u{b2} {unit}\u{b2}")),
        };
        let Ledger { emitted, absorbed, escaped, created, .. } = &mut ledger;
        for power in [emitted, absorbed, escaped, created] {
            *power *= metres * metres;
        }
        ledger.unit = unit;
        ledger.closed_area = if self.elements.area > 0.0 { closed / self.elements.area } else { 0.0 };
        ledger
    }
}
