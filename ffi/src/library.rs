//! Functions about the library itself: messages, names of statuses, versions.

use super::arguments::{check_room, put_text};
use super::entry::entry;
use super::guard::or_if_panics;
use super::status::{
    self, MRV_ERROR_CANCELLED, MRV_ERROR_DEVICE, MRV_ERROR_INPUT, MRV_ERROR_INTERNAL, MRV_ERROR_IO,
    MRV_ERROR_OUT_OF_MEMORY, MRV_ERROR_UNSUPPORTED, MRV_OK, mrv_status,
};
use mrvis::internals::model;
use std::ffi::{CStr, c_char};

#[unsafe(no_mangle)]
pub extern "C" fn mrv_error_message() -> *const c_char {
    or_if_panics(c"".as_ptr(), status::message)
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_status_name(status: mrv_status) -> *const c_char {
    let name: &CStr = match status {
        MRV_OK => c"MRV_OK",
        MRV_ERROR_INPUT => c"MRV_ERROR_INPUT",
        MRV_ERROR_UNSUPPORTED => c"MRV_ERROR_UNSUPPORTED",
        MRV_ERROR_OUT_OF_MEMORY => c"MRV_ERROR_OUT_OF_MEMORY",
        MRV_ERROR_CANCELLED => c"MRV_ERROR_CANCELLED",
        MRV_ERROR_DEVICE => c"MRV_ERROR_DEVICE",
        MRV_ERROR_IO => c"MRV_ERROR_IO",
        MRV_ERROR_INTERNAL => c"MRV_ERROR_INTERNAL",
        _ => c"unknown",
    };
    or_if_panics(c"unknown".as_ptr(), || name.as_ptr())
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_version() -> i32 {
    let number = |text: &str| text.parse().unwrap_or(0);
    or_if_panics(0, || {
        10_000 * number(env!("CARGO_PKG_VERSION_MAJOR"))
            + 100 * number(env!("CARGO_PKG_VERSION_MINOR"))
            + number(env!("CARGO_PKG_VERSION_PATCH"))
    })
}

entry!(mrv_embree_version(call, text: MutPointer<c_char>, size: usize) {
    check_room(text, size, "text")?;
    let version = model::embree_version()?;
    // SAFETY: the caller gives room for `size` bytes.
    unsafe { put_text(&version, text, size, "text") }
});
