#![doc = include_str!("ARCHITECTURE.md")]

pub mod bench;
pub mod cache;
pub mod characterise;
pub mod embree;
pub mod error;
pub mod files;
pub mod hierarchy;
pub mod math;
pub mod metrics;
pub mod output;
pub mod raster;
pub mod ray;
pub mod scene;
pub mod simd;
pub mod visibility;

pub use error::{Error, Result};
