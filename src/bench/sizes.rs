//! Default feature sizes: those that shadow images show ([`of_images`]), or of a scene without receivers those of its clusters
//! ([`default_sizes`]).
//!
//! Of clusters the smallest is the median over leaf clusters, weighted by triangles, of the blocker size averaged over the axes
//! (`ClusterOptics::blocker_size`): below it hardly any cluster is aggregated. The largest is the median of the
//! same size over clusters of 300 to 3,000 triangles (a plant, the crown of a tree), or that of the root if there is
//! none. The other two are in geometric progression. Neighbours differ by a factor of at least 1.65 (the largest is
//! raised), no size exceeds a twentieth of the scene's diagonal (the smallest is lowered), and sizes are rounded to
//! two digits for quoting.

use crate::model::Model;
use crate::optics::AXIS_COUNT;

/// Number of default sizes: the rows of the table of the report.
pub const COUNT: usize = 4;
/// Smallest ratio of neighbouring sizes before rounding: two digits round by up to 5 %, so that 1.65 · 0.95 / 1.05 =
/// 1.5 remains.
const MIN_RATIO: f64 = 1.65;
/// Largest size relative to the scene's diagonal, 5 %: in a room with a diagonal of 6 m shadows of 30 cm. Default of an
/// option, which users replace.
const MAX_DIAGONAL_FRACTION: f64 = 0.05;
/// Triangles of a cluster that stands for one object, such as a plant or the crown of a tree: a factor of √10 around
/// 1,000. Selects default sizes only.
const OBJECT_TRIANGLES: std::ops::RangeInclusive<u32> = 300..=3000;

/// Four feature sizes, ascending, scene units: those of the mesh with the most visible triangles.
///
/// # Panics
/// The model was prepared without optics.
pub fn default_sizes(model: &Model) -> Vec<f64> {
    let mut visible = vec![0u64; model.meshes().len()];
    for instance in model.instances().iter().filter(|instance| instance.is_present()) {
        visible[instance.mesh as usize] +=
            model.meshes()[instance.mesh as usize].scene().triangles.len() as u64;
    }
    let chosen = (0..visible.len()).max_by(|&a, &b| visible[a].cmp(&visible[b]).then(b.cmp(&a))).unwrap_or(0);
    let mesh = &model.meshes()[chosen];
    let (tree, optics) = (&mesh.hierarchy().micro, &mesh.measured().expect("optics").optics);
    let size = |c: usize| {
        let sum: f32 = (0..AXIS_COUNT).map(|axis| optics[c].blocker_size[axis]).sum();
        f64::from(sum) / AXIS_COUNT as f64
    };
    let of = |pick: &dyn Fn(usize) -> bool, weight: &dyn Fn(usize) -> f64| {
        let chosen = (0..tree.clusters.len()).filter(|&c| pick(c));
        weighted_median(
            chosen.map(|c| (size(c), weight(c))).filter(|(s, _)| s.is_finite() && *s > 0.0).collect(),
        )
    };
    let triangles = |c: usize| f64::from(tree.clusters[c].triangles);
    let small = of(&|c| tree.clusters[c].is_leaf(), &triangles);
    let large = of(&|c| OBJECT_TRIANGLES.contains(&tree.clusters[c].triangles), &|_| 1.0)
        .or_else(|| of(&|c| c == 0, &|_| 1.0));
    between(small, large, f64::from(model.scene().size()))
}

/// Up to four feature sizes in geometric progression from `range[0]` to `range[1]`, which are rounded inwards to two digits.
pub fn of_images([min, max]: [f64; 2]) -> Vec<f64> {
    let step = |v: f64| 10f64.powf(v.log10().floor() - 1.0);
    let (low, high) = (two_digits(min), two_digits(max));
    let first = if low < min { two_digits(low + step(min)) } else { low };
    let last = if high > max { two_digits(high - step(max)) } else { high };
    let ratio = (last / first).powf(1.0 / (COUNT as f64 - 1.0));
    let mut sizes: Vec<f64> = (0..COUNT).map(|i| two_digits(first * ratio.powi(i as i32))).collect();
    sizes.dedup();
    sizes
}

/// Sizes from the smallest to the largest, within the limits of a scene with this diagonal.
fn between(small: Option<f64>, large: Option<f64>, diagonal: f64) -> Vec<f64> {
    let spread = MIN_RATIO.powi(COUNT as i32 - 1);
    let cap = MAX_DIAGONAL_FRACTION * diagonal;
    let large = large.or(small.map(|s| s * spread)).unwrap_or(cap).min(cap);
    let small = small.unwrap_or(large / spread).min(cap / spread);
    let large = large.max(small * spread);
    let ratio = (large / small).powf(1.0 / (COUNT as f64 - 1.0));
    (0..COUNT).map(|i| two_digits(small * ratio.powi(i as i32))).collect()
}

/// Smallest value at or below which half of the weight lies.
fn weighted_median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    values
        .into_iter()
        .find(|&(_, weight)| {
            sum += weight;
            sum >= half
        })
        .map(|(value, _)| value)
}

/// Rounded to two significant decimal digits.
fn two_digits(v: f64) -> f64 {
    // Parsing the text gives the f64 nearest to the decimal number.
    format!("{v:.1e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_sane_whatever_the_statistics() {
        for small in [None, Some(1e-9), Some(0.01), Some(1.0), Some(1e3)] {
            for large in [None, Some(1e-9), Some(0.02), Some(5.0), Some(1e4)] {
                for diagonal in [1e-3, 1.0, 100.0, 1e6] {
                    let sizes = between(small, large, diagonal);
                    assert_eq!(sizes.len(), COUNT);
                    assert!(
                        sizes[0] > 0.0 && sizes[3] <= 0.1 * diagonal,
                        "{small:?} {large:?} {diagonal}: {sizes:?}"
                    );
                    assert!(
                        sizes.windows(2).all(|s| s[1] >= 1.5 * s[0]),
                        "{small:?} {large:?} {diagonal}: {sizes:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn sizes_span_what_the_scene_has() {
        assert_eq!(between(Some(0.01), Some(0.27), 100.0), [0.01, 0.03, 0.09, 0.27]);
    }

    #[test]
    fn sizes_of_images_stay_within_them() {
        assert_eq!(of_images([0.1, 2.7]), [0.1, 0.3, 0.9, 2.7]);
        for range in [[0.01234, 0.4321], [2.0e-5, 1.0e-4], [99.7, 1003.0], [0.0999, 0.3001]] {
            let sizes = of_images(range);
            assert_eq!(sizes.len(), COUNT);
            assert!(sizes[0] >= range[0] && sizes[0] <= 1.1 * range[0], "{range:?} {sizes:?}");
            assert!(sizes[3] <= range[1] && sizes[3] >= 0.9 * range[1], "{range:?} {sizes:?}");
            assert!(sizes.windows(2).all(|s| s[1] > s[0]), "{range:?} {sizes:?}");
        }
    }

    #[test]
    fn medians_are_weighted() {
        assert_eq!(weighted_median(vec![]), None);
        assert_eq!(weighted_median(vec![(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), Some(2.0));
        assert_eq!(weighted_median(vec![(3.0, 9.0), (1.0, 1.0), (2.0, 1.0)]), Some(3.0));
    }
}
