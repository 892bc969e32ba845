#![doc = include_str!("ARCHITECTURE.md")]

pub mod embree;
pub mod error;
pub mod math;
pub mod ray;
pub mod scene;

pub use error::{Error, Result};
