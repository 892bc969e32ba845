//! Public interface of the crate: checks the arguments of calls of a [`Model`](crate::Model) and passes them to the other rooms.

mod batch;
#[cfg(feature = "reports")]
mod bench;
mod form_factors;
mod mesh_arrays;
mod reference;
mod scene_builder;
mod segments;
#[cfg(feature = "reports")]
mod shown;
mod solve;
#[cfg(test)]
mod tests;
mod visibility;

#[cfg(feature = "reports")]
pub use crate::bench::BenchOptions;
pub use crate::form_factors::matrix::{FormFactors, Grouping};
pub use crate::radiosity::{SolveOptions, mesh::Element};
pub use crate::visibility::Engine;
#[cfg(feature = "reports")]
pub use bench::{BenchReport, BenchRow};
pub use form_factors::FormFactorOptions;
pub use mesh_arrays::{MeshArrays, Positions};
pub use reference::Reference;
pub use scene_builder::SceneBuilder;
pub use segments::{Answers, Segments, Strided};
#[cfg(feature = "reports")]
pub use shown::{Camera, ImageOptions, Lightmap};
pub use solve::{Solution, SolveReport, SurfacePoint};
pub use visibility::Query;
pub use visibility::Visibility;

use crate::{Error, Result};

/// `value` if it is finite and above 0.
fn positive(name: &str, value: f32) -> Result<f32> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(Error::argument(name, value, "must be a finite number above 0"))
}
