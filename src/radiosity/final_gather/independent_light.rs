//! The light of an element by paths that use no light of the solution.

use super::gatherer::{Buffers, FinalGather};
use super::paths::{EndOfPaths, to_vec};
use crate::math::sampling::{mix, sobol};
use crate::radiosity::elements::Side;
use crate::radiosity::links::{VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// Sums of the irradiance that some paths bring to an element, W/m². One shadow ray from the start of each path, to a point of an
/// emitter, finds which fraction of the direct light is visible; the direct light of diffuse faces without obstacles has a closed form.
/// Faces with a profile do without it, so that the quadrature of the solution is checked too.
#[derive(Clone, Copy, Default)]
pub struct IndependentLight {
    /// All light but the direct light of emitters.
    pub other: Rgb,
    /// Direct light by shadow rays.
    pub seen: Rgb,
    /// Direct light by the same rays if nothing blocked them.
    pub unoccluded: Rgb,
    /// The expected value of `unoccluded` for the faces drawn: of diffuse ones by closed forms at the starts of the paths.
    pub expected: Rgb,
}

impl IndependentLight {
    /// The mean irradiance by each of some groups of `paths` paths, channels averaged. The expected direct light without obstacles serves
    /// as a control variate, with the ratio of seen to unoccluded light over all groups as its coefficient: where all or nothing is
    /// visible, points on emitters cause no noise.
    pub fn means(groups: &[IndependentLight], paths: u32) -> Vec<f64> {
        let [mut seen, mut unoccluded] = [[0.0; 3]; 2];
        for group in groups {
            add(&mut seen, 1.0, group.seen);
            add(&mut unoccluded, 1.0, group.unoccluded);
        }
        let visible: Rgb =
            std::array::from_fn(|k| if unoccluded[k] > 0.0 { seen[k] / unoccluded[k] } else { 0.0 });
        let value = |of: &IndependentLight, k: usize| {
            of.other[k] + of.seen[k] + visible[k] * (of.expected[k] - of.unoccluded[k])
        };
        let of_group = |of: &IndependentLight| mean(std::array::from_fn(|k| value(of, k))) / f64::from(paths);
        groups.iter().map(of_group).collect()
    }
}

impl FinalGather<'_> {
    /// The light of paths from all of `buffers.vertices`, by exact rays. First rays and points on emitters are those of a low-discrepancy
    /// sequence.
    pub fn independent_light(&self, seed: u64, buffers: &mut Buffers) -> IndependentLight {
        let random = |i: usize| sobol(i as u32, 1, seed as u32);
        let cuts = self.cuts_of_vertices(buffers);
        self.trace_scene_rays(&random, buffers);
        self.read_hits(|_, _| None, buffers);
        self.add_suns(&random, |_| 1, buffers);
        let engine = VisibilityEngine::Exact(self.linked.engine.exact());
        let mut light = IndependentLight::default();
        let rgb = |v: Vec3| v.to_array().map(f64::from);
        for (g, group) in buffers.vertices.chunks(LANES).enumerate() {
            let (mut packet, mut unoccluded) = (Packet::EMPTY, [Vec3::ZERO; LANES]);
            for (lane, vertex) in group.iter().enumerate() {
                let (cut, random) = (&cuts[g * LANES + lane], random(g * LANES + lane));
                let Some((_, [emitter, face], density)) = self.emitters.sample(cut, random[2], random[3])
                else {
                    continue;
                };
                let face = &self.emitters.emitters[emitter].faces[face];
                let ray = self.emitter_ray(&self.emitters, cut, vertex, |q| q, random);
                let sampled = ray.as_ref().map_or(Vec3::ZERO, |ray| ray.light);
                let Side { normal, end, .. } = self.linked.elements.sides[vertex.side as usize];
                let height = face.normal.dot(vertex.at - face.corners[0]);
                let expected = match face.profile {
                    // The back of a lamp without thickness lies in the plane of its front, where the closed form has no value.
                    None if height <= end.rounding_of_heights(face.end) => Vec3::ZERO,
                    None => {
                        let factor = face.factor(vertex.at.as_dvec3(), normal.as_dvec3()) as f32;
                        // The probability of the face is the density of the point times the face's area.
                        let chance = density * mean(face.exitance) as f32 * face.area;
                        factor / chance * to_vec(face.exitance)
                    }
                    Some(_) => sampled,
                };
                add(&mut light.expected, 1.0, rgb(expected));
                add(&mut light.unoccluded, 1.0, rgb(sampled));
                if let Some(ray) = ray {
                    packet.set_blocked_from_start(lane, ray.ends[0], ray.ends[1], ray.rules);
                    unoccluded[lane] = sampled;
                }
            }
            let width = self.emitters.width;
            let query = VisibilityQuery { packet, emitter_size: width, feature_size: width };
            let through = engine.transmittances(&query, &mut buffers.scratch);
            for lane in query.packet.lanes() {
                add(&mut light.seen, 1.0, rgb(through[lane] * unoccluded[lane]));
            }
        }
        buffers.cuts = cuts;
        let sums = std::slice::from_mut(&mut light.other);
        self.advance(1, mix(seed ^ 1), EndOfPaths::Nowhere, sums, buffers);
        self.follow_from(2, seed, EndOfPaths::Nowhere, sums, buffers);
        light
    }
}
