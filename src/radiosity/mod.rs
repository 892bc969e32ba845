//! Hierarchical radiosity: the light in a scene, by links between elements and by rays.
//!
//! [`solve()`] does all of it for a scene. It starts with the link of the root with itself, which stands for all exchange of light
//! [Sillion 95], and refines the links with the greatest errors in steps (progressive multi-gridding [SD95 sec 6.2]). After every
//! step the light is consistent, so that a solution can be had at any time. A local pass follows: links
//! determine the light that reaches a cluster, rays the light that reaches each surface in it. The [`Solution`] answers irradiance
//! at points.
//!
//! Rooms, each using only those before it: `elements`, `surroundings`, `links`, `transport`, `refinement`, `final_gather`, `audit`,
//! `pipeline`.

// Solutions at given points, their audit and some options have users in the command alone.
#[cfg_attr(not(feature = "reports"), allow(dead_code, unused_imports))]
mod audit;
mod deadline;
pub mod elements;
mod final_gather;
pub mod links;
pub mod mesh;
#[cfg_attr(not(feature = "internals"), allow(dead_code))]
mod options;
#[cfg_attr(not(feature = "internals"), allow(dead_code, unused_imports))]
mod pipeline;
mod refinement;
mod rgb;
mod surroundings;
#[cfg(test)]
mod tests;
mod transport;

#[cfg(any(test, feature = "reports"))]
pub(crate) use audit::Ledger;
#[cfg(any(test, feature = "internals"))]
pub use options::Options;
pub use options::SolveOptions;
pub use pipeline::{Outcome, Record, Solution, solve};
#[cfg(any(test, feature = "reports"))]
pub use {audit::Powers, pipeline::Seconds};
#[cfg(feature = "internals")]
pub use {
    options::{Inside, RowSums, View},
    pipeline::{PointLight, run},
};
