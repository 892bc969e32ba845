//! Point files (surface points) and irradiance files (irradiance at such points).
//!
//! Both are CSV. A point file has the header `x,y,z,nx,ny,nz` and one surface point per line: position in scene units,
//! unit normal. An irradiance file has the same columns in the same order, then `Er,Eg,Eb` (W/m²), then
//! `Er_se,Eg_se,Eb_se` if standard errors are known. Further columns are ignored, so every irradiance file is also a
//! point file.

#[cfg(any(test, feature = "reports"))]
mod compare;
#[cfg(feature = "internals")]
mod read;
#[cfg(test)]
mod tests;
#[cfg(feature = "internals")]
mod write;

#[cfg(any(test, feature = "reports"))]
pub use compare::Comparison;
#[cfg(feature = "internals")]
pub use {
    compare::compare,
    read::{irradiance_of, read_irradiance, read_points},
    write::write_irradiance,
};

use glam::DVec3;

/// A surface point with the normal of one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position in the coordinates of the scene's file, scene units.
    pub position: DVec3,
    /// Unit normal of the side that receives light.
    pub normal: DVec3,
}

/// Irradiance at points. All vectors have one entry per point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// The points.
    pub points: Vec<Point>,
    /// Irradiance, W/m², linear RGB.
    pub values: Vec<[f64; 3]>,
    /// Standard errors of `values`, W/m²; empty if unknown.
    pub standard_errors: Vec<[f64; 3]>,
}
