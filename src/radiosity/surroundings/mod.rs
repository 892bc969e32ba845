//! What a few rays say about the surroundings of every side: enclosure of clusters, ways out of the scene, sides without light.

mod directed;
mod probe;
mod side_rays;
mod unlit;

pub use directed::directed_share;
pub use probe::{Surroundings, probe, received_shares};
pub use unlit::{Unlit, unlit_sides};
