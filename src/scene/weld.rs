//! Merging of vertices with equal positions, and detection of duplicate polygons.

use glam::Vec3;

/// The number of each vertex's position, in order of first appearance, and the distinct positions.
///
/// Positions are equal if their bits are (`-0.0` counts as `0.0`); without a tolerance, the result is independent of
/// the scale of the scene.
pub(super) fn weld(positions: impl Iterator<Item = Vec3>) -> (Vec<u32>, Vec<Vec3>) {
    // Adding zero converts −0 to +0.
    let mut keyed: Vec<([u32; 3], u32)> = positions
        .enumerate()
        .map(|(i, p)| ((p + Vec3::ZERO).to_array().map(f32::to_bits), i as u32))
        .collect();
    keyed.sort_unstable();
    let mut first = vec![0; keyed.len()];
    for run in keyed.chunk_by(|a, b| a.0 == b.0) {
        run.iter().for_each(|&(_, i)| first[i as usize] = run[0].1);
    }
    let mut position = vec![Vec3::ZERO; keyed.len()];
    for (bits, i) in keyed {
        position[i as usize] = Vec3::from_array(bits.map(f32::from_bits));
    }
    // `first[i] <= i`, so that entry has its final number already.
    let (mut number, mut distinct) = (first, Vec::new());
    for i in 0..number.len() {
        let f = number[i] as usize;
        if f == i {
            number[i] = distinct.len() as u32;
            distinct.push(position[i]);
        } else {
            number[i] = number[f];
        }
    }
    (number, distinct)
}

/// Groups of polygons with equal sets of corners, each ascending; single polygons are omitted.
pub(super) fn same_corners(polygons: &[&[u32]]) -> Vec<Vec<u32>> {
    let mut keyed: Vec<(u64, u32)> = polygons.iter().zip(0..).map(|(p, i)| (fingerprint(p), i)).collect();
    keyed.sort_unstable();
    let mut groups = Vec::new();
    for run in keyed.chunk_by(|a, b| a.0 == b.0).filter(|run| run.len() > 1) {
        // Equal hashes are confirmed by comparison.
        let mut exact: Vec<(Vec<u32>, u32)> =
            run.iter().map(|&(_, i)| (sorted(polygons[i as usize]), i)).collect();
        exact.sort_unstable();
        let equal = exact.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() > 1);
        groups.extend(equal.map(|g| g.iter().map(|&(_, i)| i).collect::<Vec<_>>()));
    }
    groups
}

fn sorted(p: &[u32]) -> Vec<u32> {
    let mut p = p.to_vec();
    p.sort_unstable();
    p
}

/// A hash that does not depend on the order of the corners.
fn fingerprint(p: &[u32]) -> u64 {
    // Finaliser of splitmix64 (Steele, Lea and Flood 2014).
    let mix = |v: u32| {
        let z = u64::from(v).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    p.iter().fold(p.len() as u64, |sum, &v| sum.wrapping_add(mix(v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_positions_get_one_number_in_order() {
        let p = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, -0.0, 0.0], [2.0, 0.0, 0.0], [-0.0, 0.0, -0.0]];
        let (number, distinct) = weld(p.into_iter().map(Vec3::from_array));
        assert_eq!(number, [0, 1, 0, 2, 1]);
        assert_eq!(distinct, [Vec3::X, Vec3::ZERO, 2.0 * Vec3::X]);
    }

    #[test]
    fn same_corners_in_any_order() {
        let polygons: [&[u32]; 5] = [&[1, 2, 3], &[3, 4, 5], &[3, 1, 2], &[1, 2, 4], &[2, 1, 3]];
        assert_eq!(same_corners(&polygons), [[0, 2, 4]]);
    }
}
