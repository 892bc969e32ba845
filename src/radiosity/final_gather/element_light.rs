//! The irradiance of elements by rays of their own, from light that is known already.
//!
//! The local pass estimates irradiance and exchange with the same few rays. Here each element traces more rays, which read
//! the light that the local pass found: direct light from emitters drawn for this element, reflected light from the elements that
//! cosine-weighted rays meet. An element's rays are two independent halves, so that noise can be told from differences between
//! elements ([`super::sharing`]).

use super::element_samples::{ElementLight, REFLECTED};
use super::gatherer::{Buffers, FinalGather, PathVertex};
use super::local_pass::LocalPass;
use super::neighbours::Place;
use super::sharing::{SharedLight, share};
use crate::math::sampling::{mix, point_on};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::emitter_tree::Cut;
use crate::radiosity::elements::{Elements, Shape, mean_over};
use crate::radiosity::links::{Tally, VisibilityQuery};
use crate::radiosity::rgb::add;
use crate::ray::LANES;
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// Elements of one parallel task.
const CHUNK: usize = 64;
/// Smallest number of rays of each half: a quarter of a packet; a half without rays has no estimate of its noise.
const MIN_HALF: u32 = 4;
/// Largest number of rays of each half, so that no element can use up all rays: noise of 1 % where one ray deviates by half of the mean.
const MAX_HALF: u32 = 1024;

/// Radius of an element over its distance from a face from which the closed form is evaluated at the centre alone. The midpoint rule
/// leaves an error of about half the square of that: 0.1 %.
const MIDPOINT_RADIUS: f32 = 0.05;

impl FinalGather<'_> {
    /// Traces about `rays` rays from `leaves`. `deviation` is an estimate, by element, of how much the light of one ray deviates,
    /// W/m²: the sum of squared errors by area is smallest with rays in proportion to √area times that (Neyman 1934).
    pub fn element_light(
        &self,
        leaves: &[u32],
        deviation: &(dyn Fn(u32) -> f64 + Sync),
        rays: f64,
        deadline: &Deadline,
    ) -> (Vec<ElementLight>, Tally) {
        let elements = &self.linked.elements.elements;
        let wanted = |e: u32| {
            let importance = f64::from(self.linked.elements.states[e as usize].importance);
            (elements[e as usize].area * importance).sqrt() * deviation(e)
        };
        let all: f64 = leaves.iter().map(|&e| wanted(e)).sum();
        let count = |e: u32| {
            let half = 0.5 * rays * wanted(e) / all.max(f64::MIN_POSITIVE);
            // Halves fill packets of sixteen.
            ((half / 8.0).round() as u32 * 8).clamp(MIN_HALF, MAX_HALF)
        };
        deadline.stage("light of elements", leaves.len());
        let made: Vec<(Vec<ElementLight>, Tally)> = leaves
            .par_chunks(CHUNK)
            .map_init(Buffers::default, |buffers, leaves| {
                buffers.scratch.tally = Tally::default();
                let light = leaves.iter().map(|&leaf| match deadline.late() {
                    true => ElementLight::default(),
                    false => self.light_of(leaf, count(leaf), buffers),
                });
                let light = light.collect();
                deadline.advance(leaves.len());
                (light, buffers.scratch.tally)
            })
            .collect();
        let (mut light, mut tally) = (Vec::with_capacity(leaves.len()), Tally::default());
        for (part, cost) in made {
            light.extend(part);
            tally.add(cost);
        }
        (light, tally)
    }

    fn light_of(&self, leaf: u32, half: u32, buffers: &mut Buffers) -> ElementLight {
        let linked = self.linked;
        let element = &linked.elements.elements[leaf as usize];
        let Shape::Surface { side, corners } = element.shape else { return ElementLight::default() };
        let seeds = [0u64, 1].map(|h| mix(!linked.settings.seed ^ mix(2 * element.ids[0] + h)) as u32);
        buffers.vertices.clear();
        for seed in seeds {
            buffers.vertices.extend((0..half).map(|k| {
                let [u, v, ..] = sample_4d(k, 1, seed);
                PathVertex { at: point_on(&corners, u, v), side, leaf, share: Vec3::ONE }
            }));
        }
        let mut cut = std::mem::take(&mut buffers.cut);
        self.cut_of(leaf, &mut cut);
        let random = |i: usize| sample_4d(i as u32 % half, 0, seeds[i / half as usize]);
        let mut light = ElementLight { rays: half, ..ElementLight::default() };
        match self.unblocked(leaf, &cut) {
            Some(free) => {
                self.trace_scene_rays(&random, buffers);
                self.read_hits(buffers);
                light.direct_of_fraction(
                    free,
                    half as usize,
                    &self.visible_parts(leaf, &cut, &random, buffers),
                );
            }
            None => {
                self.trace(&linked.engine, &cut, random, buffers);
                light.direct_of_rays(half as usize, &buffers.results);
            }
        }
        buffers.cut = cut;
        self.add_reflected(&mut light, seeds, buffers);
        light
    }

    /// Irradiance of an element from all emitters if nothing blocked them, W/m², by closed form or quadrature. None if too many faces light the
    /// element.
    fn unblocked(&self, leaf: u32, cut: &Cut) -> Option<Vec3> {
        let elements = &self.linked.elements;
        let element = &elements.elements[leaf as usize];
        let Shape::Surface { side, corners } = element.shape else { return None };
        let normal = elements.sides[side as usize].normal.as_dvec3();
        let quarters = centres_of_quarters(&corners);
        let mut sum = [0.0; 3];
        for face in self.emitters.faces(cut)? {
            let of = |at: Vec3| face.factor(at.as_dvec3(), normal);
            if face.profile.is_some() {
                // A beam between all places has no closed form: its light is found by rays.
                let mean = Some(mean_over(&of, corners)).filter(|mean| *mean > 0.0)?;
                add(&mut sum, mean, face.exitance);
                continue;
            }
            // The distance from the face is at least that from its centre less its own radius.
            let middle = 0.25 * face.corners.iter().sum::<Vec3>();
            let radius = face.corners.iter().map(|c| (*c - middle).length()).fold(0.0, f32::max);
            let near = element.radius > MIDPOINT_RADIUS * ((middle - element.centre).length() - radius);
            let centre = [element.centre; 1];
            let places: &[Vec3] = if near { &quarters } else { &centre };
            for &at in places {
                add(&mut sum, of(at) / places.len() as f64, face.exitance);
            }
        }
        Some(Vec3::from(sum.map(|s| s as f32)))
    }

    /// For each ray of `buffers.vertices` to an emitter, its light without blockers over its density, W/m², and its transmittance.
    fn visible_parts(
        &self,
        leaf: u32,
        cut: &Cut,
        random: &impl Fn(usize) -> [f32; 4],
        buffers: &mut Buffers,
    ) -> Vec<(Vec3, f32)> {
        let Buffers { vertices, scratch, .. } = buffers;
        let feature_size = self.feature_size_of(leaf);
        let mut parts = Vec::with_capacity(vertices.len());
        let scattered = self.linked.engine.scattered();
        let engine = if self.emitters.emitters.len() == 1 { &self.linked.engine } else { &scattered };
        for (g, group) in vertices.chunks(LANES).enumerate() {
            let (packet, light) = self.emitter_rays(group, cut, |q| q, |lane| random(g * LANES + lane));
            let query = VisibilityQuery { packet, emitter_size: self.emitters.width, feature_size };
            let through = match query.packet.is_empty() {
                true => [0.0; LANES],
                false => engine.transmittances(&query, scratch),
            };
            // A sample at no distance from the element has no finite weight.
            let weight = |lane: usize| if light[lane].is_finite() { light[lane] } else { Vec3::ZERO };
            parts.extend((0..group.len()).map(|lane| (weight(lane), through[lane])));
        }
        parts
    }

    /// Adds the light of the elements that the rays in `buffers.results` met; rays that ended too near go on as paths.
    fn add_reflected(&self, light: &mut ElementLight, seeds: [u32; 2], buffers: &mut Buffers) {
        let half = light.rays as usize;
        let mut squares = 0.0;
        let results = std::mem::take(&mut buffers.results);
        for (h, results) in results.chunks(half).enumerate() {
            buffers.vertices.clear();
            let mut reflected = Vec3::ZERO;
            for found in results.iter().filter(|found| found.met.side != Elements::NONE) {
                match self.reflected_or_next(found.met, found.distance) {
                    Ok(value) => {
                        reflected += value;
                        squares += (value.element_sum() / 3.0).powi(2);
                    }
                    Err(vertex) => buffers.vertices.push(vertex),
                }
            }
            // Paths from near surfaces count with their mean in the spread of the rays.
            let (paths, mut sum) = (buffers.vertices.len() as f32, [0.0; 3]);
            self.follow(u64::from(seeds[h]), false, &mut sum, buffers);
            let followed = Vec3::from(sum.map(|s| s as f32));
            squares += if paths > 0.0 { (followed.element_sum() / 3.0).powi(2) / paths } else { 0.0 };
            light.halves[REFLECTED][h] = (reflected + followed) / half as f32;
        }
        buffers.results = results;
        let mean = light.halves[REFLECTED].iter().sum::<Vec3>().element_sum() / 6.0;
        light.squares[REFLECTED] = (squares - 2.0 * half as f32 * mean * mean).max(0.0);
    }
}

/// The centres of the four parts that subdivision would make of an element; their mean is its centre.
fn centres_of_quarters(corners: &[Vec3; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = *corners;
    if c == d {
        let middle = (a + b + c) / 3.0;
        return [middle, 0.5 * (a + middle), 0.5 * (b + middle), 0.5 * (c + middle)];
    }
    let at = |u: f32, v: f32| (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * d + u * c);
    [at(0.25, 0.25), at(0.75, 0.25), at(0.75, 0.75), at(0.25, 0.75)]
}

impl FinalGather<'_> {
    /// The irradiance of the leaves after a local pass, by about `rays` more rays of their own, shared between neighbours. Leaves
    /// that the deadline leaves without rays are missing.
    pub fn gather_elements(
        &self,
        local: &LocalPass,
        rays: f64,
        deadline: &Deadline,
    ) -> (Vec<(u32, SharedLight)>, Tally) {
        let elements = &self.linked.elements;
        let deviation = |e: u32| {
            let result = &local.results[e as usize];
            f64::from(result.noise) * f64::from(result.rays).sqrt()
        };
        let all = self.linked.leaves();
        let (light, tally) = self.element_light(&all, &deviation, rays, deadline);
        let (leaves, light): (Vec<u32>, Vec<ElementLight>) =
            all.into_iter().zip(light).filter(|(_, light)| light.rays > 0).unzip();
        let place = |&e: &u32| {
            let element = &elements.elements[e as usize];
            let Shape::Surface { side, .. } = element.shape else { unreachable!("leaves are surfaces") };
            let normal = elements.sides[side as usize].normal;
            Place { centre: element.centre, normal, radius: element.radius }
        };
        let places: Vec<Place> = leaves.iter().map(place).collect();
        let shared = share(&places, &light, deadline);
        (leaves.into_iter().zip(shared).collect(), tally)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over the centres of the quarters is exact for linear functions.
    #[test]
    fn quarters_have_the_centre_of_the_whole() {
        let [a, b, c] = [Vec3::ZERO, Vec3::new(2.0, 0.5, 0.0), Vec3::new(0.3, 1.5, 1.0)];
        for corners in [[a, b, c, c], [a, b, b + c, c]] {
            let mean = centres_of_quarters(&corners).iter().sum::<Vec3>() / 4.0;
            let centre = if corners[2] == corners[3] { (a + b + c) / 3.0 } else { 0.5 * (b + c) };
            assert!((mean - centre).length() < 1e-6, "{mean} {centre}");
        }
    }
}
