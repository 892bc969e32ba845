//! The irradiance of elements by rays of their own, from light that is known already.
//!
//! The local pass estimates irradiance and exchange with the same few rays. Here each element traces more rays, which read
//! the light that the local pass found: direct light from emitters drawn for this element, reflected light from the elements that
//! cosine-weighted rays meet. An element's rays are two independent halves, so that noise can be told from differences between
//! elements ([`super::sharing`]).

use super::element_rays::{LeafRays, batches};
use super::element_samples::{DIRECT, ElementLight, REFLECTED};
use super::gatherer::{Buffers, FinalGather};
use super::local_pass::LocalPass;
use super::neighbours::Place;
use super::sharing::{SharedLight, share};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::Tally;
use crate::radiosity::rgb::{Rgb, mean};
use rayon::prelude::*;

/// Smallest number of rays of each half: a quarter of a packet; a half without rays has no estimate of its noise.
const MIN_HALF: u32 = 4;
/// Largest number of rays of each half, so that no element can use up all rays: noise of 1 % where one ray deviates by half of the mean.
const MAX_HALF: u32 = 1024;
/// Deviation of one ray from the mean light of its element, relative to that light, where it is not known.
const USUAL_DEVIATION: f64 = 0.5;

/// What elements have gathered.
pub struct Gathered {
    /// Leaves with their light.
    pub light: Vec<(u32, SharedLight)>,
    /// Part of the emitted power that meets elements, by channel.
    pub received: Rgb,
    /// Cost of the rays.
    pub tally: Tally,
}

impl FinalGather<'_> {
    /// The irradiance of the leaves after a local pass, by about `rays` more rays of their own, shared between neighbours. Leaves
    /// that the deadline leaves without rays are missing.
    ///
    /// The sum of squared errors by area is smallest with rays in proportion to √area times the deviation of one ray (Neyman 1934).
    /// The rays of the local pass estimate the deviation: an estimate from the same rays as the light would correlate with it, and
    /// elements that happen to look dark would stay dark.
    pub fn gather_elements(&self, local: &LocalPass, rays: f64, deadline: &Deadline) -> Gathered {
        let Elements { elements, states, .. } = &self.linked.elements;
        let wanted = |e: u32| {
            let result = &local.results[e as usize];
            let weight = elements[e as usize].area * f64::from(states[e as usize].importance);
            // The deviation is unknown where the first pass had no rays: leaves that there was no time for get the smallest number.
            let deviation = match result.rays {
                0 if states[e as usize].crossed => USUAL_DEVIATION * mean(result.irradiance),
                0 => 0.0,
                rays => f64::from(result.noise) * f64::from(rays).sqrt(),
            };
            weight.sqrt() * deviation
        };
        let all = self.linked.leaves();
        let sum: f64 = all.iter().map(|&e| wanted(e)).sum();
        let of = |leaf: u32| {
            let half = 0.5 * rays * wanted(leaf) / sum.max(f64::MIN_POSITIVE);
            // Halves of large elements fill packets of sixteen.
            LeafRays {
                leaf,
                count: (8.0 * (half / 8.0).round()).clamp(f64::from(MIN_HALF), f64::from(MAX_HALF)) as u32,
            }
        };
        let rays: Vec<LeafRays> = all.iter().map(|&leaf| of(leaf)).collect();
        let (light, tally) = self.trace_elements(&rays, deadline);
        let (leaves, light): (Vec<u32>, Vec<ElementLight>) =
            all.into_iter().zip(light).filter(|(_, light)| light.rays > 0).unzip();
        let areas: Vec<f64> = leaves.iter().map(|&e| elements[e as usize].area).collect();
        let (mut light, mut received_share) = (light, local.received);
        if leaves.len() == rays.len() {
            let received = light.iter().zip(&areas).map(|(light, area)| area * light.mean(DIRECT)).sum();
            let factor;
            (factor, received_share) = self.balance_of_direct_light(received, &local.sampled);
            light.iter_mut().for_each(|light| light.scale(DIRECT, factor as f32));
        }
        // Light differs on both sides of a surface that stands across an element: it is neither a neighbour nor has any. Nor do elements
        // that no ray of either pass has found lit share light with those behind the next wall.
        let is_alone = |i: usize| {
            let dark = local.results[leaves[i] as usize].irradiance == [0.0; 3];
            states[leaves[i] as usize].crossed
                || dark && light[i].mean(DIRECT) + light[i].mean(REFLECTED) == 0.0
        };
        let (alone, whole): (Vec<usize>, Vec<usize>) = (0..leaves.len()).partition(|&i| is_alone(i));
        let places: Vec<Place> = whole.iter().map(|&i| self.place_of(leaves[i])).collect();
        let of_whole: Vec<ElementLight> = whole.iter().map(|&i| light[i]).collect();
        let areas: Vec<f64> = whole.iter().map(|&i| areas[i]).collect();
        let sides: Vec<u32> = whole.iter().map(|&i| self.side_of(leaves[i])).collect();
        let shared = share(&places, (&sides, &areas), &of_whole, &self.ranks, deadline);
        let own = alone.iter().map(|&i| {
            let noise = f64::from(local.results[leaves[i] as usize].noise);
            let own = SharedLight::alone(&light[i]);
            // Rays that all find no light tell no deviation.
            (leaves[i], SharedLight { error: if own.error > 0.0 { own.error } else { noise * noise }, ..own })
        });
        let light = whole.iter().map(|&i| leaves[i]).zip(shared).chain(own).collect();
        Gathered { light, received: received_share, tally }
    }

    fn side_of(&self, leaf: u32) -> u32 {
        match self.linked.elements.elements[leaf as usize].shape {
            Shape::Surface { side, .. } => side,
            Shape::Cluster(_) => unreachable!("leaves are surfaces"),
        }
    }

    fn place_of(&self, leaf: u32) -> Place {
        let element = &self.linked.elements.elements[leaf as usize];
        let normal = self.linked.elements.sides[self.side_of(leaf) as usize].normal;
        Place { centre: element.centre, normal, radius: element.radius }
    }

    /// The light of leaves by their own rays. Leaves that the deadline leaves without rays have none.
    fn trace_elements(&self, leaves: &[LeafRays], deadline: &Deadline) -> (Vec<ElementLight>, Tally) {
        deadline.stage("light of elements", leaves.len());
        let batches = batches(leaves);
        let rows = self.ranks.rows(batches.len());
        let made: Vec<(Vec<ElementLight>, Tally)> = rows
            .numbers()
            .map_init(Buffers::default, |buffers, k| {
                buffers.scratch.tally = Tally::default();
                let batch = &leaves[batches[k].clone()];
                let light = match deadline.late() {
                    true => vec![ElementLight::default(); batch.len()],
                    false => self.light_of(batch, buffers),
                };
                deadline.advance(rows.steps(batch.len()));
                (light, buffers.scratch.tally)
            })
            .collect();
        let (mut light, mut tally) = (Vec::with_capacity(leaves.len()), Tally::default());
        for (part, cost) in rows.gather(made) {
            light.extend(part);
            tally.add(cost);
        }
        (light, tally)
    }
}
