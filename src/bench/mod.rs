//! Benchmark of `mrvis bench`: exact against multi-resolution visibility on the same segments.

mod audit;
mod classes;
mod context;
mod gallery;
mod maps;
pub mod measure;
mod options;
pub mod page;
mod pilot;
mod prepare;
pub mod receivers;
pub mod record;
pub mod reference;
mod rounds;
mod rows;
mod run;
mod sample;
#[cfg(any(test, feature = "internals"))]
mod scaling;
pub mod side_by_side;
pub mod sizes;
#[cfg(any(test, feature = "internals"))]
pub mod solve_scaling;
mod surface;
mod target;
mod unaveraged;
mod unbiased;
pub mod workload;

pub use options::{Options, Target};
#[cfg(any(test, feature = "internals"))]
pub use record::Record;
pub use run::run;
#[cfg(any(test, feature = "internals"))]
pub use scaling::{check_scaling, scaling};
