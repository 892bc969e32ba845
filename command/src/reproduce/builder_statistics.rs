//! Which builders have smaller errors than others, and which differences are certain.

use super::equal_time::Compared;
use mrvis::Builder;
use mrvis::internals::BuilderParts;

/// Number of builders.
const BUILDERS: usize = Builder::ALL.len();

/// The logarithm of the ratio of the errors of two builders.
#[derive(Clone, Copy, Debug)]
pub struct Ratio {
    /// Mean over scenes.
    pub mean: f64,
    /// Standard error of the mean: by the scatter between scenes, but at least by that between measurements.
    pub error: f64,
    /// Largest mean that may be due to chance or to the noise of the references.
    limit: f64,
}

impl Ratio {
    /// Whether the error of the builder is certainly larger than that of the other one.
    pub fn is_worse(&self) -> bool {
        self.mean > self.limit
    }

    /// Whether it is certainly smaller.
    pub fn is_better(&self) -> bool {
        self.mean < -self.limit
    }
}

/// Standard error of the logarithm of a ratio in one scene by repeated measurements, pooled over scenes and builders.
pub fn measurement_error(all: &[&Compared]) -> f64 {
    let of = |scene: &&Compared| (1..BUILDERS).map(|k| scene.half_difference(k, 0).powi(2)).sum::<f64>();
    (all.iter().map(of).sum::<f64>() / ((BUILDERS - 1) * all.len()).max(1) as f64).sqrt()
}

/// The ratio of the errors of two builders over some scenes; `all` scenes tell the error of measurements. A difference is certain if
/// it is outside the 95 % interval of Student's t, and larger than the noise of the references can make it.
pub fn ratio(some: &[&Compared], all: &[&Compared], builder: usize, other: usize) -> Ratio {
    let n = some.len() as f64;
    let logs = || some.iter().map(|scene| scene.log(builder) - scene.log(other));
    let mean = logs().sum::<f64>() / n;
    let square = logs().map(|log| (log - mean).powi(2)).sum::<f64>();
    let scatter = (square / (n * (n - 1.0).max(1.0))).sqrt();
    let measured = measurement_error(all) / n.sqrt();
    // What an error changes by if the whole noise of the reference is taken off its square once more.
    let noise = |scene: &&Compared| {
        let error = scene.error(builder).min(scene.error(other));
        0.5 * (scene.noise / error).powi(2).ln_1p()
    };
    let noise = some.iter().map(noise).sum::<f64>() / n;
    let by_scatter = match some.len() {
        0 | 1 => 0.0,
        n => student(n - 1) * scatter,
    };
    let limit = by_scatter.max(student(all.len()) * measured) + noise;
    Ratio { mean, error: if builder == other { 0.0 } else { scatter.max(measured) }, limit }
}

/// The builders that are not certainly worse than the one with the smallest error; [`UNDECIDED`] if these are all.
pub fn best(some: &[&Compared], all: &[&Compared]) -> String {
    let best: Vec<&str> = (0..BUILDERS).filter(|&k| may_be_best(some, all, k)).map(name).collect();
    if best.len() == BUILDERS { UNDECIDED.into() } else { best.join(", ") }
}

/// The builders that are not certainly worse than the one with the smallest error in any single scene.
pub fn never_worse(some: &[&Compared], all: &[&Compared]) -> String {
    let in_all = |k: &usize| some.iter().all(|scene| may_be_best(&[scene], all, *k));
    let names: Vec<&str> = (0..BUILDERS).filter(in_all).map(name).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// Whether a builder is not certainly worse than the one with the smallest error.
fn may_be_best(some: &[&Compared], all: &[&Compared], builder: usize) -> bool {
    let sum = |builder: usize| some.iter().map(|scene| scene.log(builder)).sum::<f64>();
    let smallest = (0..BUILDERS).min_by(|&a, &b| sum(a).total_cmp(&sum(b)));
    smallest.is_some_and(|smallest| !ratio(some, all, builder, smallest).is_worse())
}

fn name(builder: usize) -> &'static str {
    Builder::ALL[builder].name()
}

/// What tables say if no builder is certainly worse than another, or one scene stands for a kind.
pub const UNDECIDED: &str = "undecided";

/// The magnitude that Student's t exceeds with a probability of 5 %, by degrees of freedom: a table, then the expansion of M. Abramowitz
/// and I. Stegun 1964, formula 26.7.5, to second order.
fn student(freedom: usize) -> f64 {
    const FIRST: [f64; 7] = [f64::INFINITY, 12.706, 4.303, 3.182, 2.776, 2.571, 2.447];
    if let Some(factor) = FIRST.get(freedom) {
        return *factor;
    }
    let (z, n) = (1.96f64, freedom as f64);
    z + (z.powi(3) + z) / (4.0 * n) + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * n * n)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A scene with these errors, whose two sets differ by a factor.
    pub fn scene(errors: [f64; 4], factor: f64, noise: f64) -> Compared {
        let spread = 0.5 * factor.ln();
        // The sets differ in opposite directions for the first builder and the others.
        let logs = std::array::from_fn(|k| {
            let side = if k == 0 { spread } else { -spread };
            [errors[k].ln() + side, errors[k].ln() - side]
        });
        Compared { exact: 0.01, logs, handed_over: [0.0; 4], noise, triangles: 100, preparation: [0.1; 4] }
    }

    #[test]
    fn factors_are_those_of_tables() {
        for (freedom, factor) in [(1, 12.706), (7, 2.365), (10, 2.228), (30, 2.042)] {
            assert!((student(freedom) - factor).abs() < 0.01, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn certain_differences_are_told_from_chance() {
        let best_of = |scenes: &[Compared]| {
            let all: Vec<&Compared> = scenes.iter().collect();
            best(&all, &all)
        };
        let clear = [[0.1, 0.2, 0.2, 0.2], [0.1, 0.21, 0.2, 0.19], [0.1, 0.19, 0.2, 0.21]];
        assert_eq!(best_of(&clear.map(|e| scene(e, 1.01, 0.001))), "grids");
        // Scatter between scenes, between sets, and noise of the reference hide the same differences.
        let scattered = [[0.1, 0.2, 0.2, 0.2], [0.2, 0.1, 0.1, 0.1], [0.1, 0.19, 0.2, 0.21]];
        assert_eq!(best_of(&scattered.map(|e| scene(e, 1.01, 0.001))), UNDECIDED);
        assert_eq!(best_of(&clear.map(|e| scene(e, 3.0, 0.001))), UNDECIDED);
        assert_eq!(best_of(&clear.map(|e| scene(e, 1.01, 0.2))), UNDECIDED);
        // The scatter of one builder does not hide that of others.
        let one_scatters = [[0.1, 0.05, 0.2, 0.2], [0.1, 0.4, 0.2, 0.2], [0.1, 0.3, 0.2, 0.2]];
        assert_eq!(best_of(&one_scatters.map(|e| scene(e, 1.01, 0.001))), "grids, kdtree");
    }

    /// A builder that is best in some scenes and worse in others is named for none of them together.
    #[test]
    fn builders_that_are_worse_in_one_scene_are_not_named() {
        let scenes = [[0.1, 0.1, 0.2, 0.2], [0.1, 0.2, 0.2, 0.1]].map(|e| scene(e, 1.01, 0.001));
        let all: Vec<&Compared> = scenes.iter().collect();
        assert_eq!(never_worse(&all, &all), "grids");
        let scenes = [[0.1, 0.2, 0.2, 0.2], [0.2, 0.1, 0.2, 0.2]].map(|e| scene(e, 1.01, 0.001));
        let all: Vec<&Compared> = scenes.iter().collect();
        assert_eq!(never_worse(&all, &all), "none");
    }

    /// Two equal sets by chance do not make a scene certain: errors are pooled.
    #[test]
    fn sampling_errors_are_pooled() {
        let scenes = [scene([0.1; 4], 1.0, 0.001), scene([0.1; 4], 1.5, 0.001)];
        let all: Vec<&Compared> = scenes.iter().collect();
        let one = ratio(&all[..1], &all, 1, 0);
        let half = 0.5 * 2.0 * 0.5 * 1.5f64.ln();
        assert!((one.error - 2.0 * half / 2.0f64.sqrt()).abs() < 1e-12, "{}", one.error);
    }
}
