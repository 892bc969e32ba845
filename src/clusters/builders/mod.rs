//! Builders of cluster trees from the literature, besides the [`grids`](super::grids) of the paper. Each makes a
//! [`Sketch`](super::sketch::Sketch) of triangles.

mod goldsmith_salmon;
mod kd;
mod sah;

pub(super) use goldsmith_salmon::insert_all;
pub(super) use kd::halve_space;
pub(super) use sah::split_by_cost;
