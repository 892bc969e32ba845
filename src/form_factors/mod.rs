//! Form factors: closed forms between pairs ([`analytic`]), and the sparse matrix between all facets of a scene, with
//! occlusion ([`matrix`]).

pub mod analytic;
pub mod matrix;
#[cfg(test)]
pub mod testing;
