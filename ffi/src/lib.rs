//! The C interface `ffi/include/mrvis.h`: translation onto the public interface of the crate, and nothing else.
//!
//! Every entry is one [`guard::guard`] around a body; those of usual arguments are defined by the macro `entry`. A body turns pointers
//! into slices, records and handles with the functions of `arguments`, `record` and `handle`, calls the crate, and writes its outputs
//! last.
//!
//! Decisions that other interfaces take differently:
//!
//! * Options are records that begin with their size, not handles with setters: a program fills them in without a call that can fail, and
//!   members can still be appended, because `record` reads what an older program lacks as 0 and refuses what a newer one adds.
//! * Handles are looked up in a list of live ones in every call, so that a handle that was released or has
//!   another type is a status. No function skips checks; batches check positions in parallel, as in Rust.
//! * Large results (form factors, lightmaps, texts) are borrowed from their handle, others go into arrays of the caller.
//! * A call with a callback works on a thread of its own while the thread of the caller waits: the callback is then never concurrent.

#![allow(unsafe_code, non_camel_case_types)]

mod arguments;
mod bench;
mod builder;
mod call_progress;
mod elements;
mod entry;
mod fbem;
mod form_factors;
mod guard;
mod handle;
mod images;
mod library;
mod member_names;
mod model;
mod record;
mod scene;
mod solve;
mod status;
#[cfg(test)]
mod tests;
mod update;
mod visibility;

/// A handle `mrv_model *` of a model, for the benchmark of this interface.
#[doc(hidden)]
pub fn model_handle(model: mrvis::Model) -> *mut std::ffi::c_void {
    handle::give::<model::mrv_model>(model::NamedModel::new(model)).cast()
}
