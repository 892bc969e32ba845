//! Unoccluded form factors in closed form, in f64.
//!
//! `F(p→q)` is the fraction of the flux leaving `p` that arrives at `q`, unitless; reciprocity: `A_p F(p→q) = A_q
//! F(q→p)`. The form factor of a point is that of a differential area around the point; its value equals the
//! irradiance at the point for unit radiosity of the polygon. Occlusion is not considered here.

mod far;
mod pair;
mod polygon;
#[cfg(test)]
mod tests;

pub(crate) use far::point_to_far_polygon;
pub use pair::{clip, polygon_to_polygon};
pub use polygon::point_to_polygon;
