//! Tone mapping.

use crate::image_io::linear_to_srgb;
use rayon::prelude::*;

/// A tone curve: exposure by the mean logarithm of luminance, compressed highlights (Reinhard et al. 2002, equations
/// 1 to 4).
#[derive(Clone, Copy, Debug)]
pub struct Tone {
    scale: f32,
    white: f32,
}

/// Luminance that the logarithmic mean is mapped to, of 1: Reinhard et al. 2002 (section 3.1) vary it from 0.18 up to
/// 0.36 and 0.72 for bright scenes. Pictures only.
const KEY: f32 = 0.25;

impl Tone {
    /// The curve for light like `values` (linear RGB, any unit); black values are ignored.
    pub fn of(values: impl IntoIterator<Item = [f32; 3]>) -> Tone {
        let mut lit: Vec<f32> =
            values.into_iter().map(luminance).filter(|l| l.is_finite() && *l > 0.0).collect();
        if lit.is_empty() {
            return Tone { scale: 1.0, white: 1.0 };
        }
        let logs: f64 = lit.iter().map(|l| f64::from(*l).ln()).sum();
        let scale = KEY / (logs / lit.len() as f64).exp() as f32;
        lit.par_sort_unstable_by(f32::total_cmp);
        // The brightest 2 % are emitters and may be white.
        let bright = lit[(lit.len() * 98 / 100).min(lit.len() - 1)] * scale;
        Tone { scale, white: bright.max(1.0) }
    }

    /// Linear RGB in `[0, 1]` for display.
    pub fn linear(self, rgb: [f32; 3]) -> [f32; 3] {
        let l = luminance(rgb) * self.scale;
        let shown = (1.0 + l / (self.white * self.white)) / (1.0 + l);
        rgb.map(|v| (v * self.scale * shown).clamp(0.0, 1.0))
    }

    /// The 8-bit sRGB colour.
    pub fn srgb(self, rgb: [f32; 3]) -> [u8; 3] {
        self.linear(rgb).map(|v| (linear_to_srgb(v) * 255.0).round() as u8)
    }
}

/// Luminance of linear sRGB (Rec. 709).
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}
