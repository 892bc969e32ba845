//! Unbiased visibility: averaged answers corrected by a few exact segments; multilevel Monte Carlo over the feature
//! size with coupled segments (docs/method.md, Unbiased combination).
//!
//! ```text
//! x = 1/N Σ T_i + 1/(q m) Σ' (V_i - T_i)
//! ```
//!
//! The first sum is over all N segments of a bundle with their averaged transmittances T, the second over m of them
//! (whole packets picked at random) with their exact visibilities V; the second sum is evaluated with probability q,
//! else it is 0. For given segments the mean of x equals that of V for any m and any q > 0, so both may depend on the
//! averaged answer. Where nothing was averaged, T equals V and no second sum is needed.
//!
//! x is an estimate; it may be below 0 or above 1.

use super::answer::{Answer, Bundle};
use super::bundle_walks::Workspace;
use super::exact::Exact;
use super::multires::MultiResolution;
use crate::ray::{Occluder, Packet};

/// Number of packets that correct an answer, by class of its transmittance.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Packets by class, see [`Correction::class`]; positive. Values below 1 are the probability of one packet.
    pub packets: [f32; Correction::CLASSES],
}

impl Correction {
    /// Number of classes.
    pub const CLASSES: usize = 12;

    /// Class of a transmittance T in `[0, 1]`: 0 for T = 0, 1 for T = 1, else equal steps of 4 T (1 - T).
    pub fn class(transmittance: f32) -> usize {
        let spread = 4.0 * transmittance * (1.0 - transmittance);
        match transmittance {
            t if t <= 0.0 => 0,
            t if t >= 1.0 => 1,
            _ => 2 + ((spread * (Self::CLASSES - 2) as f32) as usize).min(Self::CLASSES - 3),
        }
    }

    /// Number of packets of `all` (a power of two that divides it), and the probability with which they are traced.
    fn choose(&self, transmittance: f32, all: usize) -> (usize, f32) {
        let wanted = self.packets[Self::class(transmittance)];
        if wanted < 1.0 {
            return (1, wanted);
        }
        let power = wanted.log2().round().exp2() as usize;
        (power.min(1 << all.trailing_zeros()), 1.0)
    }
}

/// Estimator of one averaged level and the exact level.
#[derive(Clone)]
pub struct Unbiased<'a> {
    /// The averaged level; segments that it hands to Embree are exact.
    pub engine: &'a MultiResolution,
    /// The exact level.
    pub exact: Exact,
    /// Feature size of the averaged level, scene units.
    pub feature_size: f32,
    /// Factor of emitter sizes in the averaged level, in `[0, 1]`; smaller values open more clusters.
    pub emitter_part: f32,
    /// Number of corrections by class.
    pub correction: &'a Correction,
}

/// An unbiased estimate.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    /// Estimate of the visible fraction; any real number.
    pub visible: f32,
    /// Number of segments of the second sum.
    pub corrections: u32,
}

/// Answer of the averaged level for a bundle, and its query of the exact level.
struct Level {
    visible: f32,
    /// Whether anything was averaged.
    averaged: bool,
    /// Number of packets traced exactly, weight of their differences, and sum of their averaged transmittances.
    asked: usize,
    weight: f32,
    sum: f32,
}

impl Unbiased<'_> {
    /// Estimates for several bundles, passed to `each` in order. `chance(k)` gives 64 random bits for bundle k,
    /// independent of its segments.
    pub fn estimates(
        &self,
        bundles: &[Bundle],
        chance: impl Fn(usize) -> u64,
        workspace: &mut Workspace,
        mut each: impl FnMut(Estimate),
    ) {
        let smaller = |b: &Bundle<'_>| b.emitter_size * self.emitter_part;
        let opened: Vec<Bundle> = bundles.iter().map(|b| Bundle { emitter_size: smaller(b), ..*b }).collect();
        let mut levels = Vec::with_capacity(bundles.len());
        self.engine.walked_answers(&opened, self.feature_size, workspace, |a| levels.push(Level::of(a)));
        let (mut packets, mut sums) = (Vec::new(), workspace.sums());
        for (k, (bundle, level)) in bundles.iter().zip(&mut levels).enumerate() {
            let (own, others) = sums.split_at(bundle.packets.len());
            if level.averaged {
                level.pick(bundle.packets, own, self.correction, chance(k), &mut packets);
            }
            sums = others;
        }
        let mut blocked = vec![0; packets.len()];
        self.exact.occluded(&packets, &mut blocked);
        let mut rest = packets.iter().zip(&blocked);
        for level in &levels {
            let (mut clear, mut corrections) = (0, 0);
            for (packet, blocked) in rest.by_ref().take(level.asked) {
                clear += (packet.active & !blocked).count_ones();
                corrections += packet.len() as u32;
            }
            let difference = level.weight * (clear as f32 - level.sum);
            each(Estimate { visible: level.visible + difference, corrections });
        }
    }
}

impl Level {
    fn of(answer: Answer) -> Level {
        let averaged = answer.cost.aggregated > 0;
        Level { visible: answer.transmittance, averaged, asked: 0, weight: 0.0, sum: 0.0 }
    }

    /// Decides whether and which packets are traced exactly.
    fn pick(
        &mut self,
        all: &[Packet],
        sums: &[f32],
        correction: &Correction,
        chance: u64,
        packets: &mut Vec<Packet>,
    ) {
        let (m, q) = correction.choose(self.visible, all.len());
        if (chance >> 40) as f32 >= q * (1u64 << 24) as f32 {
            return;
        }
        // Pick one of the groups of m consecutive packets: all are equally likely, and each is stratified.
        let parts = all.len() / m;
        let first = (chance & 0xffff_ffff) as usize % parts * m;
        packets.extend_from_slice(&all[first..first + m]);
        let segments: usize = all.iter().map(Packet::len).sum();
        self.asked = m;
        self.weight = parts as f32 / (q * segments as f32);
        self.sum = sums[first..first + m].iter().sum();
    }
}

#[cfg(test)]
mod tests;
