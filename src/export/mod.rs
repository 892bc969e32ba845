//! Output of solutions: meshes with colours, cells with fields, lightmaps, pictures.
//!
//! Elements have constant irradiance; a vertex gets the mean of the adjacent elements that face the same way.
//! Reflectance and emission are not averaged, so that borders of materials stay sharp. Elements of different sizes
//! share all vertices of a common edge, so that shape and colour have no cracks.

mod camera;
mod false_colours;
mod gltf;
mod grid_picture;
mod lightmap;
mod mesh;
mod picture;
mod ply;
mod solve_page;
#[cfg(test)]
mod tests;
mod view;
mod vtu;

use crate::image_io::Stoppable;
use crate::progress::Progress;
use crate::{Error, Result, files::WholeFile};
use std::io::{BufWriter, Write};
use std::path::Path;

pub use camera::{Camera, First, Frame, Stage, render};
pub use gltf::write_glb;
pub use lightmap::unwrapped_lightmap;
pub use lightmap::{Lightmap, lightmap};
pub use mesh::Mesh;
pub use picture::{MAX_PIXELS, MAX_SIDE, SIZE, Tone, bytes_per_pixel, picture, suitable_lightmap};
pub use ply::write_ply;
pub use solve_page::{PageView, solve_page};
pub use view::{VIEW, best_view};
pub use vtu::write_vtu;
pub use {
    grid_picture::GridLight,
    lightmap::write_lightmap_mesh,
    picture::developed,
    solve_page::{SurfaceLight, surfaces},
    view::scene_view,
};

/// Writes a file completely or not at all.
///
/// # Errors
/// The file cannot be written, or `progress` has stopped.
fn write_file(
    path: &Path,
    progress: &dyn Progress,
    write: impl FnOnce(&mut BufWriter<Stoppable<&mut WholeFile>>) -> std::io::Result<()>,
) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 16, Stoppable { out: &mut file, progress });
    write(&mut out).and_then(|()| out.flush()).map_err(|e| Error::io(path, e))?;
    drop(out);
    file.commit()
}
