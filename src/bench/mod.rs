//! The measurement `mrvis bench`: exact against multi-resolution visibility on the same segments.

pub mod measure;
pub mod page;
pub mod record;
pub mod workload;
