use super::*;
use std::collections::HashMap;

/// Error of a node that grows with its size and with how near it is to a place off the middle.
fn near_a_place(node: &Node) -> f64 {
    let middle = node.first.map(|v| f64::from(v) + 0.5 * f64::from(node.size));
    f64::from(node.size) / (1.0 + (middle[0] - 21.0).hypot(middle[1] - 40.0))
}

fn grids() -> Vec<Grid> {
    [(65, 65), (50, 71), (100, 30), (3, 2), (2, 2), (34, 67)]
        .map(|(columns, rows)| {
            let rough = fractal(columns.max(8), rows.max(8), 1.0, 20.0, 0.6, 4).expect("a grid");
            let heights = (0..columns * rows).map(|i| rough.height(i % columns, i / columns)).collect();
            Grid::new(columns, rows, [1.0; 2], heights).expect("a grid")
        })
        .into()
}

#[test]
fn leaves_cover_the_grid_once() {
    for grid in grids() {
        let tree = Quadtree::refine(&grid, near_a_place, 0.3);
        let mut covered = vec![0; (grid.columns() - 1) * (grid.rows() - 1)];
        for leaf in tree.leaves() {
            let [columns, rows] = tree.samples(leaf);
            for r in rows[0]..rows[1] {
                (columns[0]..columns[1]).for_each(|c| covered[r * (grid.columns() - 1) + c] += 1);
            }
        }
        assert!(covered.iter().all(|n| *n == 1));
    }
}

#[test]
fn meshes_have_no_cracks() {
    for grid in grids() {
        for max_error in [0.1, 0.3, 1.0, 1e9] {
            let tree = Quadtree::refine(&grid, near_a_place, max_error);
            let mesh = tree.mesh();
            let mut edges: HashMap<[u32; 2], usize> = HashMap::new();
            let mut area = 0.0;
            for triangle in &mesh.triangles {
                for k in 0..3 {
                    *edges.entry([triangle[k], triangle[(k + 1) % 3]]).or_default() += 1;
                }
                let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize].map(f64::from));
                // Rows run to the south.
                let twice = (b[0] - a[0]) * (a[1] - c[1]) - (c[0] - a[0]) * (a[1] - b[1]);
                assert!(twice > 0.0, "a triangle is turned over or has no area");
                area += 0.5 * twice;
            }
            let border = |v: u32| {
                let [c, r] = mesh.vertices[v as usize].map(|v| v as usize);
                [c == 0, r == 0, c + 1 == grid.columns(), r + 1 == grid.rows()]
            };
            for ([a, b], count) in &edges {
                assert_eq!(*count, 1, "an edge of two triangles on the same side");
                let is_border = (0..4).any(|k| border(*a)[k] && border(*b)[k]);
                assert_ne!(edges.contains_key(&[*b, *a]), is_border, "a crack");
            }
            assert_eq!(area, ((grid.columns() - 1) * (grid.rows() - 1)) as f64);
        }
    }
}

#[test]
fn full_trees_have_a_leaf_for_each_cell() {
    let grid = &grids()[5];
    let tree = Quadtree::refine(grid, |_| 1.0, 0.0);
    assert_eq!(tree.leaves().count(), 33 * 66);
    assert_eq!(tree.mesh().triangles.len(), 2 * 33 * 66);
}

#[test]
fn coarse_triangles_are_few_and_near_the_samples() {
    let rough = fractal(129, 100, 1.0, 20.0, 0.6, 4).expect("a grid");
    let mut heights = rough.heights().to_vec();
    heights[40 * 129 + 77] = f32::NAN;
    let grid = Grid::new(129, 100, [1.0; 2], heights).expect("a grid");
    let whole = 2 * 128 * 99;
    let mut before = f32::INFINITY;
    for wanted in [500, 2000, 8000] {
        let (mesh, pieces) = coarse(&grid, wanted);
        let found = mesh.triangles.len();
        assert!(found > wanted / 2 && found < 2 * wanted, "{found} instead of {wanted} of {whole}");
        let largest = pieces.iter().map(|piece| piece.error).fold(0.0, f32::max);
        assert!(largest < before, "{largest} after {before}");
        before = largest;
        let mut cells = vec![0; 128 * 99];
        for piece in &pieces {
            for row in 0..=u32::from(piece.cells[1]) {
                for column in 0..=u32::from(piece.cells[0]) {
                    let (c, r) = (piece.first[0] + column, piece.first[1] + row);
                    let corner = |v: u32| mesh.vertices[v as usize].map(|at| at as f32);
                    let flat: Vec<_> =
                        piece.triangles.clone().map(|t| mesh.triangles[t as usize].map(corner)).collect();
                    let (t, weights) = triangle_at(&flat, [c as f32, r as f32]);
                    assert!(weights.iter().all(|w| (-1e-5..1.00001).contains(w)), "{weights:?}");
                    let vertices = mesh.triangles[piece.triangles.start as usize + t];
                    let height: f32 = (0..3)
                        .map(|k| {
                            let [c, r] = mesh.vertices[vertices[k] as usize];
                            weights[k] * grid.height(c as usize, r as usize)
                        })
                        .sum();
                    assert!((grid.height(c as usize, r as usize) - height).abs() <= piece.error + 1e-4);
                    if row > 0 && column > 0 {
                        cells[(r - 1) as usize * 128 + (c - 1) as usize] += 1;
                    }
                }
            }
        }
        // No piece covers another, or the four cells around the hole, of which two triangles each are left out, or one.
        assert!(cells.iter().all(|n| *n <= 1) && cells[40 * 128 + 77] == 0 && cells[39 * 128 + 76] == 0);
    }
    // Ground with holes in half of it has as many triangles.
    let half = (0..129 * 100).map(|k| if k % 129 < 64 { f32::NAN } else { rough.heights()[k] }).collect();
    let half = Grid::new(129, 100, [1.0; 2], half).expect("a grid");
    let found = coarse(&half, 2000).0.triangles.len();
    assert!((1000..4000).contains(&found), "{found}");
    // A plane has few.
    let (mesh, pieces) = coarse(&plane(33, 1.0, 0.5, 0.7).expect("a grid"), 1000);
    assert!(mesh.triangles.len() < 40 && pieces.iter().all(|piece| piece.error < 1e-4), "{pieces:?}");
}
