//! Rasterisation of triangles into bit images.

use super::BitImage;
use glam::Vec2;

/// Sets the pixels whose centre lies in the triangle. Corners are in pixels; pixel `(x, y)` has its centre at
/// `(x + 0.5, y + 0.5)`. The part outside the image is ignored.
///
/// With samples at pixel centres the expected number of set pixels equals the area, however small the triangle, so the
/// coverage by many sub-pixel triangles is unbiased.
#[inline]
pub fn fill_triangle(image: &mut BitImage, corners: [Vec2; 3]) {
    let [a, b, c] = corners;
    // Pixels whose centres lie in [low, high] along an axis, as a half-open range.
    let pixels = |low: f32, high: f32, count: usize| {
        let from = (low - 0.5).max(0.0);
        let first = from as usize + usize::from(from > from as usize as f32);
        let end = (high + 0.5).max(0.0).min(count as f32) as usize;
        first..end
    };
    let rows = pixels(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y), image.height());
    for y in rows {
        let centre = y as f32 + 0.5;
        let (mut from, mut to) = (f32::INFINITY, f32::NEG_INFINITY);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
            if p.y <= centre && centre <= q.y {
                // A horizontal edge contributes both ends.
                let (x, other) = if q.y > p.y {
                    let x = p.x + (centre - p.y) / (q.y - p.y) * (q.x - p.x);
                    (x, x)
                } else {
                    (p.x, q.x)
                };
                from = from.min(x).min(other);
                to = to.max(x).max(other);
            }
        }
        let span = pixels(from, to, image.width());
        if !span.is_empty() {
            image.set_span(y, span.start, span.end);
        }
    }
}
