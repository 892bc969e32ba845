#![doc = include_str!("ARCHITECTURE.md")]

pub mod bench;
#[cfg(feature = "cli")]
pub mod cli;
pub mod error;
pub mod math;
pub mod metrics;
pub mod output;
pub mod raster;
pub mod scene;

pub use error::{Error, Result};
