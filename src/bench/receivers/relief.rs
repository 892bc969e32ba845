//! Receivers that are not planar: heights of terrain, texel by texel.

use super::super::workload::ReceiverPoint;
use super::rectangle::Rectangle;
use crate::math::triangle_normal;
use crate::scene::Scene;
use glam::{DVec2, DVec3};

/// Highest points of the faces at the centres of the texels of a rectangle, row by row from the top left, a
/// thousandth of a texel above the surface. Texels beside the faces get the height of the nearest texel in the row.
pub(super) fn points(
    scene: &Scene,
    triangles: &[u32],
    rectangle: &Rectangle,
    (width, height, texel): (usize, usize, f64),
) -> Vec<ReceiverPoint> {
    let Rectangle { right, normal, centre, .. } = *rectangle;
    let magnitude = scene.magnitude_of(triangles);
    let up = normal.cross(right);
    let middle = |x: usize, y: usize| {
        let at = |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * texel;
        DVec2::new(at(x, width), -at(y, height))
    };
    let mut highest: Vec<(f64, DVec3)> = vec![(f64::MIN, normal); width * height];
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
                let p = middle(x, y);
                let part = |i: usize, j: usize| (flat[i] - p).perp_dot(flat[j] - p) / twice;
                let weights = [part(1, 2), part(2, 0), part(0, 1)];
                if weights.iter().all(|&w| w >= -1e-9) {
                    let rise = weights.iter().zip(heights).map(|(w, h)| w * h).sum::<f64>();
                    let found = &mut highest[y * width + x];
                    if rise > found.0 {
                        *found = (rise, face);
                    }
                }
            }
        }
    }
    for row in highest.chunks_mut(width) {
        let outline: Vec<usize> = (0..row.len()).filter(|&x| row[x].0 > f64::MIN).collect();
        for x in (0..row.len()).filter(|x| !outline.contains(x)) {
            let nearest = outline.iter().min_by_key(|o| o.abs_diff(x));
            row[x] = nearest.map_or((rectangle.rise[0], normal), |&o| row[o]);
        }
    }
    highest
        .into_iter()
        .enumerate()
        .map(|(i, (rise, face))| {
            let p = middle(i % width, i / width);
            let position = centre + p.x * right + p.y * up + rise * normal + 1e-3 * texel * face;
            ReceiverPoint { position: position.as_vec3(), normal: face.as_vec3(), magnitude }
        })
        .collect()
}
