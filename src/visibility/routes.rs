//! Routes of bundles: each is answered by the distance cut, by a walk, or by exact rays.

use super::answer::{Answer, Bundle};
use super::bundle_walks::Workspace;
use super::cost_model::Work;
use super::cut::{Cut, Mode, over_embree};
use super::multires::MultiResolution;
use crate::ray::Packet;
use std::sync::Arc;

/// Part of the estimated work of exact rays that a certificate may take where the cut averaged nothing: shafts that are empty take a few
/// nodes.
const CERTIFICATE_PART: u64 = 8;
/// Largest product of time and mean square error, relative to that without the cut, at which the cut is used: both are those of a sample of
/// 256 bundles, whose mean squares are known to about a tenth.
const MAX_COST_RATIO: f64 = 0.8;

/// How many bundles are answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Whether walks take clearly less time than exact rays for the bundles that the cut does not answer.
    pub walks: bool,
    /// Whether the cut is used.
    pub cut: bool,
}

#[cfg(any(test, feature = "reports"))]
impl Choice {
    /// Whether any bundle is answered otherwise than by exact rays.
    pub fn pays(self) -> bool {
        self.walks || self.cut
    }
}

impl MultiResolution {
    /// Adds the distance cut, if the model has one.
    #[must_use]
    pub fn with_cut(mut self, cut: Option<Arc<Cut>>) -> Self {
        self.cut = cut;
        self
    }

    /// The engine that makes this choice for all bundles of a run; without walks exact rays take their place.
    #[must_use]
    pub fn with_choice(&self, choice: Choice) -> Self {
        let mut engine = self.clone();
        engine.cut = engine.cut.filter(|_| choice.cut);
        engine.walks = choice.walks;
        engine
    }

    /// Memory of the distance cut, bytes.
    #[cfg(any(test, feature = "reports"))]
    pub fn cut_bytes(&self) -> usize {
        self.cut.as_ref().map_or(0, |cut| cut.bytes())
    }

    /// Chooses for bundles like those of a sample, runs of neighbouring ones, at feature size `s`. `truth` is the visible fraction of each
    /// by many rays, in order.
    pub fn choice(&self, runs: &[Vec<Bundle>], truth: &[f32], s: f32, workspace: &mut Workspace) -> Choice {
        let without = Choice { walks: self.work_of(runs, s, workspace).is_clearly_less(), cut: false };
        let Some(cut) = &self.cut else { return without };
        let leaves = |bundle: &&Bundle| cut.mode(bundle).0.is_none();
        let others: Vec<Vec<Bundle>> =
            runs.iter().map(|run| run.iter().filter(leaves).copied().collect()).collect();
        if runs.iter().zip(&others).all(|(all, others)| all.len() == others.len()) {
            return without;
        }
        let with = Choice { walks: self.work_of(&others, s, workspace).is_clearly_less(), cut: true };
        let exact: Vec<f64> = runs.iter().flatten().map(|bundle| cut.exact_work(bundle)).collect();
        let mut cost = |choice| self.with_choice(choice).cost(runs, (truth, &exact), s, workspace);
        if cost(with) < MAX_COST_RATIO * cost(without) { with } else { without }
    }

    /// Work of walks and of exact rays for runs of bundles.
    fn work_of(&self, runs: &[Vec<Bundle>], s: f32, workspace: &mut Workspace) -> Work {
        let mut work = Work::default();
        for run in runs {
            work.add(self.work(run, &vec![s; run.len()], workspace));
        }
        work
    }

    /// Time for bundles times the sum of their square errors: what it takes to reach an error. Times are in units of work of the cut's
    /// tree, that of exact rays is the least that Embree may take.
    fn cost(
        &self,
        runs: &[Vec<Bundle>],
        (truth, exact): (&[f32], &[f64]),
        s: f32,
        workspace: &mut Workspace,
    ) -> f64 {
        let mut known = truth.iter().zip(exact);
        let (mut time, mut error) = (0.0, 0.0);
        for run in runs {
            let (mut others, mut truths, mut rays) = (vec![], vec![], 0.0);
            for (bundle, (&truth, exact)) in run.iter().zip(known.by_ref()) {
                let (mode, work) = self.mode(bundle);
                time += work;
                if let Some((cut, mode)) = mode {
                    let (answer, sums) = cut.answer(bundle, &mode);
                    time += sums.work();
                    error += f64::from(answer.transmittance - truth).powi(2);
                } else {
                    others.push(*bundle);
                    truths.push(truth);
                    let n: usize = bundle.packets.iter().map(Packet::len).sum();
                    rays += exact / f64::from(over_embree(n as f32));
                }
            }
            if self.walks {
                let Work { own, rays: all } = self.work(&others, &vec![s; others.len()], workspace);
                rays *= own as f64 / all.max(1) as f64;
            }
            time += rays;
            let mut truths = truths.into_iter();
            self.other_answers(&others, s, workspace, &mut |answer| {
                error += f64::from(answer.transmittance - truths.next().unwrap_or_default()).powi(2);
            });
        }
        time * error
    }

    /// How the cut answers a bundle, if it does, and the work of finding out.
    fn mode(&self, bundle: &Bundle) -> (Option<(&Cut, Mode)>, f64) {
        let Some(cut) = &self.cut else { return (None, 0.0) };
        let (mode, work) = cut.mode(bundle);
        (mode.map(|mode| (&**cut, mode)), work)
    }

    /// The visible fractions of several bundles, passed to `each` in order.
    ///
    /// Consecutive bundles with close ends share the upper part of their walks; each applies the umbra criterion by itself. Answers equal
    /// those of [`MultiResolution::answer`] up to rounding, except for bundles that only one of the two ways hands over.
    pub fn answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer),
    ) {
        let mut first = 0;
        for (k, bundle) in bundles.iter().enumerate() {
            if let (Some((cut, mode)), _) = self.mode(bundle) {
                self.other_answers(&bundles[first..k], s, workspace, &mut each);
                each(self.cut_answer((cut, &mode), bundle, workspace));
                first = k + 1;
            }
        }
        self.other_answers(&bundles[first..], s, workspace, &mut each);
    }

    /// Answers to bundles that the cut leaves.
    fn other_answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        each: &mut impl FnMut(Answer),
    ) {
        match self.walks {
            true => self.walked_answers(bundles, s, workspace, each),
            false => bundles.iter().for_each(|bundle| each(self.hand_over(*bundle, workspace))),
        }
    }

    /// The answer of the cut; that of a certificate where it is certain without averages.
    fn cut_answer(&self, (cut, mode): (&Cut, &Mode), bundle: &Bundle, workspace: &mut Workspace) -> Answer {
        let (answer, sums) = cut.answer(bundle, mode);
        let same = sums.aggregated == 0 && matches!(answer.transmittance, 0.0 | 1.0);
        let certain = if same { self.certificate(bundle, CERTIFICATE_PART, workspace) } else { None };
        certain.unwrap_or(answer)
    }
}
