//! What matters where: surfaces that are important by themselves, and those that send light to them (method A.13).

use super::cut::{Cut, sent};
use super::field::{Arriving, Outgoing, Rgb, gather};
use super::{Options, Solver};
use crate::Result;
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::radiosity::elements::{Elements, Shape};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use glam::DVec3;

/// Bounces that importance is followed for.
const BOUNCES: usize = 4;
/// What errors count at least, relative to the most important element.
pub(super) const LEAST: f64 = 0.02;

/// Rays of a camera's square picture, along an edge; a multiple of 16.
const GRID: usize = 256;
/// Width over height that the square allows for.
const WIDE: f32 = 4.0 / 3.0;
/// Features of fewer pixels of a picture with so many rows are not looked for.
const PIXELS: f64 = 2.0;
const ROWS: usize = 480;

/// Where a camera is, for importance.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct View {
    /// Its place, in the file's coordinates.
    pub eye: DVec3,
    /// Where it looks, a unit vector.
    pub forward: DVec3,
    /// Angle of view from top to bottom, radians in `(0, π)`.
    pub angle: f64,
}

impl Solver {
    /// Feature sizes and important surfaces: by name, and by what cameras see.
    ///
    /// # Errors
    /// Nothing in the scene has a name.
    pub(super) fn name(
        &mut self,
        scene: &Scene,
        options: &Options,
        (traced, traversal): (&CommittedScene, Traversal),
    ) -> Result<()> {
        let mut chosen = vec![false; self.elements.sides.len()];
        for view in &options.views {
            let far = 1.01 * scene.bounds.diagonal();
            for (side, distance) in self.seen(view, scene.origin, far, traced, traversal) {
                chosen[side as usize] = true;
                // Of the places of a side the nearest shows the most.
                let size = (PIXELS * f64::from(distance) * view.angle / ROWS as f64) as f32;
                if self.sizes.all.is_none() {
                    let own = &mut self.sizes.own[side as usize];
                    *own = own.min(size);
                }
            }
        }
        let mut painted = vec![f32::INFINITY; scene.triangles.len()];
        for (name, size) in &options.feature_sizes {
            scene.faces_named(name)?.into_iter().for_each(|t| painted[t as usize] = *size);
        }
        for (side, own) in self.elements.sides.iter().zip(&mut self.sizes.own) {
            let painted = painted[side.triangles[0] as usize];
            *own = if painted.is_finite() { painted } else { *own };
        }
        for name in &options.importance {
            let mut named = vec![false; scene.triangles.len()];
            scene.faces_named(name)?.into_iter().for_each(|t| named[t as usize] = true);
            let sides = self.elements.sides.iter().zip(&mut chosen);
            sides.for_each(|(side, chosen)| *chosen |= named[side.triangles[0] as usize]);
        }
        if chosen.contains(&true) {
            self.important = chosen;
        }
        self.size();
        Ok(())
    }

    /// The sides that a camera sees, one for each ray of a square picture, with their distances (scene units).
    fn seen(
        &self,
        view: &View,
        origin: DVec3,
        far: f32,
        traced: &CommittedScene,
        traversal: Traversal,
    ) -> Vec<(u32, f32)> {
        let eye = (view.eye - origin).as_vec3();
        let forward = view.forward.as_vec3();
        let (x, y) = forward.any_orthonormal_pair();
        let half = WIDE * (0.5 * view.angle as f32).tan();
        // Cameras may stand anywhere outside.
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
        traced.first_hits(traversal, &packets, &mut hits);
        let mut seen = Vec::new();
        for (packet, hits) in packets.iter().zip(&hits) {
            for lane in 0..LANES {
                if hits.triangle[lane] != Hits::NOTHING {
                    let direction = packet.point(lane, 1.0) - packet.point(lane, 0.0);
                    let side = self.elements.met(hits.triangle[lane], direction);
                    if side != Elements::NONE {
                        seen.push((side, hits.t[lane]));
                    }
                }
            }
        }
        seen
    }

    /// Follows importance, which spreads like light from the important surfaces [Smits, Arvo and Salesin 1992]. Feature
    /// sizes follow it.
    pub(super) fn spread_importance(&mut self, cut: &Cut) {
        if self.important.is_empty() {
            return;
        }
        let own = |side: u32| -> Rgb { [f64::from(u8::from(self.important[side as usize])); 3] };
        let emitted: Vec<_> =
            cut.sealed().map(|place| sent(&self.elements, cut.elements[place], own)).collect();
        let mut clusters = vec![Arriving::default(); cut.clusters];
        let mut surfaces = vec![[0.0; 3]; cut.elements.len() - cut.clusters];
        for _ in 0..BOUNCES {
            let sends: Vec<Rgb> = (0..surfaces.len())
                .map(|i| {
                    let e = cut.elements[cut.clusters + i] as usize;
                    let Shape::Surface { side, .. } = self.elements.elements[e].shape else {
                        return [0.0; 3];
                    };
                    let reflectance = self.elements.sides[side as usize].reflectance;
                    std::array::from_fn(|k| own(side)[k] + f64::from(reflectance[k]) * surfaces[i][k])
                })
                .collect();
            let outgoing = Outgoing::pull(&self.elements, cut, &sends, |p, r| {
                cut.responses[r].answer(&clusters[p], emitted[r])
            });
            let next = gather(&self.elements, cut, &outgoing);
            (clusters, surfaces) = (next.clusters, next.surfaces);
        }
        let arriving = cut.expand(&self.elements, &clusters, &surfaces);
        let mut importance = vec![0.0; self.elements.len()];
        for e in (0..self.elements.len()).rev() {
            let element = &self.elements.elements[e];
            if let (Shape::Surface { side, .. }, true) = (&element.shape, element.is_leaf()) {
                importance[e] = super::mean(own(*side)) + super::mean(arriving[e]);
            } else if element.area > 0.0 {
                let sum: f64 =
                    element.child_range().map(|c| self.elements.elements[c].area * importance[c]).sum();
                importance[e] = sum / element.area;
            }
        }
        let most = importance.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        self.importance = importance.into_iter().map(|i| (i / most).clamp(LEAST, 1.0) as f32).collect();
        self.size();
    }
}
