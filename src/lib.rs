#![doc = include_str!("ARCHITECTURE.md")]

pub mod error;
pub mod files;
pub mod math;
pub mod scene;

pub use error::{Error, Result};
