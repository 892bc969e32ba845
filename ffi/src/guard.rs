//! Wrapper of the body of every entry: panics and errors become statuses, and the floating-point state of the caller is restored.

use super::member_names::{Records, c_name, exchange_records};
use super::status::{self, MRV_ERROR_INTERNAL, MRV_OK, mrv_status};
use mrvis::Error;
use smallvec::SmallVec;
use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Error of the body of an entry.
pub enum Failure {
    Error(Error),
    /// A panic or another internal error of this crate.
    Internal(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        Failure::Error(error)
    }
}

/// Result of a body and of the functions that it calls.
pub type Outcome<T = ()> = Result<T, Failure>;

/// An object that a panic may have left in an inconsistent state.
pub trait MayBeDamaged {
    /// Refuses further use.
    fn refuse(&self);
}

/// A running call.
pub struct Call {
    caller: FloatState,
    /// Objects of the handles that were given; they stay alive during the call. Four need no allocation.
    used: RefCell<SmallVec<[Arc<dyn MayBeDamaged>; 4]>>,
}

impl Call {
    /// Registers an object that the call uses.
    pub fn uses(&self, object: Arc<dyn MayBeDamaged>) {
        self.used.borrow_mut().push(object);
    }

    /// Runs code of the caller in the caller's floating-point state.
    pub fn in_caller_state<R>(&self, run: impl FnOnce() -> R) -> R {
        self.caller.enter();
        let result = run();
        FloatState::DEFAULT.enter();
        result
    }
}

/// Runs the body of an entry; gives its status and keeps the message of its error.
pub fn guard(name: &str, body: impl FnOnce(&Call) -> Outcome) -> mrv_status {
    let caller = FloatState::DEFAULT.enter();
    let call = Call { caller, used: RefCell::default() };
    // A callback of another call may have made this one.
    let records_before = exchange_records(Records::new());
    let (status, message) = match catch_unwind(AssertUnwindSafe(|| body(&call))) {
        Ok(Ok(())) => (MRV_OK, None),
        Ok(Err(Failure::Error(error))) => (status::of(error.category()), Some(error.worded(c_name))),
        Ok(Err(Failure::Internal(what))) => (MRV_ERROR_INTERNAL, Some(what)),
        Err(panic) => {
            call.used.borrow().iter().for_each(|object| object.refuse());
            (
                MRV_ERROR_INTERNAL,
                Some(format!("a defect of mrvis, please report it: {}", panic_message(&*panic))),
            )
        }
    };
    exchange_records(records_before);
    if let Some(what) = message {
        status::keep_message(&format!("{name}: {what}"));
    }
    // Another thread may have released a handle meanwhile: its object ends here.
    let _ = catch_unwind(AssertUnwindSafe(|| drop(call)));
    caller.enter();
    status
}

/// Runs the body of an entry that returns no status; returns `otherwise` if it panics.
pub fn or_if_panics<T>(otherwise: T, body: impl FnOnce() -> T) -> T {
    let caller = FloatState::DEFAULT.enter();
    let result = catch_unwind(AssertUnwindSafe(body)).unwrap_or(otherwise);
    caller.enter();
    result
}

/// The message of a panic.
pub fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message")
}

/// The floating-point control register as a caller left it.
#[derive(Clone, Copy)]
struct FloatState(Register);

#[cfg(target_arch = "x86_64")]
type Register = u32;
#[cfg(not(target_arch = "x86_64"))]
type Register = u64;

/// State that Rust code assumes, with which results are equal in every host: round to nearest, no flush to zero, no traps.
#[cfg(target_arch = "x86_64")]
const DEFAULT: Register = 0x1f80;
#[cfg(not(target_arch = "x86_64"))]
const DEFAULT: Register = 0;

impl FloatState {
    /// The default state.
    pub const DEFAULT: FloatState = FloatState(DEFAULT);

    /// Sets this state for the thread; returns the previous state.
    pub fn enter(&self) -> FloatState {
        let before = read();
        if before != self.0 {
            write(self.0);
        }
        FloatState(before)
    }
}

#[cfg(target_arch = "x86_64")]
fn read() -> Register {
    let mut value: Register = 0;
    // SAFETY: stores MXCSR into a local variable; every x86-64 processor has the instruction.
    unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
    value
}

#[cfg(target_arch = "x86_64")]
fn write(value: Register) {
    // SAFETY: `value` is the default or was read from the register, so that no reserved bit is set.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, preserves_flags)) };
}

#[cfg(target_arch = "aarch64")]
fn read() -> Register {
    let value: Register;
    // SAFETY: reads FPCR, which user code may read.
    unsafe { std::arch::asm!("mrs {}, fpcr", out(reg) value, options(nomem, nostack, preserves_flags)) };
    value
}

#[cfg(target_arch = "aarch64")]
fn write(value: Register) {
    // SAFETY: `value` is the default or was read from the register, so that no reserved bit is set.
    unsafe { std::arch::asm!("msr fpcr, {}", in(reg) value, options(nomem, nostack, preserves_flags)) };
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn read() -> Register {
    DEFAULT
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn write(_: Register) {}
