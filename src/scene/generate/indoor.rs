//! Small man-made objects: a brick wall, louvres, a bookshelf, a desk in a room.

use super::{
    Spec,
    shapes::{Builder, Random},
};
use crate::{Result, scene::Soup};
use glam::{DMat3, DVec3};

const WALL: [f32; 3] = [0.7, 0.68, 0.65];
pub(super) const WOOD: [f32; 3] = [0.45, 0.3, 0.18];

const fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A floor of `width` x `width` around the origin, and a wall at its back (y > 0) that faces the front; metres.
fn stage(b: &mut Builder, width: f64, height: f64) {
    b.object("floor").material("floor", [0.5; 3]);
    b.rectangle(DVec3::ZERO, width * DVec3::X, width * DVec3::Y);
    b.object("wall").material("wall", WALL);
    b.rectangle(at(0.0, 0.5 * width, 0.5 * height), width * DVec3::X, height * DVec3::Z);
}

/// A running bond of whole and half bricks without mortar: each brick covers little, all together are opaque
/// (docs/method.md, Traps: joint features).
pub(super) fn brick_wall(spec: &Spec) -> Result<Soup> {
    const BRICK: DVec3 = at(0.24, 0.115, 0.071);
    let (mut b, courses) = (Builder::new("brick-wall"), spec.count.unwrap_or(12));
    let columns = courses.max(4);
    let (length, height) = (columns as f64 * BRICK.x, courses as f64 * BRICK.z);
    stage(&mut b, 3.0 * length.max(height), 2.0 * height);
    b.material("brick", [0.45, 0.2, 0.14]);
    for row in 0..courses {
        let z = row as f64 * BRICK.z;
        // Odd courses begin and end with half bricks.
        let joints = (0..=columns).map(|k| k as f64).map(|k| if row % 2 == 1 { k - 0.5 } else { k });
        let mut ends: Vec<f64> = joints.map(|k| (k * BRICK.x).clamp(0.0, length)).collect();
        ends.push(length);
        ends.dedup();
        for (k, x) in ends.windows(2).enumerate() {
            b.object(format!("brick {}.{}", row + 1, k + 1));
            let corner = |x: f64, y: f64, z: f64| at(x - 0.5 * length, y, z);
            b.cuboid(corner(x[0], 0.0, z), corner(x[1], BRICK.y, (row + 1) as f64 * BRICK.z));
        }
    }
    let size = spec.light_size.unwrap_or(0.5);
    b.light(at(0.0, -2.0 * length, 1.5 * height), size * DVec3::Z, size * DVec3::X, 200.0);
    Ok(b.soup)
}

/// A blind of tilted slats before an emitter of window size: aligned, strongly directional occluders (docs/method.md,
/// Traps: flat clusters).
pub(super) fn louvres(spec: &Spec) -> Result<Soup> {
    let (mut b, slats) = (Builder::new("louvres"), spec.count.unwrap_or(30));
    stage(&mut b, 4.0, 2.6);
    let (bottom, top) = (0.6, 2.2);
    let pitch = (top - bottom) / slats as f64;
    // Slats are 1.2 pitches wide and tilted by 35 degrees, so that light passes between them.
    let size = at(1.8, 1.2 * pitch, 0.04 * pitch);
    b.object("louvres").material("slat", [0.8; 3]);
    for i in 0..slats {
        let centre = at(0.0, 0.0, bottom + (i as f64 + 0.5) * pitch);
        b.turned_box(centre, size, DMat3::from_rotation_x(35f64.to_radians()));
    }
    let light = spec.light_size.unwrap_or(1.4);
    b.light(at(0.0, -2.0, 1.4), light * DVec3::X, -light * DVec3::Z, 20.0);
    Ok(b.soup)
}

/// Adjoining books on boards: hidden faces, opaque as a whole (docs/method.md, Traps: solids, hidden faces).
pub(super) fn bookshelf(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("bookshelf"), Random::new(spec.seed));
    let boards = spec.count.unwrap_or(5);
    let (width, depth, gap, thick) = (1.0, 0.3, 0.34, 0.02);
    let height = boards as f64 * gap + thick;
    stage(&mut b, 4.0, (1.4 * height).max(2.6));
    let back = 2.0 - 0.05;
    b.object("shelf").material("wood", WOOD);
    let front = back - depth;
    b.cuboid(at(-0.5 * width - thick, front, 0.0), at(-0.5 * width, back, height));
    b.cuboid(at(0.5 * width, front, 0.0), at(0.5 * width + thick, back, height));
    for i in 0..=boards {
        let z = i as f64 * gap;
        b.cuboid(at(-0.5 * width, front, z), at(0.5 * width, back - 0.01, z + thick));
    }
    b.cuboid(at(-0.5 * width, back - 0.01, 0.0), at(0.5 * width, back, height));
    for shelf in 0..boards {
        let (z, mut x, mut n) = (shelf as f64 * gap + thick, -0.5 * width, 0);
        loop {
            let book =
                at(random.between(0.012, 0.05), random.between(0.14, 0.22), random.between(0.18, 0.29));
            if x + book.x > 0.5 * width {
                break;
            }
            n += 1;
            let colour = ["red", "green", "blue", "paper"][(4.0 * random.unit()) as usize];
            let rgb = match colour {
                "red" => [0.5, 0.1, 0.08],
                "green" => [0.1, 0.35, 0.12],
                "blue" => [0.1, 0.15, 0.45],
                _ => [0.75, 0.72, 0.6],
            };
            b.object(format!("book {}.{n}", shelf + 1)).material(colour, rgb);
            let y = back - 0.02 - book.y;
            b.cuboid(at(x, y, z), at(x + book.x, y + book.y, z + book.z));
            x += book.x;
        }
    }
    let size = spec.light_size.unwrap_or(0.6);
    b.light(at(0.0, 0.0, 2.5), size * DVec3::Y, size * DVec3::X, 60.0);
    Ok(b.soup)
}

/// A closed room of 4 x 5 x 2.7 m with a desk and objects on it.
pub(super) fn desk_room(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("desk-room"), Random::new(spec.seed));
    room(&mut b, at(4.0, 5.0, 2.7));
    let top = desk(&mut b, at(0.0, 1.6, 0.0));
    things(&mut b, &mut random, at(0.0, 1.6, top));
    chair(&mut b, at(0.1, 0.75, 0.0));
    let size = spec.light_size.unwrap_or(1.2);
    b.light(at(0.0, 0.3, 2.65), 0.5 * size * DVec3::Y, size * DVec3::X, 60.0);
    Ok(b.soup)
}

/// Floor, ceiling and walls with inward faces, each an object.
pub(super) fn room(b: &mut Builder, size: DVec3) {
    let (h, up) = (0.5 * size, size.z * DVec3::Z);
    let (x, y) = (size.x * DVec3::X, size.y * DVec3::Y);
    let middle = h.z * DVec3::Z;
    let mut face = |name: &str, material: &str, rgb, centre, u, v| {
        b.object(name).material(material, rgb);
        b.rectangle(centre, u, v);
    };
    face("floor", "parquet", [0.35, 0.24, 0.15], DVec3::ZERO, x, y);
    face("ceiling", "plaster", [0.8; 3], up, y, x);
    face("wall back", "wall", WALL, middle + h.y * DVec3::Y, x, up);
    face("wall front", "wall", WALL, middle - h.y * DVec3::Y, up, x);
    face("wall left", "wall", WALL, middle - h.x * DVec3::X, y, up);
    face("wall right", "wall", WALL, middle + h.x * DVec3::X, up, y);
}

/// A table of 1.6 x 0.8 m; returns the height of its top, metres.
pub(super) fn desk(b: &mut Builder, foot: DVec3) -> f64 {
    let (size, thick, leg) = (at(1.6, 0.8, 0.74), 0.03, 0.05);
    b.object("desk").material("wood", WOOD);
    let min = foot - at(0.5 * size.x, 0.5 * size.y, 0.0);
    for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let corner = min + at(0.02 + i * (size.x - leg - 0.04), 0.02 + j * (size.y - leg - 0.04), 0.0);
        b.cuboid(corner, corner + at(leg, leg, size.z - thick));
    }
    b.cuboid(min + at(0.0, 0.0, size.z - thick), min + size);
    foot.z + size.z
}

pub(super) fn things(b: &mut Builder, random: &mut Random, top: DVec3) {
    let dark = [0.08; 3];
    b.object("screen").material("plastic", dark);
    b.cuboid(top + at(-0.1, 0.16, 0.0), top + at(0.1, 0.3, 0.012));
    b.cuboid(top + at(-0.02, 0.22, 0.012), top + at(0.02, 0.24, 0.15));
    b.cuboid(top + at(-0.28, 0.2, 0.12), top + at(0.28, 0.22, 0.46));
    b.object("keyboard").material("plastic", dark);
    b.cuboid(top + at(-0.22, -0.2, 0.004), top + at(0.22, -0.06, 0.015));
    b.material("keys", [0.4; 3]);
    for (row, column) in (0..5).flat_map(|r| (0..15).map(move |c| (f64::from(r), f64::from(c)))) {
        let corner = top + at(-0.21 + 0.028 * column, -0.19 + 0.026 * row, 0.016);
        b.cuboid(corner, corner + at(0.022, 0.02, 0.008));
    }
    b.object("cup").material("china", [0.75; 3]);
    b.cup(top + at(0.42, -0.1, 0.002), 0.04, 0.09, 24);
    b.object("pencils").material("pencil", [0.6, 0.45, 0.1]);
    b.cup(top + at(0.6, 0.2, 0.002), 0.035, 0.1, 16);
    for i in 0..9 {
        let lean = DMat3::from_rotation_z(0.7 * f64::from(i)) * DMat3::from_rotation_x(0.12);
        let spread = at(random.between(-0.012, 0.012), random.between(-0.012, 0.012), 0.0);
        b.turned_box(top + at(0.6, 0.2, 0.1) + spread, at(0.007, 0.007, 0.17), lean);
    }
    b.object("books").material("paper", [0.7, 0.66, 0.55]);
    let mut z = 0.0;
    for _ in 0..5 {
        let size = at(random.between(0.2, 0.26), random.between(0.14, 0.18), random.between(0.015, 0.04));
        let turn = DMat3::from_rotation_z(random.between(-0.25, 0.25));
        b.turned_box(top + at(-0.55, 0.12, z + 0.5 * size.z), size, turn);
        z += size.z;
    }
    b.object("sheets");
    for i in 0..4 {
        let turn = DMat3::from_rotation_z(random.between(-0.4, 0.4));
        let centre = top + at(-0.5 + 0.03 * f64::from(i), -0.18, 0.001 + 0.0005 * f64::from(i));
        b.rectangle(centre, 0.21 * turn.x_axis, 0.297 * turn.y_axis);
    }
}

pub(super) fn chair(b: &mut Builder, foot: DVec3) {
    b.object("chair").material("wood", WOOD);
    for (x, y) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)] {
        b.cuboid(foot + at(x - 0.02, y - 0.02, 0.0), foot + at(x + 0.02, y + 0.02, 0.43));
    }
    b.cuboid(foot + at(-0.23, -0.23, 0.43), foot + at(0.23, 0.23, 0.46));
    for i in 0..5 {
        let x = -0.2 + 0.1 * f64::from(i);
        b.cuboid(foot + at(x - 0.015, -0.22, 0.46), foot + at(x + 0.015, -0.2, 0.85));
    }
    b.cuboid(foot + at(-0.23, -0.23, 0.85), foot + at(0.23, -0.19, 0.93));
}
