//! Routes of bundles: each is answered by a walk, by the distance cut, or by exact rays ([`Route`]).

use super::answer::{Answer, Bundle};
use super::bundle_walks::Workspace;
use super::cost_model::Route;
#[cfg(any(test, feature = "reports"))]
use super::cost_model::Work;
use super::cut::Cut;
use super::multires::MultiResolution;
use std::sync::Arc;

/// Smallest part of a sample of bundles, a sixteenth, whose receivers suit the cut: below it the classification of all others would
/// take longer than the cut saves.
#[cfg(any(test, feature = "reports"))]
const MIN_CUT_PART: usize = 16;

/// How many bundles are answered.
#[cfg(any(test, feature = "reports"))]
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
    #[cfg(any(test, feature = "reports"))]
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

    /// Chooses for bundles like those of a sample, runs of neighbouring ones, at feature size `s`.
    #[cfg(any(test, feature = "reports"))]
    pub fn choice<'b>(
        &self,
        runs: impl Iterator<Item = &'b [Bundle<'b>]>,
        s: f32,
        workspace: &mut Workspace,
    ) -> Choice {
        let (mut work, mut taken, mut all) = (Work::default(), 0, 0);
        for run in runs {
            let others: Vec<Bundle> =
                run.iter().filter(|bundle| self.route(bundle, s) != Route::Cut).copied().collect();
            (taken, all) = (taken + run.len() - others.len(), all + run.len());
            work.add(self.work(&others, &vec![s; others.len()], workspace));
        }
        Choice { walks: work.is_clearly_less(), cut: taken * MIN_CUT_PART > all }
    }

    fn route(&self, bundle: &Bundle, s: f32) -> Route {
        match (&self.cut, self.walks) {
            (Some(cut), _) if cut.takes(bundle, s) => Route::Cut,
            (_, true) => Route::Bundle,
            (_, false) => Route::Embree,
        }
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
        if self.cut.is_none() && self.walks {
            return self.walked_answers(bundles, s, workspace, each);
        }
        let mut first = 0;
        while first < bundles.len() {
            let route = self.route(&bundles[first], s);
            let same = bundles[first + 1..].iter().take_while(|bundle| self.route(bundle, s) == route);
            let run = &bundles[first..=first + same.count()];
            first += run.len();
            match (route, &self.cut) {
                (Route::Cut, Some(cut)) => run.iter().for_each(|bundle| each(cut.answer(bundle, s))),
                (Route::Bundle, _) => self.walked_answers(run, s, workspace, &mut each),
                _ => run.iter().for_each(|bundle| each(self.hand_over(*bundle, workspace))),
            }
        }
    }
}
