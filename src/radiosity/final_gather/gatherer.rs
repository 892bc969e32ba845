//! Gathers light by rays from a scene whose elements have light.

use super::bright_leaves::BrightLeaves;
use super::hemisphere::{grid_of, hemisphere};
use super::reflected::Reflected;
use crate::embree::CommittedScene;
use crate::embree::{Hits, Traversal};
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::model::Model;
use crate::radiosity::elements::emitter_tree::{EmitterCut, Receiver};
use crate::radiosity::elements::emitters::Emitters;
use crate::radiosity::elements::{Elements, Lookup, Shape};
use crate::radiosity::links::{Scratch, VisibilityEngine};
use crate::radiosity::options::Options;
use crate::radiosity::refinement::LinkedScene;
use crate::ranks::Ranks;
use crate::ray::Packet;
use crate::scene::Scene;
use crate::sky::Environment;
use glam::Vec3;
use sobol_burley::sample;
use std::sync::{Arc, OnceLock};

/// Sets of directions that points choose from, so that neighbouring points do not share the errors of one set. Limits
/// memory to 64 sets. 16, 64 and 256 sets leave errors of 0.86 %, 0.79 % and 0.77 % (`constants.py solve`).
const DIRECTION_SETS: usize = 64;

/// Rounding error of the height of a ray's end over the face that it meets, relative to the largest coordinate of its ends: about sixteen
/// operations of half a unit in the last place each.
const HIT_ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Largest ratio of a ray's extent along the normal of the face that it meets to its extent within the plane of the face for which its
/// end is moved within the plane by the full rounding error; for steeper rays by less. The ray is followed back by at most 16 times the
/// rounding error.
const MAX_STEEPNESS: f32 = 16.0;

/// Largest ratio of a point's shadow rays to an emitter to [`Options::light_rays`]: they leave a quarter of the noise. The unoccluded
/// light of an emitter behind a louvre may be many times the light of the point.
const MAX_LIGHT_RAYS_RATIO: usize = 16;
/// Largest number of shadow rays of a point, the upper limit of [`Options::light_rays`]; the low-discrepancy numbers repeat after it.
const MAX_SHADOW_RAYS: usize = 1 << 16;

/// A scene and its light, prepared for gathering.
pub struct FinalGather<'a> {
    pub(super) model: &'a Model,
    pub(super) linked: &'a LinkedScene,
    pub(super) scene: &'a Scene,
    pub(super) traced: CommittedScene,
    pub(super) traversal: Traversal,
    pub(super) lookup: Lookup,
    pub(super) emitters: Arc<Emitters>,
    /// Sky and suns.
    pub(super) environment: Option<&'a Environment>,
    /// Whether reflected light is left out.
    pub(super) direct_only: bool,
    /// [`Options::error`].
    pub(super) error: f64,
    /// [`Options::elements`].
    pub(super) elements: bool,
    /// Columns and rows of the grid of the directions of a set.
    pub(super) hemisphere_grid: [usize; 2],
    /// Whether a distance cut may be built: only if the time of the solve is not limited.
    pub(super) may_build_cut: bool,
    /// [`FinalGather::engine_of_elements`], once it is asked for.
    pub(super) of_elements: OnceLock<VisibilityEngine>,
    /// The light that each element reflects.
    pub(super) reflected: Vec<Reflected>,
    /// [`FinalGather::bright`], once it is asked for.
    bright: OnceLock<Option<BrightLeaves>>,
    /// Low-discrepancy numbers for the shadow rays of a point to an emitter.
    pub(super) table: Vec<[f32; 2]>,
    /// Shadow rays from a point to an emitter that is partly visible.
    pub(super) light_rays: usize,
    /// Rays of a point that gather reflected light.
    pub(super) gather_rays: usize,
    /// Sets of directions about +z for light of the sky and reflected light, in blocks of 4 by 4 neighbours; none for direct light of
    /// emitters alone.
    pub(super) hemispheres: Vec<Vec<Vec3>>,
    /// Largest distance of given points from their surface, scene units: files contain rounded coordinates.
    pub(super) slack: f32,
    /// Largest distance from given points at which their surface is looked for: stacked faces may be farther than the slack; scene units.
    pub(super) reach: f32,
    /// Feature size where none is given, scene units.
    pub(super) feature_size: f32,
    /// Length of rays, more than the diagonal of the scene; scene units.
    pub(super) length: f32,
    /// The processes that share the rows.
    pub(in crate::radiosity) ranks: Ranks,
}

/// A point of a path on a surface.
#[derive(Clone, Copy)]
pub struct PathVertex {
    /// Position.
    pub at: Vec3,
    /// Side of the surface; [`Elements::NONE`] for no surface.
    pub side: u32,
    /// The leaf element at the position.
    pub leaf: u32,
    /// The triangle at the position, where a ray has ended.
    pub triangle: u32,
    /// Index of the path's sum.
    pub path: u32,
    /// Fraction of the light sent here that reaches the start of the path, by channel.
    pub share: Vec3,
}

/// The result of a ray from a path vertex.
#[derive(Clone, Copy)]
pub struct RayResult {
    /// Irradiance that emitters cause at the vertex (an estimate), W/m².
    pub direct: Vec3,
    /// Irradiance of the suns by a ray of its own to each, W/m².
    pub sun: Vec3,
    /// Irradiance of the sky by the ray if it left the scene, W/m². For rays of elements in the open, the unoccluded sky is a control
    /// variate, so that the value may be negative.
    pub sky: Vec3,
    /// Where the ray ended.
    pub met: PathVertex,
    /// Length of the ray, scene units.
    pub distance: f32,
    /// Whether the ray left the scene.
    pub escaped: bool,
}

impl RayResult {
    /// A result without light and without a hit.
    pub const EMPTY: RayResult = RayResult {
        direct: Vec3::ZERO,
        sun: Vec3::ZERO,
        sky: Vec3::ZERO,
        met: PathVertex {
            at: Vec3::ZERO,
            side: Elements::NONE,
            leaf: 0,
            triangle: Elements::NONE,
            path: 0,
            share: Vec3::ZERO,
        },
        distance: 0.0,
        escaped: false,
    };
}

/// Reusable buffers of a thread.
#[derive(Default)]
pub struct Buffers {
    /// Buffers and tally of visibility queries.
    pub scratch: Scratch,
    pub(super) packets: Vec<Packet>,
    pub(super) hits: Vec<Hits>,
    /// Path vertices from which the next rays start.
    pub vertices: Vec<PathVertex>,
    pub(super) next_vertices: Vec<PathVertex>,
    pub(super) results: Vec<RayResult>,
    /// For each followed path that ends at an element whose light is not known yet: number of the path, leaf, and fraction of the light
    /// reflected there that arrives at the start of the path.
    pub(super) path_ends: Vec<(u32, u32, Vec3)>,
    /// By element of a batch, the groups of emitting faces from which its emitter rays are drawn.
    pub(super) cuts: Vec<EmitterCut>,
    /// The same for bright leaves.
    pub(super) bright_cuts: Vec<EmitterCut>,
    /// Further places from which rays of elements to suns start, in the order of the vertices.
    pub(super) sun_places: Vec<Vec3>,
    /// By vertex of the rays of elements, the quarter of the element on which the vertex lies.
    pub(super) quarters: Vec<u8>,
}

impl<'a> FinalGather<'a> {
    /// Prepares gathering from the light of a model at points.
    pub fn new(model: &'a Model, linked: &'a LinkedScene, options: &Options) -> FinalGather<'a> {
        let (scene, magnitude) = (model.scene(), model.magnitude());
        let elements = &linked.elements;
        let gathered = options.gather_rays();
        let environment = scene.environment.as_deref();
        let sets = if options.direct_only && environment.is_none() { 0 } else { DIRECTION_SETS };
        let hemispheres =
            (0..sets).map(|k| hemisphere(gathered, mix(options.seed ^ mix(k as u64)))).collect();
        let shadow_rays = (MAX_LIGHT_RAYS_RATIO * options.light_rays()).min(MAX_SHADOW_RAYS) as u32;
        let table = (0..shadow_rays).map(|i| [sample(i, 0, 7), sample(i, 1, 7)]).collect();
        let reflected = parallel::map(0..elements.len(), |k| {
            let (e, state) = (&elements.elements[k], &elements.states[k]);
            let light = match e.shape {
                Shape::Cluster(_) => [0.0; 3],
                Shape::Surface { side, .. } => {
                    let emitted = elements.sides[side as usize].exitance;
                    std::array::from_fn(|k| (state.radiosity[k] - emitted[k]) as f32)
                }
            };
            let trusted_from = match (state.is_excluded(), elements.large_from > 0) {
                (true, _) => f32::INFINITY,
                (false, true) => e.radius,
                (false, false) => 0.0,
            };
            Reflected { light, trusted_from }
        });
        let slack = 1e-5 * scene.bounds.diagonal() + 1e-6 * magnitude;
        FinalGather {
            model,
            lookup: Lookup::new(elements),
            reflected,
            bright: OnceLock::new(),
            linked,
            scene,
            traced: model.traced().clone(),
            traversal: model.widest_packets(),
            emitters: linked.emitters(scene),
            environment,
            direct_only: options.direct_only,
            error: options.error,
            elements: options.elements,
            hemisphere_grid: grid_of(gathered).map(|blocks| 4 * blocks),
            may_build_cut: options.max_seconds.is_none(),
            of_elements: OnceLock::new(),
            table,
            light_rays: options.light_rays(),
            gather_rays: gathered,
            hemispheres,
            slack,
            reach: slack + 2.0 * model.largest_stack_distance(),
            feature_size: options.feature_size.unwrap_or(1e-2 * scene.size()),
            length: scene.ray_length(),
            ranks: model.ranks().clone(),
        }
    }

    /// Small bright surfaces whose reflected light would cause noise without shadow rays; `None` if there are none.
    pub(super) fn bright(&self) -> Option<&BrightLeaves> {
        let of = || match self.direct_only {
            true => None,
            false => {
                BrightLeaves::of(self.linked, &self.reflected, self.gather_rays, self.light_rays, self.error)
            }
        };
        self.bright.get_or_init(of).as_ref()
    }

    /// The radiosity that an element reflects, W/m².
    pub(super) fn reflected_from(&self, element: u32) -> Vec3 {
        Vec3::from(self.reflected[element as usize].light)
    }

    /// The scene that is gathered from.
    pub fn linked(&self) -> &'a LinkedScene {
        self.linked
    }

    /// Where a ray of a packet ended, moved back by rounding.
    pub(super) fn met(&self, packet: &Packet, hits: &Hits, lane: usize) -> Option<PathVertex> {
        let triangle = hits.triangle[lane];
        if triangle == Hits::NO_HIT {
            return None;
        }
        let (from, at) = (packet.point(lane, 0.0), packet.point(lane, hits.t[lane]));
        let along = at - from;
        let side = self.linked.elements.met(triangle, along);
        if side == Elements::NONE {
            return None;
        }
        // By rounding the end may lie below the face or behind a wall that stands on it: it is moved back from both.
        let rounding = HIT_ROUNDING * from.abs().max(at.abs()).max_element();
        let depth = self.linked.elements.sides[side as usize].normal.dot(along).abs();
        let across = (along.length_squared() - depth * depth).max(0.0).sqrt();
        let least = depth.min(across.max(depth / MAX_STEEPNESS));
        let at = at - (rounding / least.max(rounding)) * along;
        let leaf = self.lookup.leaf(side, at);
        Some(PathVertex { at, side, leaf, triangle, path: 0, share: Vec3::ONE })
    }

    /// Finds the groups of emitter faces from which an element draws its emitter rays.
    pub(super) fn cut_of(&self, emitters: &Emitters, leaf: u32, cut: &mut EmitterCut) {
        let element = &self.linked.elements.elements[leaf as usize];
        if let Shape::Surface { side, corners } = element.shape {
            let normal = self.linked.elements.sides[side as usize].normal;
            let centre = element.centre;
            let radius = corners.iter().map(|c| (*c - centre).length()).fold(0.0, f32::max);
            emitters.cut(&Receiver { centre, radius, normal }, cut);
        }
    }

    /// Length of rays from a point, more than its distance from anything in the scene, scene units.
    pub(super) fn reach_from(&self, at: Vec3) -> f32 {
        self.length + self.scene.bounds.distance(at)
    }

    /// The feature size of a surface element, or that for receivers without one; scene units.
    pub(super) fn feature_size_of(&self, element: u32) -> f32 {
        let LinkedScene { feature_sizes, elements, .. } = self.linked;
        feature_sizes.of_surface(elements, element as usize).unwrap_or(self.feature_size)
    }
}
