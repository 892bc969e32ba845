//! The light in a model, and irradiance at points.

use super::segments::MAX_COORDINATE;
use super::visibility::Engine;
use crate::model::Model;
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::radiosity::{self, Options, Record};
use crate::{Error, Result, memory};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Options of [`Model::solve`]: [`SolveOptions::default`], then `with_…`.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct SolveOptions {
    options: Options,
}

impl SolveOptions {
    /// Error that links are refined to, relative to the mean irradiance, above 0; default 0.02. A target, not a bound: the
    /// remaining error is estimated by [`Solution::error_estimate`].
    #[must_use]
    pub fn with_error(mut self, error: f64) -> SolveOptions {
        self.options.error = error;
        self
    }

    /// How visibility is answered; default (and [`Engine::Automatic`]) exact. Others need a model with optics.
    #[must_use]
    pub fn with_engine(mut self, engine: Engine) -> SolveOptions {
        self.options.visibility = match engine {
            Engine::MultiResolution => radiosity::Visibility::Mr,
            Engine::Average => radiosity::Visibility::Average,
            Engine::Exact | Engine::Automatic => radiosity::Visibility::Exact,
        };
        self
    }

    /// Feature size of all receivers, scene units, above 0; default: each receiver's diameter. Shadow features of at least this size
    /// are resolved.
    #[must_use]
    pub fn with_feature_size(mut self, size: f32) -> SolveOptions {
        self.options.feature_size = Some(size);
        self
    }

    /// Feature size of an object, group or material, scene units, above 0. May be called several times.
    #[must_use]
    pub fn with_feature_size_of(mut self, name: impl Into<String>, size: f32) -> SolveOptions {
        self.options.feature_sizes.push((name.into(), size));
        self
    }

    /// An object, group or material whose light matters; default: all matter alike. May be called several times.
    #[must_use]
    pub fn with_importance(mut self, name: impl Into<String>) -> SolveOptions {
        self.options.importance.push(name.into());
        self
    }

    /// Smallest element as a fraction of the scene's area, in `[1e-9, 1]`; default 2e-5.
    #[must_use]
    pub fn with_min_area(mut self, part: f64) -> SolveOptions {
        self.options.min_area = part;
        self
    }

    /// Leaves reflected light out of the irradiance at points; default false.
    #[must_use]
    pub fn with_direct_only(mut self, direct_only: bool) -> SolveOptions {
        self.options.direct_only = direct_only;
        self
    }

    /// Seconds from the call of [`Model::solve`] in which to be done, about, above 0; default: no limit. The preparation of the model does not
    /// count. Of many elements for whose rays there is no time, some are traced and determine the light of the others.
    #[must_use]
    pub fn with_max_seconds(mut self, seconds: f64) -> SolveOptions {
        self.options.max_seconds = Some(seconds);
        self
    }

    /// Number of links at which refinement ends, which bounds the memory (72 bytes each), 1 to 2³⁰; default ten million.
    #[must_use]
    pub fn with_max_links(mut self, links: usize) -> SolveOptions {
        self.options.max_links = links;
        self
    }

    /// RMS error of the elements relative to the mean irradiance, above 0, until which more rays are traced, as independent paths find it;
    /// default: none.
    #[must_use]
    pub fn with_target_error(mut self, error: f64) -> SolveOptions {
        self.options.target_error = Some(error);
        self
    }

    /// Number of elements whose error bars independent paths check, at most 1,048,576; default 200. More say more about the error in
    /// `Solution::json`; 0 leaves it out.
    #[must_use]
    pub fn with_audit(mut self, elements: usize) -> SolveOptions {
        self.options.audit = elements;
        self
    }

    /// Shadow rays from a point to an emitter that is partly visible, 1 to 65,536; default: derived from the error.
    #[must_use]
    pub fn with_light_rays(mut self, rays: usize) -> SolveOptions {
        self.options.light_rays = Some(rays);
        self
    }

    /// Rays from a point that gather reflected light, 1 to 1,048,576; default: derived from the error.
    #[must_use]
    pub fn with_gather_rays(mut self, rays: usize) -> SolveOptions {
        self.options.gather_rays = Some(rays);
        self
    }

    /// Seed of all random numbers; default 1.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> SolveOptions {
        self.options.seed = seed;
        self
    }
}

/// Bytes that a point takes while its irradiance is found, at most: the point in double and in single precision, its irradiance and the
/// error of that, all twice while they are put together.
const BYTES_PER_POINT: u64 =
    2 * (size_of::<Point>() + size_of::<(Vec3, Vec3)>() + 2 * size_of::<[f64; 3]>()) as u64;

/// A point of a surface that receives light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position in the coordinates of the file, scene units.
    pub position: [f64; 3],
    /// Normal of the side that receives light, of any length above 0.
    pub normal: [f64; 3],
}

impl SurfacePoint {
    /// The point, if rays can begin there. `origin`: that of the scene.
    fn checked(&self, index: usize, origin: DVec3) -> Result<Point> {
        let position = DVec3::from_array(self.position);
        let normal = DVec3::from_array(self.normal).normalize_or_zero();
        let largest = (position - origin).abs().max_element();
        if !position.is_finite() || largest > f64::from(MAX_COORDINATE) {
            return Err(Error::Argument(format!(
                "`points`[{index}].position {:?}: must be finite, at most {MAX_COORDINATE:e} from the scene's origin; give \
                 coordinates of the scene's file",
                self.position
            )));
        }
        if normal == DVec3::ZERO {
            return Err(Error::Argument(format!(
                "`points`[{index}].normal {:?}: must be finite and longer than 0",
                self.normal
            )));
        }
        Ok(Point { position, normal })
    }

    /// `count` points that `at` gives, checked, in the form that `as_kept` gives them.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the first wrong point, [`Error::OutOfMemory`] if there is no room for the points and what is found
    /// there.
    pub(super) fn all_checked<T>(
        count: usize,
        at: impl Fn(usize) -> SurfacePoint,
        origin: DVec3,
        as_kept: impl Fn(Point) -> T,
    ) -> Result<Vec<T>> {
        memory::check_room((count as u64).saturating_mul(BYTES_PER_POINT), || format!("{count} points"))?;
        let mut points = Vec::with_capacity(count);
        for i in 0..count {
            points.push(as_kept(at(i).checked(i, origin)?));
        }
        Ok(points)
    }
}

/// The light in a model: radiosity of all surfaces. Owned; answers irradiance at points any time.
///
/// ```
/// use mrvis::{Detail, Model, PrepareOptions, Scene, SolveOptions};
///
/// let scene = Scene::generate("cornell")?;
/// let model = Model::prepare(scene, &PrepareOptions::default().with_detail(Detail::Clusters), &())?;
/// let light = model.solve(&SolveOptions::default().with_error(0.1), &())?;
/// let vertices: Vec<[f64; 3]> = light.vertices().collect(); // scene units
/// for element in light.elements() {
///     let corners = element.corners.map(|v| vertices[v as usize]);
///     let [red, _, _] = element.radiosity; // W/m², emission included
///     assert!(red >= 0.0 && element.area > 0.0 && corners[0] != corners[1]);
/// }
/// # Ok::<(), mrvis::Error>(())
/// ```
#[derive(Clone)]
pub struct Solution {
    pub(super) inner: Arc<Solved>,
}

/// What all copies of a solution share.
pub(super) struct Solved {
    pub solved: radiosity::Solution,
    pub record: Record,
    pub mesh: RadiosityMesh,
    /// The mesh of pictures and lightmaps, made when it is first needed.
    #[cfg(feature = "reports")]
    pub smooth: std::sync::OnceLock<crate::export::Mesh>,
}

impl Model {
    /// Computes the light: hierarchical radiosity of all surfaces, with all reflections, on the threads of the model. `&()`
    /// ignores progress. If `progress` stops, the result is the consistent solution reached so far: see [`Solution::interrupted`].
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range, names nothing, or needs more of the model than was prepared
    /// ([`Detail::Clusters`](crate::Detail::Clusters), for other than exact visibility [`Detail::Optics`](crate::Detail::Optics));
    /// [`Error::Scene`] if the scene's size or light is beyond f32.
    pub fn solve(&self, options: &SolveOptions, progress: &dyn Progress) -> Result<Solution> {
        let options = &options.options;
        let needed = options.prepare().detail;
        if self.detail() < needed {
            let have = self.detail();
            return Err(Error::Argument(format!(
                "the model holds `Detail::{have:?}`: prepare it with `Detail::{needed:?}` to solve with this engine"
            )));
        }
        let (outcome, solved) = self.on_threads(|| radiosity::solve(self, &[], options, progress))??;
        let radiosity::Outcome { mesh, record, .. } = outcome;
        let solved = Solved {
            solved,
            record,
            mesh,
            #[cfg(feature = "reports")]
            smooth: Default::default(),
        };
        Ok(Solution { inner: Arc::new(solved) })
    }
}

impl Solution {
    /// Irradiance at points of surfaces, W/m², linear RGB, in their order: direct light by rays to the emitters, reflected light by
    /// rays that gather the radiosity of surfaces.
    ///
    /// # Errors
    /// [`Error::Argument`] if a position is not finite or beyond 1e12 from the scene's origin, or a normal has no length; the message names
    /// the point. [`Error::OutOfMemory`] if there are too many.
    pub fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<[f64; 3]>> {
        self.irradiance_of(points.len(), |i| points[i])
    }

    /// [`Solution::irradiance`] at `count` points that `at` gives: they are copied once, into 24 bytes each.
    #[doc(hidden)]
    pub fn irradiance_of(&self, count: usize, at: impl Fn(usize) -> SurfacePoint) -> Result<Vec<[f64; 3]>> {
        let solved = &self.inner.solved;
        let origin = solved.model().scene().origin;
        let kept = |p: Point| ((p.position - origin).as_vec3(), p.normal.as_vec3());
        let points = SurfacePoint::all_checked(count, at, origin, kept)?;
        solved.model().on_threads(|| solved.irradiance(&points))
    }

    /// The model that was solved.
    pub fn model(&self) -> &Model {
        self.inner.solved.model()
    }

    /// The elements, constant pieces of lit sides of surfaces: the first cells of `solution.vtu`, those with `lit` 1. Borrowed.
    pub fn elements(&self) -> &[Element] {
        &self.inner.mesh.elements[..self.inner.mesh.lit()]
    }

    /// Corners of the elements, each position once, in the coordinates of the file, scene units.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = [f64; 3]> {
        let RadiosityMesh { origin, vertices, .. } = &self.inner.mesh;
        vertices.iter().map(move |p| (origin + p.as_dvec3()).to_array())
    }

    /// Mean irradiance of all sides of surfaces that light arrives at, W/m², linear RGB.
    pub fn mean_irradiance(&self) -> [f64; 3] {
        self.inner.record.mean_irradiance
    }

    /// Estimated RMS error of the irradiance of the elements, relative to its mean; `None` if it is unknown.
    pub fn error_estimate(&self) -> Option<f64> {
        self.inner.record.error_estimate
    }

    /// Number of elements of the hierarchy, clusters included: more than [`Solution::elements`].
    pub fn element_count(&self) -> usize {
        self.inner.record.elements
    }

    /// What a user should know, one sentence each: repairs of the scene, limits that were reached.
    pub fn warnings(&self) -> &[String] {
        &self.inner.record.warnings
    }

    /// Whether the caller's progress stopped it before the error was reached.
    pub fn interrupted(&self) -> bool {
        self.inner.record.interrupted
    }
}
