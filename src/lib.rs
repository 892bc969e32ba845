#![doc = include_str!("ARCHITECTURE.md")]

pub mod error;
pub mod math;
pub mod metrics;
pub mod raster;
pub mod scene;

pub use error::{Error, Result};
