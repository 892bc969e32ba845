//! Gaps between height fields that lie beside each other. Samples are in the middles of cells, so that the surfaces of grids whose cells
//! touch end one cell apart.

use crate::terrain::Grid;
use glam::{DAffine3, DVec3};
use std::collections::{BTreeSet, HashMap};

/// Largest distance of a sample from the lattice of another grid, cells: positions and cell sizes in text have six digits or more.
const MAX_SHIFT: f64 = 0.01;

/// A height field by the samples of its borders.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Columns and rows.
    size: [i64; 2],
    /// Column, row and position of each sample, from the first to the last of the grid; heights are NaN in holes.
    border: Vec<([i64; 2], DVec3)>,
    /// Object and material in the soup.
    surface: [u32; 2],
    /// Whether the distances of samples are not those of the file.
    pub is_cell_given: bool,
}

impl Tile {
    /// That of a grid with an object and a material.
    pub fn of(grid: &Grid, surface: [u32; 2]) -> Tile {
        let [columns, rows] = [grid.columns(), grid.rows()];
        let is_inside = |c: usize, r: usize| c > 0 && r > 0 && c + 1 < columns && r + 1 < rows;
        let row = |r: usize| (0..columns).filter(move |&c| !is_inside(c, r)).map(move |c| (c, r));
        let sample = |(c, r)| ([c as i64, r as i64], grid.map_position(c, r));
        let border = (0..rows).flat_map(row).map(sample).collect();
        Tile { size: [columns as i64, rows as i64], border, surface, is_cell_given: grid.is_cell_given() }
    }

    /// The tile in a soup whose objects and materials begin with these numbers.
    pub fn within(&self, first: [u32; 2]) -> Tile {
        Tile { surface: [0, 1].map(|k| first[k] + self.surface[k]), ..self.clone() }
    }

    /// Moves the samples.
    pub fn transform(&mut self, by: &DAffine3) {
        self.border.iter_mut().for_each(|(_, p)| *p = by.transform_point3(*p));
    }

    /// The position of the first sample, and from it to the last one, x and y.
    fn extent(&self) -> [[f64; 2]; 2] {
        let [first, last] = [self.border[0].1, self.border[self.border.len() - 1].1];
        [[first.x, first.y], [last.x - first.x, last.y - first.y]]
    }

    /// Column and row of the first sample on the lattice of another tile; `None` if the samples are not on it.
    fn place_on(&self, lattice: &Tile) -> Option<[i64; 2]> {
        let ([first, extent], [origin, along]) = (self.extent(), lattice.extent());
        let mut place = [0; 2];
        for k in 0..2 {
            let cell = along[k] / (lattice.size[k] - 1) as f64;
            let (start, cells) = ((first[k] - origin[k]) / cell, extent[k] / cell);
            let shift = (start - start.round()).abs().max((cells - (self.size[k] - 1) as f64).abs());
            if shift.is_nan() || shift > MAX_SHIFT {
                return None;
            }
            place[k] = start.round() as i64;
        }
        Some(place)
    }
}

/// A triangle between tiles, and its object and material.
pub type Filling = ([DVec3; 3], [u32; 2]);

/// Triangles between tiles that are on one lattice and one cell apart.
pub fn fillings(mut tiles: Vec<Tile>) -> Vec<Filling> {
    let mut found = Vec::new();
    while let Some(lattice) = tiles.pop() {
        let mut placed = vec![([0; 2], lattice.clone())];
        tiles.retain(|tile| {
            let place = tile.place_on(&lattice);
            placed.extend(place.map(|place| (place, tile.clone())));
            place.is_none()
        });
        join(&placed, &mut found);
    }
    found
}

/// Triangles of all cells that lie in no tile, between samples of the borders.
fn join(tiles: &[([i64; 2], Tile)], found: &mut Vec<Filling>) {
    let mut samples = HashMap::new();
    let mut cells = BTreeSet::new();
    for ([column, row], tile) in tiles {
        for ([c, r], position) in tile.border.iter().filter(|(_, p)| p.is_finite()) {
            let (c, r) = (column + c, row + r);
            samples.entry([c, r]).or_insert((*position, tile.surface));
            cells.extend([[r - 1, c - 1], [r - 1, c], [r, c - 1], [r, c]]);
        }
    }
    let is_in = |c: i64, r: i64, ([column, row], tile): &([i64; 2], Tile)| {
        (0..tile.size[0] - 1).contains(&(c - column)) && (0..tile.size[1] - 1).contains(&(r - row))
    };
    for [r, c] in cells {
        if tiles.iter().any(|tile| is_in(c, r, tile)) {
            continue;
        }
        let [south_west, north_east] = [[c, r + 1], [c + 1, r]];
        for corners in [[south_west, [c + 1, r + 1], north_east], [south_west, north_east, [c, r]]] {
            if let [Some(a), Some(b), Some(c)] = corners.map(|at| samples.get(&at)) {
                found.push(([a.0, b.0, c.0], a.1));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{LoadOptions, Scene, read_added};
    use crate::terrain::ReadOptions;

    /// Four tiles of 3 × 3 level samples every 10 m around a corner, and one that is half a cell farther to the west.
    #[test]
    fn tiles_whose_cells_touch_have_no_gaps() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let tile = |x: i32, y: i32| {
            let path = folder.path().join(format!("{x}-{y}.asc"));
            let header = format!("ncols 3\nnrows 3\nxllcorner {x}\nyllcorner {y}\ncellsize 10\n");
            std::fs::write(&path, header + &"7 ".repeat(9)).expect("written");
            path
        };
        let house = folder.path().join("house.obj");
        std::fs::write(&house, "v 0 0 9\nv 2 0 9\nv 0 2 9\nvt 0 1\nf 1/1 2/1 3/1\n").expect("written");
        let added = [tile(30, 0), tile(0, 30), tile(30, 30), house, tile(-35, 0)];
        let scene = |grid: ReadOptions| {
            let options = LoadOptions {
                added: read_added(&added, &grid, None).expect("tiles"),
                grid,
                ..LoadOptions::default()
            };
            Scene::load_with(tile(0, 0), &options)
        };
        let given = scene(ReadOptions { cell: Some([20.0; 2]), ..ReadOptions::default() });
        assert!(given.is_err_and(|e| e.to_string().contains("`cell` with several height fields")));
        let scene = scene(ReadOptions::default()).expect("a scene");
        let area: f64 = (0..scene.triangles.len() as u32).map(|t| scene.face_area(t)).sum();
        assert_eq!(area, 50.0 * 50.0 + 20.0 * 20.0 + 2.0);
        assert!(scene.repairs.messages.iter().any(|m| m.starts_with("18 triangles close gaps")));
    }
}
