//! The light that elements reflect.

/// The light that an element reflects, as rays read it.
#[derive(Clone, Copy)]
pub struct Reflected {
    /// Reflected radiosity by channel, W/m².
    pub light: [f32; 3],
    /// Smallest distance from which the mean light of the element stands for the light at each of its points (secondary final gathers,
    /// Jensen 2001), scene units: the radius of the element; 0 in scenes without clusters, where links have divided elements as finely as
    /// their light varies; infinite outside the exchange.
    pub trusted_from: f32,
}

impl Reflected {
    /// Whether the element is outside the exchange.
    pub fn is_excluded(&self) -> bool {
        self.trusted_from == f32::INFINITY
    }
}
