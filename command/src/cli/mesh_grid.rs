//! Height fields as meshes: vertices on a regular grid of x and y, one z each.

use mrvis::internals::sky::DVec3;
use mrvis::internals::terrain::{Georeference, Grid, Loaded, ReadOptions};
use mrvis::{Error, Result, Scene};
use std::path::Path;

/// Largest distance of a vertex from the regular grid, cells: a tenth of the relief between two samples on a slope of 45 degrees.
const MAX_SHIFT: f64 = 0.1;

/// Reads the height field that the vertices of a mesh are.
///
/// # Errors
/// As [`Scene::load`]; the vertices are not those of a height field; an option is out of range.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Loaded> {
    let scene = Scene::load(path)?;
    let wrong = |what: &str| {
        let cure = "a mesh is a height field if its vertices lie on a regular grid of x and y, one z each";
        Error::format(path, None, format!("{what}: {cure}"))
    };
    let vertices: Vec<DVec3> =
        scene.parts().positions.iter().map(|p| scene.parts().origin + p.as_dvec3()).collect();
    let [x, y] = [lines(vertices.iter().map(|p| p.x)), lines(vertices.iter().map(|p| p.y))];
    let (Some(x), Some(y)) = (x, y) else {
        return Err(wrong(
            "its vertices are not at equal distances along x and y (a mesh with y up has to be turned)",
        ));
    };
    if x.count * y.count > 2 * vertices.len() {
        return Err(wrong("more than half of the grid has no vertex"));
    }
    let mut heights = vec![f32::NAN; x.count * y.count];
    for p in &vertices {
        let height = &mut heights[(y.count - 1 - y.number(p.y)) * x.count + x.number(p.x)];
        let z = (p.z * options.height_scale.unwrap_or(1.0)) as f32;
        if height.is_finite() && *height != z {
            return Err(wrong(&format!("it has two heights at {}, {}", p.x, p.y)));
        }
        *height = z;
    }
    let [dx, dy] = [x.step, y.step];
    let grid = Grid::new(x.count, y.count, options.cell.unwrap_or([dx, dy]), heights)?;
    let last = y.first + (y.count - 1) as f64 * dy;
    let grid = grid.with_georeference(Georeference::of_samples([x.first, last], [dx, dy]));
    let mut notes = vec!["the vertices of the mesh are taken as a height field in metres, z up".into()];
    if grid.holes() > 0 {
        notes.push(format!("{} places of the grid have no vertex: they block nothing", grid.holes()));
    }
    Ok(Loaded { grid, notes })
}

/// Columns or rows at equal distances.
struct Lines {
    first: f64,
    step: f64,
    count: usize,
}

impl Lines {
    /// The number of the nearest line.
    fn number(&self, at: f64) -> usize {
        ((at - self.first) / self.step).round() as usize
    }
}

/// Smallest distance of lines, of their extent: below that of 131,072 lines, and above rounding in f32.
const MIN_STEP: f64 = 2e-6;

/// The lines on which coordinates lie; `None` if their distances differ.
fn lines(coordinates: impl Iterator<Item = f64>) -> Option<Lines> {
    let mut sorted: Vec<f64> = coordinates.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let extent = sorted.last()? - sorted.first()?;
    let cells = sorted.windows(2).filter(|w| w[1] - w[0] > MIN_STEP * extent).count();
    let lines = Lines { first: sorted[0], step: extent / cells as f64, count: cells + 1 };
    let shift = |at: &f64| (at - lines.first) / lines.step - lines.number(*at) as f64;
    (cells > 0 && sorted.iter().all(|at| shift(at).abs() <= MAX_SHIFT)).then_some(lines)
}
