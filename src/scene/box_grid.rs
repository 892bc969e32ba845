//! Search of overlapping boxes in a plane.

use crate::math::sampling::mix;
use glam::DVec2;

/// A cell of a grid: the exponent of two of its size, and its place.
type BoxCell = (i32, i64, i64);

/// Boxes in the plane, each entered into the cells of a grid of its own size: in at most four cells.
pub(super) struct BoxGrid {
    /// Exponent of two of each box's cell size.
    exponents: Vec<i32>,
    /// The exponents in use, ascending.
    levels: Vec<i32>,
    /// First entry of each bucket of a hash table of cells, and the number of entries.
    starts: Vec<u32>,
    /// Cells and boxes by bucket; those of a bucket ascend.
    entries: Vec<(BoxCell, u32)>,
}

impl BoxGrid {
    /// The grid of boxes given by their lower and upper corners.
    pub fn new(boxes: &[[DVec2; 2]]) -> BoxGrid {
        let exponent =
            |b: &[DVec2; 2]| (b[1] - b[0]).max_element().max(f64::MIN_POSITIVE).log2().ceil() as i32;
        let exponents: Vec<i32> = boxes.iter().map(exponent).collect();
        let mut levels = exponents.clone();
        levels.sort_unstable();
        levels.dedup();
        let buckets = boxes.len().next_power_of_two();
        let entered =
            || (0u32..).zip(boxes).flat_map(|(k, b)| cells(b, exponents[k as usize]).map(move |c| (c, k)));
        // Counting sort by bucket: the counts, their sums, then each entry at its place.
        let mut starts = vec![0u32; buckets + 1];
        entered().for_each(|(cell, _)| starts[bucket(cell, buckets) + 1] += 1);
        (0..buckets).for_each(|i| starts[i + 1] += starts[i]);
        let (mut next, mut entries) = (starts.clone(), vec![((0, 0, 0), 0); starts[buckets] as usize]);
        entered().for_each(|(cell, k)| {
            let place = &mut next[bucket(cell, buckets)];
            entries[*place as usize] = (cell, k);
            *place += 1;
        });
        starts.windows(2).for_each(|of| entries[of[0] as usize..of[1] as usize].sort_unstable());
        BoxGrid { exponents, levels, starts, entries }
    }

    /// Boxes in the cells of box `k`, each pair once: those of larger cells, and of equal cells the boxes after `k`. A box that shares
    /// several cells with `k` comes several times.
    pub fn near<'a>(&'a self, k: usize, b: &'a [DVec2; 2]) -> impl Iterator<Item = usize> + 'a {
        let own = self.exponents[k];
        let levels = &self.levels[self.levels.partition_point(|&level| level < own)..];
        levels.iter().flat_map(move |&level| {
            let after = if level > own { 0 } else { k + 1 };
            cells(b, level).flat_map(move |cell| self.of(cell, after))
        })
    }

    /// The boxes of a cell from number `first` on, ascending.
    fn of(&self, cell: BoxCell, first: usize) -> impl Iterator<Item = usize> + '_ {
        let i = bucket(cell, self.starts.len() - 1);
        let held = &self.entries[self.starts[i] as usize..self.starts[i + 1] as usize];
        let rest = &held[held.partition_point(|&(of, k)| (of, k as usize) < (cell, first))..];
        rest.iter().take_while(move |(of, _)| *of == cell).map(|&(_, k)| k as usize)
    }
}

/// Cells of size 2^`level` that a box touches.
fn cells(b: &[DVec2; 2], level: i32) -> impl Iterator<Item = BoxCell> + use<> {
    let size = f64::from(level).exp2();
    let [low, high] = b.map(|p| (p / size).floor().as_i64vec2());
    (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| (level, x, y)))
}

/// Bucket of a cell among a power of two of buckets.
fn bucket((level, x, y): BoxCell, buckets: usize) -> usize {
    let mixed = [i64::from(level), x, y].iter().fold(0, |h, &v| mix(h ^ v as u64));
    mixed as usize & (buckets - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sampling::numbers;
    use std::collections::BTreeSet;

    /// All pairs of overlapping boxes are found, whatever their sizes, and each once in either order.
    #[test]
    fn overlapping_boxes_are_near() {
        let boxes: Vec<[DVec2; 2]> = (0..400)
            .map(|k| {
                let [x, y, w, h] = numbers(3, k).map(f64::from);
                let low = DVec2::new(20.0 * x - 10.0, 20.0 * y - 10.0);
                [low, low + DVec2::new(w, h) * f64::from(k as i32 % 9 - 5).exp2()]
            })
            .collect();
        let grid = BoxGrid::new(&boxes);
        let near = |k: usize| grid.near(k, &boxes[k]).map(move |m| (k, m)).collect::<BTreeSet<_>>();
        let pairs: BTreeSet<(usize, usize)> = (0..boxes.len()).flat_map(near).collect();
        let overlap =
            |k: usize, m: usize| boxes[k][0].cmplt(boxes[m][1]).all() && boxes[m][0].cmplt(boxes[k][1]).all();
        let all = (0..boxes.len()).flat_map(|m| (0..m).map(move |k| (k, m)));
        let overlapping: Vec<_> = all.filter(|&(k, m)| overlap(k, m)).collect();
        assert!(overlapping.len() > 300, "{}", overlapping.len());
        assert!(overlapping.iter().all(|&(k, m)| pairs.contains(&(k, m)) != pairs.contains(&(m, k))));
        assert!(pairs.len() < 50 * overlapping.len(), "{} {}", pairs.len(), overlapping.len());
    }
}
