//! Triangles into bit images.

use super::BitImage;
use glam::Vec2;

/// Sets the pixels whose centre lies in the triangle; corners are in pixels, pixel `(x, y)` has its centre at
/// `(x + 0.5, y + 0.5)`. What lies outside the image is left out.
///
/// Sampling at centres makes the expected number of set pixels equal to the area, however small the triangle:
/// the image is a fair sample of coverage for crowds of sub-pixel triangles.
#[inline]
pub fn fill_triangle(image: &mut BitImage, corners: [Vec2; 3]) {
    let [a, b, c] = corners;
    let (low, high) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
    // Rows whose centre is in [low, high].
    let first = (low - 0.5).ceil().max(0.0);
    let last = (high - 0.5).floor().min(image.height() as f32 - 1.0);
    let mut y = first;
    while y <= last {
        let centre = y + 0.5;
        let (mut from, mut to) = (f32::INFINITY, f32::NEG_INFINITY);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
            if p.y <= centre && centre <= q.y {
                let x = if q.y > p.y { p.x + (centre - p.y) / (q.y - p.y) * (q.x - p.x) } else { p.x };
                from = from.min(x);
                to = to.max(if q.y > p.y { x } else { q.x });
                from = from.min(if q.y > p.y { x } else { q.x });
            }
        }
        let start = (from - 0.5).ceil().max(0.0);
        let end = (to - 0.5).floor().min(image.width() as f32 - 1.0);
        if start <= end {
            image.set_span(y as usize, start as usize, end as usize + 1);
        }
        y += 1.0;
    }
}
