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
fn neighbours_differ_by_one_level() {
    for grid in grids() {
        let tree = Quadtree::refine(&grid, near_a_place, 0.3).expect("a tree");
        let mut pairs = 0;
        for leaf in tree.leaves() {
            for side in Side::ALL {
                let opposite = Side::ALL[Side::ALL.iter().position(|s| *s == side).expect("a side") ^ 1];
                for across in tree.leaves_across(leaf, side) {
                    let (a, b) = (tree.nodes()[leaf].size, tree.nodes()[across].size);
                    assert!(a <= 2 * b && b <= 2 * a, "{a} beside {b}");
                    assert!(tree.leaves_across(across, opposite).any(|back| back == leaf));
                    pairs += 1;
                }
            }
        }
        assert!(pairs > 0 || grid.columns() <= 3);
    }
}

#[test]
fn leaves_cover_the_grid_once() {
    for grid in grids() {
        let tree = Quadtree::refine(&grid, near_a_place, 0.3).expect("a tree");
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
            let tree = Quadtree::refine(&grid, near_a_place, max_error).expect("a tree");
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
fn shapes_bound_their_surface() {
    let grid = &grids()[1];
    let tree = Quadtree::refine(grid, near_a_place, 0.3).expect("a tree");
    let shapes = tree.shapes();
    let whole: f64 = tree.leaves().map(|leaf| shapes[leaf].area).sum();
    assert!((shapes[0].area - whole).abs() < 1e-9 * whole && whole > 49.0 * 70.0);
    for (i, shape) in shapes.iter().enumerate().filter(|(_, s)| s.area > 0.0) {
        let [columns, rows] = tree.samples(i);
        for r in rows[0]..rows[1] {
            for c in columns[0]..columns[1] {
                let p = [grid.position(c, r + 1), grid.position(c + 1, r + 1), grid.position(c + 1, r)];
                let normal = (p[1] - p[0]).cross(p[2] - p[0]).as_vec3();
                assert!(shape.axis.angle_between(normal) <= shape.half_angle + 1e-3);
                assert!(p.iter().all(|p| p.cmpge(shape.low).all() && p.cmple(shape.high).all()));
            }
        }
    }
    // A plane: its area is that of its projection over the cosine, its cone a line.
    let slope = plane(33, 1.0, 0.5, 0.7).expect("a grid");
    let tree = Quadtree::refine(&slope, |_| 0.0, 1.0).expect("a tree");
    let shape = tree.shapes()[0];
    assert!((shape.area - 1024.0 / 0.5f64.cos()).abs() < 1e-3 && shape.half_angle < 1e-3);
}

#[test]
fn full_trees_have_a_leaf_for_each_cell() {
    let grid = &grids()[5];
    let tree = Quadtree::refine(grid, |_| 1.0, 0.0).expect("a tree");
    assert_eq!(tree.leaves().count(), 33 * 66);
    assert_eq!(tree.mesh().triangles.len(), 2 * 33 * 66);
    assert!(Quadtree::refine(grid, |_| 1.0, f64::NAN).is_err());
}
