//! Statuses, and the message of the last error of a thread; versions.

use super::arguments::slice_mut;
use super::guard::{guard, quiet};
use crate::error::ErrorCategory;
use crate::model;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};

/// A status.
pub type mrv_status = i32;
pub const MRV_OK: mrv_status = 0;
pub const MRV_ERROR_INPUT: mrv_status = 1;
pub const MRV_ERROR_UNSUPPORTED: mrv_status = 2;
pub const MRV_ERROR_OUT_OF_MEMORY: mrv_status = 3;
pub const MRV_ERROR_CANCELLED: mrv_status = 4;
pub const MRV_ERROR_DEVICE: mrv_status = 5;
pub const MRV_ERROR_IO: mrv_status = 6;
pub const MRV_ERROR_INTERNAL: mrv_status = 7;

/// The status of a category of errors.
pub(super) fn of(category: ErrorCategory) -> mrv_status {
    match category {
        ErrorCategory::Input => MRV_ERROR_INPUT,
        ErrorCategory::Unsupported => MRV_ERROR_UNSUPPORTED,
        ErrorCategory::OutOfMemory => MRV_ERROR_OUT_OF_MEMORY,
        ErrorCategory::Cancelled => MRV_ERROR_CANCELLED,
        ErrorCategory::Device => MRV_ERROR_DEVICE,
        ErrorCategory::Io => MRV_ERROR_IO,
    }
}

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::default();
}

/// Keeps a message as that of the last error of this thread. At the end of a thread nothing is kept.
pub(super) fn keep_message(text: &str) {
    let bytes: Vec<u8> = text.bytes().filter(|&b| b != 0).collect();
    let text = CString::new(bytes).unwrap_or_default();
    let _ = MESSAGE.try_with(|message| message.replace(text));
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_error_message() -> *const c_char {
    quiet(c"".as_ptr(), || MESSAGE.try_with(|m| m.borrow().as_ptr()).unwrap_or(c"".as_ptr()))
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
    quiet(c"unknown".as_ptr(), || name.as_ptr())
}

#[unsafe(no_mangle)]
pub extern "C" fn mrv_version() -> i32 {
    let number = |text: &str| text.parse().unwrap_or(0);
    quiet(0, || {
        10_000 * number(env!("CARGO_PKG_VERSION_MAJOR"))
            + 100 * number(env!("CARGO_PKG_VERSION_MINOR"))
            + number(env!("CARGO_PKG_VERSION_PATCH"))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn mrv_embree_version(text: *mut c_char, size: usize) -> mrv_status {
    guard("mrv_embree_version", |_| {
        // SAFETY: the caller gives room for `size` bytes.
        let room = unsafe { slice_mut(text.cast::<u8>(), size.max(1), "text") }?;
        let version = model::embree_version()?;
        let length = version.len().min(size.saturating_sub(1));
        if let Some(room) = room.get_mut(..length + 1).filter(|_| size > 0) {
            room[..length].copy_from_slice(&version.as_bytes()[..length]);
            room[length] = 0;
        }
        Ok(())
    })
}
