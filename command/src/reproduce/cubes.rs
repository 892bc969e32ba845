//! Four groups of cubes before a wall, with a small light: the scene of Figures 1, 4 and 9 and of Table 1.

use super::blocks::{Blocks, apart_along_y};
use super::shadow::Wall;
use glam::{DVec3, Vec2};
use mrvis::internals::raster::{BitImage, fill_triangle};
use mrvis::{Result, Scene};

/// Texels along an image of the shadow of a group.
pub const COLUMNS: usize = 176;
/// Side of a texel, metres: the shadow of the largest cubes, 0.375 m, is 30 texels wide, as in the paper.
pub const TEXEL: f64 = 0.0125;
/// Edges of the cubes of the groups, from left to right, metres.
pub const EDGES: [f64; 4] = [0.1, 0.15, 0.2, 0.3];
/// Fraction of each image that is hidden from the centre of the light. The paper gives none; the work that Figure 9 saves depends on it,
/// and the item gives the numbers for other fractions.
pub const COVERAGE: f64 = 0.4;
/// Side of the light, metres.
pub const LIGHT: f64 = 0.1;
/// Distance of the light from the wall, metres.
pub const LIGHT_DISTANCE: f64 = 8.0;
/// Distance of the centres of the groups from the wall, metres.
const GROUP_DISTANCE: f64 = 1.6;
/// Distance between the centres of two groups, metres.
const PITCH: f64 = 2.6;
/// Side of the box of a group, metres.
const SIDE: f64 = 2.0;
/// Height of the light and of the centres of the groups, metres.
const HEIGHT: f64 = 2.0;

/// The scene with groups that hide this fraction of their images from the centre of the light.
pub fn covering_scene(coverage: f64) -> Result<Scene> {
    let mut blocks = Blocks::new("four groups of cubes");
    blocks.rectangle(DVec3::new(0.0, 0.0, HEIGHT), 12.0 * DVec3::Z, 14.0 * DVec3::X, false);
    for (group, edge) in EDGES.into_iter().enumerate() {
        blocks.halved_cubes(&cubes(group, coverage), edge);
    }
    blocks.rectangle(light(), LIGHT * DVec3::X, LIGHT * DVec3::Z, true);
    blocks.scene()
}

/// The centre of the light.
pub fn light() -> DVec3 {
    DVec3::new(0.0, LIGHT_DISTANCE, HEIGHT)
}

/// Fraction of an image by which its coverage may differ from the one asked for: half of the shadow of a cube at the centre of its group.
pub fn coverage_tolerance(edge: f64) -> f64 {
    let shadow = edge * LIGHT_DISTANCE / (LIGHT_DISTANCE - GROUP_DISTANCE);
    0.5 * (shadow / (COLUMNS as f64 * TEXEL)).powi(2)
}

/// Centres of the cubes of a group, added one by one until the fraction of the image that they hide is nearest to `coverage`.
fn cubes(group: usize, coverage: f64) -> Vec<DVec3> {
    let (edge, centre) = (EDGES[group], DVec3::new((group as f64 - 1.5) * PITCH, GROUP_DISTANCE, HEIGHT));
    let all = (SIDE / edge).powi(2) as usize;
    let mut cubes = apart_along_y(all, edge, centre, SIDE);
    let mut hidden = BitImage::new(COLUMNS, COLUMNS);
    let (mut best, mut smallest) = (0, coverage);
    for (k, &at) in cubes.iter().enumerate() {
        hide(&mut hidden, group, at, edge);
        let difference = (hidden.count() as f64 / (COLUMNS * COLUMNS) as f64 - coverage).abs();
        if difference < smallest {
            (best, smallest) = (k + 1, difference);
        }
    }
    cubes.truncate(best);
    cubes
}

/// Adds the texels of the image of a group that a cube hides from the centre of the light.
fn hide(hidden: &mut BitImage, group: usize, cube: DVec3, edge: f64) {
    let wall = wall(group, COLUMNS, TEXEL);
    let corner = |k: usize| {
        let side = |bit: usize| (k >> bit & 1) as f64 - 0.5;
        let at = cube + edge * DVec3::new(side(0), side(1), side(2));
        let shadow = light() + (at - light()) * LIGHT_DISTANCE / (LIGHT_DISTANCE - at.y) - wall.centre;
        let texels = |length: f64| (length / TEXEL + 0.5 * COLUMNS as f64) as f32;
        Vec2::new(texels(shadow.dot(wall.right)), texels(-shadow.dot(wall.up)))
    };
    for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        let [a, b, c, d] = face.map(corner);
        fill_triangle(hidden, [a, b, c]);
        fill_triangle(hidden, [a, c, d]);
    }
}

/// Smallest width of the shadows of single cubes, penumbra included, metres: b + (b + e) d2/d1 of the face towards the wall and of that
/// towards the light (docs/method.md, Umbra criterion).
pub fn shadow_widths(edge: f64) -> [f64; 2] {
    [-0.5, 0.5].map(|side| {
        let d2 = GROUP_DISTANCE + side * edge;
        edge + (edge + LIGHT) * d2 / (LIGHT_DISTANCE - d2)
    })
}

/// Where the shadow of a group lies on the back wall.
pub fn wall(group: usize, columns: usize, texel: f64) -> Wall {
    let across = (group as f64 - 1.5) * PITCH * LIGHT_DISTANCE / (LIGHT_DISTANCE - GROUP_DISTANCE);
    // The wall is seen from the light, which has +x on its left.
    let centre = DVec3::new(across, 0.0, HEIGHT);
    Wall { centre, right: -DVec3::X, up: DVec3::Z, columns, rows: columns, texel }
}
