//! Limits of what scenes may hold.

/// Largest coordinate: areas and volumes stay within f32.
pub const MAX_COORDINATE: f64 = 1e12;
/// Smallest extent of a scene: areas stay within f32.
pub const MIN_EXTENT: f64 = 1e-12;
/// Largest reflectance: with 1 the light in a closed room would not converge; 0.999 reflects at most 1 / (1 − 0.999) =
/// 1,000 times the emitted light.
pub const MAX_REFLECTANCE: f32 = 0.999;
