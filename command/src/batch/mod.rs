//! Batches of jobs: the job file and what it expands to, dependencies, journal, folders and the table of results.
//!
//! A job is a command line of the program. This room makes names and values of options from the job file; it does not know which
//! options a command has, and does not run anything.

mod expand;
mod folders;
mod graph;
mod hashes;
mod job;
mod journal;
mod listed;
mod names;
mod parse;
mod report;
mod schedule;
mod table;

pub use expand::expand;
pub use expand::resolve_outputs;
pub use folders::{
    begin, check_outputs, lock, lock_split, publish, publish_left, remove, seal, sync_up, withdraw, work,
};
pub use graph::{check, order};
pub use hashes::{HashedFile, Hashes, hash_file, key};
#[cfg(test)]
pub use job::COMMANDS;
pub use job::TomlSource;
pub use job::{Job, Limits, Opt, Out, Reads, Value};
pub use journal::{Entries, Entry, Journal, Journals, Status, check_has_journal, read_journals};
pub use listed::{Listed, read_listed};
pub use names::Places;
pub use names::{TABLES, suggestion};
pub use parse::parse;
pub use report::{JobPicture, Report, report_page};
pub use schedule::{Capacity, Schedule, Task};
pub use table::grids;
pub use table::{rows, write_results};

#[cfg(test)]
mod tests;
