//! Light as the eye weighs it: lumens, lux and candelas from RGB powers.

use crate::math::LUMINANCE;

/// Luminous efficacy of white light of equal energy from 380 to 780 nm: 683 lm/W at 555 nm times the mean of the CIE
/// 1931 curve V(λ) over that range, 106.9 nm / 400 nm (rounded as in Radiance, Ward 1994).
pub const WHITE_LUMENS_PER_WATT: f64 = 179.0;

/// Conversion of RGB to luminous quantities.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Photometry {
    /// Weights of the channels, with sum 1.
    pub weights: [f64; 3],
    /// Lumens per watt of a channel's power.
    pub lumens_per_watt: f64,
}

impl Default for Photometry {
    fn default() -> Photometry {
        Photometry { weights: LUMINANCE, lumens_per_watt: WHITE_LUMENS_PER_WATT }
    }
}

/// Channels that hold light as the eye weighs it. Luminous quantities of weighted channels are 179 (0.2126 R + 0.7152 G + 0.0722 B): lx of
/// W/m², lm of W, cd/m² of W/(m² sr).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Radiometric channels, weighted.
    #[default]
    Rgb,
    /// The red channel alone, in lumens instead of watts.
    Red,
    /// The green channel alone, in lumens instead of watts.
    Green,
    /// The blue channel alone, in lumens instead of watts.
    Blue,
}

impl From<Channels> for Photometry {
    fn from(channels: Channels) -> Photometry {
        let weights = match channels {
            Channels::Rgb => return Photometry::default(),
            Channels::Red => [1.0, 0.0, 0.0],
            Channels::Green => [0.0, 1.0, 0.0],
            Channels::Blue => [0.0, 0.0, 1.0],
        };
        Photometry { weights, lumens_per_watt: 1.0 }
    }
}

impl Photometry {
    /// The luminous counterpart of an RGB quantity: lm of W, lx of W/m², cd/m² of W/(m² sr).
    pub fn of(&self, rgb: [f64; 3]) -> f64 {
        self.lumens_per_watt * (0..3).map(|c| self.weights[c] * rgb[c]).sum::<f64>()
    }

    /// Whether a channel holds lumens instead of watts.
    pub fn holds_lumens(&self) -> bool {
        self.weights.contains(&1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_light_has_the_stated_efficacy() {
        assert!((Photometry::default().of([2.0; 3]) - 358.0).abs() < 1e-9);
        assert_eq!(Photometry::from(Channels::Green).of([1.0, 5.0, 9.0]), 5.0);
    }
}
