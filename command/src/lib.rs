//! The command `mrvis`, as a library for its tests.

mod batch;
mod cli;
#[doc(hidden)]
pub mod readers;
mod reproduce;

pub use cli::main;
