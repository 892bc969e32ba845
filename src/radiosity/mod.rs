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

mod audit;
mod deadline;
pub mod elements;
mod final_gather;
pub mod links;
pub mod mesh;
mod options;
mod pipeline;
mod refinement;
mod rgb;
mod surroundings;
#[cfg(test)]
mod tests;
mod transport;

#[cfg(feature = "reports")]
pub(crate) use pipeline::Seconds;
pub use {
    audit::{Ledger, Powers},
    options::{Inside, Options, RowNormalisation, SolveOptions, View},
    pipeline::{Outcome, PointLight, Record, Solution, run, solve},
};
