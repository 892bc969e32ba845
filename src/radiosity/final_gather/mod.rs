//! Final gathering by rays: irradiance at points, the local pass that solves the exchange of elements, and the light that
//! elements gather from it.

mod bright_leaves;
mod cells_around;
mod direct_light;
mod element_light;
mod element_rays;
mod element_samples;
mod engine_choice;
mod exchange_samples;
mod face_parts;
mod gather_point;
mod gatherer;
mod hemisphere;
mod independent_light;
mod kept_power;
mod light_cells;
mod local_noise;
mod local_pass;
mod neighbours;
mod openings;
mod paths;
mod points;
mod ray_counts;
mod ray_rows;
mod reflected;
mod sharing;
mod sky_light;
mod smooth_light;
mod starts;
mod sun_shadows;
mod uneven_cells;
mod untraced;

pub use element_light::ElementSamples;
pub use gatherer::{Buffers, FinalGather, PathVertex};
pub use independent_light::IndependentLight;
pub use local_pass::{LocalPass, limit_negative_light};
pub use points::with_fewer_rays;
pub use ray_counts::LATE_RAYS;
