//! Records that begin with their size, so that later versions can append members.

use super::arguments::{check_pointer, wrong};
use super::guard::Outcome;
use super::member_names::{Members, add_record};
use mrvis::Error;
use std::mem::MaybeUninit;

/// A record of the header.
///
/// # Safety
/// The type is `repr(C)`, its first member is `struct_size: usize`, and every bit pattern is a value: numbers, pointers and optional
/// functions alone.
pub unsafe trait Record: Copy {
    /// Its name.
    const NAME: &'static str;
    /// Size of the record in its first version, bytes: smaller sizes are errors.
    const FIRST_SIZE: usize;
    /// Its members, for messages.
    const MEMBERS: Members;
}

/// Defines a record with these members, and its size in its first version.
macro_rules! record {
    ($first_size:literal: struct $name:ident { $($member:ident: $kind:ty),+ $(,)? }) => {
        #[repr(C)]
        #[derive(Clone, Copy)]
        pub struct $name {
            $(pub $member: $kind),+
        }
        // SAFETY: the type is `repr(C)`; `tests` compares it with the header, and the records of this room have such members.
        unsafe impl super::record::Record for $name {
            const NAME: &'static str = stringify!($name);
            const FIRST_SIZE: usize = $first_size;
            const MEMBERS: super::member_names::Members = &[$(stringify!($member)),+];
        }
        const _: () = assert!(std::mem::offset_of!($name, struct_size) == 0 && $first_size <= size_of::<$name>());
    };
}
pub(super) use record;

/// Largest accepted size of a record, bytes: four times that of the largest record. An uninitialised size is usually larger.
const MAX_SIZE: usize = 1024;

/// A record with every member 0.
pub fn zero<R: Record>() -> R {
    // SAFETY: every bit pattern is a value.
    unsafe { MaybeUninit::zeroed().assume_init() }
}

/// The size that the caller states.
///
/// # Safety
/// `pointer` is NULL or a record of at least the stated size.
unsafe fn stated_size<R: Record>(pointer: *const R, name: &str) -> Outcome<usize> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL and aligned; the size is the first member of every version.
    let size = unsafe { pointer.cast::<usize>().read() };
    if size < R::FIRST_SIZE || size > MAX_SIZE {
        let record = R::NAME;
        return wrong(format!(
            "`{name}.struct_size` {size}: set it to sizeof({record}), now {}",
            size_of::<R>()
        ));
    }
    Ok(size)
}

/// The record of the caller; members that its version lacks are 0. Messages of this call can name its members.
///
/// # Safety
/// `pointer` is NULL or a record of the size that it states.
pub unsafe fn read<R: Record>(pointer: *const R, name: &'static str) -> Outcome<R> {
    add_record(name, R::MEMBERS);
    // SAFETY: as for this function.
    unsafe { read_entry(pointer, name) }
}

/// The same for an entry of an array, whose members messages name by the entry.
///
/// # Safety
/// As for [`read`].
pub unsafe fn read_entry<R: Record>(pointer: *const R, name: &str) -> Outcome<R> {
    // SAFETY: as for this function.
    let size = unsafe { stated_size(pointer, name) }?;
    let (from, mut record) = (pointer.cast::<u8>(), zero::<R>());
    // SAFETY: both have this number of bytes; every bit pattern is a value.
    unsafe { from.copy_to_nonoverlapping((&raw mut record).cast(), size.min(size_of::<R>())) };
    // SAFETY: the caller states that the record has `size` bytes.
    let unknown = (size_of::<R>()..size).any(|i| unsafe { from.add(i).read() } != 0);
    if unknown {
        return Err(Error::Unsupported(format!(
            "`{name}` sets members of {} that this version of mrvis does not know: set them to 0 or install a later version",
            R::NAME
        ))
        .into());
    }
    Ok(record)
}

/// The record of the caller, or one with every member 0 for NULL.
///
/// # Safety
/// As for [`read`].
pub unsafe fn read_optional<R: Record>(pointer: *const R, name: &'static str) -> Outcome<R> {
    if pointer.is_null() {
        add_record(name, R::MEMBERS);
        return Ok(zero());
    }
    // SAFETY: as for this function.
    unsafe { read(pointer, name) }
}

/// Output argument of a record.
pub struct RecordPlace<R> {
    pointer: *mut R,
    size: usize,
}

impl<R: Record> RecordPlace<R> {
    /// The place of the argument `name`.
    ///
    /// # Safety
    /// As for [`read`], as long as the place lives.
    pub unsafe fn of(pointer: *mut R, name: &str) -> Outcome<RecordPlace<R>> {
        // SAFETY: as for this function.
        Ok(RecordPlace { pointer, size: unsafe { stated_size(pointer, name) }? })
    }

    /// The same for an argument that may be NULL: nothing is written then.
    ///
    /// # Safety
    /// As for [`read`].
    pub unsafe fn optional(pointer: *mut R, name: &str) -> Outcome<RecordPlace<R>> {
        if pointer.is_null() {
            return Ok(RecordPlace { pointer, size: 0 });
        }
        // SAFETY: as for this function.
        unsafe { RecordPlace::of(pointer, name) }
    }

    /// Writes all members but the size; those that this version does not know become 0. Cannot fail: the end of most calls.
    pub fn set(self, value: R) -> Outcome {
        if self.pointer.is_null() {
            return Ok(());
        }
        let (to, own, head) = (self.pointer.cast::<u8>(), size_of::<R>(), size_of::<usize>());
        let known = self.size.min(own);
        // SAFETY: both have this number of bytes by the promise that was given with the pointer, and the first member is not written.
        unsafe {
            (&raw const value).cast::<u8>().add(head).copy_to_nonoverlapping(to.add(head), known - head);
            to.add(known).write_bytes(0, self.size - known);
        }
        Ok(())
    }
}
