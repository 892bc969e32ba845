//! Benchmark of `mrvis bench`: exact against multi-resolution visibility on the same segments.

mod audit;
mod context;
mod gallery;
pub mod measure;
mod options;
pub mod page;
mod pilot;
mod prepare;
mod receivers;
pub mod record;
pub mod reference;
mod rounds;
mod rows;
mod run;
mod sample;
mod scaling;
pub mod side_by_side;
mod sizes;
pub mod solve_scaling;
mod surface;
mod target;
mod unbiased;
pub mod workload;

pub use options::{MAX_THREADS, Options, Target};
pub use receivers::{Receiver, choose as choose_receivers};
pub use run::run;
pub use scaling::{check_scaling, scaling};
pub use sizes::default_sizes;
