//! Averaged answers made right in the mean by a few exact segments: multilevel Monte Carlo over the feature size with
//! coupled segments (method E.4).
//!
//! ```text
//! x = 1/N Σ T_i + 1/(q m) Σ' (V_i - T_i)
//! ```
//!
//! The first sum goes over all N segments of a bundle with their averaged transmittance T, the second over m of them,
//! whole packets picked at random, with their exact visibility V; it is left out with probability 1 - q. For given
//! segments the mean of x is that of V whatever m and q are, as long as q is not 0 where V and T differ: they may
//! depend on the answer itself. Where nothing was averaged T is V and no second sum is needed.
//!
//! x is an estimate, not a fraction: it may lie below 0 or above 1.

use super::{Answer, Bundle, Exact, MultiResolution, Workspace};
use crate::ray::{Occluder, Packet};

/// How many packets correct an answer, by how far its transmittance is from 0 and 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Packets by class; see [`Correction::class`]. Below 1: the probability of one. Positive.
    pub packets: [f32; Correction::CLASSES],
}

impl Correction {
    /// Number of classes.
    pub const CLASSES: usize = 12;

    /// The class of an averaged answer: none of its segments, all of them, or equal steps of 4 T (1 - T) in between.
    pub fn class(transmittance: f32) -> usize {
        let spread = 4.0 * transmittance * (1.0 - transmittance);
        match transmittance {
            t if t <= 0.0 => 0,
            t if t >= 1.0 => 1,
            _ => 2 + ((spread * (Self::CLASSES - 2) as f32) as usize).min(Self::CLASSES - 3),
        }
    }

    /// How many packets of `all`, a power of two that divides them, and the probability with which they are asked.
    fn choose(&self, transmittance: f32, all: usize) -> (usize, f32) {
        let wanted = self.packets[Self::class(transmittance)];
        if wanted < 1.0 {
            return (1, wanted);
        }
        let power = wanted.log2().round().exp2() as usize;
        (power.min(1 << all.trailing_zeros()), 1.0)
    }
}

/// One averaged level and the exact one.
#[derive(Clone)]
pub struct Unbiased<'a> {
    /// The averaged level; segments that it hands over are exact.
    pub engine: &'a MultiResolution,
    /// The exact level.
    pub exact: Exact,
    /// Feature size of the averaged level, scene units.
    pub feature_size: f32,
    /// The averaged level takes emitters for this part of their size, in `[0, 1]`, so that it opens more.
    pub emitter_part: f32,
    /// How the exact level is used.
    pub correction: &'a Correction,
}

/// An estimate and what it took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    /// The visible fraction, right in the mean; any number.
    pub visible: f32,
    /// Segments of the second sum.
    pub corrections: u32,
}

/// What the averaged level says of a bundle, and what is asked of the exact one.
struct Level {
    visible: f32,
    /// Whether anything was averaged.
    averaged: bool,
    /// Packets in the exact level's list, the weight of their sum of differences, and their averaged sum.
    asked: usize,
    weight: f32,
    sum: f32,
}

impl Unbiased<'_> {
    /// Estimates for several bundles, in their order. `chance` gives 64 random bits for each of them, independent of
    /// its segments.
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
        self.engine.answers(&opened, self.feature_size, workspace, |a| levels.push(Level::of(a)));
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

    /// Decides whether and where the exact level is asked.
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
        // One of the parts of m packets: each is as likely, and stratified in itself.
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
