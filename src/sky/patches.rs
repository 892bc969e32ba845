//! A hierarchy of patches over the sky and the ground below the horizon.
//!
//! The children of a patch have equal solid angles. Patches at the zenith and the nadir are triangles: their children are a triangle of
//! the same azimuths with a quarter of the solid angle, and the rest in three parts side by side, so that triangles keep their shape.
//! Other patches split into two by two, or into four along the longer side if it is more than twice the other.

use super::cells::GroundRadiance;
use super::cosine::Extent;
use super::frame::Frame;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

/// Levels below a hemisphere with detail: 4⁷ patches of 1.1° on a side. A further level would take four times the memory and the time;
/// smaller details count by the samples of a patch, see [`MAX_SAMPLES`].
const LEVELS: u32 = 7;
/// Levels below a hemisphere of uniform radiance: 256 patches of 9° on a side, which only receivers and blockers require.
const UNIFORM_LEVELS: u32 = 4;
/// Most samples along a side of a finest patch, of which there are two for each texel of a map of up to 5,000 columns.
const MAX_SAMPLES: usize = 32;
/// Samples along a side without a map. They give means to 1e-4 where the radiance falls by 8 % over a patch.
const SAMPLES: usize = 4;

/// A part of the sky or of the ground below the horizon, seen from any point of the scene.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Ranges of height and azimuth in local directions (east, north, up).
    pub extent: Extent,
    /// Solid angle, sr.
    pub solid_angle: f64,
    /// Mean radiance, W/(m² sr).
    pub mean: [f64; 3],
    /// Smallest radiance among the samples of its finest patches.
    pub min: [f64; 3],
    /// Largest radiance among the samples of its finest patches.
    pub max: [f64; 3],
    /// Unit vector in scene coordinates: axis of the cone that contains the patch.
    pub axis: DVec3,
    /// Half angle of this cone, radians.
    pub half_angle: f64,
    /// Integral of the unit vector over the patch, sr, scene coordinates.
    pub moment: DVec3,
    /// By channel, integral of radiance times the unit vector, by the mean radiance of its finest patches; W/m², scene coordinates.
    pub flow: [DVec3; 3],
    /// First child; 0 at the finest level.
    first_child: u32,
}

/// All patches, parents before children.
#[derive(Clone, Debug)]
pub struct Patches {
    frame: Frame,
    patches: Vec<Patch>,
    roots: u32,
}

/// Children of a patch that has any.
const CHILDREN: u32 = 4;

impl Patches {
    /// Patches of `radiance` by local directions: of the upper half, and of the lower half unless it is black, with fewer levels if it is
    /// uniform. `detail` is the angle between texels of a map, `peak` a direction of sharp maximum.
    pub(super) fn new(
        frame: Frame,
        lower: GroundRadiance,
        detail: Option<f64>,
        peak: Option<DVec3>,
        radiance: impl Fn(DVec3) -> [f64; 3],
    ) -> Patches {
        let mut patches = Patches { frame, patches: Vec::new(), roots: 0 };
        let mut halves = vec![(1.0, LEVELS)];
        match lower {
            GroundRadiance::Black => {}
            GroundRadiance::Uniform => halves.push((-1.0, UNIFORM_LEVELS)),
            GroundRadiance::Detailed => halves.push((-1.0, LEVELS)),
        }
        for (side, _) in &halves {
            let z = if *side > 0.0 { [0.0, 1.0] } else { [-1.0, 0.0] };
            patches.push(Extent { z, v: [0.0, TAU] });
        }
        patches.roots = patches.patches.len() as u32;
        let mut level: Vec<(u32, u32)> =
            halves.iter().zip(0..).map(|((_, levels), k)| (k, *levels)).collect();
        while !level.is_empty() {
            let mut next = Vec::new();
            for (k, levels) in level {
                if levels == 0 {
                    patches.sample(k, detail, peak, &radiance);
                    continue;
                }
                let first = patches.patches.len() as u32;
                patches.patches[k as usize].first_child = first;
                for extent in split(&patches.patches[k as usize].extent) {
                    patches.push(extent);
                }
                next.extend((first..first + CHILDREN).map(|k| (k, levels - 1)));
            }
            level = next;
        }
        patches.pull();
        patches
    }

    fn push(&mut self, extent: Extent) {
        let moment = extent.moment();
        let local_axis = match moment.try_normalize() {
            Some(axis) if extent.turn() < TAU => axis,
            _ => DVec3::Z * (extent.z[0] + extent.z[1]).signum(),
        };
        // With at most half a turn the directions that are farthest from the axis are corners; with a whole turn the axis is vertical.
        let corners = [0.0, 1.0].into_iter().flat_map(|s| [0.0, 1.0].map(|t| extent.at(s, t)));
        let half_angle =
            corners.map(|c| 2.0 * (0.5 * c.distance(local_axis)).min(1.0).asin()).fold(0.0, f64::max);
        self.patches.push(Patch {
            solid_angle: extent.solid_angle(),
            mean: [0.0; 3],
            min: [f64::INFINITY; 3],
            max: [0.0; 3],
            axis: self.frame.world(local_axis),
            half_angle,
            moment: self.frame.world(moment),
            flow: [DVec3::ZERO; 3],
            first_child: 0,
            extent,
        });
    }

    /// Radiance of a finest patch.
    fn sample(
        &mut self,
        k: u32,
        detail: Option<f64>,
        peak: Option<DVec3>,
        radiance: &impl Fn(DVec3) -> [f64; 3],
    ) {
        let patch = &mut self.patches[k as usize];
        let extent = patch.extent;
        let texels = detail.map_or(SAMPLES as f64, |step| 2.0 * patch.solid_angle.sqrt() / step);
        let n = (texels.ceil() as usize).clamp(SAMPLES, MAX_SAMPLES);
        let part = |k: usize| (k as f64 + 0.5) / n as f64;
        let mut take = |value: [f64; 3], weight: f64| {
            for (c, value) in value.into_iter().enumerate() {
                patch.mean[c] += weight * value;
                patch.min[c] = patch.min[c].min(value);
                patch.max[c] = patch.max[c].max(value);
            }
        };
        for k in 0..n * n {
            take(radiance(extent.at(part(k / n), part(k % n))), 1.0 / (n * n) as f64);
        }
        // Bounds take corners, too, moved inside so that those at the horizon are on the patch's side of it.
        for (s, t) in [(1e-9, 0.0), (1e-9, 1.0), (1.0 - 1e-9, 0.0), (1.0 - 1e-9, 1.0)] {
            take(radiance(extent.at(s, t)), 0.0);
        }
        if let Some(peak) = peak.filter(|p| extent.contains(*p)) {
            take(radiance(peak), 0.0);
        }
    }

    /// Means and bounds of parents from their children.
    fn pull(&mut self) {
        for k in (0..self.patches.len()).rev() {
            let children = self.children(k as u32);
            if children.is_empty() {
                let patch = &mut self.patches[k];
                patch.flow = patch.mean.map(|l| l * patch.moment);
                continue;
            }
            let mut flow = [DVec3::ZERO; 3];
            let (mut mean, mut min, mut max) = ([0.0; 3], [f64::INFINITY; 3], [0.0f64; 3]);
            for child in &self.patches[children.start as usize..children.end as usize] {
                for c in 0..3 {
                    flow[c] += child.flow[c];
                    mean[c] += child.mean[c] / f64::from(CHILDREN);
                    min[c] = min[c].min(child.min[c]);
                    max[c] = max[c].max(child.max[c]);
                }
            }
            let patch = &mut self.patches[k];
            (patch.mean, patch.min, patch.max, patch.flow) = (mean, min, max, flow);
        }
    }

    /// The same with all radiance times a factor of at least 0.
    pub(super) fn scaled(&self, factor: f64) -> Patches {
        let mut scaled = self.clone();
        for patch in &mut scaled.patches {
            for values in [&mut patch.mean, &mut patch.min, &mut patch.max] {
                *values = values.map(|l| factor * l);
            }
            patch.flow = patch.flow.map(|f| factor * f);
        }
        scaled
    }

    /// The patches that no other contains: the upper half, then the lower half unless it is black.
    pub fn roots(&self) -> Range<u32> {
        0..self.roots
    }

    /// All patches.
    pub fn all(&self) -> &[Patch] {
        &self.patches
    }

    /// A patch.
    pub fn patch(&self, k: u32) -> &Patch {
        &self.patches[k as usize]
    }

    /// A direction of a patch as a unit vector in scene coordinates, uniform by solid angle for `u` in the unit square.
    pub fn direction(&self, k: u32, [s, t]: [f64; 2]) -> DVec3 {
        self.frame.world(self.patch(k).extent.at(s, t))
    }

    /// Smallest sine of the elevation of a patch above the horizontal plane, in `[-1, 1]`.
    pub fn lowest(&self, k: u32) -> f64 {
        self.patch(k).extent.z[0]
    }

    /// The children of a patch, which have equal solid angles; none at the finest level.
    pub fn children(&self, k: u32) -> Range<u32> {
        match self.patches[k as usize].first_child {
            0 => 0..0,
            first => first..first + CHILDREN,
        }
    }

    /// The patch of the finest level that contains a unit vector in scene coordinates; none on a black side.
    pub fn find(&self, direction: DVec3) -> Option<u32> {
        let local = self.frame.local(direction);
        let mut at = self.roots().find(|k| (self.patch(*k).extent.z[1] > 0.0) == (local.z > 0.0))?;
        loop {
            let children = self.children(at);
            if children.is_empty() {
                return Some(at);
            }
            // On an edge rounding may leave a direction in none of them.
            let nearest = |k: &u32| -self.patch(*k).axis.dot(direction);
            let next = children.clone().find(|k| self.patch(*k).extent.contains(local));
            at = next.or_else(|| children.min_by(|a, b| nearest(a).total_cmp(&nearest(b))))?;
        }
    }

    /// Cosine-weighted solid angle of a patch on a receiver with a unit normal in scene coordinates, sr, without the part below the
    /// receiver's horizon. The irradiance is this times the radiance. Exact to 1e-6.
    pub fn projected(&self, k: u32, normal: DVec3) -> f64 {
        let patch = self.patch(k);
        // Angle between the axis and the receiver's horizon.
        let above = patch.axis.dot(normal).clamp(-1.0, 1.0).asin();
        if above >= patch.half_angle {
            patch.moment.dot(normal).max(0.0)
        } else if above <= -patch.half_angle {
            0.0
        } else {
            patch.extent.projected(self.frame.local(normal))
        }
    }

    /// Irradiance of a plane with a unit normal in scene coordinates, W/m², by the mean radiance of the finest patches. Patches on the
    /// plane's horizon are not clipped if all their light gives a plane at most a fraction `detail` of the irradiance of a horizontal one
    /// when they are half the side of a square above its horizon. Each then errs by less than half of that, most by a tenth.
    pub fn irradiance_to(&self, detail: f64, normal: DVec3) -> [f64; 3] {
        let of = |c: usize| self.roots().map(|k| self.patch(k).flow[c].dot(self.frame.up).abs()).sum::<f64>();
        let tolerance = [0, 1, 2].map(|c| detail * of(c));
        let mut sum = [0.0; 3];
        self.roots().for_each(|k| self.add_irradiance(k, normal, tolerance, &mut sum));
        sum
    }

    /// Contribution of one patch to [`Patches::irradiance_to`] with a detail of 0.
    pub fn irradiance_of(&self, k: u32, normal: DVec3) -> [f64; 3] {
        let mut sum = [0.0; 3];
        self.add_irradiance(k, normal, [0.0; 3], &mut sum);
        sum
    }

    fn add_irradiance(&self, k: u32, normal: DVec3, tolerance: [f64; 3], sum: &mut [f64; 3]) {
        let (patch, children) = (self.patch(k), self.children(k));
        // The sine, which is never larger than the angle: some patches that just touch the horizon count as cut, too.
        let above = patch.axis.dot(normal);
        if above <= -patch.half_angle {
            return;
        }
        if above >= patch.half_angle {
            (0..3).for_each(|c| sum[c] += patch.flow[c].dot(normal).max(0.0));
            return;
        }
        let half_side = 0.5 * patch.solid_angle.sqrt();
        let spread = |c: usize| half_side * patch.solid_angle * patch.mean[c];
        let is_even = || (0..3).all(|c| patch.max[c] <= patch.min[c]);
        if (0..3).all(|c| spread(c) <= tolerance[c]) {
            (0..3).for_each(|c| sum[c] += mean_above(patch.flow[c].dot(normal), spread(c)));
        } else if children.is_empty() || is_even() {
            let projected = self.projected(k, normal);
            (0..3).for_each(|c| sum[c] += projected * patch.mean[c]);
        } else {
            children.for_each(|child| self.add_irradiance(child, normal, tolerance, sum));
        }
    }
}

/// Mean of max(x, 0) for x in equal parts from `middle` − `spread` to `middle` + `spread`: irradiance by a patch with light in equal
/// parts from these heights above the plane. It is right on average over the places of a square patch on the horizon.
fn mean_above(middle: f64, spread: f64) -> f64 {
    if middle.abs() < spread { (middle + spread).powi(2) / (4.0 * spread) } else { middle.max(0.0) }
}

/// Four parts of equal solid angle.
fn split(extent: &Extent) -> [Extent; 4] {
    let Extent { z: [z0, z1], v: [v0, v1] } = *extent;
    let z = |t: f64| if t == 1.0 { z1 } else { z0 + t * (z1 - z0) };
    let v = |t: f64| if t == 1.0 { v1 } else { v0 + t * (v1 - v0) };
    let part = |a: f64, b: f64, s: f64, t: f64| Extent { z: [z(a), z(b)], v: [v(s), v(t)] };
    let slices = [(0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0)];
    let thirds = [(0.0, 1.0 / 3.0), (1.0 / 3.0, 2.0 / 3.0), (2.0 / 3.0, 1.0)];
    // A whole or half turn first becomes slices.
    if extent.turn() > FRAC_PI_2 {
        return slices.map(|(s, t)| part(0.0, 1.0, s, t));
    }
    if z1 == 1.0 || z0 == -1.0 {
        let (tip, rest) = if z1 == 1.0 { ((0.75, 1.0), (0.0, 0.75)) } else { ((0.0, 0.25), (0.25, 1.0)) };
        let [a, b, c] = thirds.map(|(s, t)| part(rest.0, rest.1, s, t));
        return [part(tip.0, tip.1, 0.0, 1.0), a, b, c];
    }
    let middle = 0.5 * (z0 + z1);
    let width = extent.turn() * (1.0 - middle * middle).sqrt();
    let height = z1.asin() - z0.asin();
    if width > 2.0 * height {
        slices.map(|(s, t)| part(0.0, 1.0, s, t))
    } else if height > 2.0 * width {
        slices.map(|(a, b)| part(a, b, 0.0, 1.0))
    } else {
        [(0.0, 0.5, 0.0, 0.5), (0.0, 0.5, 0.5, 1.0), (0.5, 1.0, 0.0, 0.5), (0.5, 1.0, 0.5, 1.0)]
            .map(|(a, b, s, t)| part(a, b, s, t))
    }
}
