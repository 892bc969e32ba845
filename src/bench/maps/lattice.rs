//! Tent interpolation of a map from a part of its texels.

use crate::bench::receivers::ReceiverGrid;
use crate::bench::workload::ReceiverPoint;

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

/// Of each of `n` texels: the node before it, and the part of the way to the next node.
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
