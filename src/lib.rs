//! Visibility and radiosity in scenes full of small detail.
//!
//! The crate computes the fraction of an emitter that a point sees, by one of two engines: exact [Embree](https://www.embree.org) rays,
//! or multi-resolution visibility (F. Sillion and G. Drettakis, *Feature-based control of visibility error*, 1995), in which clusters
//! that cast only shadows smaller than a stated feature size transmit according to their extinction. Hierarchical radiosity and form
//! factors use these engines.
//!
//! A [`Scene`] is read from a file (OBJ, glTF, PLY), built from arrays ([`SceneBuilder`]) or generated. A [`Model`] is a scene prepared
//! for queries: owned, immutable, shared between threads by cheap clones. Queries are [`Model::visibility`], [`Model::solve`] and
//! [`Model::form_factors`]; [`Model::update`] moves instances of meshes.
//!
//! # Visibility
//!
//! ```
//! use mrvis::{Model, PrepareOptions, Scene};
//!
//! let scene = Scene::generate("cubes")?; // or Scene::load("room.obj")?
//! let model = Model::prepare(scene, &PrepareOptions::default())?;
//! let (point, normal) = ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
//! let seen = model.visibility().from_point(point, normal).to_source(0).feature_size(0.1).answer()?;
//! println!("{} of the light is visible, {} to {}", seen.transmittance, seen.lo, seen.hi);
//! assert!(seen.lo <= seen.transmittance && seen.transmittance <= seen.hi);
//! # Ok::<(), mrvis::Error>(())
//! ```
//!
//! Many queries at once, from and into the caller's arrays: [`Visibility::answer_into`].
//!
//! # Radiosity
//!
//! ```
//! use mrvis::{Model, PrepareOptions, Scene, SolveOptions, SurfacePoint};
//!
//! let scene = Scene::generate("cornell")?;
//! let model = Model::prepare(scene, &PrepareOptions::default())?;
//! let mut options = SolveOptions::default();
//! options.error = 0.1; // of the mean irradiance
//! let light = model.solve(&options)?;
//! let floor = SurfacePoint { position: [278.0, 0.0, 279.6], normal: [0.0, 1.0, 0.0] };
//! let [red, green, blue] = light.irradiance(&[floor])?[0]; // W/m²
//! assert!(red > 0.0 && green > 0.0 && blue > 0.0);
//! # Ok::<(), mrvis::Error>(())
//! ```
//!
//! # Form factors
//!
//! ```
//! use mrvis::{Detail, FormFactorOptions, Grouping, Model, PrepareOptions, Scene};
//!
//! let scene = Scene::generate("cornell")?;
//! let mut prepare = PrepareOptions::default();
//! prepare.detail = Detail::Rays; // no more is needed
//! let model = Model::prepare(scene, &prepare)?;
//! let mut options = FormFactorOptions::default();
//! options.grouping = Grouping::Object;
//! let factors = model.form_factors(&options)?;
//! let (columns, values) = factors.row(0);
//! for (&to, factor) in columns.iter().zip(values) {
//!     println!("{} -> {}: {factor}", factors.names[0], factors.names[to as usize]);
//! }
//! # Ok::<(), mrvis::Error>(())
//! ```
//!
//! # Conventions
//!
//! * Lengths are in the unit of the scene, metres unless [`LoadOptions::unit`] says otherwise. Irradiance and radiosity are in
//!   W/m², emission of materials is radiance in W/(m² sr); light is linear RGB.
//! * Positions are in the coordinates of the file. Arrays of f32 may be relative to a point, see [`Segments`].
//! * Whatever takes long reports to a [`Progress`], which can cancel it, if the model or the solution has one: [`Model::with_progress`].
//! * Each model has threads of its own, as many as [`PrepareOptions::threads`] says; calls from inside a rayon pool use that pool. No
//!   result depends on their number.
//! * Functions do not print, do not read the environment and do not panic on input: errors say what, where and the cure, and
//!   [`Error::category`] what kind of error it is.
//!
//! The formulas, with their papers, are in `docs/method.md` of the source code.

#[macro_use]
mod options;

mod api;
#[cfg(feature = "reports")]
mod bench;
mod clusters;
mod embree;
mod error;
#[cfg(feature = "reports")]
mod export;
mod files;
mod form_factors;
#[cfg(feature = "reports")]
mod image_io;
#[doc(hidden)]
pub mod internals;
mod math;
mod memory;
pub mod metrics;
mod model;
mod optics;
#[cfg(feature = "reports")]
mod page;
mod path_tracer;
#[cfg(feature = "reports")]
mod plot;
mod points;
mod progress;
mod radiosity;
mod ranks;
mod raster;
mod ray;
mod scene;
mod simd;
mod sky;
mod terrain;
mod threads;
mod visibility;

pub use api::{
    Answers, Element, Engine, FormFactorOptions, FormFactors, Grouping, MeshArrays, Positions, Query,
    Reference, SceneBuilder, Segments, Solution, SolveOptions, SolveReport, Strided, SurfacePoint,
    Visibility,
};
#[cfg(feature = "reports")]
pub use api::{BenchOptions, BenchReport, BenchRow, Camera, ImageOptions, Lightmap};
pub use clusters::Builder;
pub use error::{Error, ErrorCategory, Result};
pub use model::{Detail, Instance, InstanceChange, Model, PrepareOptions, PrepareReport, Source};
pub use progress::Progress;
pub use scene::{Channels, GenerateOptions, LoadOptions, Scene, Strength, UpAxis};
pub use sky::SkyOptions;
pub use visibility::{Answer, Cost, Method};
