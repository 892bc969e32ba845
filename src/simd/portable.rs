//! [`Simd`] with arrays; the compiler vectorises the loops for the target.

use super::{LANES, Simd};

#[derive(Clone, Copy)]
pub(super) struct Portable;

#[inline(always)]
fn map(a: [f32; LANES], b: [f32; LANES], f: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

// Compilers for x86-64 without AVX make hundreds of bytes of each of these. Inlined, the walk of bundles is one function of 1.2 MB, which
// takes a minute to optimise; calls cost little beside what they do, as each fused operation is a call for every lane there.

#[cfg_attr(target_arch = "x86_64", inline(never))]
fn fused(a: &[f32; LANES], b: &[f32; LANES], c: &[f32; LANES]) -> [f32; LANES] {
    std::array::from_fn(|i| a[i].mul_add(b[i], c[i]))
}

#[cfg_attr(target_arch = "x86_64", inline(never))]
fn at_most(a: &[f32; LANES], b: &[f32; LANES]) -> u32 {
    (0..LANES).fold(0, |m, i| m | u32::from(a[i] <= b[i]) << i)
}

#[cfg_attr(target_arch = "x86_64", inline(never))]
fn below(a: &[f32; LANES], b: &[f32; LANES]) -> u32 {
    (0..LANES).fold(0, |m, i| m | u32::from(a[i] < b[i]) << i)
}

#[cfg_attr(target_arch = "x86_64", inline(never))]
fn selected(m: u32, a: &[f32; LANES], b: &[f32; LANES]) -> [f32; LANES] {
    std::array::from_fn(|i| if m >> i & 1 == 1 { a[i] } else { b[i] })
}

impl Simd for Portable {
    type F = [f32; LANES];
    type M = u32;

    #[inline(always)]
    fn prefetch<T>(self, _: &T) {}
    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        [v; LANES]
    }
    #[inline(always)]
    fn load(self, v: &[f32; LANES]) -> Self::F {
        *v
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32; LANES]) {
        *to = v;
    }
    #[inline(always)]
    fn load_half(self, v: &[u16; LANES]) -> Self::F {
        v.map(|h| f32::from_bits(u32::from(h) << 16))
    }
    #[inline(always)]
    fn load_whole(self, v: &[u16; LANES]) -> Self::F {
        v.map(f32::from)
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        fused(&a, &b, &c)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        a.map(f32::abs)
    }
    #[inline(always)]
    fn le(self, a: Self::F, b: Self::F) -> u32 {
        at_most(&a, &b)
    }
    #[inline(always)]
    fn lt(self, a: Self::F, b: Self::F) -> u32 {
        below(&a, &b)
    }
    #[inline(always)]
    fn and(self, a: u32, b: u32) -> u32 {
        a & b
    }
    #[inline(always)]
    fn or(self, a: u32, b: u32) -> u32 {
        a | b
    }
    #[inline(always)]
    fn and_not(self, a: u32, b: u32) -> u32 {
        a & !b
    }
    #[inline(always)]
    fn bits(self, m: u32) -> u32 {
        m
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> u32 {
        bits
    }
    #[inline(always)]
    fn select(self, m: u32, a: Self::F, b: Self::F) -> Self::F {
        selected(m, &a, &b)
    }
    #[inline(always)]
    fn least(self, v: Self::F) -> f32 {
        v.into_iter().fold(v[0], |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn greatest(self, v: Self::F) -> f32 {
        v.into_iter().fold(v[0], |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sum(self, mut v: Self::F) -> f32 {
        for half in [8, 4, 2, 1] {
            (0..half).for_each(|i| v[i] += v[i + half]);
        }
        v[0]
    }
    #[inline(always)]
    fn sum_twos(self, v: Self::F) -> Self::F {
        std::array::from_fn(|i| v[i] + v[i ^ 1])
    }
    #[inline(always)]
    fn sum_fours(self, v: Self::F) -> Self::F {
        let twos = self.sum_twos(v);
        std::array::from_fn(|i| twos[i] + twos[i ^ 2])
    }
    #[inline(always)]
    fn root(self, v: Self::F) -> Self::F {
        v.map(f32::sqrt)
    }
    #[inline(always)]
    fn keep(self, m: u32, v: Self::F) -> Self::F {
        selected(m, &v, &[0.0; LANES])
    }
}
