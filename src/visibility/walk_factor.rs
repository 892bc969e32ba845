//! The factor of the extinctions of walks that makes their mean transmittance right, fitted on a sample.

use super::answer::Bundle;
use super::bundle_walks::Workspace;
use super::multires::MultiResolution;
use super::route::Route;
use super::routes::{RouteSample, standard_error};

/// Smallest and largest factor, and the first other one that is tried: factors from 0.8 to 1.05 were fitted in park, orchard and leaf forest.
const RANGE: [f32; 2] = [0.5, 2.0];
const FIRST_STEP: f32 = 0.9;
/// Steps of the secant rule after the first: an error of the mean of 0.01 falls below 0.0001.
const STEPS: usize = 2;

impl MultiResolution {
    /// Walks at feature size `s` with the factor with which the mean transmittance of a sample is right; with the extinctions of the clusters
    /// if it is right to its standard error without.
    pub(super) fn fitted_walks(&self, sample: &RouteSample, s: f32, workspace: &mut Workspace) -> Route {
        let mut errors = |factor: f32| self.walk_errors(sample, (s, factor), workspace);
        let first = errors(1.0);
        let mean = |errors: &[f64]| errors.iter().sum::<f64>();
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

    /// Sum of the errors of the transmittances of each run with a factor of all extinctions: the bundles of a run are neighbours and err
    /// alike.
    fn walk_errors(
        &self,
        sample: &RouteSample,
        (s, factor): (f32, f32),
        workspace: &mut Workspace,
    ) -> Vec<f64> {
        let engine = self.with_route(Route::Walks { factor });
        let mut truth = sample.truth[0].iter().zip(&sample.truth[1]).map(|(a, b)| 0.5 * f64::from(a + b));
        let error = |run: &Vec<Bundle>| {
            let mut sum = 0.0;
            engine.walked_answers(run, s, workspace, |answer| {
                sum += f64::from(answer.transmittance) - truth.next().expect("a fraction a bundle");
            });
            sum
        };
        sample.finest.iter().map(error).collect()
    }
}
