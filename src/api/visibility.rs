//! Visibility of a model: which engine answers, and single queries.

use super::positive;
use crate::model::Model;
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::visibility::{Answer, Bundle, Cost, Engine, Exact, Method, MultiResolution, wilson};
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use sobol_burley::sample_4d;

/// Visibility of a model: the fraction of light between points that gets through.
///
/// Made by [`Model::visibility`]; cheap to make and to clone. The first multi-resolution query estimates the cost of exact rays
/// in this model once (milliseconds). The first single query to a source makes the tree of the distance cut and measures where it pays
/// (seconds for a million triangles), and decides whether to use it (milliseconds, once for each power of two of feature size and number
/// of segments); the model keeps all that.
#[derive(Clone)]
pub struct Visibility {
    pub(super) model: Model,
    pub(super) engine: Engine,
}

impl Model {
    /// Visibility in this model, with [`Engine::Automatic`].
    pub fn visibility(&self) -> Visibility {
        Visibility { model: self.clone(), engine: Engine::Automatic }
    }
}

impl Visibility {
    /// The same with another engine.
    #[must_use]
    pub fn with_engine(mut self, engine: Engine) -> Visibility {
        self.engine = engine;
        self
    }

    /// The engine that answers. `sized`: whether there is a feature size.
    pub(super) fn chosen(&self, sized: bool) -> Result<BatchEngine> {
        let need = |engine: Option<MultiResolution>, name: &str| {
            if !sized {
                let problem = format!("the engine ⟨Engine::{name}⟩ needs one, a length above 0");
                return Err(Error::argument("feature_size", "", problem));
            }
            self.model.check_clusters(name)?;
            engine.ok_or_else(|| {
                let cure = "prepare the model with ⟨Detail::Optics⟩";
                Error::argument("engine", format!("⟨Engine::{name}⟩"), "needs optics").with_cure(cure)
            })
        };
        let of = if self.engine == Engine::Automatic { BatchEngine::Either } else { BatchEngine::Clusters };
        match self.model.chosen(self.engine, sized) {
            Engine::MultiResolution => {
                need(self.model.multi_resolution().cloned(), "MultiResolution").map(of)
            }
            Engine::Average => need(self.model.average(), "Average").map(of),
            Engine::Exact | Engine::Automatic => Ok(BatchEngine::Exact(self.model.exact())),
        }
    }
}

/// An engine for a batch.
pub(super) enum BatchEngine {
    Exact(Exact),
    /// Multi-resolution or average.
    Clusters(MultiResolution),
    /// Multi-resolution where it pays, else exact.
    Either(MultiResolution),
}

/// Segments to a source by default: a standard error of at most 1 / (2 √64) = 0.06.
const RAYS: usize = 64;
/// Largest number of segments: points of one scrambled sequence.
const MAX_RAYS: usize = 1 << 16;

/// A single query: from a point of a surface to a source, or to another point.
///
/// Made by [`Visibility::from_point`]; ends with [`Query::answer`].
#[derive(Clone, Copy)]
#[must_use = "`answer` runs the query"]
pub struct Query<'a> {
    visibility: &'a Visibility,
    position: [f64; 3],
    normal: [f64; 3],
    target: Option<Target>,
    feature_size: Option<f32>,
    rays: usize,
    seed: u32,
}

#[derive(Clone, Copy)]
enum Target {
    Source(usize),
    Point([f64; 3]),
}

impl Visibility {
    /// Begins a single query: how much of the light that would arrive at this point of a surface gets through. `position` is in
    /// the coordinates of the file, scene units; `normal` is the normal of the side that receives light, of any length above 0.
    pub fn from_point(&self, position: [f64; 3], normal: [f64; 3]) -> Query<'_> {
        Query { visibility: self, position, normal, target: None, feature_size: None, rays: RAYS, seed: 1 }
    }
}

impl<'a> Query<'a> {
    /// To the source with this index in [`Model::sources`](crate::Model::sources).
    pub fn to_source(mut self, source: usize) -> Query<'a> {
        self.target = Some(Target::Source(source));
        self
    }

    /// To another point, by one segment; coordinates of the file, scene units.
    pub fn to_point(mut self, position: [f64; 3]) -> Query<'a> {
        self.target = Some(Target::Point(position));
        self
    }

    /// Feature size at the point, scene units, above 0: shadow features of at least this size are resolved, smaller ones may be
    /// averaged. Without it the answer is exact.
    pub fn feature_size(mut self, size: f32) -> Query<'a> {
        self.feature_size = Some(size);
        self
    }

    /// Segments to a source, 1 to 65,536; default 64. They end at stratified points of those of its faces that emit towards the
    /// point, uniform in area.
    pub fn rays(mut self, rays: usize) -> Query<'a> {
        self.rays = rays;
        self
    }

    /// Seed of the points on the source; default 1.
    pub fn seed(mut self, seed: u32) -> Query<'a> {
        self.seed = seed;
        self
    }

    /// The visible fraction. Parts of a source below the horizon of the point's normal count as hidden; cosines and distances do not
    /// count. The answer depends on the query alone.
    ///
    /// # Errors
    /// [`Error::Argument`] if there is no target, no such source, or a value is out of its range; if the engine needs a feature size
    /// or optics that are missing.
    pub fn answer(self) -> Result<Answer> {
        // Kernels that are not optimised need more stack than threads of tests have; those of the model have 8 MiB.
        if cfg!(debug_assertions) {
            return self.visibility.model.on_threads(|| self.answer_here())?;
        }
        self.answer_here()
    }

    fn answer_here(self) -> Result<Answer> {
        let model = &self.visibility.model;
        let scene = model.scene();
        let point = |name: &str, p: [f64; 3]| {
            let relative = (DVec3::from_array(p) - scene.origin).as_vec3();
            let lies =
                relative.is_finite() && relative.abs().max_element() <= super::segments::MAX_COORDINATE;
            let cure = "give finite coordinates of the scene's file";
            lies.then_some(relative).ok_or_else(|| Error::argument(name, format!("{p:?}"), cure))
        };
        let position = point("position", self.position)?;
        let normal = DVec3::from_array(self.normal).normalize_or_zero().as_vec3();
        if !(normal.is_finite() && normal != Vec3::ZERO) {
            let normal = format!("{:?}", self.normal);
            return Err(Error::argument("normal", normal, "must be finite and longer than 0"));
        }
        let rule = model.end_at(position, normal);
        let from = rule.lifted(position, normal);
        if self.rays == 0 || self.rays > MAX_RAYS {
            return Err(Error::argument("rays", self.rays, format!("must lie in 1..{MAX_RAYS}")));
        }
        let size = self.feature_size.map(|s| positive("feature_size", s)).transpose()?;
        let chosen = self.visibility.chosen(size.is_some())?;
        let (ends, emitter_size, hull) = match self.target {
            None => {
                return Err(Error::arguments("there is no target: call ⟨to_source⟩ or ⟨to_point⟩".into()));
            }
            Some(Target::Point(p)) => {
                let to = point("to_point", p)?;
                if to == position {
                    return Err(Error::argument("to_point", format!("{p:?}"), "this is the point itself"));
                }
                let there = model.end_at(to, (to - position).normalize_or_zero()).seen_from(rule);
                (vec![(to, there)], 0.0, &[][..])
            }
            Some(Target::Source(source)) => {
                let sampler = model.samplers().get(source).ok_or_else(|| {
                    let count = model.sources().len();
                    let problem = format!("the model has {count} sources, counted from 0");
                    Error::argument("to_source", source, problem)
                })?;
                let all = scene.two_sided_emission;
                if !all && !sampler.faces(from) {
                    return Ok(hidden());
                }
                let faces = if all { sampler.all() } else { sampler.facing(scene, from) };
                let draw = |i: usize| sample_4d(i as u32, 0, self.seed);
                let end = |[u, v, ..]: [f32; 4]| rule.other_end(from, faces.sample(scene, u, v));
                let ends: Vec<(Vec3, EndRule)> = (0..self.rays).map(draw).map(end).collect();
                (ends, sampler.size_from(from), sampler.hull())
            }
        };
        let above = |to: &Vec3| normal.dot(*to - from) > 0.0;
        let asked = ends.len();
        let mut ends: Vec<(Vec3, EndRule)> = ends.into_iter().filter(|(to, _)| above(to)).collect();
        if ends.is_empty() && (hull.is_empty() || !hull.iter().any(above)) {
            return Ok(hidden());
        }
        gather_neighbours(&mut ends);
        let mut packets = vec![Packet::EMPTY; ends.len().div_ceil(LANES)];
        for (k, &(to, there)) in ends.iter().enumerate() {
            packets[k / LANES].set_lifted(k % LANES, from, to, [rule, there]);
        }
        Packet::share_slack(&mut packets);
        let bundle = Bundle { packets: &packets, emitter_size, emitter: hull };
        let answer = model.with_workspace(|workspace| match (&chosen, size) {
            (BatchEngine::Clusters(engine) | BatchEngine::Either(engine), Some(s)) => {
                model.with_cut_for(engine, s, &bundle).answer(bundle, s, workspace)
            }
            _ => model.exact().answer(bundle, &mut Vec::new()),
        });
        Ok(above_horizon(answer, ends.len(), asked))
    }
}

/// The answer if the whole source lies below the horizon of the point.
fn hidden() -> Answer {
    Answer { transmittance: 0.0, lo: 0.0, hi: 0.0, method: Method::Covered, cost: Cost::default() }
}

/// The answer of a source of which `above` of `all` points lie above the horizon.
fn above_horizon(answer: Answer, above: usize, all: usize) -> Answer {
    if above == all {
        return answer;
    }
    let part = above as f32 / all as f32;
    let (lo, hi) = wilson(part, all as f32);
    let transmittance = if above == 0 { 0.0 } else { part * answer.transmittance };
    Answer {
        transmittance,
        lo: (lo * answer.lo).min(transmittance),
        hi: (hi * answer.hi).max(transmittance),
        ..answer
    }
}
