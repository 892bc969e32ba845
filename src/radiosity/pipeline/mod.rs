//! From a scene to a solution: preparation, refinement, final light, points, audit and record.

mod notes;
mod point_query;
mod prepare;
mod record;
mod run;

pub use point_query::{PointLight, Solution};
#[cfg(test)]
pub use prepare::Prepared;
pub use record::{Outcome, Record, Seconds};
#[cfg(test)]
pub use run::total_area;
pub use run::{run, solve};
