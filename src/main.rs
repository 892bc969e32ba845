//! The command `mrvis`. Exit code 0: done; 1: done, but a stated tolerance was missed; 2: error.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

#[global_allocator]
static ALLOCATOR: OrError = OrError;

fn main() -> std::process::ExitCode {
    mrvis::cli::main()
}

/// The system's allocator; ends the command with an error where the system refuses memory. The standard library would abort with a
/// backtrace, and its hook for that case is unstable.
struct OrError;

// SAFETY: all memory comes from `System` and goes back to it, with the layouts of the callers.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for OrError {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of `GlobalAlloc`, which is that of `System`.
        or_error(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as for `alloc`.
        or_error(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as for `alloc`.
        or_error(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as for `alloc`.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[inline]
fn or_error(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() {
        end(bytes);
    }
    memory
}

/// Ends the command with an error on standard error, without allocation.
#[cold]
#[allow(unsafe_code)]
fn end(bytes: usize) -> ! {
    static ENDING: AtomicBool = AtomicBool::new(false);
    // Another thread is about to end the command.
    while ENDING.swap(true, Ordering::Relaxed) {
        std::hint::spin_loop();
    }
    let mut line = [0u8; 256];
    let mut rest = &mut line[..];
    let _ = writeln!(
        rest,
        "mrvis: out of memory: the system refused {} kB more; take a smaller scene or coarser options, or allow more memory",
        bytes.div_ceil(1000)
    );
    let length = line.iter().position(|&byte| byte == 0).unwrap_or(line.len());
    // SAFETY: the buffer has so many bytes. The standard library's handle may need memory or a lock that this thread waits for;
    // a closed standard error is ignored.
    let _ = unsafe { libc::write(2, line.as_ptr().cast(), length) };
    // SAFETY: no requirement. Functions that run at an ordinary exit may need memory or locks.
    unsafe { libc::_exit(2) }
}
