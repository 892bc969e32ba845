//! [`Simd`] with arrays; the compiler vectorises the loops for the target.

use super::{LANES, Simd, operations};

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
    fn store(self, v: Self::F, to: &mut [f32; LANES]) {
        *to = v;
    }
    #[inline(always)]
    fn sum(self, mut v: Self::F) -> f32 {
        for half in [8, 4, 2, 1] {
            (0..half).for_each(|i| v[i] += v[i + half]);
        }
        v[0]
    }
    #[inline(always)]
    fn sum_fours(self, v: Self::F) -> Self::F {
        let twos = self.sum_twos(v);
        std::array::from_fn(|i| twos[i] + twos[i ^ 2])
    }
    operations! {
        splat(v: f32) -> Self::F = [v; LANES];
        load(v: &[f32; LANES]) -> Self::F = *v;
        load_half(v: &[u16; LANES]) -> Self::F = v.map(|h| f32::from_bits(u32::from(h) << 16));
        load_whole(v: &[u16; LANES]) -> Self::F = v.map(f32::from);
        add(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| a + b);
        sub(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| a - b);
        mul(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| a * b);
        div(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| a / b);
        fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F = fused(&a, &b, &c);
        min(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| if a < b { a } else { b });
        max(a: Self::F, b: Self::F) -> Self::F = map(a, b, |a, b| if a > b { a } else { b });
        abs(a: Self::F) -> Self::F = a.map(f32::abs);
        le(a: Self::F, b: Self::F) -> u32 = at_most(&a, &b);
        lt(a: Self::F, b: Self::F) -> u32 = below(&a, &b);
        and(a: u32, b: u32) -> u32 = a & b;
        or(a: u32, b: u32) -> u32 = a | b;
        and_not(a: u32, b: u32) -> u32 = a & !b;
        bits(m: u32) -> u32 = m;
        mask(bits: u32) -> u32 = bits;
        select(m: u32, a: Self::F, b: Self::F) -> Self::F = selected(m, &a, &b);
        least(v: Self::F) -> f32 = v.into_iter().fold(v[0], |a, b| if a < b { a } else { b });
        greatest(v: Self::F) -> f32 = v.into_iter().fold(v[0], |a, b| if a > b { a } else { b });
        sum_twos(v: Self::F) -> Self::F = std::array::from_fn(|i| v[i] + v[i ^ 1]);
        root(v: Self::F) -> Self::F = v.map(f32::sqrt);
        keep(m: u32, v: Self::F) -> Self::F = selected(m, &v, &[0.0; LANES]);
    }
}
