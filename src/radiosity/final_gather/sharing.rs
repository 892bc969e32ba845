//! Neighbouring elements share their samples where light is smooth.
//!
//! Around each element a linear function of place and normal is fitted to the irradiance of 8, 24 or 48 neighbours: under equal incident
//! light, irradiance is the dot product of the normal with one vector. Wider windows have less noise and more bias. The window is chosen
//! by cross validation with two halves of the rays: the fit to one half is compared with the element's estimate by the other half,
//! averaged over the neighbours (Rousselle, Knaus and Zwicker 2012 choose filters in this way). The same comparison gives the error of
//! the result, noise and bias together. Without a sky both halves are parts of one low-discrepancy sequence: where one is too bright the
//! other is rather too dark, so that their difference and the stated error are rather too large. Direct and reflected light have separate
//! windows.

use super::element_samples::{DIRECT, ElementLight, KINDS, REFLECTED, SharedLight};
use super::kept_power::{SharedKinds, keep_power};
use super::neighbours::{Neighbourhood, Place, Search, Sight};
use crate::math::parallel::{self, Items};
use crate::radiosity::deadline::Deadline;
use crate::ranks::Ranks;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Neighbours in each window, the element included: the element alone, then, in a regular grid, 3 by 3, 5 by 5 and 7 by 7 elements.
/// Each window has at most about half of the variance of the one before.
const WINDOWS: [usize; 4] = [1, 9, 25, 49];
/// Neighbours over which the comparison of windows is averaged, the element included: two rings of a square grid. Their 26
/// comparisons determine a variance to √(2/26) = 28 %.
const COMPARED_NEIGHBOURS: usize = 13;
/// Weight, in rays, of the spread of the neighbours when it is mixed with that of an element: twice the smallest number of rays of an
/// element, 8. So few rays may all miss a window by chance, and then have no spread of their own.
const NEIGHBOUR_RAYS: f64 = 16.0;
/// A window is rejected if it differs from the element's own rays by more standard deviations than this. The light of few rays is not
/// normally distributed: at 2.5, where a normal distribution rejects 1.2 %, a quarter of a living room's furniture keeps its noise.
const MAX_DEVIATION: f64 = 4.0;
/// Weight of a rotation of the normal relative to a distance of one radius in the ridge regression of slopes: a quarter of a radian
/// counts as one radius. 1, 2, 4, 8 and 16 leave errors of 3.1 %, 3.1 %, 3.2 %, 3.2 % and 3.3 % of the elements of a valley
/// (`constants.py elements --scene valley.obj`).
const NORMAL_SCALE: f32 = 4.0;
/// Ridge term of the slopes, relative to the weight of the neighbours. 0, 1e-4, 1e-3, 0.01 and 0.1 leave 3.24 %, 3.25 %, 3.20 %, 2.99 %
/// and 3.01 % as the same error.
const RIDGE: f64 = 1e-3;
/// Smallest number of neighbours for a plane: twice its three unknowns.
const MIN_FOR_PLANE: usize = 6;
/// Smallest number of neighbours for all unknowns: the smallest window has that many.
const MIN_FOR_NORMALS: usize = WINDOWS[1];

/// Irradiance of one element by the fits: by kind, window and half, W/m².
type FittedIrradiance = [[[Vec3; 2]; WINDOWS.len()]; KINDS];

/// How the windows of one element compare.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Comparison {
    /// By kind and window: mean square of the difference of the fit to one half and the other half of the element's own rays.
    crossed: [[f32; WINDOWS.len()]; KINDS],
    /// By kind and window: variance of the mean of the fits to both halves.
    variance: [[f32; WINDOWS.len()]; KINDS],
}

/// The irradiance of all elements from the rays of their neighbourhood; after the deadline from their own rays. `areas` are those of the
/// elements. Elements keep their own light if its noise is less than the fraction `needed` of their light and of the mean light, and so
/// is that of direct light around. Power is kept as [`keep_power`] says.
pub fn share(
    places: &[Place],
    areas: &[f64],
    sight: &Sight,
    light: &[ElementLight],
    needed: f64,
    ranks: &Ranks,
    deadline: &Deadline,
) -> Vec<SharedLight> {
    deadline.stage("light of elements, neighbours", places.len());
    let around = Neighbourhood::new(places, || deadline.late());
    let level = [0, 1].map(|kind| {
        let of = |(light, area): (&ElementLight, &f64)| area * light.mean(kind);
        light.iter().zip(areas).map(of).sum::<f64>() / areas.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    });
    let needed_square = |light: &ElementLight| {
        (needed * (light.mean(DIRECT) + light.mean(REFLECTED)).min(level[DIRECT] + level[REFLECTED]))
            .max(0.0)
            .powi(2)
    };
    let has_noise = |light: &ElementLight| SharedLight::alone(light).error >= needed_square(light);
    // Few rays may agree by chance: below small gaps, elements without sunlight would stay dark while others share theirs.
    let in_shadows = |light: &ElementLight| light.variance_of_mean(DIRECT) >= needed_square(light);
    let mut is_noisy: Vec<bool> = parallel::map(light, in_shadows);
    around.iter().for_each(|around| around.spread(&mut is_noisy, WINDOWS[WINDOWS.len() - 1]));
    parallel::for_each_mut(&mut is_noisy, |i, noisy| *noisy |= has_noise(&light[i]));
    let rows = ranks.rows(places.len());
    let buffers = <(Search, Vec<(f32, u32)>)>::default;
    let made = parallel::map_with(parallel::at_least(256, rows.numbers()), buffers, |(search, kept), i| {
        let own = [(0.0, i as u32)];
        let found = match &around {
            Some(around) if is_noisy[i] && !deadline.late() => {
                let found = around.nearest(i as u32, WINDOWS[WINDOWS.len() - 1], search);
                sight.visible(places, i as u32, found, kept);
                &kept[..]
            }
            _ => &own,
        };
        let (fits, compared) = fit(places, areas, light, i, found);
        deadline.advance(rows.steps(1));
        let around: Vec<u32> = found.iter().take(COMPARED_NEIGHBOURS).map(|f| f.1).collect();
        ((fits, around), compared)
    });
    let (own, compared): (Vec<_>, Vec<_>) = made.into_iter().unzip();
    let compared: Vec<Comparison> = rows.gather_numbers(compared);
    let chosen = parallel::map(parallel::at_least(256, 0..own.len()), |k| {
        let (fits, around) = &own[k];
        choose(fits, around, &compared, light, level, rows.numbers().item(k))
    });
    let mut shared: Vec<SharedKinds> = rows.gather_numbers(chosen);
    (0..KINDS).for_each(|kind| keep_power(kind, places, areas, light, &mut shared));
    let sum = |SharedKinds { irradiance: [direct, reflected], error }: SharedKinds| SharedLight {
        irradiance: std::array::from_fn(|k| direct[k] + reflected[k]),
        error,
    };
    shared.into_iter().map(sum).collect()
}

/// Number of unknowns of a fit: the value, its slopes along two directions of the surface, and its slopes by two components of the normal.
const UNKNOWNS: usize = 5;
/// Values of the unknowns' columns for one neighbour, and sums of them.
type Row = [f64; UNKNOWNS];

/// The fits of all windows around element `i`, and how they compare.
fn fit(
    places: &[Place],
    areas: &[f64],
    light: &[ElementLight],
    i: usize,
    found: &[(f32, u32)],
) -> (FittedIrradiance, Comparison) {
    let own = &places[i];
    let (x, y) = own.normal.any_orthonormal_pair();
    let scale = 1.0 / own.radius.max(f32::MIN_POSITIVE);
    // Normal equations, lower triangle; one right-hand side for each kind, half and channel.
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    let mut sides = [[[[0.0; UNKNOWNS]; 3]; 2]; KINDS];
    let (mut fits, mut compared) = (FittedIrradiance::default(), Comparison::default());
    let mut next = 0;
    for (w, &size) in WINDOWS.iter().enumerate() {
        while next < size.min(found.len()) {
            let j = found[next].1 as usize;
            next += 1;
            let offset = scale * (places[j].centre - own.centre);
            let turn = NORMAL_SCALE * places[j].normal;
            let row: Row = [1.0, offset.dot(x), offset.dot(y), turn.dot(x), turn.dot(y)].map(f64::from);
            let weight = f64::from(light[j].rays) * (areas[j] / areas[i]).min(1.0);
            let weighted = row.map(|v| weight * v);
            for (r, line) in matrix.iter_mut().enumerate() {
                (0..=r).for_each(|c| line[c] += row[r] * weighted[c]);
            }
            for (sides, halves) in sides.iter_mut().zip(&light[j].halves) {
                for (sides, value) in sides.iter_mut().zip(halves) {
                    for (side, v) in sides.iter_mut().zip(value.to_array()) {
                        side.iter_mut().zip(&weighted).for_each(|(s, w)| *s += f64::from(v) * w);
                    }
                }
            }
        }
        let first = first_row(&matrix, next);
        for (kind, sides) in sides.iter().enumerate() {
            let dot = |side: Row| side.iter().zip(&first).map(|(s, f)| s * f).sum::<f64>() as f32;
            let values = sides.map(|side| Vec3::from(side.map(dot)));
            let [a, b] = values.map(|v| v.element_sum() / 3.0);
            let [own_a, own_b] = light[i].halves[kind].map(|v| v.element_sum() / 3.0);
            fits[kind][w] = values;
            compared.crossed[kind][w] = 0.5 * ((a - own_b).powi(2) + (b - own_a).powi(2));
            compared.variance[kind][w] = 0.25 * (a - b).powi(2);
        }
    }
    (fits, compared)
}

/// The first row of the inverse of the normal equations: its product with a right-hand side is the value at the element
/// itself. With few neighbours the fit has fewer unknowns: a plane or a mean.
fn first_row(matrix: &[Row; UNKNOWNS], count: usize) -> Row {
    let weight = matrix[0][0].max(f64::MIN_POSITIVE);
    let unknowns = match count {
        0..MIN_FOR_PLANE => 1,
        MIN_FOR_PLANE..MIN_FOR_NORMALS => 3,
        _ => UNKNOWNS,
    };
    // Cholesky decomposition. The ridge term shrinks slopes that the neighbours hardly determine towards 0.
    let mut lower = *matrix;
    for r in 0..unknowns {
        if r > 0 {
            lower[r][r] += RIDGE * weight;
        }
        for c in 0..=r {
            let inner: f64 = (0..c).map(|k| lower[r][k] * lower[c][k]).sum();
            let rest = lower[r][c] - inner;
            lower[r][c] = if r == c { rest.max(1e-9 * weight).sqrt() } else { rest / lower[c][c] };
        }
    }
    let mut row = [0.0; UNKNOWNS];
    for r in 0..unknowns {
        let inner: f64 = (0..r).map(|k| lower[r][k] * row[k]).sum();
        row[r] = (if r == 0 { 1.0 } else { 0.0 } - inner) / lower[r][r];
    }
    for r in (0..unknowns).rev() {
        let inner: f64 = (r + 1..unknowns).map(|k| lower[k][r] * row[k]).sum();
        row[r] = (row[r] - inner) / lower[r][r];
    }
    row
}

/// Chooses the windows of an element from its own fits and the comparisons at the elements around.
fn choose(
    fits: &FittedIrradiance,
    around: &[u32],
    compared: &[Comparison],
    light: &[ElementLight],
    level: [f64; KINDS],
    i: usize,
) -> SharedKinds {
    let mut shared = SharedKinds::default();
    for (kind, level) in level.into_iter().enumerate() {
        let compared = MeanComparison::of(compared, light, around, kind, level.max(light[i].mean(kind)));
        let noise = compared.variance_of_rays(&light[i], kind);
        let value = |w: usize| f64::from(fits[kind][w].iter().sum::<Vec3>().element_sum()) / 6.0;
        let agrees = |w: &usize| {
            (value(*w) - value(0)).powi(2) <= MAX_DEVIATION * MAX_DEVIATION * (noise + compared.variance[*w])
        };
        let best = (0..WINDOWS.len())
            .filter(agrees)
            .min_by(|&a, &b| compared.crossed[a].total_cmp(&compared.crossed[b]))
            .unwrap_or(0);
        let [a, b] = fits[kind][best];
        shared.irradiance[kind] = (0.5 * (a + b)).to_array().map(f64::from);
        shared.error += if best == 0 { noise } else { compared.error(best) };
    }
    shared
}

/// The comparisons of windows, averaged over some neighbours by their rays.
struct MeanComparison {
    /// By window, the mean square difference of the fit to one half from the other half of the element's own rays.
    crossed: [f64; WINDOWS.len()],
    /// By window, the variance of the mean of both fits.
    variance: [f64; WINDOWS.len()],
    /// Variance of one ray.
    of_ray: f64,
}

impl MeanComparison {
    fn of(
        compared: &[Comparison],
        light: &[ElementLight],
        around: &[u32],
        kind: usize,
        level: f64,
    ) -> MeanComparison {
        let mut sums =
            MeanComparison { crossed: [0.0; WINDOWS.len()], variance: [0.0; WINDOWS.len()], of_ray: 0.0 };
        let mut rays = 0.0;
        for &j in around {
            let (windows, own) = (&compared[j as usize], &light[j as usize]);
            let weight = f64::from(own.rays);
            rays += weight;
            for w in 0..WINDOWS.len() {
                sums.crossed[w] += weight * f64::from(windows.crossed[kind][w]);
                sums.variance[w] += weight * f64::from(windows.variance[kind][w]);
            }
            sums.of_ray += 0.5 * f64::from(own.squares[kind]);
        }
        // One more ray might find the opposite of all others (Laplace's rule of succession).
        sums.of_ray += level * level;
        let scale = 1.0 / rays.max(1.0);
        MeanComparison {
            crossed: sums.crossed.map(|v| scale * v),
            variance: sums.variance.map(|v| scale * v),
            of_ray: scale * sums.of_ray,
        }
    }

    /// Variance of an element's mean from the spread of its own rays, mixed with that of the neighbours' rays.
    fn variance_of_rays(&self, light: &ElementLight, kind: usize) -> f64 {
        let rays = 2.0 * f64::from(light.rays);
        let spread = f64::from(light.squares[kind]) + NEIGHBOUR_RAYS * self.of_ray;
        spread / ((rays + NEIGHBOUR_RAYS) * rays.max(1.0))
    }

    /// Expected square of the error of a window: `crossed` is the sum of the squared bias, the variance of the fit to one half
    /// (twice that of the mean of both) and the noise of the other half (twice the variance of the first window).
    fn error(&self, window: usize) -> f64 {
        let variance = self.variance[window];
        let bias = self.crossed[window] - 2.0 * variance - 2.0 * self.variance[0];
        bias.max(0.0) + variance
    }
}

#[cfg(test)]
mod tests {
    use super::super::neighbours::Walls;
    use super::*;
    use crate::math::sampling::numbers;

    /// A floor of 40 by 40 squares with side 1 and the light of `of` at their centres, and noise of standard deviation `noise` in
    /// each half.
    fn floor(of: impl Fn(f32, f32) -> f32, noise: f32) -> (Vec<Place>, Vec<ElementLight>, Vec<f64>) {
        let (mut places, mut light, mut truth) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..1600u64 {
            let (x, y) = ((k % 40) as f32, (k / 40) as f32);
            places.push(Place {
                centre: Vec3::new(x, y, 0.0),
                normal: Vec3::Z,
                radius: 0.71,
                side: 0,
                free: 1.0,
            });
            // Uniform numbers have the variance 1/12.
            let [a, b, ..] = numbers(3, k).map(|u| of(x, y) + noise * 12f32.sqrt() * (u - 0.5));
            let halves = [[Vec3::splat(a), Vec3::splat(b)], [Vec3::ZERO; 2]];
            // 16 rays, each with four times the deviation of their mean.
            let squares = [32.0 * 16.0 * noise * noise, 0.0];
            light.push(ElementLight { rays: 16, halves, squares, ..ElementLight::default() });
            truth.push(f64::from(of(x, y)));
        }
        (places, light, truth)
    }

    fn errors(shared: &[SharedLight], truth: &[f64]) -> (f64, f64) {
        let n = truth.len() as f64;
        let squares = shared.iter().zip(truth).map(|(s, t)| (s.irradiance[0] - t).powi(2)).sum::<f64>() / n;
        (squares.sqrt(), (shared.iter().map(|s| s.error).sum::<f64>() / n).sqrt())
    }

    fn shared_on_one_side(places: &[Place], light: &[ElementLight]) -> Vec<SharedLight> {
        shared_beside(places, Walls::default(), light)
    }

    fn shared_beside(places: &[Place], walls: Walls, light: &[ElementLight]) -> Vec<SharedLight> {
        let sight = Sight { walls, blockers: None };
        share(
            places,
            &vec![1.0; places.len()],
            &sight,
            light,
            0.0,
            &Ranks::default(),
            &Deadline::start(&(), None),
        )
    }

    #[test]
    fn noise_of_smooth_light_is_divided_and_stated() {
        let noise = 0.2f32;
        let (places, light, truth) = floor(|x, y| 1.0 + 0.01 * x + 0.02 * y, noise);
        let (error, stated) = errors(&shared_on_one_side(&places, &light), &truth);
        // The mean of both halves has 0.141. A plane through 49 neighbours has a seventh of that, at borders more.
        assert!(error < 0.4 * 0.141, "{error}");
        assert!(stated > 0.5 * error && stated < 2.0 * error, "{stated} stated, {error} found");
    }

    /// Under the same light, irradiance on a rough surface is the dot product of normal and light vector: only noise is to be averaged.
    #[test]
    fn rough_surfaces_share_light_by_their_normals() {
        let (mut places, mut light, mut truth) = floor(|_, _| 0.0, 0.1);
        for (k, (place, light)) in places.iter_mut().zip(&mut light).enumerate() {
            let [u, v, ..] = numbers(5, k as u64);
            place.normal = Vec3::new(0.6 * (u - 0.5), 0.6 * (v - 0.5), 1.0).normalize();
            let exact = place.normal.dot(Vec3::new(0.5, -0.3, 1.0));
            light.halves[0].iter_mut().for_each(|half| *half += exact);
            truth[k] = f64::from(exact);
        }
        let shared = shared_on_one_side(&places, &light);
        let (error, stated) = errors(&shared, &truth);
        assert!(error < 0.6 * 0.071, "{error}");
        assert!(stated > 0.5 * error && stated < 2.0 * error, "{stated} stated, {error} found");
    }

    #[test]
    fn edges_of_shadows_stay_sharp() {
        let (places, light, truth) = floor(|x, _| if x < 20.0 { 1.0 } else { 0.1 }, 0.1);
        let shared = shared_on_one_side(&places, &light);
        let (error, _) = errors(&shared, &truth);
        assert!(error < 0.05, "{error}");
        for (k, s) in shared.iter().enumerate() {
            assert!(
                (s.irradiance[0] - truth[k]).abs() < 0.4,
                "element {k}: {} for {}",
                s.irradiance[0],
                truth[k]
            );
        }
    }

    /// A wall between the columns 19 and 20 of elements: the light behind it, a tenth less, stays apart from that before it, in noise of
    /// .3.
    #[test]
    fn nothing_is_shared_across_a_wall() {
        let (places, light, _) = floor(|x, _| if x < 20.0 { 1.0 } else { 0.9 }, 0.3);
        let before = |place: &&Place| place.centre.x == 19.0;
        let edge = |place: &Place| [-0.5, 0.5].map(|y| Vec3::new(19.5, place.centre.y + y, 0.0));
        let walls: Walls =
            (0..).zip(&places).filter(|(_, p)| before(p)).map(|(k, p)| (k, vec![edge(p)])).collect();
        let step = |shared: &[SharedLight]| {
            let of = |x: f32| {
                let column = places.iter().zip(shared).filter(|(p, _)| p.centre.x == x);
                column.map(|(_, light)| light.irradiance[0]).sum::<f64>() / 40.0
            };
            of(19.0) - of(20.0)
        };
        let shared = |walls| step(&shared_beside(&places, walls, &light));
        let [with, without] = [walls, Walls::default()].map(shared);
        assert!((with - 0.1).abs() < 0.05 && without < 0.06, "{with} {without}");
    }

    /// Windows in which no ray finds light have no noise, but the light of the side is not theirs alone. The light of a bright side beside
    /// it and noise below 0 change nothing of this.
    #[test]
    fn dim_sides_keep_the_power_of_rare_light() {
        let (mut places, mut light, _) = floor(|_, _| -0.1, 0.2);
        let (bright, of_bright, _) = floor(|_, _| 100.0, 20.0);
        for (k, of) in light.iter_mut().enumerate() {
            let rare = numbers(5, k as u64).map(|u| if u < 0.05 { 20.0 } else { 0.0 });
            of.halves[REFLECTED] = [Vec3::splat(rare[0]), Vec3::splat(rare[1])];
        }
        places.extend(bright.into_iter().map(|place| Place {
            side: 1,
            centre: place.centre + 100.0 * Vec3::X,
            ..place
        }));
        light.extend(of_bright);
        let shared = shared_on_one_side(&places, &light);
        let own = light.iter().map(|of| of.mean(DIRECT) + of.mean(REFLECTED));
        let [own, shared]: [Vec<f64>; 2] =
            [own.collect(), shared.iter().map(|of| of.irradiance[0]).collect()];
        for side in [0..1600, 1600..3200] {
            let [own, shared] = [&own, &shared].map(|of| of[side.clone()].iter().sum::<f64>());
            assert!((shared / own - 1.0).abs() < 3e-3, "{shared} instead of {own}");
        }
    }

    #[test]
    fn a_single_dark_element_stays_dark() {
        let (places, mut light, _) = floor(|_, _| 1.0, 0.1);
        light[820] = ElementLight { rays: 16, ..ElementLight::default() };
        let shared = shared_on_one_side(&places, &light);
        assert!(shared[820].irradiance[0] < 0.05, "{:?}", shared[820]);
        assert!((shared[821].irradiance[0] - 1.0).abs() < 0.3, "{:?}", shared[821]);
    }
}
