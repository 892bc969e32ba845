//! Terrain as a height field: grids of heights, what their samples see of sky and sun, exact rays, and adaptive triangles.
//!
//! A [`Grid`] holds heights at samples, `columns × rows`, the first row in the north. The surface between samples is two
//! triangles for each four neighbours, divided from the south-west to the north-east. All quantities are per sample, so that an
//! output has as many columns and rows as the input and the same georeference. Samples without a height are holes: they block
//! nothing and get no value (NaN).
//!
//! Frame: x to the east, y to the north, z up, metres; the origin is the sample of the first column and the last row. Azimuths
//! are in radians from north over east.

mod coarse;
mod generate;
mod grid;
mod numpy;
mod quadtree;
mod quantities;
mod read;
mod sky;
mod sweep;
#[cfg(test)]
mod tests;
#[cfg(feature = "reports")]
mod write;

pub use coarse::{Mesh, Piece, coarse, triangle_at};
pub use grid::{Georeference, Grid};
pub use read::{Loaded, ReadOptions, read};
#[cfg(feature = "reports")]
pub use write::{Layer, write_geotiff, write_npz, write_png};
pub use {
    generate::mountains,
    quantities::{Sun, horizon, sky_view_factor, sunlit},
    sky::{Light, irradiance},
    sweep::SweepOptions,
};
#[cfg(test)]
use {
    generate::{canyon, courtyard, fractal, plane, valley},
    quadtree::{Node, Quadtree},
    quantities::{Slopes, Tilt},
};

/// Mean radius of the earth, m (IUGG).
pub const EARTH_RADIUS: f64 = 6_371_008.8;
