//! Benchmark of `mrvis bench`: exact against multi-resolution visibility on the same segments.

mod audit;
mod classes;
mod context;
pub mod exact_reference;
mod gallery;
mod lights;
mod maps;
pub mod measure;
mod options;
pub mod page;
mod prepare;
pub mod receivers;
pub mod record;
mod run;
mod sample;
mod shown;
pub mod side_by_side;
pub mod sizes;
mod unaveraged;
pub mod workload;

pub use options::BenchOptions;
pub use record::Record;
pub use run::run;
pub use shown::text;
