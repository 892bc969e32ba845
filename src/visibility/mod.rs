//! Visibility between receiver points and emitters, by several engines.
//!
//! The unit of work is the [`Bundle`]: segments from one receiver point (or element) to one emitter.
//! * [`Exact`]: Embree rays; every segment is 0 or 1.
//! * [`MultiResolution`]: clusters whose shadow features would be smaller than `s` are not opened but transmit
//!   according to their extinction [SD95 sec 3.2]; with [`LeafMode::Average`], the paper's average visibility [SD95 sec
//!   5].
//! * [`DistanceCut`]: the same rule for single segments of wide bundles, each of which stands for a part of the emitter; part of
//!   [`MultiResolution`], which routes bundles to it.
//! * `plain_walk`: the same rule for single segments and nodes; the reference in tests of the fast engine, compiled for them alone.
//!
//! Feature size and emitter size are arguments of every query. Links, energy and materials are not known here.
//! Formulas: docs/method.md, Umbra criterion, Extinction, and Certificates and intervals.

mod answer;
mod bundle_walks;
mod cost_model;
mod cut;
mod engine;
mod exact;
#[cfg(any(test, feature = "reports"))]
mod far_field;
mod frontier;
mod instance_tree;
mod instances;
mod multires;
#[cfg(test)]
pub mod plain_walk;
mod probe;
mod routes;
mod shaft;
mod slabs;
#[cfg(test)]
mod tests;
mod triangles;
mod walk;
mod wide;

pub use answer::{Answer, Bundle, Cost, Method, wilson};
pub use bundle_walks::{BatchBuffers, Workspace};
pub use cost_model::{CALIBRATION_BUNDLES, Work, sample_runs};
pub use cut::{Candidate, DistanceCut, rays_for};
pub use engine::Engine;
pub use exact::Exact;
pub use instance_tree::{Frame, InstanceTree, Instances, PlacedChange};
pub use multires::{LeafMode, MultiResolution, Route};
pub use probe::Probe;
pub use routes::{ReferenceHalves, RouteSample};
pub use wide::WideTree;
#[cfg(feature = "reports")]
pub use {
    cut::{MIN_LARGE_SURFACE, surface_widths},
    exact::fastest_traversal,
    far_field::{FarField, FarFieldBuffers},
};
