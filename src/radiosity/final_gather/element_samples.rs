//! Estimates of one element's irradiance from its own rays, in two independent halves.

use super::gatherer::RayResult;
use glam::Vec3;

/// The two kinds of light that are estimated and shared separately: direct light has shadow edges, reflected light is smooth.
pub const KINDS: usize = 2;
/// Index of direct light.
pub const DIRECT: usize = 0;
/// Index of reflected light.
pub const REFLECTED: usize = 1;

/// Irradiance of one leaf by its own rays.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize, serde::Serialize)]
pub struct ElementLight {
    /// Rays of each half.
    pub rays: u32,
    /// By kind (direct, reflected) and half, W/m².
    pub halves: [[Vec3; 2]; KINDS],
    /// By kind, sum over all rays of the squared difference from the mean, mean over the channels, (W/m²)².
    pub squares: [f32; KINDS],
}

impl ElementLight {
    /// Irradiance of a kind, mean over halves and channels, W/m².
    pub fn mean(&self, kind: usize) -> f64 {
        f64::from(self.halves[kind].iter().sum::<Vec3>().element_sum()) / 6.0
    }

    /// Multiplies the light of a kind by a factor.
    pub fn scale(&mut self, kind: usize, factor: f32) {
        self.halves[kind].iter_mut().for_each(|e| *e *= factor);
        self.squares[kind] *= factor * factor;
    }

    /// Direct light as the mean of what all rays have found.
    pub fn direct_of_rays(&mut self, half: usize, results: &[RayResult]) {
        let mut squares = 0.0;
        for (h, results) in results.chunks(half).enumerate() {
            self.halves[DIRECT][h] = results.iter().map(|r| r.direct).sum::<Vec3>() / half as f32;
            squares += results.iter().map(|r| (r.direct.element_sum() / 3.0).powi(2)).sum::<f32>();
        }
        let mean = self.halves[DIRECT].iter().sum::<Vec3>().element_sum() / 6.0;
        self.squares[DIRECT] = (squares - 2.0 * half as f32 * mean * mean).max(0.0);
    }

    /// Direct light as the light without blockers, `free`, times the visible part of it: a ratio of two sums over the rays, which has
    /// no noise where all rays or none are blocked.
    pub fn direct_of_fraction(&mut self, free: Vec3, half: usize, parts: &[(Vec3, f32)]) {
        let ratio = |parts: &[(Vec3, f32)]| {
            let all: Vec3 = parts.iter().map(|p| p.0).sum();
            let seen: Vec3 = parts.iter().map(|p| p.1 * p.0).sum();
            (all, seen / all.max(Vec3::splat(f32::MIN_POSITIVE)))
        };
        let (all, joint) = ratio(parts);
        let joint = Vec3::select(all.cmpgt(Vec3::ZERO), joint, Vec3::ONE);
        for (h, parts) in parts.chunks(half).enumerate() {
            // A half without a sample above the horizon has the ratio of both halves.
            let (all, own) = ratio(parts);
            self.halves[DIRECT][h] = free * Vec3::select(all.cmpgt(Vec3::ZERO), own, joint);
        }
        let seen = (free * joint).element_sum() / free.element_sum().max(f32::MIN_POSITIVE);
        let weights = || parts.iter().map(|p| (p.0.element_sum(), p.1));
        let all: f32 = weights().map(|(w, _)| w).sum();
        let squares: f32 = weights().map(|(w, through)| (w * (through - seen)).powi(2)).sum();
        let n = parts.len() as f32;
        let level = free.element_sum() / 3.0;
        self.squares[DIRECT] = if all > 0.0 { n * n * level * level * (squares / all) / all } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_visible_part_is_a_ratio_of_sums() {
        let mut light = ElementLight { rays: 2, ..ElementLight::default() };
        let w = |w: f32, through: f32| (Vec3::splat(w), through);
        light.direct_of_fraction(Vec3::splat(8.0), 2, &[w(1.0, 1.0), w(3.0, 0.0), w(0.0, 0.0), w(0.0, 0.0)]);
        // The second half has no sample of its own.
        assert_eq!(light.halves[DIRECT], [Vec3::splat(2.0); 2]);
        let mut free = ElementLight { rays: 2, ..ElementLight::default() };
        free.direct_of_fraction(Vec3::splat(8.0), 2, &[w(1.0, 1.0), w(3.0, 1.0), w(2.0, 1.0), w(1.0, 1.0)]);
        assert_eq!((free.halves[DIRECT], free.squares[DIRECT]), ([Vec3::splat(8.0); 2], 0.0));
    }
}
