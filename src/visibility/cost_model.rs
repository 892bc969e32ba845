//! The cost model that decides between this engine and exact rays.
//!
//! Costs are counted in units of work, about one test of a box or triangle against a packet, and not in seconds, so that
//! results do not vary between runs. The model has three parts:
//! * *calibration*: the work of exact rays per packet, from the work of testing everything in the shafts of sample bundles;
//! * *limit*: a walk that exceeds a multiple of that work is abandoned, and Embree traces the bundle;
//! * *choice*: before many bundles are answered, the walks of some runs of them ([`sample_runs`]) are compared with exact rays:
//!   with a margin where only time counts (bench, batches; [`Work::is_clearly_less`]), without one in the solver
//!   ([`Work::is_less`]), which also saves the links of shadows that it need not resolve.

use super::answer::Bundle;
use super::walk::WalkResult;
use crate::simd::LANES;
use std::ops::Range;

/// Runs of neighbouring bundles that represent all bundles when the engine is chosen: with [`SAMPLE_RUN`], 256 bundles in all limit the
/// time of the choice.
const SAMPLE_RUNS: usize = 16;
/// Bundles of each run: they share their traversal as all bundles do.
const SAMPLE_RUN: usize = 16;
/// Smallest number of bundles for each of the sample beyond its first run: at most an eighth of them are sampled, so that the choice takes
/// little of the time.
const MIN_BUNDLES_PER_SAMPLED: usize = 8;

/// Work of exact rays per packet until [`CostModel::calibrated`] replaces it: [`EMBREE_WORK_FACTOR`] · √1,100, for a
/// shaft with some 90 blocks of triangles ([`super::wide::BLOCK_WORK`]).
const DEFAULT_RAY_WORK: u64 = 200;
/// Embree's work per packet in units of this engine's work, divided by the square root of the work of testing every
/// triangle in the shaft. An estimate that selects between engines; both times of each row of `mrvis bench` check it.
const EMBREE_WORK_FACTOR: f64 = 6.0;
/// Largest ratio of the engine's work to that of exact rays at which the engine is used: the work of exact rays is an
/// estimate, so a margin of a fifth is kept.
const MAX_WORK_RATIO: f64 = 0.8;
/// A walk is abandoned at this multiple of the estimated work of exact rays. A bundle then costs at most 2 + 1 = 3
/// times as much as exact rays alone.
const GIVE_UP_FACTOR: u64 = 2;
/// Work per bundle for its shaft and answer: five nodes. An estimate that selects between engines.
const BUNDLE_WORK: u64 = 30;

/// Bundles between surfaces and emitters on which the cost of exact rays is calibrated: limit the time to 256 walks, and the relative
/// standard error of a mean to 1/16 of the spread of one.
pub const CALIBRATION_BUNDLES: usize = 256;

/// Evenly spread runs of the indices of `bundles` bundles; the engine for all of them is chosen by these.
pub fn sample_runs(bundles: usize) -> impl Iterator<Item = Range<usize>> {
    let length = SAMPLE_RUN.min(bundles);
    let runs = SAMPLE_RUNS.min(bundles / (MIN_BUNDLES_PER_SAMPLED * SAMPLE_RUN)).max(1);
    (0..runs).map(move |k| {
        // A single run is taken from the middle.
        let first = if runs == 1 { (bundles - length) / 2 } else { (bundles - length) * k / (runs - 1) };
        first..first + length
    })
}

/// Estimated work of exact rays.
#[derive(Clone, Copy)]
pub(super) struct CostModel {
    /// Work of exact rays per packet.
    ray_work: u64,
}

/// Work of both engines for the same bundles.
#[derive(Clone, Copy, Default)]
pub struct Work {
    pub(super) own: u64,
    pub(super) rays: u64,
}

impl CostModel {
    /// The model before calibration on any bundle.
    pub const UNCALIBRATED: CostModel = CostModel { ray_work: DEFAULT_RAY_WORK };
    /// Never hands bundles over, for tests of the engine's own answers.
    #[cfg(test)]
    pub const UNLIMITED: CostModel = CostModel { ray_work: 1 << 40 };

    /// Calibrates on the work of testing everything in the shafts of sample bundles of one packet. Embree's work is about
    /// proportional to its square root. Without samples the model stays as it is.
    #[must_use]
    pub fn calibrated(self, everything: impl Iterator<Item = u64>) -> CostModel {
        let (mut work, mut count) = (0.0, 0.0);
        for one in everything {
            work += (one as f64).sqrt();
            count += 1.0;
        }
        match count > 0.0 {
            true => CostModel { ray_work: (EMBREE_WORK_FACTOR * work / count) as u64 },
            false => self,
        }
    }

    /// Work of exact rays for a bundle; each packet counts as at least a quarter full.
    pub fn rays(&self, bundle: &Bundle) -> u64 {
        let lanes: usize = bundle.packets.iter().map(|p| p.len().max(LANES / 4)).sum();
        self.ray_work * lanes as u64 / LANES as u64
    }

    /// Work at which a walk is abandoned.
    pub fn limit(&self, bundle: &Bundle) -> u64 {
        GIVE_UP_FACTOR * self.rays(bundle)
    }

    /// Work of both engines for a bundle, after its walk.
    pub fn of(&self, bundle: &Bundle, walked: &WalkResult) -> Work {
        let (rays, limit) = (self.rays(bundle), self.limit(bundle));
        let abandoned = walked.gave_up || walked.work > limit;
        Work { own: BUNDLE_WORK + if abandoned { limit + rays } else { walked.work }, rays }
    }
}

impl Work {
    /// Adds the work for another bundle.
    pub fn add(&mut self, other: Work) {
        self.own += other.own;
        self.rays += other.rays;
    }

    /// Whether this engine takes less work.
    pub fn is_less(&self) -> bool {
        self.own < self.rays
    }

    /// Whether most walks were abandoned: each counts its limit, which is twice the work of exact rays, and that of exact rays.
    pub fn is_mostly_abandoned(&self) -> bool {
        self.own > GIVE_UP_FACTOR * self.rays
    }

    /// Whether this engine takes so much less work that it is faster in spite of the error of the estimate.
    pub fn is_clearly_less(&self) -> bool {
        (self.own as f64) < MAX_WORK_RATIO * self.rays as f64
    }
}
