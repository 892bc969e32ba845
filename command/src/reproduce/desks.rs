//! The shadows under the desks of the office.

use super::shadow::{crop, mean};
use mrvis::Result;
use mrvis::internals::scene::generate::{DESKS, ROOM};
use mrvis::metrics::Image;

/// Planar surfaces of the shell of the room, which never block, stay outside the clusters; the tops of desks, with an inscribed
/// disc of 0.08 of the diagonal, do not.
pub const SHELL: f32 = 0.15;
/// Half of the area under a desk, of 1.6 x 0.8 m, that the penumbra of its edges leaves, metres.
const UNDER: [f64; 2] = [0.5, 0.2];
/// Half of the inner and outer border of the floor around a desk, up to the next one, metres.
const AROUND: [[f64; 2]; 2] = [[0.9, 0.5], [1.2, 0.8]];

/// Loss of light under the desks, relative to the floor around them.
pub fn contrast(image: &Image) -> Result<f64> {
    let texel = |metres: f64| (metres / image.texel()).round() as usize;
    // Sum and number of texels in a rectangle around a desk.
    let sum = |[x, y]: [f64; 2], [across, along]: [f64; 2]| -> Result<[f64; 2]> {
        let (left, top) = (0.5 * ROOM.x + x - across, 0.5 * ROOM.y - y - along);
        let part = [left, top, left + 2.0 * across, top + 2.0 * along].map(texel);
        let part = crop(image, part)?;
        let count = part.data().len() as f64;
        Ok([count * mean(&part), count])
    };
    let (mut under, mut around) = ([0.0; 2], [0.0; 2]);
    for desk in DESKS {
        let [own, inner, outer] = [UNDER, AROUND[0], AROUND[1]].map(|half| sum(desk, half));
        let [own, inner, outer] = [own?, inner?, outer?];
        for k in 0..2 {
            under[k] += own[k];
            around[k] += outer[k] - inner[k];
        }
    }
    Ok(1.0 - under[0] / under[1] / (around[0] / around[1]))
}
