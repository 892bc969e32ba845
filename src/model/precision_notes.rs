//! Notes of surfaces whose coordinates are too coarse in single precision for what is near them: emitters, and things that stand on them.

use super::Model;
use super::emitter_notes::PACKETS;
use crate::embree::Hits;
use crate::error::{figure, quote};
use crate::math::Aabb;
use crate::math::parallel;
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::{Emitter, magnitude};
use glam::{DVec3, Vec3};

/// Largest height at which rays start above a surface, relative to its distance from an emitter, without a note: shadows and reflected
/// light there err by up to this fraction.
const MAX_RELATIVE_HEIGHT: f32 = 0.01;
/// The same relative to the height of an object on the surface: its shadow is too short by this fraction.
const MAX_SHADOW_LOSS: f32 = 0.1;
/// Fraction of an emitter's rays, thus of its light, that must meet such surfaces: 4 of 64 rays. Even if all light on them is wrong, that
/// of the emitter errs by no more than this fraction otherwise.
const MIN_COARSE_SHARE: f64 = 0.05;

/// Largest rounding of both ends of an emitter, relative to its second largest extent, without a note: its area errs by up to twice this.
const MAX_SIZE_ERROR: f32 = 0.005;

/// Largest number of things that are tested, evenly spread: limits the time to 0.1 million rays.
const MAX_THINGS: usize = 4096;
/// Height of a thing, as a fraction of its diagonal, up to which it is flush with the surface, as a panel in a ceiling is.
const MAX_FLUSH_HEIGHT: f32 = 0.01;
/// Largest coordinate of a scene relative to its extent up to which it counts as centred: that of a centred one is half.
const MAX_CENTRED: f32 = 0.75;
/// Distance of the test rays from the box of a thing, as a fraction of the diagonal of the box: a surface that reaches as far beyond the
/// thing is found. Coordinates are rounded by up to 6e-8 of the largest, and rays start 34 times as high: beside a thing that is three
/// times higher than that, the rays keep off by more than this rounding.
const RAY_OFFSET: f32 = 0.01;

impl Model {
    /// A note if emitters light surfaces from so near that the precision of the surfaces' coordinates shows: rays start above a surface by
    /// [`EndRule::height`](crate::ray::EndRule::height), 2e-6 of its largest coordinate.
    pub(super) fn note_of_coarse_coordinates(&self) -> Option<String> {
        let tested = self.tested_emitters();
        let coarse = |emitter| self.coarsest_surface(emitter).map(|found| (found, emitter));
        let found: Vec<((f32, f32), &Emitter)> = parallel::flat_map(&tested, |emitter| coarse(*emitter));
        let &((height, distance), worst) =
            found.iter().max_by(|((h, d), _), ((i, e), _)| (h / d).total_cmp(&(i / e)))?;
        let unit = &self.scene().unit;
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "the emitter `{}`{more} is so close to a surface, {} {unit}, that rounding of the surface's coordinates limits the \
             accuracy: rays start {} {unit} above it, so that shadows and reflected light there may be wrong by up to {:.0} %; {}",
            quote(&worst.name),
            two_digits(distance),
            two_digits(height),
            100.0 * (height / distance).min(1.0),
            self.cure_of_coarseness(height, worst.triangles[0])
        ))
    }

    /// A note if emitters are so small that the rounding of their coordinates changes their size, and with it all of their light.
    pub(super) fn note_of_rounded_emitters(&self) -> Option<String> {
        let scene = self.scene();
        let rounded = |emitter: &Emitter| {
            let corners: Vec<Vec3> = emitter.triangles.iter().flat_map(|&t| scene.corners(t)).collect();
            let mut sides = Aabb::of(corners.iter().copied()).extent().to_array();
            sides.sort_by(f32::total_cmp);
            let (size, rounding) = (sides[1], f32::EPSILON * magnitude(corners));
            (rounding > MAX_SIZE_ERROR * size).then_some((rounding, size))
        };
        let found: Vec<(f32, f32, &Emitter)> = {
            let tested = self.tested_emitters();
            parallel::flat_map(&tested, |emitter| {
                rounded(emitter).map(|(rounding, size)| (rounding, size, *emitter))
            })
        };
        let &(rounding, size, worst) = found.iter().max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)))?;
        let unit = &scene.unit;
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "the emitter `{}`{more} is {} {unit} wide, and so far from the middle of the scene that its corners are rounded by up to {} {unit}: \
             its size and light, unless its power is stated, may be wrong by up to {:.0} %; remove objects far from it",
            quote(&worst.name),
            two_digits(size),
            two_digits(0.5 * rounding),
            100.0 * (2.0 * rounding / size).min(1.0)
        ))
    }

    /// The height at which rays start above the surface that is coarsest against its distance from an emitter, and that distance; scene
    /// units. None if few rays of the emitter meet coarse surfaces.
    fn coarsest_surface(&self, emitter: &Emitter) -> Option<(f32, f32)> {
        let (packets, hits) = self.rays_of_emitter(emitter, 1.0);
        let mut coarse = Vec::new();
        for (packet, hits) in packets.iter().zip(&hits) {
            for lane in (0..LANES).filter(|&lane| hits.triangle[lane] != Hits::NO_HIT) {
                let distance = (packet.point(lane, hits.t[lane]) - packet.point(lane, 0.0)).length();
                let height = self.end_on(hits.instance[lane], hits.triangle[lane]).height();
                // The reader has moved the face off the emitter, in whose plane it lies.
                let is_moved =
                    distance <= 2.0 * self.stack_distance(hits.instance[lane], hits.triangle[lane]);
                coarse.extend(
                    (height > MAX_RELATIVE_HEIGHT * distance && !is_moved).then_some((height, distance)),
                );
            }
        }
        let enough = coarse.len() as f64 >= MIN_COARSE_SHARE * (PACKETS * LANES) as f64;
        coarse.into_iter().filter(|_| enough).max_by(|(h, d), (i, e)| (h / d).total_cmp(&(i / e)))
    }

    /// A note if things stand on a surface of another object above which rays start so high that they miss part of the things: their
    /// shadows are too short.
    pub(super) fn note_of_small_things(&self) -> Option<String> {
        let scene = self.scene();
        let bounds = scene.component_bounds();
        let mut first = vec![0; bounds.len()];
        scene
            .triangle_component
            .iter()
            .enumerate()
            .rev()
            .for_each(|(t, &part)| first[part as usize] = t as u32);
        // Nothing that rises higher than this stands on a surface that is too coarse for it.
        let highest = self.end_rule().height() / MAX_SHADOW_LOSS;
        let low = |(_, own): &(&u32, &Aabb)| own.extent().min_element() < highest;
        let small: Vec<(&u32, &Aabb)> = first.iter().zip(&bounds).filter(low).collect();
        let tested: Vec<(&u32, &Aabb)> =
            small.iter().copied().step_by(small.len().div_ceil(MAX_THINGS).max(1)).collect();
        let coarse = |(thing, own): &(&u32, &Aabb)| Some((self.ground_of_thing(**thing, **own)?, **thing));
        let found: Vec<(Ground, u32)> = parallel::flat_map(&tested, coarse);
        let (ground, worst) =
            found.iter().max_by(|(a, i), (b, j)| a.coarseness().total_cmp(&b.coarseness()).then(j.cmp(i)))?;
        let name = |triangle: u32| {
            let object = scene.triangle_object[triangle as usize] as usize;
            quote(scene.object_names().nth(object).unwrap_or_default()).to_string()
        };
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        let unit = &scene.unit;
        Some(format!(
            "`{}`{more} is {} {unit} high and stands on `{}`, and rounding of that surface's coordinates limits the accuracy: rays start {} \
             {unit} above it, so that the shadow is about {:.0} % too short; {}",
            name(*worst),
            two_digits(ground.rise),
            name(ground.triangle),
            two_digits(ground.start),
            100.0 * ground.coarseness().min(1.0),
            self.cure_of_coarseness(ground.start, *worst)
        ))
    }

    /// What to change if rays start at this height, scene units, above a surface near a triangle.
    fn cure_of_coarseness(&self, height: f32, near: u32) -> &'static str {
        let scene = self.scene();
        let (low, high) = (self.bounds().min, self.bounds().max);
        let is_off_centre = magnitude([low, high]) > MAX_CENTRED * (high - low).max_element();
        if magnitude(scene.corners(near)) < 0.5 * EndRule::magnitude_of_height(height) {
            "divide that surface into smaller faces there"
        } else if scene.origin == DVec3::ZERO && is_off_centre {
            "move the centre of the scene to the origin"
        } else {
            "divide that surface into smaller faces, and leave out what is far from there"
        }
    }

    /// The coarsest surface that a small edge-connected part stands on; `thing` is one of its triangles, `bounds` its box. It belongs to
    /// another object, in scenes of one object to another part. Rays along the axes, just outside the box on all of its sides, look for it.
    fn ground_of_thing(&self, thing: u32, bounds: Aabb) -> Option<Ground> {
        let scene = self.scene();
        // Parts of one object, such as bevels, are no things that stand on it. A scene with a single object is the exception: many files
        // name no objects, so that each connected part of it counts as a thing, even if the file names that object.
        let groups = if scene.objects.len() > 1 { &scene.triangle_object } else { &scene.triangle_component };
        let (middle, half) = (0.5 * (bounds.min + bounds.max), 0.5 * bounds.extent());
        let margin = RAY_OFFSET * bounds.diagonal();
        let mut rays = Vec::with_capacity(24);
        for (down, beside) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
            for (to, from) in [(1.0f32, 1.0f32), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let (mut at, mut way) = (middle, Vec3::ZERO);
                at[beside] += from * (half[beside] + margin);
                way[down] = to * (half[down] + margin);
                rays.push((at, way));
            }
        }
        let mut packets = [Packet::EMPTY; 2];
        for (i, (from, way)) in rays.iter().enumerate() {
            packets[i / LANES].set_between(i % LANES, *from, *from + *way, [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE; 2];
        self.traced().first_hits(self.widest_packets(), &packets, &mut hits);
        let mut grounds = Vec::new();
        for (i, (_, way)) in rays.iter().enumerate() {
            let (triangle, instance, t) = (
                hits[i / LANES].triangle[i % LANES],
                hits[i / LANES].instance[i % LANES],
                hits[i / LANES].t[i % LANES],
            );
            // The first instance holds the scene's own faces.
            let other = triangle != Hits::NO_HIT
                && instance == 0
                && groups[triangle as usize] != groups[thing as usize];
            if other {
                let start = self.end_on(instance, triangle).height();
                let rise = t * way.length() + half.dot(way.abs().normalize_or_zero());
                let ground = Ground { start, rise, triangle };
                let is_low =
                    ground.coarseness() > MAX_SHADOW_LOSS && rise > MAX_FLUSH_HEIGHT * bounds.diagonal();
                grounds.extend(is_low.then_some(ground));
            }
        }
        grounds.into_iter().max_by(|a: &Ground, b| a.coarseness().total_cmp(&b.coarseness()))
    }
}

fn two_digits(length: f32) -> String {
    figure(format!("{length:.1e}").parse().unwrap_or(f64::from(length)))
}

/// The surface on which a thing stands.
struct Ground {
    /// Height above it at which rays start, scene units.
    start: f32,
    /// Height of the thing above it, scene units.
    rise: f32,
    /// One of its triangles.
    triangle: u32,
}

impl Ground {
    /// Fraction of the thing's height below which no rays start.
    fn coarseness(&self) -> f32 {
        self.start / self.rise
    }
}

#[cfg(test)]
mod tests {
    use crate::model::{Detail, Model, testing::model};
    use crate::scene::testing::{Pieces, facing_down, facing_up};
    use glam::DVec3;

    /// A lamp above a floor of this width, and a step of this height on the floor, both far from other small things, near which the reader
    /// divides the floor.
    fn scene(width: f64, lamp: f64, step: f64) -> Model {
        let mut pieces = Pieces::empty();
        let at = 0.8 * width;
        pieces.grey("floor", 0.5).polygon(&facing_up([0.0, width], [0.0, width], 0.0));
        pieces.grey("step", 0.5).rectangle(
            DVec3::new(at + 0.2, at + 0.2, 0.0),
            0.5 * DVec3::X,
            step * DVec3::Z,
        );
        pieces.glowing("lamp", 10.0).polygon(&facing_down([at, at + 0.5], [at, at + 0.5], lamp));
        pieces.grey("roofs", 0.5);
        (0..8).for_each(|k| {
            _ = pieces.polygon(&facing_up([f64::from(k), 0.5 + f64::from(k)], [0.0, 0.5], 40.0))
        });
        model(&pieces.scene(), Detail::Rays)
    }

    /// Rays start 0.2 above a floor of 100,000, and 2e-5 above one of 10.
    #[test]
    fn lamps_near_surfaces_with_coarse_coordinates_are_named() {
        let note = |width: f64, lamp: f64| scene(width, lamp, 1.0).note_of_coarse_coordinates();
        assert_eq!(note(10.0, 1.0), None);
        assert_eq!(note(1e5, 100.0), None);
        let found = note(1e5, 1.0).expect("a note");
        assert!(
            found.contains("the emitter `lamp` is so close to a surface") && found.contains("smaller faces"),
            "{found}"
        );
    }

    /// Coordinates at 80,000 are rounded by up to 0.004, those of both ends of a lamp of 0.5 by 2 % of it.
    #[test]
    fn lamps_with_coarse_coordinates_are_named() {
        assert_eq!(scene(1e4, 100.0, 1.0).note_of_rounded_emitters(), None);
        let found = scene(1e5, 100.0, 1.0).note_of_rounded_emitters().expect("a note");
        assert!(
            found.starts_with("the emitter `lamp` is 0.5 m wide") && found.contains("up to 4 %"),
            "{found}"
        );
    }

    /// Rays start 0.02 above a floor of 10,000.
    #[test]
    fn things_that_are_low_on_coarse_surfaces_are_named() {
        let note = |width: f64, step: f64| scene(width, 100.0, step).note_of_small_things();
        assert_eq!(note(10.0, 0.1), None);
        assert_eq!(note(1e4, 3.0), None);
        let found = note(1e4, 0.1).expect("a note");
        assert!(found.contains("`step` is 0.1 m high and stands on `floor`"), "{found}");
        assert!(
            found.ends_with(
                "20 % too short; divide that surface into smaller faces, and leave out what is far from there"
            ),
            "{found}"
        );
        // The same in a file that names no objects.
        let mut pieces = Pieces::empty();
        pieces.grey("all", 0.5).polygon(&facing_up([0.0, 1e4], [0.0, 1e4], 0.0));
        pieces.rectangle(DVec3::new(8000.2, 8000.2, 0.0), 0.5 * DVec3::X, 0.1 * DVec3::Z);
        (0..8).map(f64::from).for_each(|k| {
            _ = pieces.polygon(&facing_up([k, 0.5 + k], [0.0, 0.5], 40.0));
        });
        assert!(model(&pieces.scene(), Detail::Rays).note_of_small_things().is_some());
    }

    /// Rays start 9e-6 above the floor of a room of 4.5.
    #[test]
    fn small_parts_of_furniture_have_no_note() {
        let note = |object: &str, height: f64| {
            let mut pieces = Pieces::empty();
            pieces.grey("floor", 0.5).polygon(&facing_up([0.0, 4.5], [0.0, 4.5], 0.0));
            if object != "floor" {
                pieces.grey(object, 0.5);
            }
            pieces.rectangle(DVec3::new(3.0, 3.0, 0.0), 20.0 * height * DVec3::X, height * DVec3::Z);
            pieces.glowing("lamp", 10.0).polygon(&facing_down([2.0, 2.5], [2.0, 2.5], 2.0));
            model(&pieces.scene(), Detail::Rays).note_of_small_things()
        };
        assert_eq!(note("floor", 5e-5), None, "a part of the object below it");
        assert_eq!(note("rim", 5e-4), None, "its shadow is 2 % too short");
        let found = note("rim", 5e-5).expect("a note");
        assert!(found.ends_with("18 % too short; move the centre of the scene to the origin"), "{found}");
    }
}
