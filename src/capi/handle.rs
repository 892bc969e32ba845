//! Opaque handles: reference-counted objects that a C program holds by pointers.
//!
//! All live handles are listed with their type, so that a released handle or one of another type is an error and not a crash. The list
//! holds the complements of addresses: tools that look for leaks find the pointers of the program alone.

use super::arguments::null;
use super::guard::{Call, Failure, Outcome, Suspect};
use super::status::keep_message;
use crate::Error;
use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

/// An opaque type of the header.
pub trait Opaque: 'static {
    /// Its name.
    const NAME: &'static str;
    /// What stands behind it.
    type Value: Send + Sync + 'static;
}

/// What a handle points to.
pub struct Object<T> {
    value: T,
    /// References of the program.
    references: AtomicUsize,
    /// A call that used it ended by a defect.
    suspect: AtomicBool,
}

impl<T> Suspect for Object<T> {
    fn refuse(&self) {
        self.suspect.store(true, Ordering::Relaxed);
    }
}

impl<T> Deref for Object<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

/// Types of live handles by the complements of their addresses.
static LIVE: RwLock<BTreeMap<usize, &'static str>> = RwLock::new(BTreeMap::new());

/// A new handle with one reference.
pub fn give<H: Opaque>(value: H::Value) -> *mut H {
    let object = Object { value, references: AtomicUsize::new(1), suspect: AtomicBool::new(false) };
    let handle = Arc::into_raw(Arc::new(object));
    LIVE.write().unwrap_or_else(PoisonError::into_inner).insert(!handle.addr(), H::NAME);
    handle.cast::<H>().cast_mut()
}

/// The object of the handle that the argument `name` holds, alive until the result is dropped.
pub fn object<H: Opaque>(call: &Call, handle: *const H, name: &str) -> Outcome<Arc<Object<H::Value>>> {
    if handle.is_null() {
        return Err(null(name));
    }
    let live = LIVE.read().unwrap_or_else(PoisonError::into_inner);
    check::<H>(&live, handle, name)?;
    let pointer = handle.cast::<Object<H::Value>>();
    // SAFETY: the handle is listed as one of this type, so that `give` made it by `Arc::into_raw` of this type, and its reference
    // is not given back before it leaves the list, for which the list is locked.
    let object = unsafe {
        Arc::increment_strong_count(pointer);
        Arc::from_raw(pointer)
    };
    drop(live);
    call.uses(object.clone());
    if object.suspect.load(Ordering::Relaxed) {
        return Err(Failure::Internal(format!("`{name}` was in use when a defect occurred: release it")));
    }
    Ok(object)
}

/// Adds a reference of the program.
pub fn retain<H: Opaque>(call: &Call, handle: *const H, name: &str) -> Outcome {
    object(call, handle, name)?.references.fetch_add(1, Ordering::Relaxed);
    Ok(())
}

/// Gives a reference of the program back. A pointer that is no live handle of this type is ignored, with a message.
pub fn release<H: Opaque>(handle: *const H) {
    if handle.is_null() {
        return;
    }
    let mut live = LIVE.write().unwrap_or_else(PoisonError::into_inner);
    if let Err(Failure::Error(error)) = check::<H>(&live, handle, "handle") {
        return keep_message(&error.to_string());
    }
    let pointer = handle.cast::<Object<H::Value>>();
    // SAFETY: as in `object`.
    let last = unsafe { &*pointer }.references.fetch_sub(1, Ordering::Relaxed) == 1;
    if last {
        live.remove(&!handle.addr());
        drop(live);
        // SAFETY: the reference of `Arc::into_raw` in `give`; the handle left the list, so that nobody gives it back again.
        drop(unsafe { Arc::from_raw(pointer) });
    }
}

/// Whether the list has a handle of this type.
fn check<H: Opaque>(live: &BTreeMap<usize, &'static str>, handle: *const H, name: &str) -> Outcome {
    let what = match live.get(&!handle.addr()) {
        Some(&found) if found == H::NAME => return Ok(()),
        Some(found) => format!("a {found}"),
        None => "no live handle, perhaps released already".into(),
    };
    let want = H::NAME;
    Err(Error::Argument(format!("`{name}` {handle:p} is {what}: give a {want}")).into())
}
