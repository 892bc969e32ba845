//! Values of options about a scene, as the command line names them.

use mrvis::{Channels, UpAxis};

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
