//! The C interface `ffi/include/mrvis.h`: translation onto the public interface of the crate, and nothing else.
//!
//! Every entry is one [`guard::guard`] around a body. A body turns pointers into slices, records and handles with the functions of
//! `arguments`, `record` and `handle`, calls the crate, and writes its outputs last.

#![allow(unsafe_code, non_camel_case_types)]

mod arguments;
mod float_state;
mod guard;
mod handle;
mod record;
mod scene;
mod status;
#[cfg(test)]
mod tests;
