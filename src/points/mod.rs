//! Point files (surface points) and irradiance files (irradiance at such points).
//!
//! Both are CSV. A point file has the header `x,y,z,nx,ny,nz` and one surface point per line: position in scene units,
//! unit normal. An irradiance file has the same columns in the same order, then `Er,Eg,Eb` (W/m²), then
//! `Er_se,Eg_se,Eb_se` if standard errors are known. Further columns are ignored, so every irradiance file is also a
//! point file.

mod files;
#[cfg(test)]
mod tests;

pub use files::{compare, irradiance_of, read_irradiance, read_points, write_irradiance};

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

/// Differences between two irradiance files over all points and channels.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Comparison {
    /// Number of points.
    pub points: usize,
    /// Mean irradiance of the reference over points and channels, W/m².
    pub mean: f64,
    /// Root mean square difference, relative to `mean`.
    pub rms: f64,
    /// Root mean square standard error of the reference, relative to `mean`; 0 if standard errors are unknown.
    pub reference_noise: f64,
    /// Mean difference, relative to `mean`: positive if the test is brighter.
    pub bias: f64,
    /// 50th, 90th, 99th and 100th percentile of the absolute differences, relative to `mean`.
    pub percentiles: [f64; 4],
    /// Root mean square difference per channel, relative to the channel's mean; 0 if the channel is black in both
    /// files.
    pub rms_by_channel: [f64; 3],
}
