#![doc = include_str!("ARCHITECTURE.md")]

pub mod bench;
pub mod cache;
pub mod characterise;
pub mod display;
pub mod element;
pub mod embree;
pub mod error;
pub mod factor_matrix;
pub mod facts;
pub mod files;
pub mod form_factor;
pub mod hierarchy;
pub mod link;
pub mod math;
pub mod metrics;
pub mod montecarlo;
pub mod output;
pub mod points;
pub mod raster;
pub mod ray;
pub mod scene;
pub mod simd;
pub mod solution;
pub mod solver;
pub mod visibility;

pub use error::{Error, Result};
