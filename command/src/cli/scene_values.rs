//! Values of options about a scene, as the command line names them.

use mrvis::internals::SceneParts;
use mrvis::internals::points::Point;
use mrvis::{Channels, Error, Result, Scene, UpAxis};

/// A value of `--up`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum UpArg {
    /// +y, as in glTF.
    Y,
    /// +z.
    Z,
}

impl From<UpArg> for UpAxis {
    fn from(up: UpArg) -> UpAxis {
        match up {
            UpArg::Y => UpAxis::Y,
            UpArg::Z => UpAxis::Z,
        }
    }
}

/// A value of `--photometric`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum ChannelArg {
    /// Radiometric channels, weighted.
    Rgb,
    /// The red channel alone, in lumens instead of watts.
    Red,
    /// The green channel alone, in lumens instead of watts.
    Green,
    /// The blue channel alone, in lumens instead of watts.
    Blue,
}

impl From<ChannelArg> for Channels {
    fn from(channels: ChannelArg) -> Channels {
        match channels {
            ChannelArg::Rgb => Channels::Rgb,
            ChannelArg::Red => Channels::Red,
            ChannelArg::Green => Channels::Green,
            ChannelArg::Blue => Channels::Blue,
        }
    }
}

/// Lowers points of the map to a scene on the curved earth.
pub fn lower(scene: &Scene, points: &mut [Point]) {
    for point in points {
        (point.position, point.normal) = scene.lowered(point.position, point.normal);
    }
}

/// `DX` or `DX,DY`.
pub fn cell(text: &str) -> Result<[f64; 2]> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parsed.as_deref() {
        Some([both]) => Ok([*both; 2]),
        Some([dx, dy]) => Ok([*dx, *dy]),
        _ => Err(Error::Argument(format!("--cell {text}: give one distance in m, or two: DX,DY"))),
    }
}
