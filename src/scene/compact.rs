//! Removal of vertices, objects and parts without faces.

use super::{Object, Repairs, connect::Parts};
use glam::Vec3;

/// Removes the vertices of a scene without triangles, and counts those of the file.
pub(super) fn compact(
    number: &[u32],
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
    repairs: &mut Repairs,
) {
    let mut is_used = vec![false; positions.len()];
    triangles.iter().flatten().for_each(|&v| is_used[v as usize] = true);
    let referenced = number.iter().filter(|&&v| is_used[v as usize]).count();
    // Vertices beyond those of the file were made when faces were divided.
    let of_file = number.iter().max().map_or(0, |&v| v as usize + 1);
    let distinct = is_used[..of_file].iter().filter(|used| **used).count();
    repairs.unused_vertices += number.len() - referenced;
    repairs.welded_vertices += referenced - distinct;
    drop_unused(positions, triangles, 0);
}

/// Removes vertices from number `first` on that none of these triangles has; keeps the order. The triangles have no others.
pub(super) fn drop_unused(positions: &mut Vec<Vec3>, triangles: &mut [[u32; 3]], first: usize) {
    let mut place = vec![u32::MAX; positions.len() - first];
    triangles.iter().flatten().for_each(|&v| place[v as usize - first] = 0);
    let mut next = first;
    for (k, place) in place.iter_mut().enumerate().filter(|(_, place)| **place == 0) {
        *place = next as u32;
        positions[next] = positions[first + k];
        next += 1;
    }
    positions.truncate(next);
    triangles.iter_mut().flatten().for_each(|v| *v = place[*v as usize - first]);
}

/// Objects with faces, and the index of each face's object among them.
pub(super) fn used_objects(names: Vec<String>, mut object: Vec<u32>) -> (Vec<Object>, Vec<u32>) {
    let mut used = vec![false; names.len()];
    object.iter().for_each(|&o| used[o as usize] = true);
    let mut place = vec![0; names.len()];
    let mut objects = Vec::new();
    for (i, name) in names.into_iter().enumerate().filter(|(i, _)| used[*i]) {
        place[i] = objects.len() as u32;
        objects.push(Object { name });
    }
    object.iter_mut().for_each(|o| *o = place[*o as usize]);
    (objects, object)
}

/// Parts renumbered without those that lost all faces (without area).
pub(super) fn used_parts(parts: &Parts, polygon: &[u32]) -> (Vec<u32>, Vec<bool>) {
    let mut place = vec![u32::MAX; parts.closed.len()];
    let mut closed = Vec::new();
    let component = polygon.iter().map(|&p| {
        let part = parts.part[p as usize] as usize;
        if place[part] == u32::MAX {
            place[part] = closed.len() as u32;
            closed.push(parts.closed[part]);
        }
        place[part]
    });
    (component.collect(), closed)
}
