//! Division of a map into cells between whose corners light is interpolated.

use crate::bench::receivers::ReceiverGrid;
use crate::bench::workload::ReceiverPoint;
use std::collections::BTreeMap;
use std::ops::Range;

/// Most sets of segments of a node: of a far field's targets each is used once.
const MAX_SETS: usize = 16;

/// A rectangle between texels: columns and rows of its first and last texels. Neighbours share corners.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MapCell {
    low: [usize; 2],
    high: [usize; 2],
}

/// A texel at which light is computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct MapNode {
    /// Column and row.
    pub at: [usize; 2],
    /// Side of the largest cell that it is a corner of, texels.
    side: usize,
}

/// The cells and nodes of a map.
pub(super) struct Quadtree {
    size: [usize; 2],
    /// Cells whose texels are interpolated, with the indices of the nodes at their corners.
    smooth: Vec<(MapCell, [u32; 4])>,
    nodes: Vec<MapNode>,
    /// Number of the nodes at corners of smooth cells, which come first.
    probes: usize,
}

impl MapNode {
    /// Sets of segments: as many as the node is texels apart from others, because the noise of a probe is that of the whole cell.
    /// Neighbours begin with different ones.
    pub fn sets(self) -> Range<usize> {
        let [x, y] = self.at.map(|place| place / self.side % 4);
        let first = x + 4 * y;
        first..first + self.side.min(MAX_SETS)
    }
}

impl MapCell {
    /// Corners as columns and rows.
    fn corners(&self) -> [[usize; 2]; 4] {
        let MapCell { low: [x0, y0], high: [x1, y1] } = *self;
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]]
    }

    /// Whether every texel of it is a corner.
    fn is_smallest(&self) -> bool {
        (0..2).all(|axis| self.high[axis] - self.low[axis] <= 1)
    }

    /// The parts that it is divided into: halves of both sides that are longer than a step.
    fn add_parts(&self, parts: &mut Vec<MapCell>) {
        let halves = |axis: usize| {
            let (a, b) = (self.low[axis], self.high[axis]);
            let middle = if b - a > 1 { (a + b) / 2 } else { b };
            [[a, middle], [middle, b]].into_iter().take(if b - a > 1 { 2 } else { 1 })
        };
        for [y0, y1] in halves(1) {
            parts.extend(halves(0).map(|[x0, x1]| MapCell { low: [x0, y0], high: [x1, y1] }));
        }
    }
}

impl Quadtree {
    /// Divides a map of this size. The largest cells have sides of `spacing`, a power of two. `clear` tells of texels, as columns and rows,
    /// whether light is smooth around them for cells with this side; cells with another corner are divided.
    pub fn new(
        size: [usize; 2],
        spacing: usize,
        mut clear: impl FnMut(&[[usize; 2]], usize) -> Vec<bool>,
    ) -> Quadtree {
        let mut tree = Quadtree { size, smooth: Vec::new(), nodes: Vec::new(), probes: 0 };
        let mut numbers = vec![u32::MAX; size[0] * size[1]];
        let (mut cells, mut side, mut rest) = (whole(size, spacing), spacing, Vec::new());
        while !cells.is_empty() {
            let mut asked: BTreeMap<[usize; 2], bool> = BTreeMap::new();
            cells.iter().flat_map(MapCell::corners).for_each(|corner| _ = asked.insert(corner, false));
            let texels: Vec<[usize; 2]> = asked.keys().copied().collect();
            asked.values_mut().zip(clear(&texels, side)).for_each(|(value, found)| *value = found);
            let mut parts = Vec::new();
            for cell in cells {
                if cell.corners().iter().all(|corner| asked[corner]) {
                    let corners = cell.corners().map(|corner| tree.node(&mut numbers, corner, side));
                    tree.smooth.push((cell, corners));
                } else if cell.is_smallest() {
                    rest.push(cell);
                } else {
                    cell.add_parts(&mut parts);
                }
            }
            (cells, side) = (parts, (side / 2).max(1));
        }
        tree.probes = tree.nodes.len();
        for corner in rest.iter().flat_map(MapCell::corners) {
            tree.node(&mut numbers, corner, 1);
        }
        tree
    }

    /// The number of the node at a texel, which is added if there is none.
    fn node(&mut self, numbers: &mut [u32], at: [usize; 2], side: usize) -> u32 {
        let number = &mut numbers[at[1] * self.size[0] + at[0]];
        if *number == u32::MAX {
            *number = self.nodes.len() as u32;
            self.nodes.push(MapNode { at, side });
        }
        *number
    }

    pub fn nodes(&self) -> &[MapNode] {
        &self.nodes
    }

    /// Nodes at corners of smooth cells.
    pub fn probes(&self) -> &[MapNode] {
        &self.nodes[..self.probes]
    }

    /// All other nodes.
    pub fn others(&self) -> &[MapNode] {
        &self.nodes[self.probes..]
    }

    /// Values of all texels, row by row, from those of the nodes: linear along both sides of smooth cells.
    pub fn texels(&self, values: &[f32]) -> Vec<f32> {
        let [width, height] = self.size;
        let mut texels = vec![0.0; width * height];
        for (cell, corners) in &self.smooth {
            let [a, b, c, d] = corners.map(|node| values[node as usize]);
            let [columns, rows] = [0, 1].map(|axis| cell.high[axis] - cell.low[axis]);
            let part = |n: usize| 1.0 / n.max(1) as f32;
            for row in 0..=rows {
                let v = row as f32 * part(rows);
                let (left, right) = (a + v * (c - a), b + v * (d - b));
                let slope = (right - left) * part(columns);
                let line = &mut texels[(cell.low[1] + row) * width + cell.low[0]..][..=columns];
                for (column, texel) in line.iter_mut().enumerate() {
                    *texel = left + column as f32 * slope;
                }
            }
        }
        // Where a cell meets smaller ones, the values of the nodes count.
        for (MapNode { at: [x, y], .. }, &value) in self.nodes.iter().zip(values) {
            texels[y * width + x] = value;
        }
        texels
    }
}

/// Cells of a whole map, at most `spacing` wide.
fn whole([width, height]: [usize; 2], spacing: usize) -> Vec<MapCell> {
    let sides = |n: usize| -> Vec<[usize; 2]> {
        let last = n - 1;
        (0..last.max(1)).step_by(spacing).map(|a| [a, (a + spacing).min(last)]).collect()
    };
    let across = sides(width);
    let row =
        |[y0, y1]: [usize; 2]| across.iter().map(move |&[x0, x1]| MapCell { low: [x0, y0], high: [x1, y1] });
    sides(height).into_iter().flat_map(row).collect()
}

/// Texels of a map at which the light is computed: every `spacing`-th column and row, and the last of both.
pub(super) struct Lattice {
    columns: Vec<usize>,
    rows: Vec<usize>,
    size: [usize; 2],
}

impl Lattice {
    pub fn new(grid: &ReceiverGrid, spacing: usize) -> Lattice {
        let nodes = |n: usize| {
            let mut nodes: Vec<usize> = (0..n).step_by(spacing).collect();
            if !(n - 1).is_multiple_of(spacing) {
                nodes.push(n - 1);
            }
            nodes
        };
        Lattice { columns: nodes(grid.width), rows: nodes(grid.height), size: [grid.width, grid.height] }
    }

    /// The texels of the lattice, row by row.
    pub fn points(&self, grid: &ReceiverGrid) -> Vec<ReceiverPoint> {
        let row = |&y: &usize| self.columns.iter().map(move |&x| grid.points[y * grid.width + x]);
        self.rows.iter().flat_map(row).collect()
    }

    /// Values of all texels: between the texels of the lattice, linear in both directions.
    pub fn fill(&self, values: &[f32]) -> Vec<f32> {
        let [width, height] = self.size;
        if values.len() == width * height {
            return values.to_vec();
        }
        let (across, down) = (places(&self.columns, width), places(&self.rows, height));
        let mut texels = Vec::with_capacity(width * height);
        for &(row, v) in &down {
            let upper = &values[row * self.columns.len()..][..self.columns.len()];
            let lower = &values[(row + 1).min(self.rows.len() - 1) * self.columns.len()..];
            for &(column, u) in &across {
                let next = (column + 1).min(self.columns.len() - 1);
                let mix = |line: &[f32]| line[column] + u * (line[next] - line[column]);
                let (above, below) = (mix(upper), mix(lower));
                texels.push(above + v * (below - above));
            }
        }
        texels
    }
}

/// Of each of `n` texels: the node before it, and the fraction of the way to the next node.
fn places(nodes: &[usize], n: usize) -> Vec<(usize, f32)> {
    let place = |at: usize| {
        let before = nodes.partition_point(|&node| node <= at) - 1;
        let part = match nodes.get(before + 1) {
            Some(&next) => (at - nodes[before]) as f32 / (next - nodes[before]) as f32,
            None => 0.0,
        };
        (before, part)
    };
    (0..n).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn values(tree: &Quadtree, light: impl Fn([usize; 2]) -> f32) -> Vec<f32> {
        tree.nodes.iter().map(|node| light(node.at)).collect()
    }

    const SIZES: [[usize; 2]; 6] = [[1, 1], [1, 7], [2, 2], [33, 17], [50, 31], [64, 9]];

    /// Linear light is exact at every texel, whatever is divided: every texel is interpolated or a node.
    #[test]
    fn linear_light_is_exact_however_a_map_is_divided() {
        let light = |[x, y]: [usize; 2]| 0.1 + 0.02 * x as f32 - 0.01 * y as f32;
        for size in SIZES {
            for period in [1, 2, 3, 7] {
                let clear = |texels: &[[usize; 2]], side: usize| {
                    texels.iter().map(|[x, y]| (x * 31 + y * 17 + side).is_multiple_of(period)).collect()
                };
                let tree = Quadtree::new(size, 8, clear);
                for (k, value) in tree.texels(&values(&tree, light)).into_iter().enumerate() {
                    let exact = light([k % size[0], k / size[0]]);
                    assert!((value - exact).abs() < 1e-5, "{size:?} {period} {k}: {value} {exact}");
                }
            }
        }
    }

    /// Where nothing is smooth every texel is a node, so that any light is exact; where all is, nodes are a spacing apart.
    #[test]
    fn nodes_are_as_dense_as_light_is_rough() {
        let rough = |[x, y]: [usize; 2]| ((x * 7 + y * 13) % 5) as f32;
        for size in SIZES {
            let all = Quadtree::new(size, 8, |texels, _| vec![false; texels.len()]);
            assert_eq!((all.probes().len(), all.others().len()), (0, size[0] * size[1]));
            for (k, value) in all.texels(&values(&all, rough)).into_iter().enumerate() {
                assert_eq!(value, rough([k % size[0], k / size[0]]));
            }
            let smooth = Quadtree::new(size, 8, |texels, _| vec![true; texels.len()]);
            let count = |n: usize| if n == 1 { 1 } else { (n - 1).div_ceil(8) + 1 };
            assert_eq!((smooth.probes().len(), smooth.others().len()), (count(size[0]) * count(size[1]), 0));
        }
    }

    /// The edge of a shadow along a column costs nodes beside it only, and no texel of it is wrong.
    #[test]
    fn an_edge_is_resolved_where_it_is() {
        let light = |[x, _]: [usize; 2]| if x < 21 { 1.0 } else { 0.0 };
        let clear = |texels: &[[usize; 2]], side: usize| {
            texels.iter().map(|[x, _]| (*x as f32 - 20.5).abs() > 1.5 * side as f32).collect()
        };
        let tree = Quadtree::new([65, 65], 16, clear);
        for (k, value) in tree.texels(&values(&tree, light)).into_iter().enumerate() {
            assert_eq!(value, light([k % 65, k / 65]), "{k}");
        }
        assert!(tree.nodes().len() < 65 * 65 / 5, "{}", tree.nodes().len());
    }

    /// Linear light is exact at every texel, whatever the spacing; nodes keep their values.
    #[test]
    fn linear_light_is_interpolated_exactly() {
        let light = |x: f32, y: f32| 0.1 + 0.02 * x - 0.01 * y;
        for (width, height) in [(13, 9), (16, 16), (1, 5), (256, 1)] {
            let point = |k: usize| ReceiverPoint {
                position: Vec3::new((k % width) as f32, (k / width) as f32, 0.0),
                normal: Vec3::Z,
                magnitude: 1.0,
            };
            let grid = ReceiverGrid {
                name: String::new(),
                width,
                height,
                texel: 1.0,
                surface: [width as f64, height as f64],
                lit: true,
                points: (0..width * height).map(point).collect(),
            };
            for spacing in [1, 2, 4, 8] {
                let lattice = Lattice::new(&grid, spacing);
                let nodes = lattice.points(&grid);
                assert!(nodes.len() <= (width / spacing + 2) * (height / spacing + 2));
                let values: Vec<f32> = nodes.iter().map(|p| light(p.position.x, p.position.y)).collect();
                let texels = lattice.fill(&values);
                assert_eq!(texels.len(), width * height);
                for (k, value) in texels.into_iter().enumerate() {
                    let exact = light((k % width) as f32, (k / width) as f32);
                    assert!((value - exact).abs() < 1e-5, "{width} {height} {spacing} {k}: {value} {exact}");
                }
            }
        }
    }
}
