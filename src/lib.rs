//! Visibility and radiosity in scenes full of small detail.

// Some code serves tests, benches or the command alone; unused code is found with `internals`, as `make test` builds.
#![cfg_attr(not(feature = "internals"), allow(dead_code, unused_imports))]

mod api;
#[cfg(feature = "cli")]
mod bench;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
mod clusters;
mod embree;
mod error;
#[cfg(feature = "cli")]
mod export;
mod files;
mod form_factors;
#[cfg(feature = "cli")]
mod image_io;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals;
mod math;
pub mod metrics;
mod model;
mod optics;
#[cfg(feature = "cli")]
mod path_tracer;
#[cfg(feature = "cli")]
mod plot;
mod points;
mod progress;
// Being restructured: what nobody uses there goes with that.
#[allow(dead_code, unused_imports)]
mod radiosity;
mod raster;
mod ray;
mod scene;
mod simd;
mod threads;
mod visibility;

pub use api::{
    Answers, Between, Engine, FormFactorOptions, FormFactors, Query, Segments, Solution, SolveOptions,
    Strided, SurfacePoint, Visibility,
};
pub use error::{Error, ErrorCategory, Result};
pub use model::{Detail, Model, PrepareOptions, PrepareReport, Source};
pub use progress::Progress;
pub use scene::{LoadOptions, Scene};
pub use visibility::{Answer, Cost, Method};
