//! Merging of equal positions.

use super::{parallel, sampling::mix};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// The number of each position, in order of first appearance, and the distinct positions.
///
/// Positions are equal if their bits are (`-0.0` counts as `0.0`); without a tolerance, the result is independent of the scale of the
/// scene. At most 2³² − 1 positions.
pub fn weld(positions: &[Vec3]) -> (Vec<u32>, Vec<Vec3>) {
    let position = |i: u32| positions[i as usize] + Vec3::ZERO;
    let bits = |i: u32| position(i).to_array().map(f32::to_bits);
    // A hash in the upper half of each number and the index in the lower one: numbers sort faster than positions.
    let mut hashed: Vec<u64> =
        parallel::map(0..positions.len() as u32, |i| u64::from(hash(bits(i))) << 32 | u64::from(i));
    hashed.par_sort_unstable();
    let first: Vec<AtomicU32> = positions.iter().map(|_| AtomicU32::new(0)).collect();
    hashed.par_chunk_by(|a, b| a >> 32 == b >> 32).for_each(|run| {
        let assign = |equal: &mut dyn Iterator<Item = u32>, of: u32| {
            equal.for_each(|i| first[i as usize].store(of, Relaxed));
        };
        let lowest = run[0] as u32;
        if run.iter().all(|&entry| bits(entry as u32) == bits(lowest)) {
            return assign(&mut run.iter().map(|&entry| entry as u32), lowest);
        }
        // Different positions with one hash.
        let mut apart: Vec<u32> = run.iter().map(|&entry| entry as u32).collect();
        apart.sort_unstable_by_key(|&i| (bits(i), i));
        for equal in apart.chunk_by(|&a, &b| bits(a) == bits(b)) {
            assign(&mut equal.iter().copied(), equal[0]);
        }
    });
    let mut number: Vec<u32> = first.into_iter().map(AtomicU32::into_inner).collect();
    let mut distinct = Vec::new();
    // `number[i]` is the first index of an equal position, at most i, so that its entry is final already.
    for i in 0..number.len() {
        let first = number[i] as usize;
        if first == i {
            number[i] = distinct.len() as u32;
            distinct.push(position(i as u32));
        } else {
            number[i] = number[first];
        }
    }
    (number, distinct)
}

/// A hash of three numbers.
fn hash([x, y, z]: [u32; 3]) -> u32 {
    (mix(mix(u64::from(x) << 32 | u64::from(y)).wrapping_add(u64::from(z))) >> 32) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn equal_positions_get_one_number_in_order() {
        let p = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, -0.0, 0.0], [2.0, 0.0, 0.0], [-0.0, 0.0, -0.0]];
        let (number, distinct) = weld(&p.map(Vec3::from_array));
        assert_eq!(number, [0, 1, 0, 2, 1]);
        assert_eq!(distinct, [Vec3::X, Vec3::ZERO, 2.0 * Vec3::X]);
        assert_eq!(weld(&[]), (vec![], vec![]));
    }

    /// 1.25 million positions, of which 250,000 differ. Hashes of 32 bits coincide for about seven pairs of them.
    #[test]
    fn many_positions_get_the_numbers_of_a_hash_map() {
        let at = |k: u32| Vec3::new((k % 500) as f32 * 0.37, (k / 500) as f32 * 0.11, (k % 7) as f32);
        let positions: Vec<Vec3> = (0..1_250_000u32).map(|i| at(i.wrapping_mul(7919) % 250_000)).collect();
        let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
        let hashes: std::collections::HashSet<u32> = (0..250_000).map(|k| hash(bits(&at(k)))).collect();
        assert!((249_900..250_000).contains(&hashes.len()), "{}", hashes.len());
        let mut numbers = HashMap::new();
        let mut next = 0;
        let expected: Vec<u32> = positions
            .iter()
            .map(|p| {
                *numbers.entry(bits(p)).or_insert_with(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect();
        let (number, distinct) = weld(&positions);
        assert!(number == expected && distinct.len() == 250_000);
        assert!(number.iter().zip(&positions).all(|(&n, p)| distinct[n as usize] == *p));
    }
}
