//! What a solution is asked for.

pub use super::importance::View;
use crate::model::cache::CacheLocation;
pub use crate::radiosity::links::{Inside, Oracle};
use crate::{Error, Result};

/// Which engine answers visibility.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Embree rays.
    #[default]
    Exact,
    /// Clusters whose features are smaller than the feature size are not opened [SD95 sec 3.2].
    Mr,
    /// Extinction only [SD95 sec 5].
    Average,
}

/// What is done so that the form factors of an element that sees no way out of the scene sum up to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rows {
    /// Nothing.
    Sampled,
    /// What each leaf gathers is multiplied: each irradiance is a mean of radiosities.
    Closed,
    /// What each leaf gathers and what it sends is multiplied alike (Sinkhorn and Knopp 1967): factors stay reciprocal and
    /// no energy is made.
    #[default]
    Balanced,
}

/// Options of [`super::run()`].
#[derive(Clone, Debug, serde::Serialize)]
pub struct Options {
    /// Error relative to the mean irradiance that links are refined to, each to a share of it; above 0. What errors they
    /// leave together is estimated and audited, not promised.
    pub error: f64,
    /// What links are refined for.
    pub oracle: Oracle,
    /// Smallest element as part of the scene's area; above 0.
    pub min_area: f64,
    /// What is done about row sums along links; those of a local pass are shares of rays.
    pub rows: Rows,
    /// The engine.
    pub visibility: Visibility,
    /// Feature size for all receivers, scene units; by default each one's own diameter. With importance it is that of what is
    /// important by itself, and grows with √(I_max / I), up to 7 times, elsewhere (method A.13).
    pub feature_size: Option<f32>,
    /// Feature sizes of objects, groups or materials by name, scene units: they go before `feature_size` and never grow.
    pub feature_sizes: Vec<(String, f32)>,
    /// What light does inside the clusters that a link ends at.
    pub inside: Inside,
    /// Objects, groups or materials whose light matters: errors elsewhere count as much as they show there; everything if
    /// empty.
    pub importance: Vec<String>,
    /// Cameras whose pictures matter: what they see, and by default features of a few pixels in them.
    pub views: Vec<View>,
    /// Elements whose error bars are checked.
    pub audit: usize,
    /// Leave the bounces out of what points receive; with points nothing else is computed.
    pub direct_only: bool,
    /// Rays from a point to an emitter that is partly visible; by default what the error asks for.
    pub light_rays: Option<usize>,
    /// Rays from a point to gather what surfaces reflect, rounded up to a grid of blocks of sixteen; by default what the
    /// error asks for.
    pub gather_rays: Option<usize>,
    /// Rays by which the elements of a scene with clusters gather their light in the end, in all; none for 0, by default
    /// what the error asks for.
    pub local_rays: Option<usize>,
    /// Seconds of refinement a step: progressive multi-gridding; all at once if none.
    pub step_seconds: Option<f64>,
    /// Seconds from the start of [`super::run()`] for preparation, refinement, the local pass and points; less is refined and
    /// fewer rays are traced, so that they are enough.
    pub max_seconds: Option<f64>,
    /// Whether light at more points is asked for when there is a solution ([`super::run_then()`]): part of the time is kept.
    pub more_points: bool,
    /// Error estimate at which refinement ends.
    pub target_error: Option<f64>,
    /// Links at which refinement ends.
    pub max_links: usize,
    /// Where measured clusters are kept.
    #[serde(skip)]
    pub cache: CacheLocation,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            error: 0.02,
            oracle: Oracle::default(),
            min_area: 2e-5,
            rows: Rows::default(),
            visibility: Visibility::default(),
            feature_size: None,
            feature_sizes: Vec::new(),
            inside: Inside::default(),
            importance: Vec::new(),
            views: Vec::new(),
            audit: 200,
            direct_only: false,
            light_rays: None,
            gather_rays: None,
            local_rays: None,
            step_seconds: None,
            max_seconds: None,
            more_points: false,
            target_error: None,
            max_links: 10_000_000,
            cache: CacheLocation::Off,
            seed: 1,
        }
    }
}

impl Options {
    /// Whether the options make sense for any scene.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the option and its range.
    pub fn check(&self) -> Result<()> {
        let above_zero = [
            ("--error", Some(self.error)),
            ("--min-area", Some(self.min_area)),
            ("--feature-size", self.feature_size.map(f64::from)),
            ("--step-seconds", self.step_seconds),
            ("--max-seconds", self.max_seconds),
            ("--target-error", self.target_error),
        ];
        for (name, value) in above_zero {
            if let Some(v) = value.filter(|v| !v.is_finite() || *v <= 0.0) {
                return Err(Error::Argument(format!("{name} {v}: must be a number above 0")));
            }
        }
        if let Some((name, s)) = self.feature_sizes.iter().find(|(_, s)| !s.is_finite() || *s <= 0.0) {
            return Err(Error::Argument(format!("feature size {s} of `{name}`: must be a number above 0")));
        }
        let [light, gather] = [self.light_rays, self.gather_rays].map(|n| n.unwrap_or(1));
        for (name, value, most) in [
            ("--light-rays", light, 1 << 16),
            ("--gather-rays", gather, 1 << 20),
            ("--max-links", self.max_links, 1 << 30),
            ("--local-rays", self.local_rays.unwrap_or(0).saturating_add(1), 1 << 30),
            ("--audit", self.audit.saturating_add(1), 1 << 20),
        ] {
            if value == 0 || value > most {
                return Err(Error::Argument(format!("{name} {value}: must lie in 1..{most}")));
            }
        }
        if self.min_area > 1.0 {
            return Err(Error::Argument(format!(
                "--min-area {}: is a part of the scene's area, at most 1",
                self.min_area
            )));
        }
        Ok(())
    }

    /// Shadow rays to a partly visible emitter.
    pub fn light_rays(&self) -> usize {
        self.light_rays.unwrap_or((5.0 / self.error).clamp(64.0, 4096.0) as usize)
    }

    /// Rays of a final gather: its noise is less than the error.
    pub fn gather_rays(&self) -> usize {
        self.gather_rays.unwrap_or((0.27 / self.error).powi(2).clamp(64.0, 2304.0) as usize)
    }

    /// Rays of the local pass.
    pub fn local_rays(&self) -> usize {
        self.local_rays.unwrap_or((LOCAL / self.error.powi(2)).clamp(1e5, 1e8) as usize)
    }

    /// Smallest element of the local pass as part of the scene's area: its share of the rays is enough to tell it from its
    /// neighbours.
    pub fn local_area(&self) -> f64 {
        self.min_area.min(Self::area_for(self.local_rays() as f64))
    }

    /// The same of a pass of fewer rays than were asked for.
    pub fn area_for(rays: f64) -> f64 {
        EACH / rays.max(1.0)
    }
}

/// Rays of the smallest element that the local pass splits others into.
const EACH: f64 = 20.0;
/// Rays of the local pass times the square of the error.
const LOCAL: f64 = 1600.0;
