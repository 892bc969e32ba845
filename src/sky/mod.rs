//! Sky and sun as sources of light, without a scene: radiance by direction, patches, samples, irradiance of unobstructed planes.
//!
//! [`SkyOptions`] describe a sky, [`SkyOptions::environment`] makes the [`Environment`] that rays, points and links query. Directions of
//! the public interface are unit vectors in scene coordinates, from the scene outwards; inside, local directions are (east, north, up).
//!
//! * `frame`: up, north and east; `position`: the sun by place and time.
//! * `gradation` is the form of the models, `perez` the coefficients of one, `map` pictures; `radiance` scales them to a level,
//!   `spots` makes suns of the bright spots of a map.
//! * `cosine`: patches on a receiver, clipped at its horizon; `patches`: their hierarchy; `planes`: a table of irradiance;
//!   `cells`: samples.
//! * `options`, `parse` and `build`: descriptions.

mod build;
mod cells;
mod cosine;
mod environment;
mod frame;
mod gradation;
mod map;
mod options;
mod parse;
mod patches;
mod perez;
mod planes;
mod position;
mod radiance;
mod spots;
mod sun;
#[cfg(test)]
mod tests;

pub use environment::Environment;
pub use options::SkyOptions;
pub use parse::SkyModel;
pub use sun::Sun;
#[cfg(test)]
pub use {
    frame::Frame,
    gradation::Shape,
    map::SkyMap,
    options::Amount,
    position::{Air, Place},
    radiance::{Level, Sky},
};
