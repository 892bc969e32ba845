//! Entries of the header: one macro converts arguments and results.

/// The type of an argument in C.
macro_rules! in_c {
    (Handle<$of:ty>) => { *const $of };
    (Record<$of:ty>) => { *const $of };
    (Given<$of:ty>) => { *const $of };
    (Pointer<$of:ty>) => { *const $of };
    (Text) => { *const std::ffi::c_char };
    (OptionalText) => { *const std::ffi::c_char };
    (Made<$of:ty>) => { *mut *mut $of };
    // A `MutHandle`, a `MutPointer` or a place.
    ($kind:ident<$of:ty>) => { *mut $of };
    ($kind:ty) => { $kind };
}
pub(super) use in_c;

/// Conversion of a C argument to the type that the body of an entry uses.
macro_rules! taken {
    ($call:ident, $name:ident, Handle<$of:ty>) => {
        super::handle::object($call, $name, stringify!($name))?
    };
    ($call:ident, $name:ident, MutHandle<$of:ty>) => {
        super::handle::object($call, $name, stringify!($name))?
    };
    ($call:ident, $name:ident, Pointer<$of:ty>) => {
        $name
    };
    ($call:ident, $name:ident, MutPointer<$of:ty>) => {
        $name
    };
    ($call:ident, $name:ident, Record<$of:ty>) => {{
        // SAFETY: the caller gives a record.
        unsafe { super::record::read($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, Given<$of:ty>) => {{
        // SAFETY: the caller gives a record or NULL.
        unsafe { super::record::read_optional($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, Text) => {{
        // SAFETY: the caller gives text.
        unsafe { super::arguments::text($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, OptionalText) => {{
        // SAFETY: the caller gives text or NULL.
        unsafe { super::arguments::optional_text($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, RecordPlace<$of:ty>) => {{
        // SAFETY: the caller gives a record.
        unsafe { super::record::RecordPlace::of($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, OptionalRecordPlace<$of:ty>) => {{
        // SAFETY: the caller gives a record or NULL.
        unsafe { super::record::RecordPlace::optional($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, OptionalPlace<$of:ty>) => {{
        // SAFETY: the caller gives a place or NULL.
        unsafe { super::arguments::Place::optional($name, stringify!($name)) }?
    }};
    // A `Place`, or one of a handle that is `Made`.
    ($call:ident, $name:ident, $place:ident<$of:ty>) => {{
        // SAFETY: the caller gives a place.
        unsafe { super::arguments::Place::of($name, stringify!($name)) }?
    }};
    ($call:ident, $name:ident, $kind:ty) => {
        $name
    };
}
pub(super) use taken;

/// Conversion of the result of a body to the value that is written to the output argument.
macro_rules! given {
    (Made<$of:ty>, $value:expr) => {
        super::handle::give::<$of>($value)
    };
    ($place:ident<$of:ty>, $value:expr) => {
        $value
    };
}
pub(super) use given;

/// Defines an entry of the header by its arguments and its body. Arguments are `Handle`s, records that are `Given` (NULL: every member 0)
/// or required (`Record`), `Text`, numbers, pointers that the body reads or writes itself, and places of results that it sets itself.
/// With one result the body is its value: a value in a `Place`, a record, or a handle that is `Made`.
macro_rules! entry {
    ($function:ident($call:ident $(, $name:ident: $kind:ident $(<$of:ty>)?)*) $body:block) => {
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $function(
            $($name: super::entry::in_c!($kind $(<$of>)?)),*
        ) -> super::status::mrv_status {
            super::guard::guard(stringify!($function), |$call| {
                let _ = $call;
                $(let $name = super::entry::taken!($call, $name, $kind $(<$of>)?);)*
                $body
            })
        }
    };
    ($function:ident($call:ident $(, $name:ident: $kind:ident $(<$of:ty>)?)*) -> $result:ident: $place:ident<$made:ty> $body:block) => {
        super::entry::entry!($function($call $(, $name: $kind $(<$of>)?)*, $result: $place<$made>) {
            let made = $body;
            $result.set(super::entry::given!($place<$made>, made))
        });
    };
}
pub(super) use entry;
