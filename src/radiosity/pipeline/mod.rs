//! From a scene to a solution: preparation, refinement, final light, points, audit and record.

mod engine;
mod light_by_rays;
mod notes;
mod point_query;
mod record;
mod run;

#[cfg(test)]
pub use engine::engine_for;
#[cfg(any(test, feature = "internals"))]
pub use point_query::PointLight;
pub use point_query::Solution;
#[cfg(any(test, feature = "reports"))]
pub use record::Seconds;
pub use record::{Outcome, Record};
#[cfg(any(test, feature = "internals"))]
pub use run::run;
pub use run::solve;
#[cfg(test)]
pub use run::total_area;
