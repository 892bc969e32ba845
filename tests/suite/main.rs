//! Tests of the whole project, in one binary.

#[cfg(unix)]
mod batch;
mod capi;
mod cli;
mod determinism;
mod ended;
mod features;
mod fuzz;
mod hostile;
mod install;
mod light;
mod lighting;
#[cfg(feature = "mpi")]
mod mpi;
mod outdoor;
mod outputs;
mod package;
mod pages;
mod reproduced;
mod run;
mod scenes;
mod shown;
mod tidy;
