//! The factor of the extinctions of walks that makes their mean transmittance right, fitted on a sample.

use super::answer::Bundle;
use super::bundle_walks::Workspace;
use super::multires::MultiResolution;
use super::route::Route;
use super::routes::standard_error;

/// Smallest and largest factor: half and twice the optical depth of the clusters. The first trial differs from 1 by a tenth.
const RANGE: [f32; 2] = [0.5, 2.0];
const FIRST_STEP: f32 = 0.9;
/// Steps of the secant rule after the first: an error of the mean of 0.01 falls below 0.0001.
const STEPS: usize = 2;

impl MultiResolution {
    /// Walks at feature size `s` with the factor for which the mean transmittance of runs of neighbouring bundles is that of exact rays along
    /// the same segments; with the unchanged extinctions if these means already agree to the standard error of their difference.
    pub(super) fn fitted_walks(&self, runs: &[Vec<Bundle>], s: f32, workspace: &mut Workspace) -> Route {
        let seen = self.with_route(Route::Exact).sums(runs, s, workspace);
        let mut errors = |factor: f32| -> Vec<f64> {
            let passed = self.with_route(Route::Walks { factor }).sums(runs, s, workspace);
            passed.iter().zip(&seen).map(|(passed, seen)| passed - seen).collect()
        };
        let mean = |errors: &[f64]| errors.iter().sum::<f64>();
        let first = errors(1.0);
        if mean(&first).abs() <= standard_error(&first) {
            return Route::WALKS;
        }
        let (mut last, mut next) = ((1.0, mean(&first)), FIRST_STEP);
        if last.1 > 0.0 {
            next = 1.0 / FIRST_STEP;
        }
        for _ in 0..=STEPS {
            let found = (next, mean(&errors(next)));
            if found.1 == last.1 {
                return Route::WALKS;
            }
            let step = found.1 * f64::from(found.0 - last.0) / (found.1 - last.1);
            (last, next) = (found, (found.0 - step as f32).clamp(RANGE[0], RANGE[1]));
        }
        Route::Walks { factor: next }
    }

    /// Sum of the transmittances of the bundles of each run: neighbours err alike.
    fn sums(&self, runs: &[Vec<Bundle>], s: f32, workspace: &mut Workspace) -> Vec<f64> {
        let sum = |run: &Vec<Bundle>| {
            let mut sum = 0.0;
            self.answers(run, s, workspace, |answer| sum += f64::from(answer.transmittance));
            sum
        };
        runs.iter().map(sum).collect()
    }
}
