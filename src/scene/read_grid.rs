//! Height fields as scenes: two triangles for each four neighbouring samples, in the coordinates of the file in metres.

use super::soup::{Soup, SoupMaterial};
use super::{FineGround, seams::Tile};
use crate::terrain::{self, Grid, ReadOptions};
use crate::{Result, memory};
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
    soup.metres_of_degree = grid.metres_of_degree();
    soup.tiles = vec![Tile::of(&grid, [object, material])];
    let cells = (grid.columns() - 1) * (grid.rows() - 1);
    if 2 * cells <= FineGround::MAX_TRIANGLES {
        add(&mut soup, &grid, object, material);
        return Ok(soup);
    }
    add_coarse(&mut soup, &grid, object, material, FineGround::MAX_TRIANGLES)?;
    soup.repairs.messages.push(format!(
        "{cells} cells of the terrain exchange light as {} triangles; rays meet all of them",
        soup.polygons()
    ));
    Ok(soup)
}

/// Adds the triangles of a grid between samples with heights. Cells are divided from the south-west to the north-east.
fn add(soup: &mut Soup, grid: &Grid, object: u32, material: u32) {
    let (columns, rows) = (grid.columns(), grid.rows());
    let mut vertex = vec![u32::MAX; columns * rows];
    for row in 0..rows {
        for column in 0..columns {
            if grid.height(column, row).is_finite() {
                vertex[row * columns + column] = soup.positions.len() as u32;
                soup.positions.push(grid.map_position(column, row));
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

/// Adds about this number of triangles for a grid, and its samples, which rays meet in their place.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub(crate) fn add_coarse(
    soup: &mut Soup,
    grid: &Grid,
    object: u32,
    material: u32,
    triangles: usize,
) -> Result<()> {
    let (columns, rows) = (grid.columns(), grid.rows());
    // A position in f64, one in f32, Embree's, and its tree.
    memory::check_room(80 * (columns * rows) as u64, || "samples of the terrain".into())?;
    let position = |column: usize, row: usize| grid.map_position(column, row);
    let (mesh, pieces) = terrain::coarse(grid, triangles);
    let (vertex, polygon) = (soup.positions.len() as u32, soup.polygons() as u32);
    soup.positions.extend(mesh.vertices.iter().map(|v| position(v[0] as usize, v[1] as usize)));
    for corners in &mesh.triangles {
        soup.indexed_polygon(object, material, corners.map(|v| vertex + v));
    }
    let samples = (0..columns * rows).map(|k| position(k % columns, k / columns));
    soup.ground.get_or_insert_default().add(samples, columns, &mesh, pieces, polygon, object);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LoadOptions, Scene, added::read_added};
    use crate::terrain::{Georeference, Layer, write_geotiff};

    /// A level GeoTIFF of 9 × 5 samples every .001 units, whose first sample is at 7.0005, `north` - .0005.
    fn tile(folder: &Path, name: &str, north: f64, keys: &[u16]) -> std::path::PathBuf {
        let path = folder.join(name);
        let grid = Grid::new(9, 5, [1.0; 2], vec![500.0; 45]).expect("a grid");
        let georeference = Georeference {
            tie_point: [0.0, 0.0, 0.0, 7.0, north, 0.0],
            scale: [0.001, 0.001, 0.0],
            keys: keys.to_vec(),
            ..Georeference::default()
        };
        let layer = Layer { name: "heights", values: grid.heights() };
        write_geotiff(&path, &grid.clone().with_georeference(georeference), &[layer]).expect("written");
        path
    }

    fn size(scene: &Scene) -> [f32; 2] {
        let size = scene.world_bounds().extent();
        [size.x, size.y]
    }

    #[test]
    fn other_axes_and_units_of_scenes_are_refused() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let path = folder.path().join("a.asc");
        std::fs::write(&path, "ncols 2\nnrows 2\ncellsize 9\n1 2 3 4\n").expect("written");
        let read = |options: &LoadOptions| Scene::load_with(&path, options).map_err(|e| e.to_string());
        let up = read(&LoadOptions { up: Some(crate::UpAxis::Y), ..LoadOptions::default() });
        assert!(up.is_err_and(|e| e.contains("axis z")));
        let unit = read(&LoadOptions { unit: "km".into(), ..LoadOptions::default() });
        assert!(unit.is_err_and(|e| e.contains("in metres")));
    }

    #[test]
    fn grids_of_all_units_are_in_metres() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let feet = tile(folder.path(), "feet.tif", 46.0, &[1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9002]);
        let [x, y] = size(&Scene::load(&feet).expect("a scene"));
        assert!((x / (0.008 * 0.3048) - 1.0).abs() < 1e-5 && (y / (0.004 * 0.3048) - 1.0).abs() < 1e-5);
        let mut options = LoadOptions::default();
        options.grid.cell = Some([10.0, 20.0]);
        let [x, y] = size(&Scene::load_with(&feet, &options).expect("a scene"));
        assert!((x - 80.0).abs() < 0.02 && (y - 80.0).abs() < 0.02, "{x} {y}");
        // The corner stays.
        let low = |options: &LoadOptions| {
            let scene = Scene::load_with(&feet, options).expect("a scene");
            scene.origin.y + f64::from(scene.world_bounds().min.y)
        };
        assert!((low(&options) - 46.0).abs() < 0.1, "{}", low(&options));
        // Lengths of a degree at 46°: 77.46 km and 111.15 km. One tile begins where the first one ends, the other far to the south.
        let degrees = [1, 1, 0, 1, 1024, 0, 1, 2];
        let north = tile(folder.path(), "north.tif", 46.0, &degrees);
        let south = tile(folder.path(), "south.tif", 45.0, &degrees);
        let next = tile(folder.path(), "next.tif", 45.995, &degrees);
        let added = read_added(&[next, south], &ReadOptions::default(), None).expect("a tile");
        let scene = Scene::load_with(&north, &LoadOptions { added, ..LoadOptions::default() });
        let scene = scene.expect("a scene");
        let [x, y] = size(&scene);
        assert!((x - 8.0 * 77.46).abs() < 0.1 && (y - 1004.0 * 111.15).abs() < 2.0, "{x} {y}");
        let messages = &scene.repairs.messages;
        for words in ["as in the first height field", "16 triangles close gaps"] {
            assert!(messages.iter().any(|m| m.contains(words)), "{messages:?}");
        }
    }
}
