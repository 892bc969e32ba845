//! [`Simd`] with one 512-bit register per vector.
#![allow(unsafe_code)]

use super::x86::{feature_token, op, prefetch};
use super::{Kernel, LANES, Simd, operations};
use std::arch::x86_64::*;

feature_token!(Avx512, "avx512f,avx512bw", ["avx512f", "avx512bw"]);

impl Simd for Avx512 {
    type F = __m512;
    type M = __mmask16;

    prefetch!();
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
