//! Form factors without obstruction: closed forms, in f64.
//!
//! `F(p→q)` is the part of what `p` sends out that reaches `q`, unitless; reciprocity: `A_p F(p→q) = A_q F(q→p)`. The
//! factor of a point is that of a differential area about it, which is also the irradiance at the point for unit
//! radiosity of the polygon. Knows neither scenes nor rays: what stands in between is a question for others.

mod discs;
mod pair;
mod polygon;
mod rectangles;
#[cfg(test)]
mod tests;

pub use discs::{coaxial_discs, point_to_disc, point_to_sphere};
pub use pair::{clip, polygon_to_polygon};
pub use polygon::point_to_polygon;
pub use rectangles::{Span, parallel_rectangles, perpendicular_rectangles};
