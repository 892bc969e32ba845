//! Three colour channels in double precision.

/// One value for each colour channel: red, green, blue.
pub type Rgb = [f64; 3];

/// Adds `factor` times a value to a sum, channel by channel.
#[inline]
pub fn add(sum: &mut Rgb, factor: f64, value: Rgb) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s += factor * v;
    }
}

/// Mean of the three channels.
pub fn mean(v: Rgb) -> f64 {
    (v[0] + v[1] + v[2]) / 3.0
}
