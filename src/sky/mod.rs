//! Sky and sun as sources of light, without a scene: radiance by direction, patches, samples, irradiance of unobstructed planes.
//!
//! [`SkyOptions`] describe a sky, [`SkyOptions::environment`] makes the [`Environment`] that rays, points and links ask. Directions of the
//! public interface are unit vectors in scene coordinates, from the scene outwards; inside, local directions are (east, north, up).
//!
//! * `frame`: up, north and east; `position`: the sun by place and time.
//! * `gradation` is the form of the models, `cie`, `perez` and `clear` their coefficients, `map` pictures; `radiance` scales them to a level.
//! * `cosine`: patches on a receiver, clipped at its horizon; `patches`: their hierarchy; `cells`: samples.
//! * `options`, `parse` and `build`: descriptions.

mod build;
mod cells;
mod cie;
mod clear;
mod cosine;
mod environment;
mod frame;
mod gradation;
mod map;
mod options;
mod parse;
mod patches;
mod perez;
mod position;
mod radiance;
mod sun;
#[cfg(test)]
mod tests;

pub use cosine::Extent;
pub use environment::{Environment, SkySample};
pub use frame::Frame;
pub use gradation::{Gradation, Shape};
pub use map::SkyMap;
pub use options::{Amount, SkyOptions};
pub use parse::{SkyModel, SunChoice, SunDirection};
pub use patches::{Patch, Patches};
pub use position::{Air, Moment, Place, SunPosition};
pub use radiance::{Level, Sky};
pub use sun::{SUN_DIAMETER, Sun};
