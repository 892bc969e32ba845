//! Embree 4 behind a safe interface. No other room uses Embree types.
//!
//! A [`Device`] makes [`SceneBuilder`]s; [`SceneBuilder::commit`] consumes the builder and returns an immutable
//! [`CommittedScene`], so that no scene can change while it is traced. Embree allocates the buffers, with its padding.
//! Input is slices of positions and triangles; materials and light are not known here.

#[allow(unsafe_code)]
mod device;
#[allow(unsafe_code)]
mod scene;
#[allow(unsafe_code, non_snake_case)]
mod sys;
#[cfg(test)]
mod tests;

pub use device::Device;
pub use scene::{CommittedScene, SceneBuilder, Traversal};
pub use sys::{GridPiece, Hits};

/// The scene of these triangles.
#[cfg(test)]
pub fn committed(positions: &[glam::Vec3], triangles: &[[u32; 3]]) -> CommittedScene {
    let mut builder = SceneBuilder::new(&Device::new(1).expect("a device")).expect("a builder");
    builder.add_triangles(positions, triangles).expect("triangles");
    builder.commit().expect("a scene")
}
