//! Vectors of sixteen f32 lanes with AVX-512, AVX2 or portable code, selected at run time.
//!
//! Kernels are written once against [`Simd`]; [`dispatch`] compiles them for each instruction set. Multiplications and
//! additions are fused only where a kernel says so, so results are bit-identical on every instruction set. (Portable
//! code on a processor without fused operations makes a function call for each.)
//!
//! Besides the Embree binding and the C interface this is the only room with `unsafe`.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
#[cfg(test)]
mod tests;
pub mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

/// Number of lanes of a vector.
pub const LANES: usize = 16;

/// Operations on sixteen lanes. `F` holds f32, `M` a condition per lane.
///
/// Comparisons with NaN are false; `min` and `max` return the second operand if either is NaN.
#[allow(missing_docs)] // The names are the operations.
pub trait Simd: Copy {
    type F: Copy;
    type M: Copy;

    /// Prefetches the cache lines of a value.
    fn prefetch<T>(self, value: &T);
    fn splat(self, v: f32) -> Self::F;
    fn load(self, v: &[f32; LANES]) -> Self::F;
    fn store(self, v: Self::F, to: &mut [f32; LANES]);
    /// Widens bfloat16 values, the upper halves of f32, to f32.
    fn load_half(self, v: &[u16; LANES]) -> Self::F;
    /// Whole numbers from 0 to 65,535 as f32.
    fn load_whole(self, v: &[u16; LANES]) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a b + c`, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn abs(self, a: Self::F) -> Self::F;
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    fn lt(self, a: Self::F, b: Self::F) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// `a` and not `b`.
    fn and_not(self, a: Self::M, b: Self::M) -> Self::M;
    /// The condition as a bit mask: bit `i` is lane `i`.
    fn bits(self, m: Self::M) -> u32;
    fn mask(self, bits: u32) -> Self::M;
    /// `a` where the condition holds, `b` elsewhere.
    fn select(self, m: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// Smallest lane.
    fn least(self, v: Self::F) -> f32;
    /// Largest lane.
    fn greatest(self, v: Self::F) -> f32;
    /// Sum of the lanes, by folding halves onto each other: every instruction set rounds alike.
    fn sum(self, v: Self::F) -> f32;
    /// Sum of each pair of adjacent lanes, in both lanes.
    fn sum_twos(self, v: Self::F) -> Self::F;
    /// Sum of each group of four adjacent lanes, (0 + 1) + (2 + 3), in all four lanes.
    fn sum_fours(self, v: Self::F) -> Self::F;
    /// Square root.
    fn root(self, v: Self::F) -> Self::F;
    /// `v` where the condition holds, 0 elsewhere.
    fn keep(self, m: Self::M, v: Self::F) -> Self::F;
}

/// Defines operations of an instruction set, each by an expression.
macro_rules! operations {
    ($($name:ident($($argument:ident: $kind:ty),+) -> $result:ty = $value:expr;)+) => {
        $(
            #[inline(always)]
            fn $name(self, $($argument: $kind),+) -> $result {
                $value
            }
        )+
    };
}
use operations;

/// A bfloat16 that is at least `v`, which is not negative.
pub const fn half_up(v: f32) -> u16 {
    (v.to_bits().saturating_add(0xffff) >> 16) as u16
}

/// The bfloat16 nearest to `v`, which is not negative.
pub fn half_nearest(v: f32) -> u16 {
    (v.to_bits().saturating_add(0x8000) >> 16) as u16
}

/// exp(-x) for x >= 0 with an error below 1e-5: (1 + y + y²/2 + y³/6 + y⁴/24)^-64 with y = x/64. Bit-identical on every
/// instruction set. x above 80 counts as 80.
#[inline(always)]
pub fn decay<S: Simd>(simd: S, x: S::F) -> S::F {
    let one = simd.splat(1.0);
    let y = simd.mul(simd.min(x, simd.splat(80.0)), simd.splat(1.0 / 64.0));
    // Horner's rule.
    let mut p = simd.splat(1.0 / 24.0);
    for k in [1.0 / 6.0, 0.5, 1.0, 1.0] {
        p = simd.fma(p, y, simd.splat(k));
    }
    for _ in 0..6 {
        p = simd.mul(p, p);
    }
    simd.div(one, p)
}

/// A computation that [`dispatch`] compiles for each instruction set.
pub trait Kernel {
    /// Result of the computation.
    type Output;
    /// Runs the computation. Implementations are `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 512-bit registers: AVX-512 F and BW.
    Avx512,
    /// Pairs of 256-bit registers: AVX2 and FMA.
    Avx2,
    /// Portable code.
    Portable,
}

impl Isa {
    /// The widest instruction set of this machine.
    pub fn detect() -> Isa {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw") {
                return Isa::Avx512;
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Isa::Avx2;
            }
        }
        Isa::Portable
    }

    /// Whether this machine supports the instruction set.
    #[cfg(test)]
    pub fn available(self) -> bool {
        let best = Isa::detect();
        self == Isa::Portable || self == best || (self == Isa::Avx2 && best == Isa::Avx512)
    }

    /// Name in reports: `avx512`, `avx2` or `portable`.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Portable => "portable",
        }
    }
}

/// Runs a kernel compiled for `isa`. On processors other than x86-64 portable code runs.
///
/// # Panics
/// If this machine does not support `isa`.
#[inline]
pub fn dispatch<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match isa {
        Isa::Avx512 => return avx512::run(kernel),
        Isa::Avx2 => return avx2::run(kernel),
        Isa::Portable => {}
    }
    kernel.run(portable::Portable)
}
