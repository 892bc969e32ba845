//! [`Simd`] with one 512-bit register per vector.
#![allow(unsafe_code)]

use super::{Kernel, LANES, Simd, operations};
use std::arch::x86_64::*;

/// Token that proves the presence of AVX-512 F and BW; only [`run`] makes one.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx512f,avx512bw")]
    fn inner<K: Kernel>(kernel: K) -> K::Output {
        kernel.run(Avx512(()))
    }
    // Feature detection is one load and a test, cheap compared with any kernel.
    assert!(is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw"));
    // SAFETY: the features were just detected.
    unsafe { inner(kernel) }
}

/// The body of an operation: intrinsics without memory access, or on references of the full width.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: a value of `Avx512` exists only inside `run`, which checked the features; loads and stores are
        // unaligned ones on references to sixteen whole elements.
        unsafe { $e }
    };
}

impl Simd for Avx512 {
    type F = __m512;
    type M = __mmask16;

    #[inline(always)]
    fn prefetch<T>(self, value: &T) {
        let start: *const i8 = std::ptr::from_ref(value).cast();
        for line in 0..size_of::<T>().div_ceil(64) {
            // A prefetch never faults; these lines belong to the value.
            op!(_mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)));
        }
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32; LANES]) {
        op!(_mm512_storeu_ps(to.as_mut_ptr(), v))
    }
    #[inline(always)]
    fn sum_fours(self, v: Self::F) -> Self::F {
        let twos = self.sum_twos(v);
        op!(_mm512_add_ps(twos, _mm512_permute_ps::<0b01_00_11_10>(twos)))
    }
    operations! {
        splat(v: f32) -> Self::F = op!(_mm512_set1_ps(v));
        load(v: &[f32; LANES]) -> Self::F = op!(_mm512_loadu_ps(v.as_ptr()));
        load_half(v: &[u16; LANES]) -> Self::F = op!({
            let wide = _mm512_cvtepu16_epi32(_mm256_loadu_si256(v.as_ptr().cast()));
            _mm512_castsi512_ps(_mm512_slli_epi32::<16>(wide))
        });
        load_whole(v: &[u16; LANES]) -> Self::F = op!(_mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(_mm256_loadu_si256(v.as_ptr().cast()))));
        add(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_add_ps(a, b));
        sub(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_sub_ps(a, b));
        mul(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_mul_ps(a, b));
        div(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_div_ps(a, b));
        fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F = op!(_mm512_fmadd_ps(a, b, c));
        min(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_min_ps(a, b));
        max(a: Self::F, b: Self::F) -> Self::F = op!(_mm512_max_ps(a, b));
        abs(a: Self::F) -> Self::F = op!(_mm512_abs_ps(a));
        le(a: Self::F, b: Self::F) -> Self::M = op!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b));
        lt(a: Self::F, b: Self::F) -> Self::M = op!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b));
        and(a: Self::M, b: Self::M) -> Self::M = a & b;
        or(a: Self::M, b: Self::M) -> Self::M = a | b;
        and_not(a: Self::M, b: Self::M) -> Self::M = a & !b;
        bits(m: Self::M) -> u32 = u32::from(m);
        mask(bits: u32) -> Self::M = bits as u16;
        select(m: Self::M, a: Self::F, b: Self::F) -> Self::F = op!(_mm512_mask_blend_ps(m, b, a));
        least(v: Self::F) -> f32 = op!(_mm512_reduce_min_ps(v));
        greatest(v: Self::F) -> f32 = op!(_mm512_reduce_max_ps(v));
        sum(v: Self::F) -> f32 = op!({
            let high = _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(v)));
            let s = _mm256_add_ps(_mm512_castps512_ps256(v), high);
            let s = _mm_add_ps(_mm256_castps256_ps128(s), _mm256_extractf128_ps::<1>(s));
            let s = _mm_add_ps(s, _mm_movehl_ps(s, s));
            _mm_cvtss_f32(_mm_add_ss(s, _mm_shuffle_ps::<1>(s, s)))
        });
        sum_twos(v: Self::F) -> Self::F = op!(_mm512_add_ps(v, _mm512_permute_ps::<0b10_11_00_01>(v)));
        root(v: Self::F) -> Self::F = op!(_mm512_sqrt_ps(v));
        keep(m: Self::M, v: Self::F) -> Self::F = op!(_mm512_maskz_mov_ps(m, v));
    }
}
