//! The measurement `mrvis bench`: exact against multi-resolution visibility on the same segments.

pub mod measure;
pub mod page;
mod receivers;
pub mod record;
mod run;
mod sizes;
pub mod workload;

pub use receivers::{Receiver, choose as choose_receivers};
pub use run::{Options, Progress, run};
pub use sizes::default_sizes;
