//! Embree 4 behind a safe wrapper. The only room that sees an Embree type, and one of the few with `unsafe`.
//!
//! A [`Device`] makes [`SceneBuilder`]s; [`SceneBuilder::commit`] consumes the builder and gives an immutable
//! [`CommittedScene`], so that changing a scene while it is traced cannot be written down. Buffers are allocated
//! by Embree itself, which sees to their padding and lifetime. Knows nothing of scenes, materials or light.

#[allow(unsafe_code, missing_docs, dead_code, non_camel_case_types, non_upper_case_globals, non_snake_case)]
#[allow(clippy::all, clippy::undocumented_unsafe_blocks)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}
#[allow(unsafe_code)]
mod device;
#[allow(unsafe_code)]
mod scene;
#[cfg(test)]
mod tests;

pub use device::Device;
pub use scene::{CommittedScene, Hits, Options, Quality, SceneBuilder, Traversal};
