//! The solver's data of one element: its light, its importance, its feature size and its row factors.

use crate::radiosity::rgb::Rgb;

/// Light, importance, feature size and row factors of one element; the arena holds its geometry under the same index.
#[derive(Clone, Copy, Debug)]
pub struct ElementState {
    /// Radiosity, W/m²: for an element with children the mean by area.
    pub radiosity: Rgb,
    /// Irradiance of a surface element, W/m²; 0 for clusters.
    pub irradiance: Rgb,
    /// Statistics for the error oracle.
    pub statistics: LightStatistics,
    /// Row normalisation of a leaf.
    pub factors: RowFactors,
    /// The sum that the form factors of a leaf should have: 1, or less where other surfaces cover part of the leaf.
    pub row_target: f32,
    /// Shadow features smaller than this on the element may be averaged, scene units.
    pub feature_size: f32,
    /// Weight of errors here relative to the most important element, in `(0, 1]`; 1 where everything is important.
    pub importance: f32,
    /// Whether another surface crosses the element, so that its mean light is wrong on both sides of that surface. Such an element does not
    /// exchange light, and paths that hit it continue from the hit point.
    pub crossed: bool,
    /// Whether the element lies in a gap narrower than itself, along which light decays within its size. Such an element exchanges no light either.
    pub narrow: bool,
}

impl ElementState {
    /// An element without light.
    pub const DARK: ElementState = ElementState {
        radiosity: [0.0; 3],
        irradiance: [0.0; 3],
        statistics: LightStatistics { mean: 0.0, deviation: 0.0, weight: 0.0 },
        factors: RowFactors::ONE,
        row_target: 1.0,
        feature_size: 0.0,
        importance: 1.0,
        crossed: false,
        narrow: false,
    };

    /// Whether the element does not exchange light, and paths that hit it continue from the hit point.
    pub fn is_apart(&self) -> bool {
        self.crossed || self.narrow
    }

    /// The state of a quarter of an element with this state: the same light, which varies half as much over half the size.
    pub fn of_part(self) -> ElementState {
        let statistics = LightStatistics { deviation: 0.5 * self.statistics.deviation, ..self.statistics };
        ElementState { statistics, ..self }
    }
}

/// The light that an element sends out, as the error oracle needs it.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightStatistics {
    /// Mean radiosity, W/m², mean over the channels.
    pub mean: f32,
    /// Standard deviation of the radiosity inside the element, W/m².
    pub deviation: f32,
    /// Weight of an error of the element's irradiance: reflectance times importance.
    pub weight: f32,
}

/// Row normalisation of a leaf: factors by which its light is multiplied so that its form factors have the right sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowFactors {
    /// Factor of the irradiance that arrives.
    pub gathers: f32,
    /// Factor of the radiosity that is sent.
    pub sends: f32,
}

impl RowFactors {
    /// No normalisation.
    pub const ONE: RowFactors = RowFactors { gathers: 1.0, sends: 1.0 };
}
