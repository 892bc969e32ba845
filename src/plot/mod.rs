//! Line charts as SVG text: axes, scales and series.

mod axis;
mod chart;

pub use axis::{Scale, number};
pub use chart::{Marks, Plot, PlotPoint, Series};
