//! From a scene to a solution: preparation, refinement, final light, points, audit and record.

mod engine;
mod light_by_rays;
mod notes;
mod point_query;
mod record;
mod run;

pub use point_query::{PointLight, Solution};
#[cfg(feature = "reports")]
pub use record::Seconds;
pub use record::{Outcome, Record};
pub use run::{run, solve};
#[cfg(test)]
pub use {engine::engine_for, run::total_area};
