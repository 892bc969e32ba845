//! Draws sides of a cluster, preferring sides that face a direction.

use super::{Cluster, DIRECTIONS};
use glam::Vec3;

/// Fraction of the samples that is uniform over all sides, so that every side has a positive density: bounds the weight of
/// a sample to 1 / 0.2 = 5 times the weight of uniform sampling. Without a local pass half or twice as much changes
/// irradiance by less than 0.1 % (`constants.py solve`).
const UNIFORM_FRACTION: f32 = 0.2;

/// Running sums of the sides' areas and projected areas.
#[derive(Clone, Debug, Default)]
pub struct SideSampler {
    /// By side and direction, area last: sums over all sides before that side.
    sums: Vec<[f64; DIRECTIONS + 1]>,
}

impl SideSampler {
    /// From the area and the facing of each side.
    pub(super) fn new(sides: impl Iterator<Item = (f64, [f32; DIRECTIONS])>) -> SideSampler {
        let mut sums = vec![[0.0; DIRECTIONS + 1]];
        let mut sum = [0.0; DIRECTIONS + 1];
        for (area, facing) in sides {
            for (sum, part) in sum.iter_mut().zip(facing) {
                *sum += area * f64::from(part);
            }
            sum[DIRECTIONS] += area;
            sums.push(sum);
        }
        SideSampler { sums }
    }

    /// Projected areas of a range of sides along the six directions, and their area.
    pub(super) fn of_range(&self, [from, to]: [u32; 2]) -> [f64; DIRECTIONS + 1] {
        std::array::from_fn(|k| self.sums[to as usize][k] - self.sums[from as usize][k])
    }

    /// A side of a cluster by two numbers in `[0, 1)`, likely to face `towards` (a unit vector). [`SideSampler::density`] is its density.
    pub fn pick(&self, cluster: &Cluster, towards: Vec3, u: f32, v: f32) -> u32 {
        let weights = weights(cluster, towards);
        let total: f64 = weights.iter().sum();
        let mut kind = DIRECTIONS;
        if total > 0.0 && u >= UNIFORM_FRACTION {
            let mut left = f64::from((u - UNIFORM_FRACTION) / (1.0 - UNIFORM_FRACTION)) * total;
            kind = (0..DIRECTIONS).rfind(|&k| weights[k] > 0.0).unwrap_or(DIRECTIONS);
            for (k, weight) in weights.iter().enumerate() {
                if left < *weight {
                    kind = k;
                    break;
                }
                left -= weight;
            }
        }
        let [from, to] = cluster.sides.map(|s| s as usize);
        let (low, high) = (self.sums[from][kind], self.sums[to][kind]);
        let target = low + f64::from(v) * (high - low);
        let k = self.sums[from + 1..=to].partition_point(|s| s[kind] <= target);
        (from + k).min(to - 1) as u32
    }

    /// Density of [`SideSampler::pick`] with a uniform point on the side, for a side with this normal; 1/area.
    pub fn density(&self, cluster: &Cluster, towards: Vec3, normal: Vec3) -> f32 {
        let total: f64 = weights(cluster, towards).iter().sum();
        let area = self.of_range(cluster.sides)[DIRECTIONS];
        let even = 1.0 / area as f32;
        if total <= 0.0 {
            return even;
        }
        UNIFORM_FRACTION * even + (1.0 - UNIFORM_FRACTION) * facing_bound(normal, towards) / total as f32
    }

    pub(super) fn bytes(&self) -> usize {
        self.sums.capacity() * size_of::<[f64; DIRECTIONS + 1]>()
    }
}

/// Contributions of the six directions to the projected area of a cluster.
#[inline]
fn weights(cluster: &Cluster, towards: Vec3) -> [f64; DIRECTIONS] {
    let towards = super::facing(towards);
    std::array::from_fn(|k| f64::from(towards[k]) * cluster.projected[k])
}

/// Upper bound of the cosine between a normal and a direction that six directions give: equal to the cosine where the signs
/// agree on all axes.
#[inline]
fn facing_bound(normal: Vec3, towards: Vec3) -> f32 {
    (normal * towards).max(Vec3::ZERO).element_sum()
}
