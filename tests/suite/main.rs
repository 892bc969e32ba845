//! Tests of the whole project, in one binary.

#[cfg(all(feature = "cli", unix))]
mod batch;
#[cfg(feature = "capi")]
mod capi;
#[cfg(feature = "cli")]
mod cli;
#[cfg(feature = "cli")]
mod cures;
#[cfg(feature = "cli")]
mod determinism;
#[cfg(feature = "cli")]
mod ended;
mod features;
#[cfg(feature = "cli")]
mod fuzz;
#[cfg(feature = "cli")]
mod hostile;
#[cfg(feature = "cli")]
mod install;
#[cfg(feature = "cli")]
mod light;
#[cfg(feature = "cli")]
mod lighting;
#[cfg(feature = "cli")]
mod outputs;
#[cfg(feature = "cli")]
mod package;
#[cfg(feature = "cli")]
mod pages;
#[cfg(feature = "cli")]
mod reproduced;
#[cfg(feature = "cli")]
mod run;
#[cfg(feature = "cli")]
mod scenes;
#[cfg(feature = "cli")]
mod shown;
#[cfg(feature = "cli")]
mod target;
mod tidy;
#[cfg(feature = "cli")]
mod under_a_sky;
#[cfg(feature = "cli")]
mod upright;
