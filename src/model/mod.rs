//! What is prepared once for a scene and shared by everything that asks it.

pub mod cache;
pub mod summary;
