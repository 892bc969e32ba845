//! The Cornell box with the original measurements (Cornell Program of Computer Graphics, Cornell Box Data):
//! millimetres, y up, the camera looks along +z.

use super::{Spec, shapes::Builder};
use crate::{Result, scene::Soup};
use glam::DVec3;

/// Reflectances: means of the measured spectra over 600-700, 500-600 and 400-500 nm.
const WHITE: [f32; 3] = [0.734, 0.736, 0.700];
const GREEN: [f32; 3] = [0.133, 0.344, 0.120];
const RED: [f32; 3] = [0.576, 0.091, 0.056];
/// Relative emission over the same bands (0, 8, 15.6, 18.4 at 400, 500, 600, 700 nm), used as W/(m² sr).
const LIGHT: [f32; 3] = [17.0, 11.8, 4.0];

type Quad = [[f64; 3]; 4];

const FLOOR: Quad = [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]];
const EMITTER: Quad =
    [[343.0, 548.8, 227.0], [343.0, 548.8, 332.0], [213.0, 548.8, 332.0], [213.0, 548.8, 227.0]];
const CEILING: Quad = [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]];
const BACK: Quad = [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]];
const RIGHT: Quad = [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]];
const LEFT: Quad = [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]];
/// Base quadrilaterals of the blocks, and their heights.
const SHORT: ([[f64; 2]; 4], f64) = ([[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]], 165.0);
const TALL: ([[f64; 2]; 4], f64) = ([[423.0, 247.0], [265.0, 296.0], [314.0, 456.0], [472.0, 406.0]], 330.0);

pub(super) fn cornell(_: &Spec) -> Result<Soup> {
    let mut b = Builder::new("cornell");
    let middle = DVec3::new(278.0, 274.4, 279.6);
    for (name, quad, material, colour) in [
        ("floor", FLOOR, "white", WHITE),
        ("back wall", BACK, "white", WHITE),
        ("right wall", RIGHT, "green", GREEN),
        ("left wall", LEFT, "red", RED),
    ] {
        b.object(name).material(material, colour);
        facing(&mut b, quad, middle, 1.0);
    }
    // The emitter fills a hole in the ceiling, so that no two surfaces coincide.
    b.object("ceiling").material("white", WHITE);
    for i in 0..4 {
        let j = (i + 1) % 4;
        facing(&mut b, [CEILING[i], CEILING[j], EMITTER[j], EMITTER[i]], middle, 1.0);
    }
    for (name, (foot, height)) in [("short block", SHORT), ("tall block", TALL)] {
        b.object(name);
        block(&mut b, foot, height);
    }
    // Reflectance of the emitter in the published data: 0.78.
    b.emissive(0.78, LIGHT);
    facing(&mut b, EMITTER, middle, 1.0);
    Ok(b.soup)
}

/// A closed block on the floor with outward faces.
fn block(b: &mut Builder, foot: [[f64; 2]; 4], height: f64) {
    let at = |i: usize, y: f64| [foot[i % 4][0], y, foot[i % 4][1]];
    let sum: DVec3 = (0..4).map(|i| DVec3::from_array(at(i, 0.5 * height))).sum();
    let centre = 0.25 * sum;
    for y in [0.0, height] {
        facing(b, std::array::from_fn(|i| at(i, y)), centre, -1.0);
    }
    for i in 0..4 {
        facing(b, [at(i, 0.0), at(i + 1, 0.0), at(i + 1, height), at(i, height)], centre, -1.0);
    }
}

/// Adds a quad wound so that it faces `target` (`sense` 1) or away from it (-1).
fn facing(b: &mut Builder, quad: Quad, target: DVec3, sense: f64) {
    let mut q = quad.map(DVec3::from_array);
    let normal = (q[2] - q[0]).cross(q[3] - q[1]);
    if sense * normal.dot(target - q[0]) < 0.0 {
        q.reverse();
    }
    b.polygon(&q);
}
