//! Number, size and place of a receiver's texels.

use super::patch::Patch;
use super::{Rectangle, TexelGrid, probe};
use crate::model::Model;
use crate::ray::Occluder;
use crate::scene::Scene;

/// Smallest and largest number of texels along the longer side. A page shows 512 pixels without scaling; fewer than 96 show no shape.
const SIDE_TEXELS: [usize; 2] = [96, 512];
/// Approximate number of pairs of all images: about 100 million segments of reference and rows together, some ten seconds on two cores.
const MAX_PAIRS: usize = 400_000;
/// Smallest side of a window, in largest feature sizes: 6 · 6 features of that size, each there with probability ½, cover 50 % of the
/// window with a standard error of ½ / 6 = 8 %.
const LARGEST_FEATURES: f64 = 6.0;
/// Test points along the longer side of a surface of which a window is imaged: a window of the smallest size, 1/20 of
/// the side, contains several.
const PROBES: usize = 48;
/// Factor by which a window off the centre must have more borders of shadows than the one nearest to the centre.
const MIN_GAIN: f64 = 1.05;

impl TexelGrid {
    /// Texels of at most half of `sizes[0]` on a surface with these sides, the longer first: the whole surface, or as
    /// much of it as the number of texels allows. `share`: number of emitters times number of images. If six of
    /// `sizes[1]` do not fit into the image, its texels are larger.
    pub(super) fn new(surface: [f64; 2], sizes: [f64; 2], share: usize) -> TexelGrid {
        let [min, max] = SIDE_TEXELS.map(|n| n as f64);
        let fine = (0.5 * sizes[0]).min(surface[0] / min);
        // A window is as wide as the number of its texels allows; narrow surfaces need fewer rows.
        let texels = MAX_PAIRS as f64 / share.max(1) as f64;
        let shape = surface[1] / surface[0];
        let square = texels.sqrt().clamp(min / 3.0, max);
        let rows = |texel: f64| (surface[1] / texel).min(square).max(1.0);
        let side = |texel: f64| (texels / rows(texel)).clamp(square, max).min(surface[0] / texel);
        let texel = match side(fine) * fine >= 0.999 * (LARGEST_FEATURES * sizes[1]).min(surface[0]) {
            true => fine,
            false => {
                (LARGEST_FEATURES * sizes[1]).min(surface[0]) / (texels / shape).sqrt().clamp(square, max)
            }
        };
        let count = |n: f64| (n.round() as usize).max(1);
        TexelGrid { width: count(side(texel)), height: count(rows(texel)), texel }
    }

    /// Texels of a map: `side` along the longer side of the surface. Where they would be wider than half of the smallest feature size,
    /// a window of texels of that width.
    pub(super) fn map(surface: [f64; 2], side: usize, smallest: f64) -> TexelGrid {
        let texel = (surface[0] / side as f64).min(0.5 * smallest);
        let height = ((surface[1] / texel).round() as usize).clamp(1, side);
        TexelGrid { width: side, height, texel }
    }
}

/// The part of a patch's rectangle that a grid covers: all, or the window with the most borders of shadows.
pub(super) fn place(
    model: &Model,
    exact: &dyn Occluder,
    surfaces: &Scene,
    patch: &Patch,
    rectangle: Rectangle,
    grid: &TexelGrid,
) -> Rectangle {
    let TexelGrid { width, height, texel } = *grid;
    let window = [width as f64 * texel, height as f64 * texel];
    let room = [rectangle.width - window[0], rectangle.height - window[1]].map(|r| r.max(0.0));
    if room[0] < texel && room[1] < texel {
        return rectangle;
    }
    let ([columns, rows], points) = patch.spread(surfaces, &rectangle, PROBES);
    let (workload, values) = probe(model, exact, points);
    let light = workload.weighted(&values);
    let step = rectangle.width / columns as f64;
    // Partly visible light, and steps of light to the next point.
    let interest = |x: usize, y: usize| {
        let v = light[y * columns + x];
        let next = |x: usize, y: usize| {
            if x < columns && y < rows { (light[y * columns + x] - v).abs() } else { 0.0 }
        };
        f64::from(v * (1.0 - v) + 0.25 * (next(x + 1, y) + next(x, y + 1)))
    };
    let count = |side: f64, n: usize| ((side / step).round() as usize).clamp(1, n);
    let [w, h] = [count(window[0], columns), count(window[1], rows)];
    let sum = |x: usize, y: usize| -> f64 {
        (y..y + h).flat_map(|y| (x..x + w).map(move |x| (x, y))).map(|(x, y)| interest(x, y)).sum()
    };
    let places = (0..=rows - h).flat_map(|y| (0..=columns - w).map(move |x| (x, y)));
    let off = |&(x, y): &(usize, usize)| (2 * x).abs_diff(columns - w) + (2 * y).abs_diff(rows - h);
    let mut places: Vec<(usize, usize)> = places.collect();
    places.sort_by_key(off);
    let mut best = (f64::MIN, (0, 0));
    for (x, y) in places {
        let sum = sum(x, y);
        if best.0 == f64::MIN || sum > MIN_GAIN * best.0 {
            best = (sum, (x, y));
        }
    }
    let up = rectangle.normal.cross(rectangle.right);
    let shift = |first: usize, wide: usize, n: usize, room: f64| {
        let off = (first as f64 + 0.5 * wide as f64 - 0.5 * n as f64) * step;
        off.clamp(-0.5 * room, 0.5 * room)
    };
    let (x, y) = best.1;
    let centre =
        rectangle.centre + shift(x, w, columns, room[0]) * rectangle.right - shift(y, h, rows, room[1]) * up;
    Rectangle { centre, width: window[0], height: window[1], ..rectangle }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sizes from centimetres to decimetres on floors of all kinds: the texels are small enough and not too many.
    #[test]
    fn texels_resolve_the_smallest_size() {
        for surface in [[7.0, 5.0], [7.0, 0.3], [0.5, 0.5], [200.0, 150.0]] {
            for sizes in [[0.007, 0.035], [0.02, 0.1], [0.06, 0.3]] {
                for share in [1, 3, 12] {
                    let TexelGrid { width, height, texel } = TexelGrid::new(surface, sizes, share);
                    assert!(texel <= 0.5 * sizes[0], "{surface:?} {sizes:?} {share}: {texel}");
                    assert!(width <= SIDE_TEXELS[1] && height <= SIDE_TEXELS[1]);
                    assert!(width * height * share <= MAX_PAIRS * 11 / 10, "{surface:?} {width} {height}");
                    let [w, h] = [width as f64 * texel, height as f64 * texel];
                    assert!(w <= 1.01 * surface[0] && h <= surface[1].max(texel) + texel);
                    assert!(
                        w >= 0.99 * (LARGEST_FEATURES * sizes[1]).min(surface[0]),
                        "{surface:?} {sizes:?} {w}"
                    );
                }
            }
        }
        assert_eq!(
            TexelGrid::map([8.0, 6.0], 256, 0.1),
            TexelGrid { width: 256, height: 192, texel: 8.0 / 256.0 }
        );
        assert_eq!(TexelGrid::map([8.0, 6.0], 256, 0.02), TexelGrid { width: 256, height: 256, texel: 0.01 });
        // A small surface is imaged whole, however large the sizes.
        let TexelGrid { width, texel, .. } = TexelGrid::new([1.0, 1.0], [0.5, 2.0], 1);
        assert!(width >= SIDE_TEXELS[0] && (width as f64 * texel - 1.0).abs() < 0.01);
    }
}
