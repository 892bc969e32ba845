//! An office, of the kind and size of the scene in figures 7 and 8 of Sillion and Drettakis 1995, which is lost: 5,380
//! polygons.

use super::Spec;
use super::indoor::{WOOD, chair, desk, room, things};
use super::shapes::{Builder, Random};
use crate::{Result, scene::Soup};
use glam::DVec3;

/// Feet of the desks, metres: x, y.
pub const DESKS: [[f64; 2]; 7] =
    [[-3.0, 1.6], [-1.0, 1.6], [1.0, 1.6], [3.0, 1.6], [-3.0, -1.4], [-1.0, -1.4], [1.0, -1.4]];
/// Size of the room, metres.
pub const ROOM: DVec3 = DVec3::new(8.4, 6.0, 2.7);
/// Books in the shelf: as many as make 5,380 polygons.
const BOOKS: usize = 70;

/// Seven desks with chairs and small things, a bookshelf, and six panels in the ceiling of a closed room.
pub(super) fn office(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("office"), Random::new(spec.seed));
    room(&mut b, ROOM);
    for (k, [x, y]) in DESKS.into_iter().enumerate() {
        b.number(k + 1);
        let foot = DVec3::new(x, y, 0.0);
        let top = desk(&mut b, foot);
        things(&mut b, &mut random, foot.with_z(top));
        chair(&mut b, foot + DVec3::new(0.1, -0.85, 0.0));
    }
    b.number(0);
    shelf(&mut b, &mut random, DVec3::new(3.17, -1.6, 0.0));
    let size = spec.light_size.unwrap_or(1.2);
    for k in 0..6 {
        let centre = DVec3::new(2.6 * f64::from(k % 3) - 2.6, 3.0 * f64::from(k / 3) - 1.5, ROOM.z - 0.05);
        if k == 0 {
            b.emissive(0.0, [60.0; 3]);
        } else {
            b.object(format!("light {}", k + 1));
        }
        b.rectangle(centre, 0.25 * size * DVec3::Y, size * DVec3::X);
    }
    Ok(b.soup)
}

/// A shelf of 1 x 0.3 x 1.8 m with books.
fn shelf(b: &mut Builder, random: &mut Random, foot: DVec3) {
    let (width, depth, height, thick, boards) = (1.0, 0.3, 1.8, 0.02, 5);
    b.object("shelf").material("wood", WOOD);
    let mut part = |min: [f64; 3], max: [f64; 3]| {
        b.cuboid(foot + DVec3::from_array(min), foot + DVec3::from_array(max));
    };
    part([-thick, 0.0, 0.0], [0.0, depth, height]);
    part([width, 0.0, 0.0], [width + thick, depth, height]);
    part([0.0, depth - thick, 0.0], [width, depth, height]);
    let gap = (height - thick) / f64::from(boards - 1);
    for k in 0..boards {
        part([0.0, 0.0, gap * f64::from(k)], [width, depth - thick, gap * f64::from(k) + thick]);
    }
    b.object("shelf books").material("paper", [0.7, 0.66, 0.55]);
    let shelves = boards as usize - 1;
    for k in 0..BOOKS {
        // Books of a board share its width.
        let (row, place) = (k % shelves, (k / shelves) as f64);
        let pitch = width / BOOKS.div_ceil(shelves) as f64;
        let low = DVec3::new(place * pitch, 0.1, gap * row as f64 + thick);
        let size = DVec3::new(random.between(0.6, 0.98) * pitch, 0.17, random.between(0.22, 0.32));
        b.cuboid(foot + low, foot + low + size);
    }
}
