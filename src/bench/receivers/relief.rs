//! Receivers that are not planar: heights of terrain, texel by texel.

use super::super::workload::ReceiverPoint;
use super::{Rectangle, TexelGrid};
use crate::math::triangle_normal;
use crate::scene::Scene;
use glam::{DVec2, DVec3};

/// Height of the highest face above the centre of each texel of a rectangle, and its normal on the side of the height, row by row from the
/// top left; none beside the faces.
pub(super) fn highest(
    scene: &Scene,
    triangles: &[u32],
    &Rectangle { right, normal, centre, .. }: &Rectangle,
    &TexelGrid { width, height, texel }: &TexelGrid,
) -> Vec<Option<(f64, DVec3)>> {
    let up = normal.cross(right);
    let mut highest: Vec<Option<(f64, DVec3)>> = vec![None; width * height];
    for &t in triangles {
        let [a, b, c] = scene.corners(t);
        let corners = [a, b, c].map(|p| p.as_dvec3() - centre);
        let flat = corners.map(|p| DVec2::new(p.dot(right), p.dot(up)));
        let heights = corners.map(|p| p.dot(normal));
        let twice = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        if twice == 0.0 {
            continue;
        }
        let face = triangle_normal(a, b, c).as_dvec3();
        let face = if face.dot(normal) < 0.0 { -face } else { face };
        let (low, high) = (flat[0].min(flat[1]).min(flat[2]), flat[0].max(flat[1]).max(flat[2]));
        // Range of texels whose centres may be inside, with one more at the end.
        let span = |from: f64, to: f64, n: usize| {
            let place = |v: f64| (v / texel + 0.5 * n as f64 - 0.5).clamp(0.0, n as f64);
            place(from) as usize..((place(to) as usize) + 2).min(n)
        };
        for y in span(-high.y, -low.y, height) {
            for x in span(low.x, high.x, width) {
                let p = middle([x, y], [width, height], texel);
                let part = |i: usize, j: usize| (flat[i] - p).perp_dot(flat[j] - p) / twice;
                let weights = [part(1, 2), part(2, 0), part(0, 1)];
                if weights.iter().all(|&w| w >= -1e-9) {
                    let rise = weights.iter().zip(heights).map(|(w, h)| w * h).sum::<f64>();
                    let found = &mut highest[y * width + x];
                    if found.is_none_or(|(other, _)| rise > other) {
                        *found = Some((rise, face));
                    }
                }
            }
        }
    }
    highest
}

/// The centre of a texel, in axes to the right and upwards from the middle of a grid of this size.
fn middle([x, y]: [usize; 2], [width, height]: [usize; 2], texel: f64) -> DVec2 {
    let at = |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * texel;
    DVec2::new(at(x, width), -at(y, height))
}

/// Highest points of the faces at the centres of the texels of a rectangle, row by row from the top left, a
/// thousandth of a texel above the surface. Texels beside the faces get the height of the nearest texel in the row.
pub(super) fn points(
    scene: &Scene,
    triangles: &[u32],
    rectangle: &Rectangle,
    grid: &TexelGrid,
) -> Vec<ReceiverPoint> {
    let TexelGrid { width, height, texel } = *grid;
    let Rectangle { right, normal, centre, .. } = *rectangle;
    let magnitude = scene.magnitude_of(triangles);
    let up = normal.cross(right);
    let mut highest = highest(scene, triangles, rectangle, grid);
    for row in highest.chunks_mut(width) {
        let outline: Vec<usize> = (0..row.len()).filter(|&x| row[x].is_some()).collect();
        for x in (0..row.len()).filter(|x| !outline.contains(x)) {
            row[x] = outline.iter().min_by_key(|o| o.abs_diff(x)).and_then(|&o| row[o]);
        }
    }
    let point = |(i, found): (usize, Option<(f64, DVec3)>)| {
        let (rise, face) = found.unwrap_or((rectangle.rise[0], normal));
        let p = middle([i % width, i / width], [width, height], texel);
        let position = centre + p.x * right + p.y * up + rise * normal + 1e-3 * texel * face;
        ReceiverPoint { position: position.as_vec3(), normal: face.as_vec3(), magnitude }
    };
    highest.into_iter().enumerate().map(point).collect()
}
