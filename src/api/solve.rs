//! The light in a model, and irradiance at points.

use super::segments::MAX_COORDINATE;
use crate::model::Model;
use crate::points::Point;
use crate::progress::{Progress, Watcher};
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::radiosity::{self, Record, SolveOptions};
use crate::{Error, Result, error::own_word, error::worded, memory};
use glam::{DVec3, Vec3};
use std::sync::Arc;

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
    /// The point, if its position and normal are valid. `origin`: that of the scene.
    fn checked(&self, index: usize, origin: DVec3) -> Result<Point> {
        let wrong = |name: &str, value: [f64; 3], problem: String| {
            Error::argument(name, format!("{value:?}"), problem).in_entry("points", index)
        };
        let position = DVec3::from_array(self.position);
        let normal = DVec3::from_array(self.normal).normalize_or_zero();
        let largest = (position - origin).abs().max_element();
        if !position.is_finite() || largest > f64::from(MAX_COORDINATE) {
            let problem = format!("must be finite, at most {MAX_COORDINATE:e} from the scene's origin");
            return Err(
                wrong("position", self.position, problem).with_cure("give coordinates of the scene's file")
            );
        }
        if normal == DVec3::ZERO {
            return Err(wrong("normal", self.normal, "must be finite and longer than 0".into()));
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
/// use mrvis::{Model, PrepareOptions, Scene, SolveOptions};
///
/// let scene = Scene::generate("cornell")?;
/// let model = Model::prepare(scene, &PrepareOptions::default())?;
/// let mut options = SolveOptions::default();
/// options.error = 0.1;
/// let light = model.solve(&options)?;
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
    /// Progress of the calls of this handle.
    pub(super) watcher: Watcher,
}

/// Data that all copies of a solution share.
pub(super) struct Solved {
    pub solved: radiosity::Solution,
    pub report: SolveReport,
    pub record: Record,
    pub mesh: RadiosityMesh,
    /// The mesh of pictures and lightmaps, made when it is first needed.
    #[cfg(feature = "reports")]
    pub smooth: std::sync::OnceLock<crate::export::Mesh>,
}

impl Model {
    /// Computes the light: hierarchical radiosity of all surfaces, with all reflections, on the threads of the model. If the progress of
    /// [`Model::with_progress`] stops it, the result is the consistent solution reached so far: see [`SolveReport::interrupted`].
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range, names nothing, or needs more of the model than was prepared
    /// ([`Detail::Clusters`](crate::Detail::Clusters), for other than exact visibility [`Detail::Optics`](crate::Detail::Optics));
    /// [`Error::Scene`] if the scene's size or light is beyond f32.
    pub fn solve(&self, options: &SolveOptions) -> Result<Solution> {
        let options = &SolveOptions { engine: options.chosen_engine(self), ..options.clone() };
        let needed = options.prepare().detail;
        if self.detail() < needed {
            let have = self.detail();
            return Err(Error::arguments(format!(
                "the model holds ⟨Detail::{have:?}⟩: prepare it with ⟨Detail::{needed:?}⟩ to solve with this engine"
            )));
        }
        let (outcome, solved) =
            self.on_threads(|| radiosity::solve(&self.unwatched(), &[], options, self.progress()))??;
        let radiosity::Outcome { mesh, record, .. } = outcome;
        let solved = Solved {
            solved,
            report: SolveReport::of(&record),
            record,
            mesh,
            #[cfg(feature = "reports")]
            smooth: Default::default(),
        };
        Ok(Solution { inner: Arc::new(solved), watcher: Watcher::default() })
    }
}

impl Solution {
    /// The same solution, of which all that is asked reports to `progress` and can be stopped by it:
    /// `light.with_progress(bar).irradiance(&points)`. Clones keep it.
    #[must_use]
    pub fn with_progress(&self, progress: impl Progress + 'static) -> Solution {
        Solution { watcher: Watcher::new(progress), ..self.clone() }
    }

    /// Irradiance at points of surfaces, W/m², linear RGB, in their order: direct light by rays to the emitters, reflected light by
    /// rays that gather the radiosity of surfaces.
    ///
    /// # Errors
    /// [`Error::Argument`] if a position is not finite or beyond 1e12 from the scene's origin, or a normal has no length; the message names
    /// the point. [`Error::OutOfMemory`] if there are too many; [`Error::Cancelled`] if the caller's progress stops it.
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
        let stopped = || Error::Cancelled("stopped before the light at all points was found".into());
        let find = || solved.irradiance(&points, self.watcher.progress()).ok_or_else(stopped);
        solved.model().on_threads(find)?
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

    /// The warnings of the report, with names of options between `⟨` and `⟩`.
    #[doc(hidden)]
    pub fn notes(&self) -> &[String] {
        &self.inner.record.warnings
    }

    /// What is known of the solution as a whole.
    pub fn report(&self) -> &SolveReport {
        &self.inner.report
    }
}

/// What is known of a solution as a whole; [`Solution::json`] says more.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SolveReport {
    /// Mean irradiance of all sides of surfaces that light arrives at, W/m², linear RGB.
    pub mean_irradiance: [f64; 3],
    /// Estimated RMS error of the irradiance of the elements, relative to its mean; `None` if it is unknown.
    pub error_estimate: Option<f64>,
    /// Number of elements of the hierarchy, clusters included: more than [`Solution::elements`].
    pub elements: usize,
    /// Number of links between elements.
    pub links: usize,
    /// What a user should know, one sentence each: repairs of the scene, limits that were reached.
    pub warnings: Vec<String>,
    /// Whether the caller's progress stopped it before the error was reached.
    pub interrupted: bool,
}

impl SolveReport {
    fn of(record: &Record) -> SolveReport {
        let &Record { mean_irradiance, error_estimate, elements, links, interrupted, .. } = record;
        let warnings = record.warnings.iter().map(|note| worded(note, own_word)).collect();
        SolveReport { mean_irradiance, error_estimate, elements, links, warnings, interrupted }
    }
}
