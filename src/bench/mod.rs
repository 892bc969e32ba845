//! Benchmark of `mrvis bench`: exact against multi-resolution visibility on the same segments.

mod audit;
mod classes;
mod context;
mod gallery;
mod lights;
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
mod scaling;
pub mod side_by_side;
pub mod sizes;
pub mod solve_scaling;
mod surface;
mod target;
mod unaveraged;
mod unbiased;
pub mod workload;

pub use options::{Options, Target};
pub use record::Record;
pub use run::run;
pub use scaling::{check_scaling, scaling};
