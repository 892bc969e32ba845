//! A solution as others want it: meshes with colours, cells with fields, lightmaps, pictures.
//!
//! What is shown is smooth: every element has one irradiance, and vertices take the mean of the elements around them that
//! face the same way. Reflectance and emission are not averaged, so that borders of materials stay sharp. Elements of
//! different sizes that meet share all vertices of the common edge, so that there are no cracks, in shape or in colour.
//! Knows nothing of links or of how light was computed.

mod camera;
mod gather;
mod gltf;
mod lightmap;
mod mesh;
mod ply;
#[cfg(test)]
mod tests;
mod tone;
mod unwrapped;
mod view;
mod vtu;

pub use camera::{Camera, First, Frame, Stage, render};
pub use gather::{light_of, places};
pub use gltf::write_glb;
pub use lightmap::{Lightmap, lightmap, write_lightmap};
pub use mesh::Mesh;
pub use ply::write_ply;
pub use tone::Tone;
pub use unwrapped::unwrapped_lightmap;
pub use view::best_view;
pub use vtu::write_vtu;
