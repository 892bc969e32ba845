//! Detection of duplicate polygons.

use crate::math::sampling::mix;
use rayon::prelude::*;

/// Groups of polygons with equal sets of corners, each ascending; single polygons are omitted.
pub(super) fn same_corners(polygons: &[&[u32]]) -> Vec<Vec<u32>> {
    let mut keyed: Vec<(u64, u32)> = polygons.iter().zip(0..).map(|(p, i)| (fingerprint(p), i)).collect();
    keyed.par_sort_unstable();
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
    p.iter().fold(p.len() as u64, |sum, &v| sum.wrapping_add(mix(v.into())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_corners_in_any_order() {
        let polygons: [&[u32]; 5] = [&[1, 2, 3], &[3, 4, 5], &[3, 1, 2], &[1, 2, 4], &[2, 1, 3]];
        assert_eq!(same_corners(&polygons), [[0, 2, 4]]);
    }
}
