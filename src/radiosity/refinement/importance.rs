//! Importance: the weight of surfaces by themselves, and of others by the light that they send to these.

use super::feature_sizes::MIN_IMPORTANCE;
use super::linked_scene::LinkedScene;
use crate::Result;
use crate::embree::Hits;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::options::{Options, View};
use crate::radiosity::rgb::{Rgb, mean};
use crate::radiosity::transport::{ActiveNodes, NodeRadiosity, emission_moments, gather};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use crate::visibility::Exact;
use glam::DVec3;

/// Bounces that importance is propagated for: at a reflectance of 0.5 later ones add 0.5⁴ = 6 % of it at most.
const BOUNCES: usize = 4;
/// Rays along an edge of a camera's square picture; a multiple of 16. Sides that are smaller than 1/256 of the picture
/// may be missed; they get importance from the light that they send to others.
const GRID: usize = 256;
/// Aspect ratio (width over height) of pictures that the square covers.
const ASPECT: f32 = 4.0 / 3.0;
/// Smallest feature that is resolved, in pixels of a picture with [`PICTURE_ROWS`]: a shadow needs a lit and a dark pixel.
const FEATURE_PIXELS: f64 = 2.0;
/// Rows of the picture that feature sizes are computed for. A convention: a picture with more rows needs a smaller
/// option `feature_size`.
const PICTURE_ROWS: usize = 480;

/// Assigns importance and feature sizes to sides: to those named in the options, and to those that their cameras see.
pub fn apply_importance(
    linked: &mut LinkedScene,
    scene: &Scene,
    options: &Options,
    exact: &Exact,
) -> Result<()> {
    let mut chosen = vec![false; linked.elements.sides.len()];
    for view in &options.views {
        let far = scene.ray_length();
        for (side, distance) in visible_sides(&linked.elements, view, scene.origin, far, exact) {
            chosen[side as usize] = true;
            // The nearest point of a side shows its smallest features.
            let size = (FEATURE_PIXELS * f64::from(distance) * view.angle / PICTURE_ROWS as f64) as f32;
            if linked.feature_sizes.given.is_none() {
                let own = &mut linked.feature_sizes.by_side[side as usize];
                *own = own.min(size);
            }
        }
    }
    let faces = |option, name| scene.faces_named(name).map_err(|error| error.of(option));
    let mut named_sizes = vec![f32::INFINITY; scene.triangles.len()];
    for (name, size) in &options.feature_sizes {
        faces("feature_sizes", name)?.into_iter().for_each(|t| named_sizes[t as usize] = *size);
    }
    for (side, own) in linked.elements.sides.iter().zip(&mut linked.feature_sizes.by_side) {
        let named = named_sizes[side.triangles[0] as usize];
        *own = if named.is_finite() { named } else { *own };
    }
    for name in &options.importance {
        let mut named = vec![false; scene.triangles.len()];
        faces("importance", name)?.into_iter().for_each(|t| named[t as usize] = true);
        let sides = linked.elements.sides.iter().zip(&mut chosen);
        sides.for_each(|(side, chosen)| *chosen |= named[side.triangles[0] as usize]);
    }
    if chosen.contains(&true) {
        linked.feature_sizes.important = chosen;
    }
    linked.feature_sizes.assign(&mut linked.elements);
    Ok(())
}

/// The sides that a camera sees and their distances (scene units), one for each ray of a square picture.
fn visible_sides(
    elements: &Elements,
    view: &View,
    origin: DVec3,
    far: f32,
    exact: &Exact,
) -> Vec<(u32, f32)> {
    let eye = (view.eye - origin).as_vec3();
    let forward = view.forward.as_vec3();
    let (x, y) = forward.any_orthonormal_pair();
    let half = ASPECT * (0.5 * view.angle as f32).tan();
    // Cameras may stand outside the scene at any distance.
    let reach = far + eye.length();
    let at = |i: usize| half * ((2 * i + 1) as f32 / GRID as f32 - 1.0);
    let mut packets = Vec::with_capacity(GRID * GRID / LANES);
    for first in (0..GRID * GRID).step_by(LANES) {
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let (row, column) = ((first + lane) / GRID, (first + lane) % GRID);
            packet.set_ray(lane, eye, (forward + at(column) * x + at(row) * y).normalize());
            packet.far[lane] = reach;
        }
        packets.push(packet);
    }
    let mut hits = vec![Hits::NONE; packets.len()];
    exact.scene.first_hits(exact.traversal, &packets, &mut hits);
    let mut seen = Vec::new();
    for (packet, hits) in packets.iter().zip(&hits) {
        for lane in 0..LANES {
            if hits.triangle[lane] != Hits::NO_HIT {
                let direction = packet.point(lane, 1.0) - packet.point(lane, 0.0);
                let side = elements.met(hits.triangle[lane], direction);
                if side != Elements::NONE {
                    seen.push((side, hits.t[lane]));
                }
            }
        }
    }
    seen
}

/// Propagates importance, which spreads from the important surfaces like light from emitters [Smits, Arvo and Salesin 1992], and
/// updates feature sizes. Row factors apply inside aggregated clusters only.
pub fn propagate_importance(linked: &mut LinkedScene, nodes: &ActiveNodes) {
    if linked.feature_sizes.important.is_empty() {
        return;
    }
    let (elements, important) = (&linked.elements, &linked.feature_sizes.important);
    let own = |side: u32| -> Rgb { [f64::from(u8::from(important[side as usize])); 3] };
    let emitted: Vec<_> =
        nodes.aggregated().map(|node| emission_moments(elements, nodes.elements[node], own)).collect();
    let mut arriving = nodes.dark();
    for _ in 0..BOUNCES {
        let sends: Vec<Rgb> = (0..arriving.surfaces.len())
            .map(|i| {
                let e = nodes.elements[nodes.clusters + i] as usize;
                let Shape::Surface { side, .. } = elements.elements[e].shape else { return [0.0; 3] };
                let reflectance = elements.sides[side as usize].reflectance;
                std::array::from_fn(|k| own(side)[k] + f64::from(reflectance[k]) * arriving.surfaces[i][k])
            })
            .collect();
        let outgoing = NodeRadiosity::pull(elements, nodes, &sends, |p, r| {
            nodes.reflections[r].sent(&arriving.clusters[p], emitted[r])
        });
        arriving = gather(elements, nodes, &outgoing);
    }
    let arriving = nodes.expand(elements, &arriving.clusters, &arriving.surfaces);
    let mut importance = vec![0.0; elements.len()];
    for e in (0..elements.len()).rev() {
        let element = &elements.elements[e];
        if let (Shape::Surface { side, .. }, true) = (&element.shape, element.is_leaf()) {
            importance[e] = mean(own(*side)) + mean(arriving[e]);
        } else if element.area > 0.0 {
            // The square of an error counts times the square of its importance, summed over all parts.
            let of_part = |c: usize| elements.elements[c].area * f64::powi(importance[c], 2);
            importance[e] = (element.child_range().map(of_part).sum::<f64>() / element.area).sqrt();
        }
    }
    let largest = importance.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    for (state, importance) in linked.elements.states.iter_mut().zip(importance) {
        state.importance = (importance / largest).clamp(MIN_IMPORTANCE, 1.0) as f32;
    }
    linked.feature_sizes.assign(&mut linked.elements);
}
