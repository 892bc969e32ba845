//! Light transport: one bounce of light along links or along rays, row normalisation, and the solver for both.

mod active_nodes;
mod cluster_reflection;
mod directional;
mod gather_push_pull;
mod krylov;
mod link_transport;
mod operator;
mod ray_transport;
mod row_normalisation;
mod solver;
mod sweeps;
mod transport_matrix;

pub use active_nodes::ActiveNodes;
pub use cluster_reflection::emission_moments;
pub use directional::{DirectionalIrradiance, NodeIrradiance};
pub use gather_push_pull::{NodeRadiosity, gather, pushed};
pub use link_transport::LinkTransport;
pub use operator::{Convergence, Field};
pub use ray_transport::RayTransport;
pub use row_normalisation::{cap_row_sums, link_row_sums, normalise_link_rows, short_rows};
pub use solver::{Method, solve};
pub use transport_matrix::{MatrixRow, TransportMatrix};
