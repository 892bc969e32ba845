//! Refinement: links with large errors are replaced by links between parts of their ends, in steps after each of which the light
//! is consistent (progressive multi-gridding [SD95 sec 6.2]; `docs/method.md`, Links and refinement).
//!
//! An [`Unrefined`] scene has the link of the root with itself, which stands for all exchange of light [Sillion 95]; refining makes it
//! a [`Refined`] one.

mod crossings;
mod feature_sizes;
mod importance;
mod link_measurement;
mod linked_scene;
mod points_view;
mod refine;
mod schedule;
mod sky_links;

pub use importance::apply_importance;
pub use linked_scene::LinkedScene;
pub use points_view::UNIFORM_IMPORTANCE;
pub use schedule::{Iteration, LinkClosing, Refined, StopReason, Unrefined};
#[cfg(test)]
pub use {
    importance::propagate_importance,
    link_measurement::remeasure_links,
    refine::{link_errors, refine},
};
