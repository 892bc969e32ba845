//! Standard errors of the local pass, from the spread of its rays.

use super::bright_leaves::Brightest;
use super::ray_rows::{RayRow, RayRows};
use crate::math::parallel;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::rgb::{Rgb, mean};
use crate::radiosity::transport::RayTransport;

/// Smallest number of rows of one parallel task, so that the work of a task outweighs its start. Does not change results.
const CHUNK: usize = 64;
/// Weight, in rays, of the spread around an element when it is mixed with its own: the relative error of a
/// variance from 8 rays alone is √(2/8) = 50 %. Affects error bars and the number of rays.
const NEIGHBOUR_RAYS: f64 = 8.0;
/// Light of a side relative to the mean below which errors are relative to the side's own light, not to the mean: sides of furniture in
/// a lit room have more.
const DIM_SIDE: f64 = 0.25;
/// Largest weight of an error: that of a room with a sixty-fourth of the mean light. Otherwise sides that receive hardly any light would
/// take all rays.
const MAX_WEIGHT: f64 = 16.0;

/// The result of the local pass for one element.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocalResult {
    /// Irradiance of a leaf, W/m².
    pub irradiance: Rgb,
    /// Standard error of the irradiance's mean over the channels, W/m², from the spread of the rays.
    pub noise: f32,
    /// Rays of the leaf.
    pub rays: u32,
    /// Sum of the form factors with sides that light can reach.
    pub row_sum: f32,
    /// Fraction of the rays that did not leave the scene.
    pub kept: f32,
    /// Whether rays of the leaf and of those with the same parent find some of the suns' light, neither none nor all.
    pub sun_varies: bool,
    /// Whether most of its rays met emitters that are about equally bright
    /// ([`Emitters::is_even`](crate::radiosity::elements::emitters::Emitters::is_even)) and too many for a closed form: then
    /// cosine-weighted rays alone find their light with the least noise.
    pub meets_emitters: bool,
    /// Standard deviation of the irradiance of one ray, W/m², by which the rays of the next pass are distributed among leaves. Sides that
    /// are much darker than the scene on average have a larger weight.
    pub deviation: f32,
}

/// Assigns standard errors to all leaves with rows, from the mean row sums by both halves of the rays. `brightest` chooses the
/// elements whose light is gathered by shadow rays, from leaves with their radiosities and the power that all leaves receive.
pub fn assign_noise(
    elements: &Elements,
    rows: &RayRows,
    transport: &RayTransport,
    sums: &[f64],
    brightest: impl Fn(&[(u32, f64)], f64) -> Brightest,
    results: &mut [LocalResult],
) {
    let light = |row: &RayRow| (row.leaf, reflected(elements, row.leaf, results));
    let leaves: Vec<(u32, f64)> = rows.rows.iter().map(light).collect();
    let area = |row: &RayRow| elements.elements[row.leaf as usize].area;
    let all: f64 = rows.rows.iter().map(area).sum();
    let level: f64 = rows.rows.iter().zip(&leaves).map(|(row, of)| area(row) * of.1).sum();
    let level = level / all.max(f64::MIN_POSITIVE);
    let received = |row: &RayRow| area(row) * mean(results[row.leaf as usize].irradiance);
    let Brightest { face_of, .. } = brightest(&leaves, rows.rows.iter().map(received).sum());
    // Elements gather the light of the brightest leaves by shadow rays.
    let seen = |&(leaf, light): &(u32, f64)| match face_of[leaf as usize] {
        Elements::NONE => light,
        _ => level,
    };
    let seen: Vec<f64> = leaves.iter().map(seen).collect();
    let spreads: Vec<RowSpread> = parallel::map(parallel::at_least(CHUNK, 0..rows.rows.len()), |i| {
        let row = &rows.rows[i];
        let others = transport.form_factors(i).map(|(j, f)| (f, seen[j as usize]));
        RowSpread::new(row, f64::from(row.rays), others)
    });
    let mut below = vec![[Spread::default(); 2]; elements.len()];
    rows.rows.iter().zip(&spreads).for_each(|(row, spread)| below[row.leaf as usize] = spread.spreads);
    let variances = variances_below(elements, &mut below);
    for (i, (row, spread)) in rows.rows.iter().zip(&spreads).enumerate() {
        let leaf = row.leaf as usize;
        let n = f64::from(row.rays);
        let parent = elements.elements[leaf].parent as usize;
        let [direct, reflected] = [0, 1].map(|k| spread.spreads[k].variance(variances[parent][k]));
        let rays = (spread.spreads[1].freedom + 1.0).max(1.0);
        let variance = direct / n
            + sums[i] * sums[i] * reflected / rays
            + sums[i] * (1.0 - sums[i]).max(0.0) * spread.mean * spread.mean / n;
        // One more ray might meet a surface that no other ray has met, here or nearby, as bright as the scene on average.
        let known = n + NEIGHBOUR_RAYS.min(below[parent][0].freedom);
        results[leaf].noise = variance.sqrt().hypot(level / known) as f32;
    }
}

/// Adds the spreads of leaves to those of all elements above them. Returns the variance of one ray among the leaves below each element.
/// Few rays may miss the light that comes between blockers: where all rays of an element find the same, the variance among the rays of
/// the larger element around it counts, with the weight [`NEIGHBOUR_RAYS`]. Other surfaces do not count: in an office, shaded elements
/// would take rays from those in penumbrae.
fn variances_below(elements: &Elements, below: &mut [[Spread; 2]]) -> Vec<[f64; 2]> {
    let parent = |e: usize| elements.elements[e].parent as usize;
    let is_cluster = |e: usize| matches!(elements.elements[e].shape, Shape::Cluster(_));
    // Parents come before their children.
    for e in (1..below.len()).rev() {
        let own = below[e];
        below[parent(e)].iter_mut().zip(own).for_each(|(sum, of)| sum.add(of));
    }
    let mut variances: Vec<[f64; 2]> = Vec::with_capacity(below.len());
    for (e, spreads) in below.iter().enumerate() {
        let of = |k: usize| match spreads[k] {
            Spread { squares, freedom } if squares > 0.0 || e == 0 => squares / freedom.max(1.0),
            _ if is_cluster(parent(e)) => 0.0,
            same => same.variance(variances[parent(e)][k]),
        };
        variances.push([0, 1].map(of));
    }
    variances
}

/// Increases the weight of errors on sides that have less than [`DIM_SIDE`] of the mean light: an image of a room that the sky lights
/// through a window shows the light of the room alone, a hundredth of that of the ground outside. All leaves of such a side have one
/// deviation: few of their rays pass through the window. Irradiance up to `dark`, W/m², is rounding.
pub fn weigh_errors(elements: &Elements, leaves: &[u32], dark: f64, results: &mut [LocalResult]) {
    let side_of = |leaf: u32| match elements.elements[leaf as usize].shape {
        Shape::Surface { side, .. } => side as usize,
        Shape::Cluster(_) => unreachable!("leaves are surfaces"),
    };
    let area = |leaf: u32| elements.elements[leaf as usize].area;
    // By side: its area, and the area-weighted sums of light and of the variance of one ray.
    let mut sides = vec![[0.0; 3]; elements.sides.len()];
    for &leaf in leaves {
        let (area, result) = (area(leaf), &results[leaf as usize]);
        let variance = f64::from(result.noise).powi(2) * f64::from(result.rays);
        let of = [area, area * mean(result.irradiance), area * variance];
        sides[side_of(leaf)].iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
    }
    let [all, light] = [0, 1].map(|k| sides.iter().map(|side| side[k]).sum::<f64>());
    for &leaf in leaves {
        let [area, own, variance] = sides[side_of(leaf)];
        let result = &mut results[leaf as usize];
        let weight = weight_of_side(own / area, light / all, dark);
        result.deviation = match weight > 1.0 {
            true => (weight * (variance / area).sqrt()) as f32,
            false => result.noise * (result.rays as f32).sqrt(),
        };
    }
}

/// Weight of errors on a side with the mean irradiance `own`, in a scene with the mean irradiance `all`. A side without light, but for
/// rounding up to `dark`, has no relative error; light that noise brings below 0 may be any small light. W/m².
fn weight_of_side(own: f64, all: f64, dark: f64) -> f64 {
    if own.abs() <= dark {
        return 1.0;
    }
    (DIM_SIDE * all / own.max(f64::MIN_POSITIVE)).clamp(1.0, MAX_WEIGHT)
}

/// Reflected radiosity of an element, mean over the channels, W/m².
fn reflected(elements: &Elements, element: u32, results: &[LocalResult]) -> f64 {
    let Shape::Surface { side, .. } = elements.elements[element as usize].shape else { return 0.0 };
    let rho = elements.sides[side as usize].reflectance;
    let irradiance = results[element as usize].irradiance;
    (0..3).map(|k| f64::from(rho[k]) * irradiance[k]).sum::<f64>() / 3.0
}

/// Spread of the light along the rays of a leaf.
struct RowSpread {
    /// Mean reflected radiosity that the leaf sees, W/m².
    mean: f64,
    /// Spread between rays: direct light, reflected light.
    spreads: [Spread; 2],
}

impl RowSpread {
    /// For `n` rays; `others` are the form factors and radiosities at the other ends of all rays that leave or meet the leaf.
    fn new(row: &RayRow, n: f64, others: impl Iterator<Item = (f64, f64)>) -> RowSpread {
        let direct = f64::from(row.direct().element_sum()) / 3.0;
        let (mut weights, mut squared_weights, mut sum, mut squares) = (0.0, 0.0, 0.0, 0.0);
        for (w, b) in others {
            (weights, squared_weights) = (weights + w, squared_weights + w * w);
            (sum, squares) = (sum + w * b, squares + w * b * b);
        }
        let weighted = |v: f64| if weights > 0.0 { v / weights } else { 0.0 };
        // The effective number of rays with different weights.
        let rays = if weights > 0.0 { weights * weights / squared_weights } else { 0.0 };
        let mean = weighted(sum);
        RowSpread {
            mean,
            spreads: [
                Spread::new(n, (f64::from(row.squares) - direct * direct / n).max(0.0)),
                Spread::new(rays, rays * (weighted(squares) - mean * mean).max(0.0)),
            ],
        }
    }
}

/// Sum of squared differences from the mean, and degrees of freedom.
#[derive(Clone, Copy, Default)]
struct Spread {
    squares: f64,
    freedom: f64,
}

impl Spread {
    fn new(rays: f64, squares: f64) -> Spread {
        Spread { squares, freedom: (rays - 1.0).max(0.0) }
    }

    fn add(&mut self, other: Spread) {
        (self.squares, self.freedom) = (self.squares + other.squares, self.freedom + other.freedom);
    }

    /// Variance of one ray by these rays, mixed with the variance of other rays with the weight [`NEIGHBOUR_RAYS`].
    fn variance(self, around: f64) -> f64 {
        (self.squares + NEIGHBOUR_RAYS * around) / (self.freedom + NEIGHBOUR_RAYS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dim_sides_weigh_more_and_dark_ones_do_not() {
        let weight = |own| weight_of_side(own, 1.0, 1e-9);
        for dark in [0.0, 1e-14, -1e-14] {
            assert_eq!(weight(dark), 1.0);
        }
        assert_eq!([-0.1, 0.001, 1.0].map(weight), [MAX_WEIGHT, MAX_WEIGHT, 1.0]);
    }
}
