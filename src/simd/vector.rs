//! Vectors of three components, one vector per lane.
//!
//! These functions avoid closures and `array::map`: code that the compiler does not inline into the function with the
//! target features is not vectorised.

use super::{LANES, Simd};
use glam::Vec3;

/// x, y and z components of sixteen vectors.
pub type Vector<S> = [<S as Simd>::F; 3];

/// The same vector in every lane.
#[inline(always)]
pub fn splat<S: Simd>(simd: S, v: Vec3) -> Vector<S> {
    [simd.splat(v.x), simd.splat(v.y), simd.splat(v.z)]
}

/// Loads sixteen vectors, stored by axis.
#[inline(always)]
pub fn load<S: Simd>(simd: S, v: &[[f32; LANES]; 3]) -> Vector<S> {
    [simd.load(&v[0]), simd.load(&v[1]), simd.load(&v[2])]
}

/// Stores sixteen vectors by axis.
#[inline(always)]
pub fn store<S: Simd>(simd: S, v: &Vector<S>, to: &mut [[f32; LANES]; 3]) {
    for (v, to) in v.iter().zip(to) {
        simd.store(*v, to);
    }
}

#[inline(always)]
pub fn sub<S: Simd>(simd: S, a: &Vector<S>, b: &Vector<S>) -> Vector<S> {
    [simd.sub(a[0], b[0]), simd.sub(a[1], b[1]), simd.sub(a[2], b[2])]
}

/// Scalar product a · b, summed from x to z with fused operations.
#[inline(always)]
pub fn dot<S: Simd>(simd: S, a: &Vector<S>, b: &Vector<S>) -> S::F {
    simd.fma(a[2], b[2], simd.fma(a[1], b[1], simd.mul(a[0], b[0])))
}

/// Vector product a × b.
#[inline(always)]
pub fn cross<S: Simd>(simd: S, a: &Vector<S>, b: &Vector<S>) -> Vector<S> {
    let part = |i: usize, j: usize| simd.sub(simd.mul(a[i], b[j]), simd.mul(a[j], b[i]));
    [part(1, 2), part(2, 0), part(0, 1)]
}

/// Sum of the absolute components.
#[inline(always)]
pub fn sum_abs<S: Simd>(simd: S, v: &Vector<S>) -> S::F {
    simd.add(simd.add(simd.abs(v[0]), simd.abs(v[1])), simd.abs(v[2]))
}

/// `f a`.
#[inline(always)]
pub fn scaled<S: Simd>(simd: S, f: S::F, a: &Vector<S>) -> Vector<S> {
    [simd.mul(f, a[0]), simd.mul(f, a[1]), simd.mul(f, a[2])]
}
