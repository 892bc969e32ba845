//! [`Simd`] with two 256-bit registers per vector.
#![allow(unsafe_code)]

use super::x86::{feature_token, op, prefetch};
use super::{Kernel, LANES, Simd, operations};
use std::arch::x86_64::*;

feature_token!(Avx2, "avx2,fma", ["avx2", "fma"]);

type F = [__m256; 2];

#[inline(always)]
fn both(a: F, b: F, f: impl Fn(__m256, __m256) -> __m256) -> F {
    [f(a[0], b[0]), f(a[1], b[1])]
}

impl Simd for Avx2 {
    type F = F;
    type M = F;

    prefetch!();
    #[inline(always)]
    fn store(self, v: F, to: &mut [f32; LANES]) {
        op!({
            _mm256_storeu_ps(to.as_mut_ptr(), v[0]);
            _mm256_storeu_ps(to.as_mut_ptr().add(8), v[1]);
        })
    }
    #[inline(always)]
    fn sum_fours(self, v: F) -> F {
        let twos = self.sum_twos(v);
        both(twos, twos, |v, _| op!(_mm256_add_ps(v, _mm256_permute_ps::<0b01_00_11_10>(v))))
    }
    #[inline(always)]
    fn keep(self, m: F, v: F) -> F {
        self.and(m, v)
    }
    operations! {
        splat(v: f32) -> F = op!([_mm256_set1_ps(v); 2]);
        load(v: &[f32; LANES]) -> F = op!([_mm256_loadu_ps(v.as_ptr()), _mm256_loadu_ps(v.as_ptr().add(8))]);
        load_half(v: &[u16; LANES]) -> F = op!({
            let low = _mm256_cvtepu16_epi32(_mm_loadu_si128(v.as_ptr().cast()));
            let high = _mm256_cvtepu16_epi32(_mm_loadu_si128(v.as_ptr().add(8).cast()));
            [
                _mm256_castsi256_ps(_mm256_slli_epi32::<16>(low)),
                _mm256_castsi256_ps(_mm256_slli_epi32::<16>(high)),
            ]
        });
        load_whole(v: &[u16; LANES]) -> F = op!([
            _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(v.as_ptr().cast()))),
            _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(v.as_ptr().add(8).cast()))),
        ]);
        add(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_add_ps(a, b)));
        sub(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_sub_ps(a, b)));
        mul(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_mul_ps(a, b)));
        div(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_div_ps(a, b)));
        fma(a: F, b: F, c: F) -> F = op!([_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])]);
        min(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_min_ps(a, b)));
        max(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_max_ps(a, b)));
        abs(a: F) -> F = both(a, a, |a, _| op!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), a)));
        le(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)));
        lt(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)));
        and(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_and_ps(a, b)));
        or(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_or_ps(a, b)));
        and_not(a: F, b: F) -> F = both(a, b, |a, b| op!(_mm256_andnot_ps(b, a)));
        bits(m: F) -> u32 = op!(_mm256_movemask_ps(m[0]) as u32 | (_mm256_movemask_ps(m[1]) as u32) << 8);
        mask(bits: u32) -> F = op!({
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let low = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
            let high = _mm256_and_si256(_mm256_set1_epi32((bits >> 8) as i32), lane);
            [
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(low, lane)),
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, lane)),
            ]
        });
        select(m: F, a: F, b: F) -> F = op!([_mm256_blendv_ps(b[0], a[0], m[0]), _mm256_blendv_ps(b[1], a[1], m[1])]);
        least(v: F) -> f32 = op!({
            let m = _mm256_min_ps(v[0], v[1]);
            let m = _mm_min_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps::<1>(m));
            let m = _mm_min_ps(m, _mm_movehl_ps(m, m));
            _mm_cvtss_f32(_mm_min_ss(m, _mm_shuffle_ps::<1>(m, m)))
        });
        greatest(v: F) -> f32 = op!({
            let m = _mm256_max_ps(v[0], v[1]);
            let m = _mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps::<1>(m));
            let m = _mm_max_ps(m, _mm_movehl_ps(m, m));
            _mm_cvtss_f32(_mm_max_ss(m, _mm_shuffle_ps::<1>(m, m)))
        });
        sum(v: F) -> f32 = op!({
            let s = _mm256_add_ps(v[0], v[1]);
            let s = _mm_add_ps(_mm256_castps256_ps128(s), _mm256_extractf128_ps::<1>(s));
            let s = _mm_add_ps(s, _mm_movehl_ps(s, s));
            _mm_cvtss_f32(_mm_add_ss(s, _mm_shuffle_ps::<1>(s, s)))
        });
        sum_twos(v: F) -> F = both(v, v, |v, _| op!(_mm256_add_ps(v, _mm256_permute_ps::<0b10_11_00_01>(v))));
        root(v: F) -> F = both(v, v, |v, _| op!(_mm256_sqrt_ps(v)));
    }
}
