//! Pointers of a C program as slices and text.

use super::guard::{Failure, Outcome};
use mrvis::Error;
use std::ffi::{CStr, CString, c_char};

/// A required pointer is NULL.
pub fn null(name: &str) -> Failure {
    Error::arguments(format!("`{name}` is NULL: it is required")).into()
}

/// An error of an argument.
pub fn wrong<T>(what: String) -> Outcome<T> {
    Err(Error::arguments(what).into())
}

/// Refuses NULL and addresses that do not suit the type.
pub fn check_pointer<T>(pointer: *const T, name: &str) -> Outcome {
    if pointer.is_null() {
        return Err(null(name));
    }
    if !pointer.is_aligned() {
        let align = align_of::<T>();
        return wrong(format!("`{name}` {pointer:p}: its address must be a multiple of {align}"));
    }
    Ok(())
}

/// Refuses NULL, wrong addresses, and numbers of entries that no memory holds. Without entries every pointer is right.
pub fn check_array<T>(pointer: *const T, count: usize, name: &str) -> Outcome {
    if count == 0 {
        return Ok(());
    }
    check_pointer(pointer, name)?;
    match count.checked_mul(size_of::<T>()).filter(|&bytes| isize::try_from(bytes).is_ok()) {
        Some(_) => Ok(()),
        None => wrong(format!("`{name}` with {count} entries is larger than memory: give their number")),
    }
}

/// An array of the caller.
///
/// # Safety
/// `pointer` is NULL or the array has `count` entries, which nobody changes during the call. Every bit pattern is a `T`.
pub unsafe fn slice<'a, T>(pointer: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    check_array(pointer, count, name)?;
    if count == 0 {
        return Ok(&[]);
    }
    // SAFETY: it is neither NULL nor misaligned nor too large; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// An array of the caller that is written.
///
/// # Safety
/// `pointer` is NULL or there is room for `count` entries, which nobody else uses during the call. Every bit pattern is a `T`.
pub unsafe fn slice_mut<'a, T>(pointer: *mut T, count: usize, name: &str) -> Outcome<&'a mut [T]> {
    check_array(pointer, count, name)?;
    if count == 0 {
        return Ok(&mut []);
    }
    // SAFETY: it is neither NULL nor misaligned nor too large; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

/// Text of the caller.
///
/// # Safety
/// `pointer` is NULL or text that ends with NUL and that nobody changes during the call.
pub unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Outcome<&'a str> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL; the rest is the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    match text.to_str() {
        Ok(text) => Ok(text),
        Err(_) => wrong(format!("`{name}` {text:?}: must be UTF-8")),
    }
}

/// Text of the caller that may be missing.
///
/// # Safety
/// As for [`text`].
pub unsafe fn optional_text<'a>(pointer: *const c_char, name: &str) -> Outcome<Option<&'a str>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: as for this function.
    unsafe { text(pointer, name) }.map(Some)
}

/// Texts of the caller.
///
/// # Safety
/// As for [`slice`], and for [`text`] each.
pub unsafe fn texts<'a>(pointer: *const *const c_char, count: usize, name: &str) -> Outcome<Vec<&'a str>> {
    // SAFETY: as for this function.
    let all = unsafe { slice(pointer, count, name) }?;
    // SAFETY: as for this function.
    all.iter().enumerate().map(|(i, &p)| unsafe { text(p, &format!("{name}[{i}]")) }).collect()
}

/// Output argument of a call. It is written last, after everything that can fail.
pub struct Place<T>(*mut T);

impl<T> Place<T> {
    /// The place of the argument `name`.
    ///
    /// # Safety
    /// The pointer has room for a `T` as long as the place lives.
    pub unsafe fn of(pointer: *mut T, name: &str) -> Outcome<Place<T>> {
        check_pointer(pointer, name)?;
        Ok(Place(pointer))
    }

    /// The same for an argument that may be NULL: nothing is written then.
    ///
    /// # Safety
    /// As for [`Place::of`].
    pub unsafe fn optional(pointer: *mut T, name: &str) -> Outcome<Place<T>> {
        // SAFETY: as for this function.
        if pointer.is_null() { Ok(Place(pointer)) } else { unsafe { Place::of(pointer, name) } }
    }

    /// Writes the result, which cannot fail: the end of most calls.
    pub fn set(self, value: T) -> Outcome {
        if !self.0.is_null() {
            // SAFETY: not misaligned; the rest is the promise that was given with the pointer.
            unsafe { self.0.write(value) };
        }
        Ok(())
    }
}

/// The value that a number of the caller stands for, by the constants of the header.
macro_rules! one_of {
    ($argument:expr, $number:expr, $($($constant:ident)|+ => $value:expr),+ $(,)?) => {
        match $number {
            $($($constant)|+ => $value,)+
            other => {
                let names = [$($(stringify!($constant)),+),+].join(", ");
                return super::arguments::wrong(format!("`{}` {other}: give one of {names}", $argument));
            }
        }
    };
}
pub(super) use one_of;

/// Sets an option of the caller; 0 stands for the default.
pub fn set<T: Default + PartialEq, O: From<T>>(option: &mut O, given: T) {
    if given != T::default() {
        *option = given.into();
    }
}

/// A number of entries; one that no memory holds if it does not fit.
pub fn count_of(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// The entry of a list that a caller asks for by its number; `of` has the list.
pub fn nth<'a, T>(list: &'a [T], index: u64, of: &str, what: &str) -> Outcome<&'a T> {
    match list.get(count_of(index)) {
        Some(entry) => Ok(entry),
        None => wrong(format!("`index` {index}: {of} has {} {what}", list.len())),
    }
}

/// Refuses members that have no meaning yet.
pub fn no_reserved(value: u32, name: &str) -> Outcome {
    if value == 0 { Ok(()) } else { wrong(format!("`{name}` {value}: must be 0")) }
}

/// Text for a C program; NUL within it is left out.
pub fn c_text(text: &str) -> CString {
    CString::new(text.bytes().filter(|&b| b != 0).collect::<Vec<_>>()).unwrap_or_default()
}

/// Refuses room for text without any byte.
pub fn check_room(room: *mut c_char, size: usize, name: &str) -> Outcome {
    check_pointer(room, name)?;
    if size == 0 {
        return wrong("`size` 0: must be at least 1, for the NUL at the end".into());
    }
    Ok(())
}

/// Writes text and the NUL behind it; what does not fit is cut between two characters.
///
/// # Safety
/// There is room for `size` bytes.
pub unsafe fn put_text(text: &str, room: *mut c_char, size: usize, name: &str) -> Outcome {
    check_room(room, size, name)?;
    // SAFETY: as for this function.
    let room = unsafe { slice_mut(room.cast::<u8>(), size, name) }?;
    let length = (0..=text.len().min(size - 1)).rev().find(|&n| text.is_char_boundary(n)).unwrap_or(0);
    room[..length].copy_from_slice(&text.as_bytes()[..length]);
    room[length] = 0;
    Ok(())
}

/// Address range of an array.
#[derive(Clone, Copy)]
pub struct Span {
    name: &'static str,
    start: usize,
    end: usize,
}

impl Span {
    /// An array of `bytes` bytes; NULL is no memory.
    pub fn new<T>(name: &'static str, array: *const T, bytes: usize) -> Span {
        let start = array.addr();
        Span { name, start, end: start.saturating_add(bytes) }
    }

    /// An array of `count` entries.
    pub fn of<T>(name: &'static str, array: *const T, count: usize) -> Span {
        Span::new(name, array, count.saturating_mul(size_of::<T>()))
    }

    fn overlaps(&self, other: &Span) -> bool {
        self.start != 0 && other.start != 0 && self.start < other.end && other.start < self.end
    }
}

/// Refuses outputs that overlap each other or an input.
pub fn check_apart(inputs: &[Span], outputs: &[Span]) -> Outcome {
    for (i, out) in outputs.iter().enumerate() {
        let others = inputs.iter().chain(&outputs[i + 1..]);
        if let Some(other) = others.into_iter().find(|other| out.overlaps(other)) {
            return wrong(format!(
                "`{}` and `{}` overlap: give each memory of its own",
                out.name, other.name
            ));
        }
    }
    Ok(())
}
