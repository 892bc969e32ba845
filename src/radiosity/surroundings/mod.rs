//! Properties of the surroundings of every side, from a few rays: enclosure of clusters, ways out of the scene, emitted light
//! that leaves it, sides without light; and the power that arrives from beyond the scene.

mod arrived;
mod emission;
mod probe;
mod side_rays;
mod unlit;

pub use arrived::Arrived;
pub use emission::{SampledShare, emitted_share};
pub use probe::{Surroundings, probe, received_shares};
pub use side_rays::{ESCAPED, SideRays};
pub use unlit::{Unlit, unlit_sides};
