//! The floating-point state of a thread: rounding, flush to zero, denormals are zero.

/// The floating-point control register as a caller left it.
#[derive(Clone, Copy)]
pub struct FloatState(Register);

#[cfg(target_arch = "x86_64")]
type Register = u32;
#[cfg(not(target_arch = "x86_64"))]
type Register = u64;

/// What Rust code assumes, and what makes results the same in every host: round to nearest, no flush to zero, no traps.
#[cfg(target_arch = "x86_64")]
const DEFAULT: Register = 0x1f80;
#[cfg(not(target_arch = "x86_64"))]
const DEFAULT: Register = 0;

impl FloatState {
    /// The default state.
    pub const DEFAULT: FloatState = FloatState(DEFAULT);

    /// Makes this the state of the thread; gives the one before.
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
