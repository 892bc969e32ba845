//! Statuses, and the message of the last error of a thread.

use mrvis::ErrorCategory;
use std::cell::RefCell;
use std::ffi::{CString, c_char};

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
        _ => MRV_ERROR_INTERNAL,
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

/// The message of the last error of this thread; empty before the first.
pub(super) fn message() -> *const c_char {
    MESSAGE.try_with(|message| message.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
