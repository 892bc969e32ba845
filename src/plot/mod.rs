//! Line charts as SVG text: axes, scales and series.

mod axis;
mod chart;

pub use crate::error::number;
pub use axis::Scale;
pub use chart::{Marks, Plot, PlotPoint, Series};
