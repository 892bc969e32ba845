//! Point files: surface points at which irradiance is asked for, and the irradiance there.
//!
//! Both are CSV. A point file has the header `x,y,z,nx,ny,nz` and a point on a surface in each line: scene units, unit
//! normals. An irradiance file has the same columns in the same order and after them `Er,Eg,Eb` (W/m²), and after those
//! `Er_se,Eg_se,Eb_se` where standard errors are known. Columns beyond are allowed and left alone, so that an irradiance
//! file is a point file too. Knows neither scenes nor how irradiance is computed.

mod compare;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use compare::{Comparison, compare};
pub use read::{read_irradiance, read_points};
pub use write::write_irradiance;

use glam::DVec3;

/// A place on a surface and the side of it that is meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position in the coordinates of the scene's file, scene units.
    pub position: DVec3,
    /// Unit normal of the side.
    pub normal: DVec3,
}

/// Irradiance at points, one entry a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// Where.
    pub points: Vec<Point>,
    /// W/m² in linear RGB.
    pub values: Vec<[f64; 3]>,
    /// Standard errors of `values`; empty if they are not known.
    pub standard_errors: Vec<[f64; 3]>,
}
