#![doc = include_str!("ARCHITECTURE.md")]

pub mod bench;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
pub mod clusters;
pub mod embree;
pub mod error;
pub mod export;
pub mod files;
pub mod form_factors;
pub mod image_io;
pub mod math;
pub mod metrics;
pub mod model;
pub mod optics;
pub mod path_tracer;
pub mod plot;
pub mod points;
pub mod progress;
pub mod radiosity;
pub mod raster;
pub mod ray;
pub mod scene;
pub mod simd;
pub mod visibility;

pub use error::{Error, Result};
