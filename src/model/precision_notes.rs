//! Notes of surfaces whose coordinates are too coarse in single precision for what is near them: emitters, and things that stand on them.

use super::Model;
use super::emitter_notes::PACKETS;
use crate::embree::Hits;
use crate::error::{figure, quote};
use crate::math::Aabb;
use crate::ray::{LANES, Packet};
use crate::scene::Emitter;
use glam::Vec3;
use rayon::prelude::*;

/// Smallest height at which rays start above a surface, as a part of its distance from an emitter, or of the height of a thing that stands on
/// it, of which a note tells: shadows and reflected light there err by up to that part.
const COARSE: f32 = 0.01;
/// Distance to which the reader moves overlapping faces of one plane off each other, as a multiple of the height at which rays start: 9e-6 of the
/// largest coordinate against 2e-6, and their rounding.
const MOVED: f32 = 6.0;
/// Part of an emitter's rays that must meet such surfaces.
const MIN_COARSE_SHARE: f64 = 0.05;

/// Largest number of things that are tested, evenly spread: limits the time to 0.1 million rays.
const MAX_THINGS: usize = 4096;
/// Height of a thing, as a part of its diagonal, up to which it is flush with the surface, as a panel in a ceiling is.
const FLUSH: f32 = 0.01;
/// How far outside the box of a thing its rays run, as a part of the extent of the box.
const OUTSIDE: f32 = 0.01;

impl Model {
    /// A note if emitters light surfaces from so near that the precision of the surfaces' coordinates shows: rays start above a surface by
    /// [`EndRule::height`](crate::ray::EndRule::height), 2e-6 of its largest coordinate.
    pub(crate) fn note_of_coarse_coordinates(&self) -> Option<String> {
        let tested = self.tested_emitters();
        let coarse = |emitter| self.coarsest_surface(emitter).map(|found| (found, emitter));
        let found: Vec<((f32, f32), &Emitter)> = tested.into_par_iter().filter_map(coarse).collect();
        let &((height, distance), worst) =
            found.iter().max_by(|((h, d), _), ((i, e), _)| (h / d).total_cmp(&(i / e)))?;
        let unit = &self.scene().unit;
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        Some(format!(
            "the emitter `{}`{more} is so close to a surface, {} {unit}, that rounding of the surface's coordinates limits the \
             accuracy: rays start {} {unit} above it, so that shadows and reflected light there may be wrong by up to {:.0} %; divide that surface into \
             smaller faces, or move the scene nearer to the origin",
            quote(&worst.name),
            two_digits(distance),
            two_digits(height),
            100.0 * (height / distance).min(1.0)
        ))
    }

    /// The height at which rays start above the surface that is coarsest against its distance from an emitter, and that distance; scene
    /// units. None if few rays of the emitter meet coarse surfaces.
    fn coarsest_surface(&self, emitter: &Emitter) -> Option<(f32, f32)> {
        let (packets, hits) = self.rays_of_emitter(emitter, 1.0);
        // Faces of one plane that the reader has moved off each other have a note of their own.
        let moved = self.scene().repairs.overlapping_objects > 0;
        let mut coarse = Vec::new();
        for (packet, hits) in packets.iter().zip(&hits) {
            for lane in (0..LANES).filter(|&lane| hits.triangle[lane] != Hits::NOTHING) {
                let distance = (packet.point(lane, hits.t[lane]) - packet.point(lane, 0.0)).length();
                let height = self.end_on(hits.instance[lane], hits.triangle[lane]).height();
                let is_moved = moved && distance < MOVED * height;
                coarse.extend((height > COARSE * distance && !is_moved).then_some((height, distance)));
            }
        }
        let enough = coarse.len() as f64 >= MIN_COARSE_SHARE * (PACKETS * LANES) as f64;
        coarse.into_iter().filter(|_| enough).max_by(|(h, d), (i, e)| (h / d).total_cmp(&(i / e)))
    }

    /// A note if things stand on a surface above which rays start so high that they miss part of the things: their shadows are wrong near them.
    pub(super) fn note_of_small_things(&self) -> Option<String> {
        let scene = self.scene();
        let bounds = scene.component_bounds();
        // Nothing that rises higher than this stands on a surface that is too coarse for it.
        let highest = self.end_rule().height() / COARSE;
        let low = |own: &Aabb| own.extent().min_element() < highest;
        let small: Vec<u32> =
            (0u32..).zip(&bounds).filter(|(_, own)| low(own)).map(|(part, _)| part).collect();
        let tested: Vec<u32> =
            small.iter().copied().step_by(small.len().div_ceil(MAX_THINGS).max(1)).collect();
        let coarse =
            |&part: &u32| self.ground_of_thing(part, bounds[part as usize]).map(|found| (found, part));
        let found: Vec<(Ground, u32)> = tested.par_iter().filter_map(coarse).collect();
        let coarseness = |ground: &Ground| ground.start / ground.rise;
        let (Ground { start, rise, triangle }, worst) =
            found.iter().max_by(|(a, i), (b, j)| coarseness(a).total_cmp(&coarseness(b)).then(j.cmp(i)))?;
        let name = |triangle: usize| {
            let object = scene.triangle_object[triangle] as usize;
            quote(scene.object_names().nth(object).unwrap_or_default()).to_string()
        };
        let thing = name(scene.triangle_component.iter().position(|part| part == worst)?);
        let more = if found.len() > 1 { format!(" (and {} more)", found.len() - 1) } else { String::new() };
        let unit = &scene.unit;
        Some(format!(
            "`{thing}`{more} is only {} {unit} high on `{}`, whose coordinates are so large that single precision limits the accuracy: \
             rays start {} {unit} above it, so that shadows and light beside such low things are wrong; divide that surface into smaller \
             faces there, or move the scene nearer to the origin",
            two_digits(*rise),
            name(*triangle as usize),
            two_digits(*start),
        ))
    }

    /// The coarsest surface on which an edge-connected part with this box stands: rays along the axes, just outside the box on all of its sides,
    /// look for it.
    fn ground_of_thing(&self, part: u32, bounds: Aabb) -> Option<Ground> {
        let (middle, half) = (0.5 * (bounds.min + bounds.max), 0.5 * bounds.extent());
        let margin = OUTSIDE * bounds.diagonal();
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
            let other = triangle != Hits::NOTHING
                && instance == 0
                && self.scene().triangle_component[triangle as usize] != part;
            if other {
                let start = self.end_on(instance, triangle).height();
                let rise = t * way.length() + half.dot(way.abs().normalize_or_zero());
                let is_low = start > COARSE * rise && rise > FLUSH * bounds.diagonal();
                grounds.extend(is_low.then_some(Ground { start, rise, triangle }));
            }
        }
        grounds.into_iter().max_by(|a, b| (a.start / a.rise).total_cmp(&(b.start / b.rise)))
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

#[cfg(test)]
mod tests {
    use crate::model::{Detail, Model, testing::model};
    use crate::scene::testing::{Pieces, facing_down, facing_up};
    use glam::DVec3;

    /// A lamp above a floor of this width, and a step of this height on the floor, both far from other small things, near which the reader divides the
    /// floor.
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

    /// Rays start 0.02 above a floor of 10,000.
    #[test]
    fn things_that_are_low_on_coarse_surfaces_are_named() {
        let note = |width: f64, step: f64| scene(width, 100.0, step).note_of_small_things();
        assert_eq!(note(10.0, 0.1), None);
        assert_eq!(note(1e4, 3.0), None);
        let found = note(1e4, 0.1).expect("a note");
        assert!(found.contains("`step` is only 0.1 m high on `floor`"), "{found}");
    }
}
