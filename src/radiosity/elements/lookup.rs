//! Finds the leaf element of a surface that holds a point, for many points.

use super::cuts::ChildrenOutlines;
use super::subdivision::is_triangle;
use super::{Elements, Shape};
use crate::math::parallel;
use glam::{Vec2, Vec3};

/// The quadtrees of all sides in packed form. Elements must not be split or cut while a lookup is in use.
pub struct Lookup {
    frames: Vec<Frame>,
    /// First of the quarters of each element, 0 for leaves; of an irregular element `!k` with its index k in `irregular`, which is
    /// negative.
    first_child: Vec<i32>,
    irregular: Vec<ChildrenOutlines>,
    /// Elements in the cells of a grid over each side: one access replaces a descent of several levels.
    cells: Vec<u32>,
}

/// Parametrisation of one side.
struct Frame {
    origin: Vec3,
    /// Gradients of the two parameters, which run along two edges. Triangle: the two edges from its first corner, twice. Quad: the
    /// edges 0-1 and 1-2 on one side of its diagonal, 3-2 and 0-3 on the other.
    gradients: [[Vec3; 2]; 2],
    element: u32,
    triangle: bool,
    /// Levels that the grid spans and its first cell: `2^depth` rows of `2^depth` cells, of twice as many for triangles.
    depth: u32,
    first_cell: usize,
}

/// Largest number of levels of a grid: 4⁸ = 65,536 cells, which limits a grid to 256 KiB of offsets. Does not change
/// results.
const MAX_GRID_LEVELS: u32 = 8;

impl Lookup {
    /// The lookup for the present elements.
    pub fn new(elements: &Elements) -> Lookup {
        let frames = parallel::map(&elements.sides, |side| {
            let c = elements.corners(side);
            let (x, y) = side.normal.any_orthonormal_pair();
            let gradients = |[e, f]: [Vec3; 2]| {
                let [e, f] = [e, f].map(|v| Vec2::new(v.dot(x), v.dot(y)));
                let area = e.perp_dot(f);
                [(f.y * x - f.x * y) / area, (e.x * y - e.y * x) / area]
            };
            let triangle = is_triangle(c);
            let edges = if triangle {
                [[c[1] - c[0], c[2] - c[0]]; 2]
            } else {
                [[c[1] - c[0], c[2] - c[1]], [c[2] - c[3], c[3] - c[0]]]
            };
            Frame {
                origin: c[0],
                gradients: edges.map(gradients),
                element: side.element,
                triangle,
                depth: 0,
                first_cell: 0,
            }
        });
        let mut lookup = Lookup {
            frames,
            first_child: parallel::map(&elements.elements, |e| {
                if e.is_leaf() { 0 } else { e.first_child as i32 }
            }),
            irregular: Vec::new(),
            cells: Vec::new(),
        };
        let mut parts = vec![0u32; elements.sides.len()];
        for (e, element) in elements.elements.iter().enumerate() {
            if let Shape::Surface { side, .. } = element.shape {
                parts[side as usize] += 1;
            }
            if element.is_irregular {
                lookup.first_child[e] = !(lookup.irregular.len() as i32);
                lookup.irregular.push(ChildrenOutlines::of(elements, e as u32));
            }
        }
        for (side, &parts) in parts.iter().enumerate().filter(|(_, parts)| **parts > 1) {
            lookup.lay_grid(side, parts);
        }
        lookup
    }

    /// A grid with about as many cells as the side has parts.
    fn lay_grid(&mut self, side: usize, parts: u32) {
        let frame = &mut self.frames[side];
        frame.depth = (parts.ilog2() / 2).clamp(1, MAX_GRID_LEVELS);
        frame.first_cell = self.cells.len();
        let Frame { depth, triangle, element, .. } = *frame;
        let rows = 1 << depth;
        let halves: &[f32] = if triangle { &[1.0 / 3.0, 2.0 / 3.0] } else { &[0.5] };
        for j in 0..rows {
            for i in 0..rows {
                for &middle in halves {
                    let place = [i, j].map(|k| (k as f32 + middle) / rows as f32);
                    self.cells.push(self.descend(triangle, element, place, depth));
                }
            }
        }
    }

    /// The leaf of a side that holds a point of its plane; the nearest one for points beside it.
    #[inline]
    pub fn leaf(&self, side: u32, point: Vec3) -> u32 {
        let frame = &self.frames[side as usize];
        if frame.depth == 0 {
            return frame.element;
        }
        let (u, v) = frame.parameters(point - frame.origin);
        let rows = 1u32 << frame.depth;
        let (x, y) = (u * rows as f32, v * rows as f32);
        // The conversion turns NaN into 0.
        let (i, j) = ((x as u32).min(rows - 1), (y as u32).min(rows - 1));
        let (x, y) = (x - i as f32, y - j as f32);
        let cell = (j * rows + i) as usize;
        if !frame.triangle {
            let at = self.cells[frame.first_cell + cell];
            return self.below_irregular(self.descend(false, at, [x, y], u32::MAX), point);
        }
        let at = self.cells[frame.first_cell + 2 * cell + usize::from(x + y > 1.0)];
        // Parts of the middle quarter are rotated: the descent starts at the top again.
        let is_whole = self.first_child[at as usize] <= 0;
        let at = if is_whole { at } else { self.descend(true, frame.element, [u, v], u32::MAX) };
        self.below_irregular(at, point)
    }

    /// The leaf of an irregular element that holds a point; other elements are returned as they are.
    #[inline]
    fn below_irregular(&self, mut at: u32, point: Vec3) -> u32 {
        while self.first_child[at as usize] < 0 {
            at = self.irregular[!self.first_child[at as usize] as usize].child_at(point);
        }
        at
    }

    /// The quarter, or quarter of a quarter and so on, of an element that holds a parameter pair, at most `levels` below the element.
    #[inline]
    fn descend(&self, triangle: bool, element: u32, [mut u, mut v]: [f32; 2], levels: u32) -> u32 {
        let (mut at, mut left) = (element, levels);
        let mut first = self.first_child[at as usize];
        while first > 0 && left > 0 {
            let part;
            (part, u, v) = if triangle { quarter_of_triangle(u, v) } else { quarter_of_quad(u, v) };
            at = first as u32 + part;
            first = self.first_child[at as usize];
            left -= 1;
        }
        at
    }
}

impl Frame {
    /// Triangle: weights of the second and third corner. Quad: parameters with corners at (0, 0), (1, 0), (1, 1), (0, 1), linear
    /// on either side of the diagonal u = v, so that quarters halve both parameters.
    #[inline]
    fn parameters(&self, from: Vec3) -> (f32, f32) {
        let along = |[u, v]: [Vec3; 2]| (from.dot(u), from.dot(v));
        let (u, v) = along(self.gradients[0]);
        if self.triangle || v <= u { (u, v) } else { along(self.gradients[1]) }
    }
}

/// The quarter of a quad that holds a parameter pair, and the parameters within the quarter.
#[inline]
fn quarter_of_quad(u: f32, v: f32) -> (u32, f32, f32) {
    let (right, upper) = (u >= 0.5, v >= 0.5);
    let part = [[0, 3], [1, 2]][usize::from(right)][usize::from(upper)];
    (part, 2.0 * u - f32::from(right), 2.0 * v - f32::from(upper))
}

/// The same for a triangle and weights of its second and third corner.
#[inline]
fn quarter_of_triangle(b: f32, c: f32) -> (u32, f32, f32) {
    let a = 1.0 - b - c;
    if a > 0.5 {
        (0, 2.0 * b, 2.0 * c)
    } else if b > 0.5 {
        (1, 2.0 * b - 1.0, 2.0 * c)
    } else if c > 0.5 {
        (2, 2.0 * b, 2.0 * c - 1.0)
    } else {
        (3, 1.0 - 2.0 * a, 1.0 - 2.0 * b)
    }
}
