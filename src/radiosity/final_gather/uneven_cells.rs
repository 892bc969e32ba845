//! Which cells of a point's grid of rays differ from their neighbours, and are divided.

use glam::Vec3;

/// Part of a cell that is known to be open or blocked only by its ray, as a standard deviation: an edge that is anywhere in two cells is found by
/// their two rays to √(1/12) = .29 of a cell.
const ERROR_OF_EDGE: f64 = 0.29;
/// The same for a difference of radiance: a place at random in the cell errs by √(1/12) of the difference over it. Open cells of the undivided grid have
/// two places that mirror each other: a quarter of that is left where the difference is not even.
const ERROR_OF_GRADIENT: [f64; 2] = [0.29 / 4.0, 0.29];
/// Error of the light of the sky at a point, relative to all of its light, over the error asked for.
pub(super) const TOLERANCE: f64 = 0.1;
/// Weight of squared errors of the light of surfaces, which is to be known to about the error asked for and not to a tenth of it.
const WEIGHT_OF_SURFACES: f64 = TOLERANCE * TOLERANCE;

/// A cell of the grid or of one of its divisions.
#[derive(Clone, Copy)]
pub(super) struct Cell {
    /// Column and row among the cells of its level.
    pub place: [u32; 2],
    /// Whether its ray leaves the scene.
    pub is_open: bool,
    /// Irradiance by it over its area, if all of it is as its ray has found, W/m².
    pub light: Vec3,
    /// The same by the mean light of the element that its ray has met, or of the surfaces around it where only one of four quarters was looked up,
    /// W/m²: without the noise of paths.
    pub surfaces: Vec3,
    /// Mean over the channels of the light that comes if all of it is open, W/m².
    pub sky: f32,
    /// Index of the first of its quarters in the next level; [`WHOLE`] if it is not divided.
    pub quarters: u32,
}

/// Index of the quarters of a cell that is not divided.
pub(super) const WHOLE: u32 = u32::MAX;

/// A cell that may be divided, by its index in its level.
pub(super) struct Uneven {
    pub cell: u32,
    /// Squares of the expected errors of the light of sky and surfaces, (W/m²)², that of surfaces times [`WEIGHT_OF_SURFACES`].
    pub errors: [f64; 2],
    /// Mean light of the surfaces around it, W/m².
    pub around: Vec3,
}

impl Uneven {
    pub fn error(&self) -> f64 {
        self.errors[0] + self.errors[1]
    }
}

/// The cells of the finest level whose neighbours differ from each other, the largest errors first. The ray of
/// a cell does not say whether it is divided: of cells that are open in part, those whose ray happens to be blocked would be left so. Where a
/// neighbour is not divided as often, its larger cell counts. In `openings`, places of the grid's unit square, the sky is seen: cells there and beside them count as beside an open one.
pub(super) fn uneven_cells(
    levels: &[Vec<Cell>],
    [columns, rows]: [usize; 2],
    area: f64,
    openings: &[[f32; 2]],
) -> Vec<Uneven> {
    let finest = levels.len() - 1;
    let size = [columns << finest, rows << finest];
    // The cell of the finest level at a place, or the smallest that is not divided there.
    let of = |[i, j]: [usize; 2]| {
        let mut cell = &levels[0][(j >> finest) * columns + (i >> finest)];
        for (depth, cells) in levels.iter().enumerate().skip(1) {
            if cell.quarters == WHOLE {
                break;
            }
            let half = |at: usize| (at >> (finest - depth)) & 1;
            cell = &cells[cell.quarters as usize + half(i) + 2 * half(j)];
        }
        cell
    };
    // Of the whole grid two rings: the ends of narrow strips of sky are thinner than a cell.
    let reach = if finest == 0 { 2 } else { 1 };
    let range =
        |at: u32, size: usize| (at as usize).saturating_sub(reach)..(at as usize + reach + 1).min(size);
    let mut beside_openings: Vec<[u32; 2]> = openings
        .iter()
        .flat_map(|&[u, v]| {
            let [i, j] = [(u, size[0]), (v, size[1])].map(|(at, n)| (at * n as f32) as u32);
            range(j, size[1])
                .flat_map(move |row| range(i, size[0]).map(move |column| [column as u32, row as u32]))
        })
        .collect();
    beside_openings.sort_unstable();
    beside_openings.dedup();
    let mut found: Vec<Uneven> = Vec::new();
    for (k, cell) in levels[finest].iter().enumerate() {
        let [i, j] = cell.place;
        let nothing = [f32::INFINITY, f32::NEG_INFINITY];
        // Ranges of the light of the sky, blocked or not, and of surfaces.
        let ([mut sky, mut surfaces], mut open) =
            ([nothing; 2], beside_openings.binary_search(&cell.place).is_ok());
        let (mut around, mut blocked) = (Vec3::ZERO, 0u16);
        let widen = |range: &mut [f32; 2], by: f32| *range = [range[0].min(by), range[1].max(by)];
        for row in range(j, size[1]) {
            for column in range(i, size[0]) {
                if [column, row] != [i as usize, j as usize] {
                    let near = of([column, row]);
                    widen(&mut sky, near.sky);
                    match near.is_open {
                        true => open = true,
                        false => {
                            widen(&mut surfaces, near.surfaces.element_sum() / 3.0);
                            (around, blocked) = (around + near.surfaces, blocked + 1);
                        }
                    }
                }
            }
        }
        let edge = if open && blocked > 0 { ERROR_OF_EDGE * f64::from(sky[1]) } else { 0.0 };
        let between = if blocked > 0 { ERROR_OF_EDGE * f64::from(surfaces[1] - surfaces[0]) } else { 0.0 };
        // An edge is in one of the cells across it, and so is the difference between the nearest on either side.
        let across = (2 * reach + 1) as f64;
        let of_cell = if open { ERROR_OF_GRADIENT[usize::from(finest > 0)] / across } else { 0.0 };
        let gradient = of_cell * f64::from(sky[1] - sky[0]);
        // Mirrored places do not help at the sharp edge of a bright part of the sky, which is in one of two cells.
        let step = if finest == 0 { ERROR_OF_EDGE * step_at(&levels[0], k, columns) } else { 0.0 };
        let of_sky = edge * edge / across + gradient * gradient + 0.5 * step * step;
        let errors = [of_sky, WEIGHT_OF_SURFACES * between * between / across];
        let around = around / f32::from(blocked.max(1));
        let of = Uneven { cell: k as u32, errors: errors.map(|e| area * area * e), around };
        if of.error() > 0.0 {
            found.push(of);
        }
    }
    found.sort_unstable_by(|a, b| b.error().total_cmp(&a.error()).then(a.cell.cmp(&b.cell)));
    found
}

/// By how much the sky changes abruptly at a cell of the undivided grid: the larger second difference along a row and along a column, which is the step for both
/// cells at a step; W/m². At the rim of the grid, or beside blocked cells, it is the difference to the only neighbour.
fn step_at(cells: &[Cell], k: usize, columns: usize) -> f64 {
    let open = |k: usize| cells.get(k).filter(|cell| cell.is_open).map(|cell| f64::from(cell.sky));
    let Some(own) = open(k) else { return 0.0 };
    let bend =
        |before: Option<usize>, after: Option<usize>| match (before.and_then(open), after.and_then(open)) {
            (Some(before), Some(after)) => (before + after - 2.0 * own).abs(),
            (Some(only), None) | (None, Some(only)) => (only - own).abs(),
            (None, None) => 0.0,
        };
    let column = k % columns;
    let across = bend((column > 0).then(|| k - 1), (column + 1 < columns).then_some(k + 1));
    across.max(bend(k.checked_sub(columns), Some(k + columns)))
}
