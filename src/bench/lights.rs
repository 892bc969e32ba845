//! Sources of light of a workload: surfaces that emit, suns, and patches of the sky.
//!
//! Patches are those of [`Environment::patches`] at the first level at which the cone around a patch is at most [`MAX_HALF_ANGLE`] wide to
//! each side of its axis; black ones are left out. A segment to a patch or a sun ends at a distance L in a direction of it, and the engines
//! take the width of the source for that of an emitter of α L there: a blocker of width b at a distance d from the receiver then has
//! an umbra of (b − α d) · L / (L − d), that of a source at infinity as L grows. It is nowhere smaller, so that nothing is averaged that a
//! source at infinity would show.
//!
//! A luminous dome is divided in the same way: its parts are surfaces that are asked like patches.

use super::record::SkySources;
use crate::math::Aabb;
use crate::model::Model;
use crate::scene::{Emitter, EmitterSampler, Scene};
use crate::sky::Environment;
use glam::{DVec2, DVec3, Vec3};
use std::sync::Arc;

/// Largest half angle of a patch, radians: 16°, with which a hemisphere has 64 patches. Surfaces of rooms and streets that emit
/// are seen as wide: a window of a metre from two metres.
const MAX_HALF_ANGLE: f64 = 16.0 * std::f64::consts::PI / 180.0;
/// Patches that are asked from a receiver point: as many pairs as with four lamps, so that a run takes minutes, not an hour.
const PATCHES_PER_POINT: usize = 4;
/// L in diagonals of the scene: an umbra is at most a third larger than that of a source at infinity, at the far end of the scene. With
/// more rounding errors of parameters along a segment grow.
const SOURCE_DISTANCE: f32 = 4.0;
/// Samples along each side of a patch that find whether a receiver sees any of it: pieces below 1/16 of a patch lie within 2° of the
/// horizon, with a cosine of at most 0.04.
const SAMPLES_PER_SIDE: usize = 4;

/// Steps along each edge of a source for the box around it.
const STEPS_PER_EDGE: usize = 64;
/// Distance by which the edge may lie outside between two of these steps, in units of the sine of the half angle: of a disc 1 − cos(π /
/// 64) = 0.0012, of patches less.
const SAGITTA: f64 = 0.002;

/// Patches of the sky to which a workload traces segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PatchSet {
    /// A few per point, drawn in proportion to their irradiance at the point.
    Some,
    /// All patches that are above the horizon of the point, at least partly.
    #[cfg(test)]
    All,
    /// None; in scenes without other light that with the largest irradiance of a horizontal plane.
    Shown,
}

/// A source of light.
#[derive(Clone, Debug)]
pub(super) enum Light {
    Surface(EmitterSampler),
    Distant(Distant),
}

#[derive(Clone, Copy, Debug)]
enum Place {
    Patch(u32),
    Sun(usize),
}

/// A patch of the sky or a sun.
#[derive(Clone, Debug)]
pub(super) struct Distant {
    environment: Arc<Environment>,
    place: Place,
    /// Smallest width of the source as the chord at the distance L, and L; scene units.
    size: f32,
    length: f32,
    /// Integral of radiance times direction over a patch; zero for a sun.
    moment: DVec3,
    /// Corners of a box around all ends, relative to the start of the segments.
    corners: [Vec3; 8],
}

impl Distant {
    fn new(environment: Arc<Environment>, place: Place, angle: f64, length: f32) -> Distant {
        let moment = match place {
            Place::Patch(k) => moment(&environment, k),
            Place::Sun(_) => DVec3::ZERO,
        };
        let (size, corners) = (chord(angle, length), [Vec3::ZERO; 8]);
        let mut distant = Distant { environment, place, size, length, moment, corners };
        distant.corners = distant.around().map(|corner| length * corner.as_vec3());
        distant
    }

    /// Corners of a box around its directions.
    fn around(&self) -> [DVec3; 8] {
        let (axis, half_angle) = match self.place {
            Place::Patch(k) => {
                let patch = &self.environment.patches().all()[k as usize];
                (patch.axis, patch.half_angle)
            }
            Place::Sun(k) => {
                (self.environment.suns()[k].direction, 0.5 * self.environment.suns()[k].diameter)
            }
        };
        let up = self.environment.frame().up;
        let x = up.cross(axis).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        let y = axis.cross(x);
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        // The edge of a disc and of a patch; no direction inside is farther along x or y, which are perpendicular to the axis.
        for k in 0..=STEPS_PER_EDGE {
            let t = k as f64 / STEPS_PER_EDGE as f64;
            let edge = match self.place {
                Place::Patch(_) => vec![[0.0, t], [1.0, t], [t, 0.0], [t, 1.0]],
                Place::Sun(_) => vec![[1.0, t]],
            };
            for u in edge {
                let direction = self.direction_of(u);
                let at = DVec2::new(direction.dot(x), direction.dot(y));
                (low, high) = (low.min(at), high.max(at));
            }
        }
        let margin = DVec2::splat(SAGITTA * half_angle.sin() + 1e-6);
        let [low, high] = [low - margin, high + margin];
        let depths = [half_angle.cos() - 1e-6, 1.0 + 1e-6];
        std::array::from_fn(|k| {
            let pick = |bit: usize, [a, b]: [f64; 2]| if k >> bit & 1 == 0 { a } else { b };
            pick(0, [low.x, high.x]) * x + pick(1, [low.y, high.y]) * y + pick(2, depths) * axis
        })
    }

    /// Points whose hull contains the ends of all segments from here.
    pub fn hull(&self, from: Vec3) -> [Vec3; 8] {
        self.corners.map(|corner| from + corner)
    }

    /// Mean over the channels of the irradiance of an unobstructed plane.
    pub fn irradiance(&self, normal: DVec3) -> f64 {
        match self.place {
            Place::Patch(_) if self.is_above(normal) => self.moment.dot(normal),
            // Parts of it are closer to one radiance each.
            Place::Patch(k) => match self.environment.patches().children(k) {
                children if children.is_empty() => self.irradiance_of(k, normal),
                children => children.map(|k| self.irradiance_of(k, normal)).sum(),
            },
            Place::Sun(k) => mean(self.environment.suns()[k].irradiance_on(normal)),
        }
    }

    fn irradiance_of(&self, patch: u32, normal: DVec3) -> f64 {
        let patches = self.environment.patches();
        mean(patches.all()[patch as usize].mean) * patches.projected(patch, normal)
    }

    /// Whether all of a patch is above the horizon of a receiver.
    fn is_above(&self, normal: DVec3) -> bool {
        let Place::Patch(k) = self.place else { return false };
        let patch = &self.environment.patches().all()[k as usize];
        patch.axis.dot(normal).clamp(-1.0, 1.0).asin() >= patch.half_angle
    }

    /// Size at the far ends of segments, and irradiance of a plane that sees a part of the source.
    pub fn size_and_weight(&self, normal: Vec3) -> Option<(f32, f32)> {
        let irradiance = self.irradiance(normal.as_dvec3()) as f32;
        (irradiance > 0.0 && self.seen_from(normal).is_some()).then_some((self.size, irradiance))
    }

    /// A direction of the source for `u` in the unit square, even by solid angle.
    fn direction(&self, u: [f64; 2]) -> Vec3 {
        self.direction_of(u).as_vec3()
    }

    fn direction_of(&self, u: [f64; 2]) -> DVec3 {
        match self.place {
            Place::Patch(k) => {
                let extent = self.environment.patches().all()[k as usize].extent;
                self.environment.frame().world(extent.at(u[0], u[1]))
            }
            Place::Sun(k) => self.environment.suns()[k].sample(u),
        }
    }

    /// A direction of the source above the horizon of a receiver.
    fn seen_from(&self, normal: Vec3) -> Option<Vec3> {
        let part = |k: usize| (k as f64 + 0.5) / SAMPLES_PER_SIDE as f64;
        let tried = (0..SAMPLES_PER_SIDE * SAMPLES_PER_SIDE)
            .map(|k| self.direction([part(k / SAMPLES_PER_SIDE), part(k % SAMPLES_PER_SIDE)]));
        tried.into_iter().find(|direction| direction.dot(normal) > 0.0)
    }

    /// Ends of `count` segments from a point with a normal: the first directions above its horizon of those that `draw` gives by number.
    pub fn ends(&self, from: Vec3, normal: Vec3, count: usize, draw: impl Fn(u32) -> [f32; 4]) -> Vec<Vec3> {
        // At least about a sixteenth is above.
        let most = (16 * SAMPLES_PER_SIDE * SAMPLES_PER_SIDE * count) as u32;
        let drawn = (0..most).map(|i| {
            let [u, v, ..] = draw(i);
            self.direction([f64::from(u), f64::from(v)])
        });
        let above = drawn.filter(|direction| direction.dot(normal) > 0.0);
        let other = self.seen_from(normal).unwrap_or(normal);
        let directions = above.chain(std::iter::repeat(other)).take(count);
        directions.map(|direction| from + self.length * direction).collect()
    }
}

fn mean(channels: [f64; 3]) -> f64 {
    channels.iter().sum::<f64>() / 3.0
}

/// Integral of radiance, mean over the channels, times direction over a patch.
fn moment(environment: &Environment, patch: u32) -> DVec3 {
    let (mut sum, mut open) = (DVec3::ZERO, vec![patch]);
    while let Some(k) = open.pop() {
        let (patch, children) = (&environment.patches().all()[k as usize], environment.patches().children(k));
        if children.is_empty() {
            sum += mean(patch.mean) * patch.moment;
        }
        open.extend(children);
    }
    sum
}

/// Chord at a distance of an angle, which is at most half a turn.
fn chord(angle: f64, distance: f32) -> f32 {
    2.0 * distance * (0.5 * angle).sin() as f32
}

/// The patches that are asked of a sky: of bounded angle, not black.
pub(super) fn patches(environment: &Environment) -> Vec<u32> {
    let patches = environment.patches();
    let mut found = Vec::new();
    let mut open: Vec<u32> = patches.roots().rev().collect();
    while let Some(k) = open.pop() {
        let (patch, children) = (&patches.all()[k as usize], patches.children(k));
        if mean(patch.max) <= 0.0 {
            continue;
        }
        if patch.half_angle > MAX_HALF_ANGLE && !children.is_empty() {
            open.extend(children.rev());
        } else {
            found.push(k);
        }
    }
    found
}

/// The suns and patches among the emitters of a scene.
pub(super) fn record(scene: &Scene) -> Option<SkySources> {
    let (sky, domes) = (scene.sky(), domes(scene));
    if sky.is_none() && domes.is_empty() {
        return None;
    }
    let half_angle = |sky: &Environment, k: u32| sky.patches().all()[k as usize].half_angle;
    let of_sky = sky.map_or(Vec::new(), |sky| patches(sky).into_iter().map(|k| half_angle(sky, k)).collect());
    let of_domes = domes.iter().flat_map(|(_, parts)| parts).map(|part| part.half_angle);
    let half_angles: Vec<f64> = of_sky.into_iter().chain(of_domes).collect();
    let suns = sky.map_or(0, |sky| suns(sky).count());
    Some(SkySources {
        patches: half_angles.len(),
        largest_angle: half_angles.iter().map(|angle| 2.0 * angle.to_degrees()).fold(0.0, f64::max),
        patches_per_point: half_angles.len().min(PATCHES_PER_POINT),
        domes: domes.len(),
        suns,
        shown: if scene.emitters.len() + suns > 0 { "lamps" } else { "patch" }.into(),
    })
}

/// The patch with the largest irradiance of a horizontal plane.
fn brightest(environment: &Environment) -> Option<u32> {
    let irradiance = |k: &u32| {
        let patches = environment.patches();
        mean(patches.all()[*k as usize].mean) * patches.projected(*k, environment.frame().up)
    };
    patches(environment).into_iter().max_by(|a, b| irradiance(a).total_cmp(&irradiance(b)))
}

/// Indices of the suns that shine.
fn suns(environment: &Environment) -> impl Iterator<Item = usize> {
    (0..environment.suns().len()).filter(|&k| mean(environment.suns()[k].irradiance) > 0.0)
}

/// Largest number of sources that a point of a workload is paired with.
pub(super) fn per_point(scene: &Scene) -> usize {
    let domes = domes(scene);
    let lamps = scene.emitters.len() - domes.len() + scene.sky().map_or(0, |sky| suns(sky).count());
    let parts: usize = domes.iter().map(|(_, parts)| parts.len()).sum();
    lamps + PATCHES_PER_POINT.min(parts + scene.sky().map_or(0, |sky| patches(sky).len()))
}

/// Number of sources that shadow images and maps show.
pub(super) fn shown(scene: &Scene) -> usize {
    let lamps = scene.emitters.len() + scene.sky().map_or(0, |sky| suns(sky).count());
    lamps.max(usize::from(per_point(scene) > 0))
}

/// Sources of light: the surfaces in order, then suns, then parts of domes and patches of the sky.
#[derive(Clone, Debug)]
pub(super) struct Lights {
    pub all: Vec<Light>,
    /// Numbers of the emitters that are divided into parts.
    domes: Vec<usize>,
    /// Number of sources before the patches.
    lamps: usize,
    asked: PatchSet,
}

impl Lights {
    pub fn of(model: &Model, asked: PatchSet) -> Lights {
        let mut all: Vec<Light> = model.samplers().iter().cloned().map(Light::Surface).collect();
        let divided = if asked == PatchSet::Shown { Vec::new() } else { domes(model.scene()) };
        let domes = divided.iter().map(|(k, _)| *k).collect();
        let part = |part: DomePart| {
            Light::Surface(EmitterSampler::new(model.scene(), &part.emitter, model.base().magnitudes()))
        };
        let parts = divided.into_iter().flat_map(|(_, parts)| parts).map(part);
        let Some(environment) = &model.scene().environment else {
            let lamps = all.len();
            all.extend(parts);
            return Lights { lamps, all, domes, asked };
        };
        let length = SOURCE_DISTANCE * model.bounds().diagonal();
        let distant = |place: Place, angle: f64| {
            Light::Distant(Distant::new(environment.clone(), place, angle, length))
        };
        all.extend(suns(environment).map(|k| distant(Place::Sun(k), environment.suns()[k].diameter)));
        let lamps = all.len();
        all.extend(parts);
        let patches = match asked {
            PatchSet::Shown if lamps > 0 => Vec::new(),
            PatchSet::Shown => brightest(environment).into_iter().collect(),
            _ => patches(environment),
        };
        all.extend(patches.into_iter().map(|k| {
            let patch = &environment.patches().all()[k as usize];
            let [low, high] = patch.extent.z.map(|z| z.clamp(-1.0, 1.0).asin());
            // Across the elevations, and the mean across the azimuths.
            distant(Place::Patch(k), (high - low).min(patch.solid_angle / (high - low)))
        }));
        Lights { all, domes, lamps, asked }
    }

    /// Whether there is a sun or a patch.
    pub fn has_distant(&self) -> bool {
        self.all.iter().any(|light| matches!(light, Light::Distant(_)))
    }

    /// The sources of a point, with their sizes and weights. `chance` in `[0, 1)` is random and independent between points.
    pub fn seen_from(
        &self,
        position: Vec3,
        normal: Vec3,
        chance: impl Fn() -> f64,
    ) -> Vec<(u32, (f32, f32))> {
        let seen = |k: usize| {
            let found = match &self.all[k] {
                Light::Surface(sampler) => sampler.size_and_weight(position, normal),
                Light::Distant(distant) => distant.size_and_weight(normal),
            };
            found.map(|found| (k as u32, found))
        };
        let mut sources: Vec<_> =
            (0..self.lamps).filter(|k| !self.domes.contains(k)).filter_map(seen).collect();
        let mut patches: Vec<_> = (self.lamps..self.all.len()).filter_map(seen).collect();
        if self.asked == PatchSet::Some && patches.len() > PATCHES_PER_POINT {
            patches = drawn(&patches, chance());
        }
        sources.append(&mut patches);
        sources
    }
}

/// A few of these sources, in proportion to their weights by systematic sampling: those that are drawn several times have as many times the
/// weight of the others. The weights add up to the same.
fn drawn(sources: &[(u32, (f32, f32))], chance: f64) -> Vec<(u32, (f32, f32))> {
    let all: f64 = sources.iter().map(|(_, (_, weight))| f64::from(*weight)).sum();
    let each = all / PATCHES_PER_POINT as f64;
    let (mut before, mut sum) = (0, 0.0);
    let mut found = Vec::new();
    for (place, &(k, (size, weight))) in sources.iter().enumerate() {
        sum += f64::from(weight);
        let last = place + 1 == sources.len();
        // Number of the draws up to here.
        let upto = if last { PATCHES_PER_POINT } else { (sum / each - chance).ceil().max(0.0) as usize };
        let upto = upto.clamp(before, PATCHES_PER_POINT);
        if upto > before {
            found.push((k, (size, (each * (upto - before) as f64) as f32)));
        }
        before = upto;
    }
    found
}

/// A part of a dome.
pub struct DomePart {
    pub emitter: Emitter,
    /// Half angle of the cone around it from the middle of the scene, radians.
    pub half_angle: f64,
}

/// The emitters that are domes, with their parts: emissive surfaces that are not plane, whose faces all look at the middle of the other
/// surfaces, and that are wider from there than a patch may be. A part that is one face may be wider too.
pub fn domes(scene: &Scene) -> Vec<(usize, Vec<DomePart>)> {
    let count = scene.triangles.len() as u32;
    let others = (0..count).filter(|&t| scene.triangle_emitter[t as usize] == u32::MAX);
    let bounds = Aabb::of(others.flat_map(|t| scene.corners(t)));
    if !bounds.center().is_finite() {
        return Vec::new();
    }
    let middle = bounds.center();
    let looks_inwards = |t: &u32| {
        let [a, b, c] = scene.corners(*t);
        (b - a).cross(c - a).dot(middle - a) > 0.0
    };
    let parts_of = |emitter: &Emitter| {
        let is_plane = emitter.normal.length() > MAX_HALF_ANGLE.cos() as f32;
        if is_plane || !emitter.triangles.iter().all(looks_inwards) {
            return None;
        }
        let faces: Vec<DirectedFace> =
            emitter.triangles.iter().map(|&t| DirectedFace::new(scene, t, middle)).collect();
        let groups = divided(faces);
        let part = |faces: Vec<DirectedFace>| {
            let triangles = faces.iter().map(|face| face.triangle).collect();
            DomePart { emitter: emitter.part(scene, triangles), half_angle: half_angle(&faces) }
        };
        (groups.len() > 1).then(|| groups.into_iter().map(part).collect())
    };
    scene.emitters.iter().enumerate().filter_map(|(k, emitter)| Some((k, parts_of(emitter)?))).collect()
}

/// A face with the directions of its corners from the middle of the scene.
struct DirectedFace {
    triangle: u32,
    corners: [Vec3; 3],
    centre: Vec3,
}

impl DirectedFace {
    fn new(scene: &Scene, triangle: u32, from: Vec3) -> DirectedFace {
        let corners = scene.corners(triangle).map(|corner| (corner - from).normalize_or_zero());
        DirectedFace { triangle, corners, centre: corners.iter().sum::<Vec3>().normalize_or_zero() }
    }
}

/// Half angle of a cone around the directions of all corners.
fn half_angle(faces: &[DirectedFace]) -> f64 {
    let axis = faces.iter().map(|face| face.centre).sum::<Vec3>().normalize_or_zero();
    let cosines = faces.iter().flat_map(|face| &face.corners).map(|corner| axis.dot(*corner));
    f64::from(cosines.fold(1.0f32, f32::min)).clamp(-1.0, 1.0).acos()
}

/// Groups of faces, halved across their largest extent until each is no wider than a patch of the sky may be.
fn divided(faces: Vec<DirectedFace>) -> Vec<Vec<DirectedFace>> {
    let (mut found, mut open) = (Vec::new(), vec![faces]);
    while let Some(mut faces) = open.pop() {
        if faces.len() == 1 || half_angle(&faces) <= MAX_HALF_ANGLE {
            found.push(faces);
            continue;
        }
        let extent = Aabb::of(faces.iter().map(|face| face.centre)).extent();
        let axis = extent.max_position();
        faces.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.triangle.cmp(&b.triangle)));
        let rest = faces.split_off(faces.len() / 2);
        open.extend([rest, faces]);
    }
    found
}

#[cfg(test)]
mod tests;
