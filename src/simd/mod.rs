//! Sixteen lanes of f32 on whatever the machine has: AVX-512, AVX2 or plain code, chosen at run time.
//!
//! Kernels are written once against [`Simd`] and compiled three times by [`dispatch`]. Multiplications and additions
//! are fused exactly where a kernel says so, so results are the same bit for bit on every instruction set. (Plain code
//! on a processor without fused operations pays a function call for each.)
//! The only room besides the Embree binding (and the C ABI) with `unsafe`.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
#[cfg(test)]
mod tests;
pub mod vector;

/// Lanes of a vector.
pub const LANES: usize = 16;

/// Operations on sixteen lanes. `F` holds f32, `M` a condition per lane.
///
/// Comparisons with NaN are false; `min` and `max` return the second operand if either is NaN.
#[allow(missing_docs)] // The names are the operations.
pub trait Simd: Copy {
    type F: Copy;
    type M: Copy;

    /// Asks for the cache lines of a value that will be read soon.
    fn prefetch<T>(self, value: &T);
    fn splat(self, v: f32) -> Self::F;
    fn load(self, v: &[f32; LANES]) -> Self::F;
    fn store(self, v: Self::F, to: &mut [f32; LANES]);
    /// Upper halves of f32 (bfloat16).
    fn load_half(self, v: &[u16; LANES]) -> Self::F;
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
    /// Bit `i` is lane `i`.
    fn bits(self, m: Self::M) -> u32;
    fn mask(self, bits: u32) -> Self::M;
    /// `a` where the condition holds, `b` elsewhere.
    fn select(self, m: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// Smallest lane.
    fn least(self, v: Self::F) -> f32;
    /// Largest lane.
    fn greatest(self, v: Self::F) -> f32;
    /// Sum of the lanes, halves folded onto each other so that every instruction set rounds alike.
    fn sum(self, v: Self::F) -> f32;
    /// Sum of each two neighbouring lanes, in both of them.
    fn sum_twos(self, v: Self::F) -> Self::F;
    /// Sum of each four neighbouring lanes, (0 + 1) + (2 + 3), in all of them.
    fn sum_fours(self, v: Self::F) -> Self::F;
    /// Square root.
    fn root(self, v: Self::F) -> Self::F;
    /// Zero where the condition is false.
    fn keep(self, m: Self::M, v: Self::F) -> Self::F;
}

/// exp(-x) for x >= 0 to 1e-5, as (1 + y + y²/2 + y³/6 + y⁴/24)^-64 with y = x/64; the same on every machine.
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

/// A computation that is compiled for each instruction set.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Does it. Implementations are `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// An instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 512-bit registers.
    Avx512,
    /// 256-bit registers in pairs.
    Avx2,
    /// What every machine has.
    Portable,
}

impl Isa {
    /// The best that this machine has.
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

    /// Whether this machine can run it.
    pub fn available(self) -> bool {
        let best = Isa::detect();
        self == Isa::Portable || self == best || (self == Isa::Avx2 && best == Isa::Avx512)
    }

    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Portable => "portable",
        }
    }
}

/// Runs a kernel compiled for `isa`, or portably if this machine lacks it.
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
