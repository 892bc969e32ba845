//! Macros shared by the instruction sets of x86-64.

/// Defines the token that proves the presence of some features, and the function `run`, which alone makes one.
macro_rules! feature_token {
    ($token:ident, $enabled:literal, [$($feature:tt),+]) => {
        #[derive(Clone, Copy)]
        pub(super) struct $token(());

        pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
            #[target_feature(enable = $enabled)]
            fn inner<K: Kernel>(kernel: K) -> K::Output {
                kernel.run($token(()))
            }
            // Feature detection is one load and a test, cheap compared with any kernel.
            assert!($(is_x86_feature_detected!($feature))&&+);
            // SAFETY: the features were just detected.
            unsafe { inner(kernel) }
        }
    };
}
pub(super) use feature_token;

/// The body of an operation: intrinsics without memory access, or on references of the full width.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: a token exists only inside `run`, which checked the features; loads and stores are unaligned ones on references to
        // sixteen whole elements.
        unsafe { $e }
    };
}
pub(super) use op;

/// Defines `Simd::prefetch`.
macro_rules! prefetch {
    () => {
        #[inline(always)]
        fn prefetch<T>(self, value: &T) {
            let start: *const i8 = std::ptr::from_ref(value).cast();
            for line in 0..size_of::<T>().div_ceil(64) {
                // A prefetch never faults; these lines belong to the value.
                op!(_mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)));
            }
        }
    };
}
pub(super) use prefetch;
