//! The cells of a point's grid at the rim of its hemisphere, where what rises a little above the plane of the point, and the ends of what is seen of the
//! sky between walls, are strips thinner than a cell.

/// Part of the rim about a cell, half of it on either side, in which an open and a blocked cell mean that a strip may cross the cell. Of floors, walls and
/// slopes of streets and valleys a quarter leaves twice the noise; the whole rim takes rays from other edges in rooms with small windows.
const ARC: f64 = 0.5;

/// Whether the rays of cells along the rim leave the scene. The rim of the hemisphere is that of the grid.
pub(super) struct Rim {
    /// Columns and rows of the grid.
    size: [usize; 2],
    /// Numbers of blocked and of open cells before each place of a walk three times around the rim.
    before: Vec<[u32; 2]>,
}

impl Rim {
    /// Of a grid of so many columns and rows, from the places of some of its cells and whether they are open.
    pub fn new(size: [usize; 2], cells: impl Iterator<Item = ([u32; 2], bool)>) -> Rim {
        let mut rim = Rim { size, before: Vec::new() };
        let length = rim.length();
        rim.before = vec![[0; 2]; 3 * length + 1];
        for (place, is_open) in cells {
            if let Some(at) = rim.position(place) {
                (0..3).for_each(|turn| rim.before[turn * length + at + 1][usize::from(is_open)] += 1);
            }
        }
        let mut sums = [0; 2];
        for counts in &mut rim.before {
            sums = [sums[0] + counts[0], sums[1] + counts[1]];
            *counts = sums;
        }
        rim
    }

    /// Whether a cell lies at the rim, and open and blocked cells about it, without itself.
    pub fn is_mixed_about(&self, place: [u32; 2], is_open: bool) -> bool {
        let Some(at) = self.position(place) else { return false };
        let half = (0.5 * ARC * self.length() as f64) as usize;
        let (first, end) = (self.length() + at - half, self.length() + at + half + 1);
        let others = |open: bool| {
            let k = usize::from(open);
            self.before[end][k] - self.before[first][k] - u32::from(open == is_open)
        };
        others(false) > 0 && others(true) > 0
    }

    /// Number of cells along the rim.
    fn length(&self) -> usize {
        2 * (self.size[0] + self.size[1]) - 4
    }

    /// Number of the cells before one on a walk around the rim; none if it is inside.
    fn position(&self, place: [u32; 2]) -> Option<usize> {
        let ([right, bottom], [i, j]) = (self.size.map(|n| n - 1), place.map(|at| at as usize));
        match (i, j) {
            (i, 0) => Some(i),
            (i, j) if i == right => Some(right + j),
            (i, j) if j == bottom => Some(right + bottom + (right - i)),
            (0, j) => Some(2 * right + bottom + (bottom - j)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(size: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
        (0..size[1]).flat_map(move |j| (0..size[0]).map(move |i| [i, j]))
    }

    #[test]
    fn each_cell_of_the_rim_has_a_position_of_its_own() {
        let rim = Rim::new([12, 8], std::iter::empty());
        let mut positions: Vec<usize> = all([12, 8]).filter_map(|place| rim.position(place)).collect();
        positions.sort_unstable();
        assert_eq!(positions, (0..36).collect::<Vec<_>>());
    }

    #[test]
    fn a_cell_does_not_count_itself_and_sees_a_quarter_of_the_rim_on_either_side() {
        let open = |at: [u32; 2]| move |place: [u32; 2]| (place, place == at);
        let rim = Rim::new([12, 8], all([12, 8]).map(open([2, 0])));
        let mixed: Vec<[u32; 2]> = all([12, 8]).filter(|&at| rim.is_mixed_about(at, at == [2, 0])).collect();
        assert!(!mixed.contains(&[2, 0]) && mixed.contains(&[11, 0]) && mixed.contains(&[0, 7]));
        assert!(mixed.iter().all(|at| rim.position(*at).is_some()) && mixed.len() == 18);
    }
}
