//! The command `mrvis`. Exit code 0: done; 1: done, but a stated tolerance was missed; 2: error.

use std::alloc::{GlobalAlloc, Layout, System};

/// The system's allocator. If memory is refused the command ends with an error of one line, where Rust would abort.
struct Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

/// What was allocated, if it was.
fn given(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() {
        mrvis::cli::refused(bytes);
    }
    memory
}

#[allow(unsafe_code)]
// SAFETY: all is done by the system's allocator; nothing between allocates or panics.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised by the caller.
        given(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised by the caller.
        given(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as promised by the caller.
        given(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as promised by the caller.
        unsafe { System.dealloc(memory, layout) }
    }
}

fn main() -> std::process::ExitCode {
    mrvis::cli::main()
}
