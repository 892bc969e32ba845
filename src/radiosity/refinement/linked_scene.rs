//! The elements of a scene with their links and their light: the data that all phases of a solution share.

use super::feature_sizes::FeatureSizes;
use crate::math::parallel;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::emitter_tree::Receiver;
use crate::radiosity::elements::emitters::Emitters;
use crate::radiosity::elements::{Elements, LightStatistics, RowFactors, Shape};
use crate::radiosity::links::{BlockerCertificate, Link, SkyLink, Tally, VisibilityEngine};
use crate::radiosity::options::Options;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::{Surroundings, received_shares};
use crate::radiosity::transport::{
    ActiveNodes, Convergence, Field, LinkTransport, NodeIrradiance, link_row_sums, normalise_link_rows,
    pushed, short_rows, sweeps,
};
use crate::ranks::Ranks;
use crate::scene::Scene;
use crate::sky::Environment;
use glam::Vec3;
use std::sync::{Arc, OnceLock};

/// Reflectance that dark surfaces count with in the error oracle, because their irradiance is an output as well. 0.05
/// or 0.2 instead change irradiance by less than 0.04 % (`constants.py solve`).
const MIN_WEIGHT: f32 = 0.1;

/// Largest error if one value stands for the direct light of an element, as a fraction of the emitted power: some 500 elements
/// around one lamp, whose sizes grow with the distance, have a total error of .1 % (`radiosity::tests::ratios`).
const MAX_VARIATION: f32 = 2e-5;

/// Largest importance by points that makes elements smaller, by √8 = 2.8 times at most: more elements of a small room in a large hall
/// take half as much time again, and its points are no better.
const MAX_SPLIT_IMPORTANCE: f64 = 8.0;

/// Elements that are split between two reports of progress, at which an interruption is noticed: 2¹² take about 1 ms.
const SPLIT_SLICE: usize = 1 << 12;

/// Light on a side, as a fraction of the mean over all sides, below which the side counts as dark: light leaking through the edges of a
/// closed room is below a millionth, and a side of so little light adds less than a thousandth to any mean.
const MIN_LIT: f64 = 1e-3;

/// Fraction of its rays that leave the scene up to which a side belongs to an inside: half of that at the outside of a wall above a ground.
const MAX_ESCAPED_INSIDE: f32 = 0.25;
/// Mean fraction of pairs of rays from one side of which one leaves the scene and the other does not, up to which a scene has an inside:
/// that of a room from whose sides 5 % of the rays leave through windows is 2 · .05 · .95. In furnished rooms it is about .01, in a
/// valley with trees .29.
const MAX_DIFFERENT_RAYS: f64 = 0.1;

/// Results of paths from points, weighted by the fraction of the light that gets to a point: the fraction of the points' light that
/// surfaces reflect, if they have as much light as the points, and the fraction of the rays from these surfaces that leave the scene.
#[derive(Clone, Copy)]
pub struct PointsView {
    pub reflected: f64,
    pub open: f64,
}

/// The elements of a scene with their links and their light.
pub struct LinkedScene {
    /// The elements with their light, importance, feature sizes and row factors.
    pub elements: Elements,
    /// The links.
    pub links: Vec<Link>,
    /// Results of the rays from every side.
    pub surroundings: Surroundings,
    /// The visibility engine.
    pub engine: VisibilityEngine,
    /// Options for measuring, refining and normalising links.
    pub settings: Options,
    /// Data from which the feature sizes of receivers are computed.
    pub feature_sizes: FeatureSizes,
    /// Mean irradiance that the emitted power and the mean reflectance imply, W/m²: errors are relative to this.
    pub mean_irradiance: f64,
    /// Light from beyond the scene.
    pub environment: Option<Arc<Environment>>,
    /// Links to sky and suns.
    pub sky_links: Vec<SkyLink>,
    /// Irradiance of a horizontal plane by the sky and the suns, W/m².
    pub(super) beyond: f64,
    /// The view of the scene from the requested points; none if importance does not depend on points.
    pub points_view: Option<PointsView>,
    /// The processes that share the measurement of links.
    pub ranks: Ranks,
    /// Visibility queries so far.
    pub tally: Tally,
    /// Irradiance at the active nodes after the last sweeps: the first guess of the next ones.
    last_field: Option<Field>,
    /// The emitting faces, which subdivision does not change.
    emitters: OnceLock<Arc<Emitters>>,
    /// Places in openings through which the sky lights rooms; computed at the first use.
    pub openings: OnceLock<Arc<Vec<Vec3>>>,
}

/// Elements that [`LinkedScene::split_small_surfaces`] may add, as a fraction of all: a furnished office takes 2 % longer.
const MAX_SMALL_ADDED: f64 = 1.0 / 32.0;

impl LinkedScene {
    /// Elements with the light that they emit and the link of the root with itself.
    pub fn new(
        elements: Elements,
        surroundings: Surroundings,
        engine: VisibilityEngine,
        options: &Options,
    ) -> LinkedScene {
        let (mut power, mut absorbed) = (0.0, 0.0);
        for side in &elements.sides {
            let area = elements.elements[side.element as usize].area;
            power += area * mean(side.exitance);
            absorbed += area * (1.0 - mean(side.reflectance.map(f64::from)));
        }
        let root = Link {
            a: 0,
            b: 0,
            exchange_area: (f64::from(surroundings.enclosed[0]) * elements.area) as f32,
            transmittance: 1.0,
            variation: [elements.area as f32; 2],
            noise: elements.area as f32,
            rays: 0,
            certificate: BlockerCertificate::UNKNOWN,
        };
        let by_side = vec![f32::INFINITY; elements.sides.len()];
        let feature_sizes = FeatureSizes { given: options.feature_size, by_side, important: Vec::new() };
        let mut scene = LinkedScene {
            elements,
            links: vec![root],
            surroundings,
            engine,
            settings: options.clone(),
            feature_sizes,
            mean_irradiance: if absorbed > 0.0 { power / absorbed } else { 0.0 },
            environment: None,
            sky_links: Vec::new(),
            beyond: 0.0,
            points_view: None,
            ranks: Ranks::default(),
            tally: Tally::default(),
            last_field: None,
            emitters: OnceLock::new(),
            openings: OnceLock::new(),
        };
        scene.feature_sizes.assign(&mut scene.elements);
        scene.pull_radiosity();
        scene.update_oracle_statistics();
        scene
    }

    /// The emitting faces of the scene of the elements; collected at the first call.
    pub fn emitters(&self, scene: &Scene) -> Arc<Emitters> {
        self.emitters.get_or_init(|| Arc::new(Emitters::new(scene, &self.elements))).clone()
    }

    /// Irradiance that counts as zero, W/m²: 1e-9 of the surfaces' irradiance if all emitted light arrived once. Rounding at the edges
    /// of emitters lets about 1e-14 pass.
    pub fn dark(&self) -> f64 {
        1e-9 * (self.emitted_over_area() + self.beyond)
    }

    /// Irradiance of the surfaces if all emitted light arrived once, W/m².
    pub(super) fn emitted_over_area(&self) -> f64 {
        let Elements { elements, sides, .. } = &self.elements;
        let emitted: f64 = sides.iter().map(|s| elements[s.element as usize].area * mean(s.exitance)).sum();
        emitted / elements[0].area
    }

    /// By side, whether it counts in means of light and relative errors: light arrives there, at least [`MIN_LIT`] of the mean over all
    /// sides, and it belongs to the inside if the scene has one. So means depend neither on whether the outsides of a closed room have
    /// elements nor on lamps above it. Under a sky the outside counts as well.
    pub fn lit_sides(&self) -> Vec<bool> {
        let Elements { elements, states, sides, .. } = &self.elements;
        let (mut light, mut all) = (vec![0.0; sides.len()], 0.0);
        for (element, state) in elements.iter().zip(states.iter()).filter(|(e, _)| e.is_leaf()) {
            if let Shape::Surface { side, .. } = element.shape {
                let power = element.area * mean(state.irradiance);
                light[side as usize] += power;
                all += power;
            }
        }
        let least = MIN_LIT * all.max(0.0) / self.elements.area;
        let area = |side: usize| elements[sides[side].element as usize].area;
        let mut lit: Vec<bool> = (0..sides.len()).map(|side| light[side] > least * area(side)).collect();
        if self.environment.is_some() {
            return lit;
        }
        let Surroundings { escaped, differ, .. } = &self.surroundings;
        let is_inside = |side: usize| escaped[side] < MAX_ESCAPED_INSIDE;
        // Sums over lit sides, by area and by light: of all, of the inside, and of pairs of rays that differ.
        let mut sums = [[0.0; 3]; 2];
        for side in (0..sides.len()).filter(|side| lit[*side]) {
            let counts = [1.0, f64::from(u8::from(is_inside(side))), f64::from(differ[side])];
            for (sum, weight) in sums.iter_mut().zip([area(side), light[side]]) {
                add(sum, weight, counts);
            }
        }
        if sums
            .iter()
            .any(|[all, inside, differ]| 2.0 * inside >= *all && *differ <= MAX_DIFFERENT_RAYS * all)
        {
            lit.iter_mut().enumerate().for_each(|(side, lit)| *lit &= is_inside(side));
        }
        lit
    }

    /// The leaves of the sides that [count](LinkedScene::lit_sides).
    pub fn lit_leaves(&self) -> Vec<u32> {
        let lit = self.lit_sides();
        let mut leaves = self.leaves();
        leaves.retain(|&e| match self.elements.elements[e as usize].shape {
            Shape::Surface { side, .. } => lit[side as usize],
            Shape::Cluster(_) => false,
        });
        leaves
    }

    /// The active nodes of the present links.
    pub fn active_nodes(&self) -> ActiveNodes {
        let beyond = self.light_from_beyond();
        let mut nodes = ActiveNodes::new(&self.elements, &self.links, beyond.iter().map(|(e, _)| *e));
        nodes.beyond = pushed(&self.elements, &nodes, &beyond);
        nodes
    }

    /// Splits a surface into four parts that send out the light of the whole.
    pub fn split(&mut self, element: u32) {
        let first = self.elements.len();
        self.elements.split(element);
        self.assign_feature_sizes(first);
    }

    /// Sets the feature sizes of new elements, from the `first` on.
    pub(super) fn assign_feature_sizes(&mut self, first: usize) {
        for part in first..self.elements.len() {
            let size = self.feature_sizes.of_surface(&self.elements, part);
            let diameter = 2.0 * self.elements.elements[part].radius;
            self.elements.states[part].feature_size = size.unwrap_or(diameter);
        }
    }

    /// Splits all surfaces down to an area (scene units squared, no smaller than the ranges of ids allow), for the local pass: an object
    /// that covers a part of a surface, as furniture does with a floor, would darken the mean of a large element. Splitting ends on an
    /// interruption.
    pub fn split_all(&mut self, min_area: f64, deadline: &Deadline) {
        self.elements.min_area = min_area;
        // Named surfaces have importance for links: that of others is no less than it should be.
        let by_points = self.points_view.is_some();
        deadline.stage("splitting surfaces", self.elements.expected_after_split());
        let mut e = 0;
        while e < self.elements.len() {
            if e % SPLIT_SLICE == 0 {
                deadline.advance(SPLIT_SLICE);
                if deadline.interrupted() {
                    break;
                }
            }
            let importance = match by_points {
                true => f64::from(self.elements.states[e].importance).min(MAX_SPLIT_IMPORTANCE),
                false => 1.0,
            };
            if self.elements.can_split(e as u32, min_area / importance) {
                self.split(e as u32);
            }
            e += 1;
        }
        self.last_field = None;
    }

    /// Splits the largest surfaces that are smaller than the elements of the others into sixteen parts: a hut on a plain would be a few
    /// elements, parts of which lie outdoors. Lamps stay whole: what they send does not depend on their elements.
    pub fn split_small_surfaces(&mut self, deadline: &Deadline) {
        let (elements, sides) = (&self.elements.elements, &self.elements.sides);
        let is_whole = |e: &u32| {
            let element = &elements[*e as usize];
            let Shape::Surface { side, .. } = element.shape else { return false };
            element.level == 0 && element.area > 0.0 && sides[side as usize].exitance == [0.0; 3]
        };
        let (mut whole, parts): (Vec<u32>, Vec<u32>) = self.leaves().into_iter().partition(is_whole);
        whole.sort_by(|&a, &b| {
            elements[b as usize].area.total_cmp(&elements[a as usize].area).then(a.cmp(&b))
        });
        whole.truncate((MAX_SMALL_ADDED * parts.len() as f64) as usize / 15);
        for surface in whole {
            if deadline.interrupted() {
                break;
            }
            let first = self.elements.len() as u32;
            self.split(surface);
            (first..self.elements.len() as u32).for_each(|part| self.split(part));
        }
        self.last_field = None;
    }

    /// Splits surfaces further where direct light changes much over them, as below a lamp that is small against the elements of a large
    /// floor: until one value for each part errs by at most [`MAX_VARIATION`] of the emitted power.
    pub fn split_near_emitters(&mut self, scene: &Scene, deadline: &Deadline) {
        let emitters = self.emitters(scene);
        let mut from = 0;
        while from < self.elements.len() && !deadline.interrupted() {
            let elements = &self.elements;
            let changes = |e: u32| {
                let element = &elements.elements[e as usize];
                let Shape::Surface { side, .. } = element.shape else { return false };
                let normal = elements.sides[side as usize].normal;
                let receiver = Receiver { centre: element.centre, radius: element.radius, normal };
                element.is_leaf()
                    && element.area > 0.0
                    && emitters.variation(&receiver, element.area as f32, MAX_VARIATION) > MAX_VARIATION
            };
            let end = elements.len();
            let all = parallel::at_least(SPLIT_SLICE, from as u32..end as u32);
            let found: Vec<u32> = parallel::flat_map(all, |e| changes(e).then_some(e));
            found.into_iter().for_each(|e| self.split(e));
            from = end;
        }
        self.last_field = None;
    }

    /// Sets the irradiance of all elements, W/m², and derives radiosities. The statistics of the error oracle stay those of the last
    /// refinement.
    pub fn set_irradiance(&mut self, irradiance: impl Iterator<Item = Rgb>) {
        self.elements.states.iter_mut().zip(irradiance).for_each(|(state, e)| state.irradiance = e);
        self.pull_radiosity();
    }

    /// Radiosity of all elements from the irradiance of the leaves; elements with children have the mean by area.
    fn pull_radiosity(&mut self) {
        let Elements { elements, states, sides, .. } = &mut self.elements;
        for (e, element) in elements.iter().enumerate().rev() {
            let mut radiosity = [0.0; 3];
            if let (Shape::Surface { side, .. }, true) = (&element.shape, element.is_leaf()) {
                radiosity = sides[*side as usize].radiosity(states[e].irradiance);
            }
            let mut irradiance = [0.0; 3];
            for c in element.child_range() {
                let share = elements[c].area / element.area.max(f64::MIN_POSITIVE);
                add(&mut radiosity, share, states[c].radiosity);
                add(&mut irradiance, share, states[c].irradiance);
            }
            let state = &mut states[e];
            state.radiosity = radiosity;
            if !element.is_leaf() && !element.is_cluster() {
                state.irradiance = irradiance;
            }
        }
    }

    /// Computes the error oracle's statistics of every element from the present light.
    pub fn update_oracle_statistics(&mut self) {
        let n = self.elements.len();
        let mut squares = vec![0.0f64; n];
        let together = self.effect_of_errors_together();
        for e in (0..n).rev() {
            let element = &self.elements.elements[e];
            let mean = mean(self.elements.states[e].radiosity);
            let reflectance = match element.shape {
                Shape::Cluster(c) => self.elements.clusters[c as usize].reflectance,
                Shape::Surface { side, .. } => {
                    self.elements.sides[side as usize].reflectance.iter().sum::<f32>() / 3.0
                }
            };
            let weight =
                reflectance.max(MIN_WEIGHT) * (together * self.elements.states[e].importance).min(1.0);
            if element.is_leaf() {
                squares[e] = mean * mean;
            } else {
                let parts = element.child_range();
                let sum: f64 = parts.map(|c| self.elements.elements[c].area * squares[c]).sum();
                squares[e] = sum / element.area.max(f64::MIN_POSITIVE);
            }
            let deviation = (squares[e] - mean * mean).max(0.0).sqrt();
            self.elements.states[e].statistics =
                LightStatistics { mean: mean as f32, deviation: deviation as f32, weight };
        }
    }

    /// Twice the effect of the errors of all other surfaces on the important ones, relative to their effect if they cancelled: 2 √((A -
    /// A_i) / A_i), at least 1. Patches of area A_p that see important surfaces of area A_i with form factors of importance I = A_i / A
    /// change the light of these by Σ (A_p / A_i) I δ = δ if their errors δ are alike, and by δ √(A_p / A) if not. The factor 2 limits
    /// this effect to half of the error asked for, so that it and the errors of the important surfaces' own links together are within
    /// that error.
    fn effect_of_errors_together(&self) -> f32 {
        let Elements { elements, sides, area, .. } = &self.elements;
        let is_important = sides.iter().zip(&self.feature_sizes.important).filter(|(_, of)| **of);
        let important: f64 = is_important.map(|(side, _)| elements[side.element as usize].area).sum();
        let others = (area - important).max(0.0);
        // The errors of important surfaces count in full.
        if important > 0.0 { (2.0 * (others / important).sqrt() as f32).max(1.0) } else { 1.0 }
    }

    /// Sweeps along the links, starting from the light of the last sweeps, and sets radiosity and irradiance of all elements.
    pub fn iterate(
        &mut self,
        nodes: &ActiveNodes,
        tolerance: f64,
        max_sweeps: usize,
        deadline: &Deadline,
    ) -> Convergence {
        let transport = LinkTransport::new(&self.elements, nodes);
        let (field, convergence) =
            sweeps(&transport, self.last_field.take(), tolerance, max_sweeps, deadline);
        let found = NodeIrradiance::from_field(&field, nodes.clusters);
        let irradiance = nodes.expand(&self.elements, &found.clusters, &found.surfaces);
        let beyond = nodes.beyond.as_ref();
        let beyond = beyond.map(|of| nodes.expand(&self.elements, &of.clusters, &of.surfaces));
        for (k, (state, e)) in self.elements.states.iter_mut().zip(irradiance).enumerate() {
            let gathers = f64::from(state.factors.gathers);
            state.irradiance = e.map(|v| gathers * v);
            if let Some(beyond) = &beyond {
                add(&mut state.irradiance, 1.0 - gathers, beyond[k]);
            }
        }
        self.pull_radiosity();
        self.last_field = Some(field);
        convergence
    }

    /// Normalises the row sums of leaves from which no light leaves the scene. Short rows get their target from rays first. Returns the
    /// row sums before, and the number of leaves whose light would have grown without end and was bounded.
    pub fn normalise_rows(&mut self, deadline: &Deadline) -> (Vec<f64>, usize) {
        self.elements.states.iter_mut().for_each(|s| s.factors = RowFactors::ONE);
        let mut nodes = self.active_nodes();
        let sampled = link_row_sums(&self.elements, &nodes);
        self.assign_row_targets(&sampled);
        let (closed, row_sums) = (&self.surroundings.closed, self.settings.row_sums);
        let bounded =
            normalise_link_rows(&mut self.elements, &mut nodes, closed, row_sums, &sampled, deadline);
        (sampled, bounded)
    }

    /// The targets of the row sums: 1, and for short rows the fraction of their rays that meets lit sides.
    fn assign_row_targets(&mut self, sums: &[f64]) {
        let Surroundings { closed, length, .. } = &self.surroundings;
        let short = short_rows(&self.elements, closed, sums);
        let exact = self.engine.exact();
        let seed = self.settings.seed;
        let shares = received_shares(&self.elements, &exact, *length, seed, &short);
        self.elements.states.iter_mut().for_each(|s| s.row_target = 1.0);
        for (e, share) in short.into_iter().zip(shares) {
            self.elements.states[e as usize].row_target = share as f32;
        }
    }

    /// All surface elements without children and with an area.
    pub fn leaves(&self) -> Vec<u32> {
        (0..self.elements.len() as u32)
            .filter(|&e| {
                let element = &self.elements.elements[e as usize];
                element.is_leaf() && !element.is_cluster() && element.area > 0.0
            })
            .collect()
    }
}
