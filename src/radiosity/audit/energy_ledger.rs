//! The energy ledger: emitted, absorbed, escaped and created power of a solution.

use super::solved::{FinalLight, Solved};
use crate::radiosity::elements::{RowFactors, Shape};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::SkyPower;
use crate::scene::Photometry;
use crate::scene::unit_in_metres;

/// Powers, summed over all surfaces; means of the channels. If only direct light at points was computed, all but the emitted power are NaN
/// (`null` in JSON).
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Ledger {
    /// Unit of powers: W, or W/m² times scene units squared where the length of a scene unit is not known.
    pub unit: String,
    /// Emitted by surfaces, and received from sky and suns.
    pub emitted: f64,
    /// Received from the sky and the ground around the scene; included in what is emitted.
    pub sky: f64,
    /// Received from the suns; included in what is emitted.
    pub sun: f64,
    /// Absorbed.
    pub absorbed: f64,
    /// Left the scene, or met sides that no light reaches, as the back of a lamp in a ceiling: power that elements send to no element.
    pub escaped: f64,
    /// Received minus sent.
    pub created: f64,
    /// Mean difference of the factors by which a leaf gathers and sends, relative to them, by area. A link has one exchange area for both
    /// directions, so that `A_a F(a→b)` and `A_b F(b→a)` differ only by these factors. 0 after a local pass: a ray counts equally in both
    /// directions.
    pub reciprocity_residual: f64,
    /// Smallest and largest sum of the form factors of an element from which no light leaves the scene, with the fraction that meets
    /// unlit insides.
    pub row_sums: Option<[f64; 2]>,
    /// Root mean square difference of the row sums from 1, by area, before normalisation.
    pub row_sum_error_sampled: f64,
    /// The same after normalisation.
    pub row_sum_error: f64,
    /// Fraction of the scene's area from whose elements no light leaves the scene.
    pub closed_area: f64,
    /// The powers of each channel, in [`Ledger::unit`].
    #[serde(skip)]
    pub(crate) channels: Powers<Rgb>,
}

/// The powers of a ledger.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Powers<T> {
    /// Emitted.
    pub emitted: T,
    /// Absorbed.
    pub absorbed: T,
    /// Left the scene.
    pub escaped: T,
    /// Received minus sent.
    pub created: T,
}

impl Powers<Rgb> {
    /// One number for each power.
    pub fn map<T>(&self, f: impl Fn(Rgb) -> T) -> Powers<T> {
        Powers {
            emitted: f(self.emitted),
            absorbed: f(self.absorbed),
            escaped: f(self.escaped),
            created: f(self.created),
        }
    }
}

impl Solved {
    /// The ledger of a scene with this unit of length.
    pub fn ledger(&self, unit: &str) -> Ledger {
        let linked = &self.linked;
        let (elements, area) = (&linked.elements, linked.elements.area);
        let mut ledger = Ledger::default();
        let mut powers = Powers::<Rgb>::default();
        let (mut received, mut sent, mut closed) = ([0.0; 3], [0.0; 3], 0.0);
        let by_rays = matches!(self.closing, FinalLight::Rays(_));
        for (e, (element, state)) in elements.elements.iter().zip(elements.states.iter()).enumerate() {
            let Shape::Surface { side, .. } = element.shape else { continue };
            if !element.is_leaf() {
                continue;
            }
            let s = &elements.sides[side as usize];
            let absorbed: Rgb =
                std::array::from_fn(|k| (1.0 - f64::from(s.reflectance[k])) * state.irradiance[k]);
            let RowFactors { gathers, sends } = state.factors;
            ledger.reciprocity_residual += element.area * f64::from(gathers / sends - 1.0).abs();
            let RowSums { sampled, used, sent: sent_part } = self.row_sums(e);
            add(&mut powers.emitted, element.area, s.exitance);
            add(&mut powers.absorbed, element.area, absorbed);
            add(&mut received, element.area, state.irradiance);
            // Rays from the emitters measure their light better than the rows of a few small elements.
            let emitted = if by_rays { s.exitance } else { [0.0; 3] };
            let of_rows: Rgb = std::array::from_fn(|k| state.radiosity[k] - emitted[k]);
            // The noise of rays brings some row sums above 1: a limit would count the noise of the others as power that escapes.
            let sent_part = if by_rays { sent_part } else { sent_part.min(1.0) };
            add(&mut sent, element.area * sent_part, of_rows);
            add(&mut powers.escaped, element.area * (1.0 - sent_part), of_rows);
            if linked.surroundings.closed[side as usize] {
                closed += element.area;
                let covered = 1.0 - f64::from(state.row_target);
                let [sampled, row] = [sampled + covered, used + covered];
                let [low, high] = ledger.row_sums.unwrap_or([row, row]);
                ledger.row_sums = Some([low.min(row), high.max(row)]);
                ledger.row_sum_error += element.area * (row - 1.0).powi(2);
                ledger.row_sum_error_sampled += element.area * (sampled - 1.0).powi(2);
            }
        }
        let arrived = match &self.closing {
            FinalLight::Links(links) => links.arrived,
            FinalLight::Rays(local) => local.arrived,
            FinalLight::Nothing => SkyPower::default(),
        };
        (ledger.sky, ledger.sun) = (mean(arrived.sky), mean(arrived.sun));
        if let FinalLight::Rays(local) = &self.closing {
            for (k, share) in local.received.into_iter().enumerate() {
                sent[k] += share * powers.emitted[k];
                powers.escaped[k] += (1.0 - share) * powers.emitted[k];
            }
        }
        // Noise may bring it below 0 where hardly any power escapes.
        powers.escaped = powers.escaped.map(|power| power.max(0.0));
        for of in [arrived.sky, arrived.sun] {
            add(&mut sent, 1.0, of);
            add(&mut powers.emitted, 1.0, of);
        }
        for error in [&mut ledger.row_sum_error, &mut ledger.row_sum_error_sampled] {
            *error = if closed > 0.0 { (*error / closed).sqrt() } else { 0.0 };
        }
        ledger.reciprocity_residual /= area.max(f64::MIN_POSITIVE);
        if by_rays {
            ledger.reciprocity_residual = 0.0;
        }
        powers.created = std::array::from_fn(|k| received[k] - sent[k]);
        if matches!(self.closing, FinalLight::Nothing) {
            let unknown = [f64::NAN; 3];
            powers =
                Powers { emitted: powers.emitted, absorbed: unknown, escaped: unknown, created: unknown };
        }
        ledger.closed_area = if area > 0.0 { closed / area } else { 0.0 };
        ledger.with_powers(powers, unit)
    }

    /// The row sums of a leaf. After a local pass both are the fraction of its rays that stayed in the scene; the light that meets
    /// sides without elements is not sent to any element.
    pub(super) fn row_sums(&self, e: usize) -> RowSums {
        match &self.closing {
            FinalLight::Links(links) => {
                let used = links.used[e] * f64::from(self.linked.elements.states[e].factors.gathers);
                RowSums { sampled: links.sampled[e], used, sent: used }
            }
            FinalLight::Rays(local) => {
                let result = local.results[e];
                let kept = f64::from(result.kept);
                RowSums { sampled: kept, used: kept, sent: f64::from(result.row_sum) }
            }
            FinalLight::Nothing => RowSums { sampled: 1.0, used: 1.0, sent: 1.0 },
        }
    }
}

/// Row sums of one leaf.
pub(super) struct RowSums {
    /// Before normalisation.
    sampled: f64,
    /// After normalisation.
    used: f64,
    /// Fraction of the leaf's light that reaches other elements.
    pub(super) sent: f64,
}

impl Ledger {
    /// Power relative to that of all emitters up to which it is rounding: of 10⁶ elements, each of which adds one of 10⁻¹⁶ or so.
    pub const ROUNDING: f64 = 1e-10;

    /// The ledger with powers in watts, if the unit of length is known. `powers` are in W/m² times squares of that unit.
    fn with_powers(self, powers: Powers<Rgb>, unit: &str) -> Ledger {
        let (metres, unit) = match unit_in_metres(unit) {
            Some(metres) => (metres, "W".into()),
            None => (1.0, format!("W/m\u{b2} {unit}\u{b2}")),
        };
        let channels = powers.map(|power| power.map(|p| p * metres * metres));
        let Powers { emitted, absorbed, escaped, created } = channels.map(mean);
        let [sky, sun] = [self.sky, self.sun].map(|power| power * metres * metres);
        Ledger { unit, emitted, sky, sun, absorbed, escaped, created, channels, ..self }
    }

    /// The luminous powers and their unit: lm, or lx times scene units squared where the length of a scene unit is not known.
    /// Without `photometry` the means of the channels.
    pub fn shown(&self, photometry: Option<Photometry>) -> (Powers<f64>, String) {
        match photometry {
            None => (self.channels.map(mean), self.unit.clone()),
            Some(photometry) if self.unit == "W" => (self.channels.map(|p| photometry.of(p)), "lm".into()),
            Some(photometry) => {
                (self.channels.map(|p| photometry.of(p)), self.unit.replace("W/m\u{b2}", "lx"))
            }
        }
    }
}
