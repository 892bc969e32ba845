//! Height fields as scenes: two triangles for each four neighbouring samples, in the coordinates of the file.

use super::FineGround;
use super::soup::{Soup, SoupMaterial};
use crate::terrain::{self, Grid, ReadOptions};
use crate::{Result, memory};
use glam::DVec3;
use std::path::Path;

/// Diffuse reflectance of the ground, of which height fields say nothing: that of grass and bare soil.
const REFLECTANCE: f32 = 0.2;

/// Extensions of height fields.
pub const EXTENSIONS: [&str; 6] = ["asc", "tif", "tiff", "png", "npy", "npz"];

/// Reads a height field: the object `terrain` of the material `ground`.
///
/// # Errors
/// Those of [`terrain::read`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Soup> {
    let terrain::Loaded { grid, notes } = terrain::read(path, options)?;
    let mut soup = Soup::new(path);
    soup.repairs.messages = notes;
    soup.repairs
        .messages
        .push(format!("the material `ground` of the terrain has the reflectance {REFLECTANCE}"));
    let material = soup.material(SoupMaterial::diffuse("ground", [REFLECTANCE; 3]));
    let object = soup.object("terrain");
    let cells = (grid.columns() - 1) * (grid.rows() - 1);
    if 2 * cells <= FineGround::MAX_TRIANGLES {
        add(&mut soup, &grid, (object, material));
        return Ok(soup);
    }
    add_coarse(&mut soup, &grid, (object, material), FineGround::MAX_TRIANGLES)?;
    soup.repairs.messages.push(format!(
        "{cells} cells of the terrain exchange light as {} triangles; rays meet all of them",
        soup.polygons()
    ));
    Ok(soup)
}

/// Adds the triangles of a grid between samples with heights. Cells are divided from the south-west to the north-east.
fn add(soup: &mut Soup, grid: &Grid, (object, material): (u32, u32)) {
    let (columns, rows) = (grid.columns(), grid.rows());
    let mut vertex = vec![u32::MAX; columns * rows];
    for row in 0..rows {
        for column in 0..columns {
            let height = grid.height(column, row);
            if height.is_finite() {
                let [x, y] = grid.georeference().position(column, row);
                vertex[row * columns + column] = soup.positions.len() as u32;
                soup.positions.push(DVec3::new(x, y, height.into()));
            }
        }
    }
    for row in 1..rows {
        for column in 1..columns {
            let at = |c: usize, r: usize| vertex[r * columns + c];
            let [north_west, north_east] = [at(column - 1, row - 1), at(column, row - 1)];
            let [south_west, south_east] = [at(column - 1, row), at(column, row)];
            for corners in [[south_west, south_east, north_east], [south_west, north_east, north_west]] {
                if corners.iter().all(|v| *v != u32::MAX) {
                    soup.indexed_polygon(object, material, corners);
                }
            }
        }
    }
}

/// Adds about so many triangles for a grid, and its samples, which rays meet in their place.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub(crate) fn add_coarse(
    soup: &mut Soup,
    grid: &Grid,
    (object, material): (u32, u32),
    triangles: usize,
) -> Result<()> {
    let (columns, rows) = (grid.columns(), grid.rows());
    // A position in f64, one in f32, Embree's, and its tree.
    memory::check_room(80 * (columns * rows) as u64, || "samples of the terrain".into())?;
    let position = |column: usize, row: usize| {
        let [x, y] = grid.georeference().position(column, row);
        DVec3::new(x, y, grid.height(column, row).into())
    };
    let (mesh, pieces) = terrain::coarse(grid, triangles)?;
    let (vertex, polygon) = (soup.positions.len() as u32, soup.polygons() as u32);
    soup.positions.extend(mesh.vertices.iter().map(|v| position(v[0] as usize, v[1] as usize)));
    for corners in &mesh.triangles {
        soup.indexed_polygon(object, material, corners.map(|v| vertex + v));
    }
    let samples = (0..columns * rows).map(|k| position(k % columns, k / columns));
    soup.ground.get_or_insert_default().add(samples, columns, (&mesh, pieces), [polygon, object]);
    Ok(())
}
