//! Box filter of arbitrary width; the time per texel does not depend on the width.

/// Means of `values` (`width` columns, row by row) over the square of side `size` texels around each texel's centre.
///
/// Values are constant over each texel, so a square that ends inside a texel counts that part of the texel and the
/// result is continuous in `size`. Up to `size` 1 the square stays inside its texel and values are returned unchanged.
/// Beyond the border the nearest texel is repeated. Prefix sums are in f64. `size` must not be NaN; the length of
/// `values` must be a multiple of `width`.
pub fn box_filter(values: &[f64], width: usize, size: f64) -> Vec<f64> {
    if size <= 1.0 || values.is_empty() {
        return values.to_vec();
    }
    let height = values.len() / width;
    let mut rows = vec![0.0; values.len()];
    let mut sums = vec![0.0; width + 1];
    for (line, out) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (x, v) in line.iter().enumerate() {
            sums[x + 1] = sums[x] + v;
        }
        for (x, out) in out.iter_mut().enumerate() {
            let (from, to) = ends(x, size, width);
            *out = (integral(&sums, line, to) - integral(&sums, line, from)) / size;
        }
    }
    // The same along the columns, a whole row at a time for sequential memory access.
    let mut sums = vec![0.0; values.len() + width];
    for y in 0..height {
        for x in 0..width {
            sums[(y + 1) * width + x] = sums[y * width + x] + rows[y * width + x];
        }
    }
    let mut out = vec![0.0; values.len()];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let (from, to) = ends(y, size, height);
        for (end, sign) in [(to, 1.0 / size), (from, -1.0 / size)] {
            for (x, out) in out.iter_mut().enumerate() {
                *out += sign * (sums[end.whole * width + x] + end.part * rows[end.texel * width + x]);
            }
        }
    }
    out
}

/// A position on a line of texels: the integral from the start of the line to the position is the sum of the first
/// `whole` values plus `part` times the value of `texel`. Beyond the line `part` is negative or above 1: the end
/// repeats.
struct End {
    whole: usize,
    texel: usize,
    part: f64,
}

/// Both ends of the interval of length `size` (texels) around the centre of texel `i`, on a line of `n` texels.
fn ends(i: usize, size: f64, n: usize) -> (End, End) {
    let place = |t: f64| {
        let whole = t.floor().clamp(0.0, (n - 1) as f64);
        End { whole: whole as usize, texel: whole as usize, part: t - whole }
    };
    let centre = i as f64 + 0.5;
    (place(centre - size / 2.0), place(centre + size / 2.0))
}

/// Integral over the line from its start to `end`.
#[inline]
fn integral(sums: &[f64], line: &[f64], end: End) -> f64 {
    sums[end.whole] + end.part * line[end.texel]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sum over the texels that the box overlaps, in an image extended by its border.
    fn naive(values: &[f64], width: usize, size: f64, x: usize, y: usize) -> f64 {
        let height = values.len() / width;
        let reach = size.ceil() as i64;
        let overlap = |d: i64| (size / 2.0).min(d as f64 + 0.5) - (-size / 2.0).max(d as f64 - 0.5);
        let mut sum = 0.0;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let u = (x as i64 + dx).clamp(0, width as i64 - 1) as usize;
                let v = (y as i64 + dy).clamp(0, height as i64 - 1) as usize;
                sum += overlap(dx).max(0.0) * overlap(dy).max(0.0) * values[v * width + u];
            }
        }
        sum / (size * size)
    }

    proptest! {
        #[test]
        fn matches_the_sum_of_overlaps(w in 1usize..12, h in 1usize..12, size in 0.1f64..30.0, seed: u32) {
            let value = |i: usize| f64::from((seed ^ i as u32).wrapping_mul(2654435761) >> 8);
            let values: Vec<f64> = (0..w * h).map(value).collect();
            let filtered = box_filter(&values, w, size);
            for y in 0..h {
                for x in 0..w {
                    let expected = naive(&values, w, size.max(1.0), x, y);
                    let found = filtered[y * w + x];
                    prop_assert!((found - expected).abs() < 1e-3, "{found} {expected}");
                }
            }
        }
    }

    #[test]
    fn up_to_one_texel_nothing_changes() {
        let values = [0.1, 0.7, 0.2, 0.9, 0.3, 0.5];
        for size in [-1.0, 0.0, 0.5, 1.0] {
            assert_eq!(box_filter(&values, 3, size), values);
        }
        assert!(box_filter(&[], 4, 9.0).is_empty());
    }
}
