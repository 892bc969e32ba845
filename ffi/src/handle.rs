//! Opaque handles: reference-counted objects that a C program holds by pointers.
//!
//! A handle is a number in the form of a pointer; no number is given twice. All live handles are listed with their objects, so that a
//! handle that was released, or has another type, is an error and never another object.

use super::arguments::null;
use super::guard::{Call, Failure, MayBeDamaged, Outcome};
use super::status::keep_message;
use mrvis::Error;
use std::any::Any;
use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

/// An opaque type of the header.
pub trait Opaque: 'static {
    /// Its name.
    const NAME: &'static str;
    /// Rust type of its objects.
    type Inner: Send + Sync + 'static;
}

/// Defines an opaque type, the Rust type of its objects, and the two functions that count its references.
macro_rules! handle {
    ($name:ident($argument:ident): $value:ty, $retain:ident, $release:ident) => {
        #[repr(C)]
        pub struct $name {
            _opaque: [u8; 0],
        }

        impl super::handle::Opaque for $name {
            const NAME: &'static str = stringify!($name);
            type Inner = $value;
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $retain($argument: *const $name) -> super::status::mrv_status {
            let body = |call: &_| super::handle::retain(call, $argument, stringify!($argument));
            super::guard::guard(stringify!($retain), body)
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $release($argument: *const $name) {
            super::guard::or_if_panics((), || super::handle::release($argument));
        }
    };
}
pub(super) use handle;

/// The object of a handle.
pub struct Object<T> {
    value: T,
    /// References of the program.
    references: AtomicUsize,
    /// Whether a call that used it panicked.
    may_be_damaged: AtomicBool,
}

impl<T> MayBeDamaged for Object<T> {
    fn refuse(&self) {
        self.may_be_damaged.store(true, Ordering::Relaxed);
    }
}

impl<T> Deref for Object<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

/// A live handle.
struct LiveHandle {
    /// Type of the handle.
    name: &'static str,
    object: Arc<dyn Any + Send + Sync>,
}

/// All live handles by their numbers.
static LIVE: RwLock<BTreeMap<usize, LiveHandle>> = RwLock::new(BTreeMap::new());
/// Number of the next handle, a multiple of [`STEP`].
static NEXT: AtomicUsize = AtomicUsize::new(STEP);
/// Difference of handles: that of aligned memory, for hosts that use the lowest bits of pointers.
const STEP: usize = 16;

/// A new handle with one reference.
pub fn give<H: Opaque>(value: H::Inner) -> *mut H {
    let object = Object { value, references: AtomicUsize::new(1), may_be_damaged: AtomicBool::new(false) };
    let handle = NEXT.fetch_add(STEP, Ordering::Relaxed);
    let live = LiveHandle { name: H::NAME, object: Arc::new(object) };
    LIVE.write().unwrap_or_else(PoisonError::into_inner).insert(handle, live);
    std::ptr::without_provenance_mut(handle)
}

/// The object of the handle that the argument `name` holds, alive until the result is dropped.
pub fn object<H: Opaque>(call: &Call, handle: *const H, name: &str) -> Outcome<Arc<Object<H::Inner>>> {
    if handle.is_null() {
        return Err(null(name));
    }
    let object = {
        let live = LIVE.read().unwrap_or_else(PoisonError::into_inner);
        listed(&live, handle, name)?
    };
    call.uses(object.clone());
    if object.may_be_damaged.load(Ordering::Relaxed) {
        return Err(Failure::Internal(format!("`{name}` was in use when a defect occurred: release it")));
    }
    Ok(object)
}

/// Adds a reference of the program.
pub fn retain<H: Opaque>(call: &Call, handle: *const H, name: &str) -> Outcome {
    object(call, handle, name)?.references.fetch_add(1, Ordering::Relaxed);
    Ok(())
}

/// Releases a reference of the program. A pointer that is no live handle of this type is ignored, with a message.
pub fn release<H: Opaque>(handle: *const H) {
    if handle.is_null() {
        return;
    }
    let mut live = LIVE.write().unwrap_or_else(PoisonError::into_inner);
    match listed(&live, handle, "handle") {
        Ok(object) => {
            let last = object.references.fetch_sub(1, Ordering::Relaxed) == 1;
            // The object is dropped after the lock, because dropping it may take long.
            let _ended = last.then(|| live.remove(&handle.addr()));
            drop(live);
        }
        Err(Failure::Error(error)) => keep_message(&error.to_string()),
        Err(Failure::Internal(_)) => {}
    }
}

/// The object of a handle of this type.
fn listed<H: Opaque>(
    live: &BTreeMap<usize, LiveHandle>,
    handle: *const H,
    name: &str,
) -> Outcome<Arc<Object<H::Inner>>> {
    let found = live.get(&handle.addr());
    if let Some(Ok(object)) =
        found.filter(|found| found.name == H::NAME).map(|found| found.object.clone().downcast())
    {
        return Ok(object);
    }
    let what = match found {
        Some(found) => format!("a {}", found.name),
        None => "no live handle, perhaps released already".into(),
    };
    let want = H::NAME;
    Err(Error::arguments(format!("`{name}` {handle:p} is {what}: give a {want}")).into())
}
