//! Estimates of one element's irradiance from its own rays, in two halves.

use super::gatherer::RayResult;
use crate::radiosity::rgb::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// The two kinds of light that are estimated and shared separately: direct light has shadow edges, reflected light is smooth.
pub const KINDS: usize = 2;
/// Index of direct light.
pub const DIRECT: usize = 0;
/// Index of reflected light.
pub const REFLECTED: usize = 1;

/// Light of emitters along the rays from one point of a leaf, over their density, W/m².
#[derive(Clone, Copy, Default)]
pub struct DirectRay {
    /// Unoccluded light.
    pub free: Vec3,
    /// Light that arrives.
    pub seen: Vec3,
}

/// Irradiance of one leaf by its own rays.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize, serde::Serialize)]
pub struct ElementLight {
    /// Rays of each half.
    pub rays: u32,
    /// By kind (direct, reflected) and half, W/m².
    pub halves: [[Vec3; 2]; KINDS],
    /// By kind, sum over all rays of the squared difference from the mean, mean over the channels, (W/m²)².
    pub squares: [f32; KINDS],
    /// Irradiance of suns (included in the direct light) and of the sky (included in the reflected light), mean over the halves, W/m².
    pub sun: Vec3,
    pub sky: Vec3,
    /// Variance of direct light over the element, estimated from its quarters; mean over the channels, (W/m²)².
    pub variance_over_quarters: f32,
}

/// Parts of an element whose light is compared.
const QUARTERS: usize = 4;
/// Smallest ratio of the variance between quarters to the variance expected from the noise of their rays. With 2 and with 4, the exported
/// mesh of an office errs by 9.5 % and 10.8 % at points, that of a valley by 3.4 and 3.5 % (`scenes/room.py SCENE --elements 2000`).
const MIN_RATIO: f32 = 2.0;

/// A ray in the comparison of quarters: the number of its quarter, its weight, and the light that it has found, W/m².
pub type QuarterRay = (u8, f32, f32);

/// The variance of light between the quarters of an element, (W/m²)², less what noise adds; 0 where noise explains it.
pub fn variance_of_quarters(rays: impl Iterator<Item = QuarterRay>) -> f32 {
    // By quarter, sums of weights, of their squares, and of light and its squares by weight.
    let mut quarters = [[0.0; 4]; QUARTERS];
    for (quarter, weight, light) in rays {
        let of_ray = [weight, weight * weight, weight * light, weight * light * light];
        quarters[usize::from(quarter)].iter_mut().zip(of_ray).for_each(|(sum, v)| *sum += v);
    }
    let (mut count, mut sum, mut squares, mut noise) = (0.0, 0.0, 0.0, 0.0);
    for [weight, squared_weights, light, squared_light] in quarters.into_iter().filter(|q| q[0] > 0.0) {
        let mean = light / weight;
        let rays = weight * weight / squared_weights;
        let spread = (squared_light / weight - mean * mean).max(0.0);
        (count, sum, squares) = (count + 1.0, sum + mean, squares + mean * mean);
        noise += spread / (rays - 1.0).max(1.0);
    }
    if count < 2.0 {
        return 0.0;
    }
    let between = squares / count - (sum / count).powi(2);
    let of_noise = noise * (count - 1.0) / (count * count);
    if between > MIN_RATIO * of_noise { between - of_noise } else { 0.0 }
}

impl ElementLight {
    /// Irradiance of a kind, mean over halves and channels, W/m².
    pub fn mean(&self, kind: usize) -> f64 {
        f64::from(self.halves[kind].iter().sum::<Vec3>().element_sum()) / 6.0
    }

    /// Variance of the mean light of a kind by the spread of its rays, (W/m²)².
    pub fn variance_of_mean(&self, kind: usize) -> f64 {
        f64::from(self.squares[kind]) / f64::from(2 * self.rays.max(1)).powi(2)
    }

    /// Multiplies the light of a kind by a factor for each channel; the light of suns and sky does not change.
    pub fn scale(&mut self, kind: usize, factor: Vec3) {
        let beyond = if kind == DIRECT { self.sun } else { self.sky };
        self.halves[kind].iter_mut().for_each(|e| *e = beyond + factor * (*e - beyond));
        self.squares[kind] *= (factor.element_sum() / 3.0).powi(2);
    }

    /// Irradiance of a kind by channel, mean over halves, W/m².
    pub fn by_channel(&self, kind: usize) -> Rgb {
        (0.5 * (self.halves[kind][0] + self.halves[kind][1])).to_array().map(f64::from)
    }

    /// Sets direct light to the mean over all rays.
    pub fn direct_of_rays(&mut self, half: usize, results: &[RayResult]) {
        let mut squares = 0.0;
        for (h, results) in results.chunks(half).enumerate() {
            self.halves[DIRECT][h] = results.iter().map(|r| r.direct).sum::<Vec3>() / half as f32;
            squares += results.iter().map(|r| (r.direct.element_sum() / 3.0).powi(2)).sum::<f32>();
        }
        let mean = self.halves[DIRECT].iter().sum::<Vec3>().element_sum() / 6.0;
        self.squares[DIRECT] = (squares - 2.0 * half as f32 * mean * mean).max(0.0);
    }

    /// Adds the light of suns to direct light, and stores the light of suns and sky. `quarters` are those of the rays.
    pub fn add_beyond(&mut self, half: usize, quarters: &[u8], results: &[RayResult]) {
        let level = |r: &RayResult| r.sun.element_sum() / 3.0;
        let count = results.len() as f32;
        self.sun = results.iter().map(|r| r.sun).sum::<Vec3>() / count;
        self.sky = results.iter().map(|r| r.sky).sum::<Vec3>() / count;
        for (light, results) in self.halves[DIRECT].iter_mut().zip(results.chunks(half)) {
            *light += results.iter().map(|r| r.sun).sum::<Vec3>() / half as f32;
        }
        let mean = self.sun.element_sum() / 3.0;
        self.squares[DIRECT] += results.iter().map(|r| (level(r) - mean).powi(2)).sum::<f32>();
        let of = |(&quarter, result): (&u8, &RayResult)| (quarter, 1.0, level(result));
        self.variance_over_quarters += variance_of_quarters(quarters.iter().zip(results).map(of));
    }

    /// Direct light as the light without blockers, `free`, times the visible fraction of it: a ratio of two sums over the rays, which has
    /// no noise where all rays or none are blocked.
    pub fn direct_of_fraction(&mut self, free: Vec3, half: usize, rays: &[DirectRay]) {
        let ratio = |rays: &[DirectRay]| {
            let all: Vec3 = rays.iter().map(|ray| ray.free).sum();
            let seen: Vec3 = rays.iter().map(|ray| ray.seen).sum();
            (all, seen / all.max(Vec3::splat(f32::MIN_POSITIVE)))
        };
        // Without any sample above the horizon nothing is known of blockers: the element counts as dark, so that no light passes a wall.
        let (_, joint) = ratio(rays);
        for (h, rays) in rays.chunks(half).enumerate() {
            // A half without a sample above the horizon has the ratio of both halves.
            let (all, own) = ratio(rays);
            self.halves[DIRECT][h] = free * Vec3::select(all.cmpgt(Vec3::ZERO), own, joint);
        }
        let part = (free * joint).element_sum() / free.element_sum().max(f32::MIN_POSITIVE);
        let all: f32 = rays.iter().map(|ray| ray.free.element_sum()).sum();
        let difference = |ray: &DirectRay| ray.seen.element_sum() - part * ray.free.element_sum();
        let squares: f32 = rays.iter().map(|ray| difference(ray).powi(2)).sum();
        let n = rays.len() as f32;
        let level = free.element_sum() / 3.0;
        self.squares[DIRECT] = if all > 0.0 { n * n * level * level * (squares / all) / all } else { 0.0 };
    }
}

/// Irradiance of an element after sharing.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SharedLight {
    /// W/m².
    pub irradiance: Rgb,
    /// Expected square of the error of the mean over the channels, (W/m²)².
    pub error: f64,
}

impl SharedLight {
    /// The light of an element by its own rays alone.
    pub fn alone(light: &ElementLight) -> SharedLight {
        let sum = light.halves.iter().flatten().map(|half| 0.5 * *half).sum::<Vec3>();
        let error = light.variance_of_mean(DIRECT) + light.variance_of_mean(REFLECTED);
        SharedLight { irradiance: sum.to_array().map(f64::from), error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sampling::numbers;

    /// Quarters that see different parts of the light have their variance; noise alone has none.
    #[test]
    fn quarters_are_compared_beyond_their_noise() {
        let rays = |dark: u8| (0..32u8).map(move |k| (k % 4, 1.0, if k % 4 < dark { 0.0 } else { 2.0 }));
        assert_eq!(variance_of_quarters(rays(0)), 0.0);
        assert!((variance_of_quarters(rays(2)) - 1.0).abs() < 1e-6);
        assert!((variance_of_quarters(rays(1)) - 0.75).abs() < 1e-6);
        let split = (0..1000u64)
            .filter(|&seed| {
                let of = |k: u64| (k as u8 % 4, 1.0, numbers(seed, k)[0].round());
                variance_of_quarters((0..32).map(of)) > 0.0
            })
            .count();
        // Of a ratio that is chi-squared with three degrees of freedom over three, 11 % lie above 2.
        assert!((60..180).contains(&split), "{split}");
        assert_eq!(variance_of_quarters([(1, 1.0, 3.0), (1, 1.0, 0.0)].into_iter()), 0.0);
    }

    #[test]
    fn the_visible_part_is_a_ratio_of_sums() {
        let mut light = ElementLight { rays: 2, ..ElementLight::default() };
        let w = |w: f32, through: f32| DirectRay { free: Vec3::splat(w), seen: Vec3::splat(through * w) };
        light.direct_of_fraction(Vec3::splat(8.0), 2, &[w(1.0, 1.0), w(3.0, 0.0), w(0.0, 0.0), w(0.0, 0.0)]);
        // The second half has no sample of its own.
        assert_eq!(light.halves[DIRECT], [Vec3::splat(2.0); 2]);
        let mut free = ElementLight { rays: 2, ..ElementLight::default() };
        free.direct_of_fraction(Vec3::splat(8.0), 2, &[w(1.0, 1.0), w(3.0, 1.0), w(2.0, 1.0), w(1.0, 1.0)]);
        assert_eq!((free.halves[DIRECT], free.squares[DIRECT]), ([Vec3::splat(8.0); 2], 0.0));
    }
}
