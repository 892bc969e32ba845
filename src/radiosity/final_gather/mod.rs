//! Final gathering by rays: irradiance at points, and the local pass that gathers the irradiance of elements in scenes with
//! clusters.

mod direct_light;
mod gatherer;
mod local_noise;
mod local_pass;
mod paths;
mod points;
mod ray_rows;
mod starts;

pub use gatherer::{Buffers, FinalGather, PathVertex};
pub use local_pass::{LATE_RAYS, LocalPass};
pub use points::with_fewer_rays;
