//! Options of a solution.

use crate::clusters::Builder;
use crate::model::cache::CacheLocation;
use crate::visibility::Engine;
use glam::DVec3;

/// Normalisation of the row sums of form factors, for elements from which no light leaves the scene, to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowNormalisation {
    /// No normalisation: the sums that sampling gave. The record always reports them; solving with them shows what
    /// normalisation changes.
    Sampled,
    /// Along links each leaf has one factor for what it gathers and what it sends (Sinkhorn and Knopp 1967); by rays it exchanges what
    /// its sum lacks with itself. Exchange stays reciprocal, and no energy is created.
    #[default]
    Balanced,
}

/// What happens to light between the surfaces of a linked cluster and the cluster's box [SD95 sec 6.1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Inside {
    /// Surfaces face all directions alike and hide nothing: the cluster kernel of Sillion (1995), a quarter of the area.
    Isotropic,
    /// Surfaces have orientations and hide nothing: more light arrives than the silhouette of the cluster lets in.
    Oriented,
    /// Segments end on the surfaces: surfaces that the cluster hides receive nothing, and no energy is created.
    #[default]
    Visible,
}

/// Position and view of a camera, for importance.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct View {
    /// Position of the camera, in the file's coordinates.
    pub eye: DVec3,
    /// Viewing direction, a unit vector.
    pub forward: DVec3,
    /// Vertical angle of view, radians in `(0, π)`.
    pub angle: f64,
}

options! {
    /// Options of [`Model::solve`](crate::Model::solve): [`SolveOptions::default`] with other values of some fields.
    ///
    /// ```
    /// let mut options = mrvis::SolveOptions::default();
    /// options.error = 0.01;
    /// options.importance.push("table".into());
    /// ```
    #[derive(Clone, Debug, serde::Serialize)]
    #[non_exhaustive]
    pub struct SolveOptions {
        /// RMS error of the irradiance that links are refined to, relative to its mean. A goal, not a bound: each link is refined to a
        /// share of it, and the error that all links leave together is estimated in
        /// [`SolveReport::error_estimate`](crate::SolveReport::error_estimate).
        pub error: f64 = 0.02, above 0.0;
        /// Smallest element as a fraction of the scene's area.
        // Numbers of elements have 32 bits, of which ranges of ids take a factor 4.
        pub min_area: f64 = 2e-5, in 1e-9..=1.0, "a part of the scene's area";
        /// How row sums of form factors are normalised, along links and in the local pass.
        #[doc(hidden)]
        #[serde(rename = "rows")]
        pub row_sums: RowNormalisation = RowNormalisation::default();
        /// Algorithm that builds the clusters.
        #[doc(hidden)]
        pub builder: Builder = Builder::default();
        /// How visibility is answered; default [`Engine::Exact`]. Multi-resolution and average need a model with optics; multi-resolution
        /// was measured to take longer than exact rays, as most rays of a solution are incoherent (`docs/light.md`).
        #[serde(rename = "visibility")]
        pub engine: Engine = Engine::Exact;
        /// Feature size of all receivers, scene units, for other engines than exact: shadow features of at least this size are resolved.
        /// `None`: each receiver's diameter. With importance this is the size on important surfaces; elsewhere it grows with √(I_max /
        /// I), up to 7 times.
        pub feature_size: Option<f32> = None, above 0.0;
        /// Feature sizes of objects, groups or materials by name, scene units. They override `feature_size` and never grow.
        pub feature_sizes: Vec<(String, f32)> = Vec::new(), above 0.0;
        /// What light does inside the clusters that links end at.
        #[doc(hidden)]
        pub inside: Inside = Inside::default();
        /// Objects, groups or materials whose light matters; default none: all matter alike. Errors elsewhere count by their effect there.
        pub importance: Vec<String> = Vec::new();
        /// Cameras whose pictures matter: what they see is important, and by default features have a few of their pixels.
        #[doc(hidden)]
        pub views: Vec<View> = Vec::new();
        /// Number of elements whose error bars independent paths check. More say more about the error in `Solution::json`; 0 leaves it out.
        pub audit: usize = 200, in 0..=1_048_576;
        /// Whether reflected light is left out of the irradiance at points; default false.
        pub direct_only: bool = false;
        /// Whether the light of elements is asked for: for meshes, pictures and lightmaps, and for its error. Otherwise the solution has
        /// no more than irradiance at points needs.
        #[doc(hidden)]
        pub elements: bool = true;
        /// Shadow rays from a point to an emitter that is partly visible, and up to sixteen times as many where it would light the point
        /// much more if nothing blocked it. `None`: derived from the error.
        pub light_rays: Option<usize> = None, in 1..=65_536;
        /// Rays from a point that gather reflected light, rounded up to a grid of blocks of sixteen. `None`: derived from the error.
        pub gather_rays: Option<usize> = None, in 1..=1_048_576;
        /// Rays by which elements gather their light in the end, at most; 0 for light along links alone, by default derived from the
        /// error. Scenes of few elements need fewer.
        #[doc(hidden)]
        pub local_rays: Option<usize> = None, in 0..=1 << 30;
        /// Seconds of refinement a step (progressive multi-gridding); without a number each step ends at its error threshold.
        #[doc(hidden)]
        pub step_seconds: Option<f64> = None, above 0.0;
        /// Seconds from the call of [`Model::solve`](crate::Model::solve) in which to be done, about. `None`: no limit. The preparation
        /// of the model does not count. Fewer links are refined and fewer rays traced to meet it: of many elements for whose rays there
        /// is no time, some are traced and determine the light of the others.
        pub max_seconds: Option<f64> = None, above 0.0;
        /// Seconds of that time that the caller has spent already: the command counts reading and preparation.
        #[doc(hidden)]
        #[serde(skip)]
        pub seconds_spent: f64 = 0.0;
        /// Whether irradiance at more points will be asked for after the solution: part of the time limit is kept for that.
        #[doc(hidden)]
        pub more_points: bool = false;
        /// Number of points, the last of them, that are meant to lie off surfaces: they are not reported for it.
        #[doc(hidden)]
        #[serde(skip)]
        pub points_in_space: usize = 0;
        /// Largest RMS error of the elements' irradiance relative to its mean, as independent paths find it: more rays are traced until
        /// then. Refinement of links ends when their error estimate is no larger. `None`: no such target.
        pub target_error: Option<f64> = None, above 0.0;
        /// Number of links at which refinement ends, which bounds the memory, 72 bytes each.
        pub max_links: usize = 10_000_000, in 1..=1_073_741_824;
        /// Where measured clusters are kept.
        #[doc(hidden)]
        #[serde(skip)]
        pub cache: CacheLocation = CacheLocation::Off;
        /// Seed of all random numbers; default 1.
        pub seed: u64 = 1;
    }
}

/// The short name of [`SolveOptions`] within the module `radiosity`.
pub use SolveOptions as Options;

impl SolveOptions {
    /// Shadow rays to a partly visible emitter: 5 / error, 250 at the default error of 0.02, where a visible fraction of one half
    /// has a standard error of 0.5 / √250 = 3 %.
    pub(crate) fn light_rays(&self) -> usize {
        self.light_rays.unwrap_or((5.0 / self.error).clamp(64.0, 4096.0) as usize)
    }

    /// Rays of a final gather: n = (0.27 / error)², so that the noise is the error where one ray deviates by
    /// 0.27 of the mean: 182 rays at the default error of 0.02. The bounds limit the noise to 3.4 % and the time to 2,304 rays.
    pub(crate) fn gather_rays(&self) -> usize {
        self.gather_rays.unwrap_or((0.27 / self.error).powi(2).clamp(64.0, 2304.0) as usize)
    }

    /// Rays of the local pass.
    pub(crate) fn local_rays(&self) -> usize {
        self.local_rays
            .unwrap_or((LOCAL_RAYS_TIMES_ERROR_SQUARED / self.error.powi(2)).clamp(1e5, 1e8) as usize)
    }

    /// Smallest element of the local pass as a fraction of the scene's area: so large that its share of the rays tells its light
    /// from that of its neighbours.
    pub(crate) fn local_area(&self) -> f64 {
        self.min_area.min(Self::area_for(self.local_rays() as f64))
    }

    /// The same area for a local pass of this number of rays.
    pub(crate) fn area_for(rays: f64) -> f64 {
        RAYS_OF_SMALLEST_ELEMENT / rays.max(1.0)
    }
}

/// Rays of the smallest element that the local pass splits others into: a seventh of them, 20, exchange light, with noise of
/// 1/√20 = 22 % of the spread of one ray; 96 gather, with noise of 10 %, which sharing between neighbours brings down. 70 instead
/// makes a third more elements, whose mean light errs by 3.24 instead of 3.14 % in a valley (`scenes/room.py SCENE --elements 1500`).
const RAYS_OF_SMALLEST_ELEMENT: f64 = 140.0;
/// Rays of the local pass times the square of the error, as noise falls with one over the root of the rays: 18.75 million rays at the
/// default error of 0.02. By 14, 17 and 20 million, elements of an office err by 3.7, 3.5 and 3.1 %, the mean of four seeds, in about 38,
/// 39 and 41 s of user time (`scenes/room.py scenes/real/office.obj --elements 3000` with these numbers as [`SolveOptions::local_rays`]).
const LOCAL_RAYS_TIMES_ERROR_SQUARED: f64 = 7500.0;
