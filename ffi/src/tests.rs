//! Records of other versions, defects, and handles that are no longer.

mod header;

use super::arguments::{check_pointer, put_text};
use super::guard::{Outcome, guard};
use super::handle::object;
use super::library::mrv_error_message;
use super::record::{RecordPlace, read, read_optional, record};
use super::scene::{mrv_scene, mrv_scene_generate, mrv_scene_get_unit, mrv_scene_release, mrv_scene_retain};
use super::status::{MRV_ERROR_INPUT, MRV_ERROR_INTERNAL, MRV_ERROR_UNSUPPORTED, MRV_OK, mrv_status};
use std::ffi::{CStr, c_char};

// A record as it was in its first version.
record!(16: struct First {
    struct_size: usize,
    a: u64,
});

// The same with a member that was appended later.
record!(16: struct Second {
    struct_size: usize,
    a: u64,
    b: u64,
});

/// The status of a body, and its message.
fn run<T>(body: impl FnOnce() -> Outcome<T>) -> (mrv_status, Option<T>, String) {
    let mut result = None;
    let status = guard("run", |_| {
        result = Some(body()?);
        Ok(())
    });
    // SAFETY: the message ends with NUL and is valid until the next error of this thread.
    let message = unsafe { CStr::from_ptr(mrv_error_message()) }.to_string_lossy().into_owned();
    (status, result, message)
}

/// An older caller reaches a newer library and the other way round.
#[test]
fn records_of_other_versions_are_understood() {
    let old = First { struct_size: 16, a: 5 };
    // SAFETY: the record has the size that it states.
    let (status, read_new, _) = run(|| unsafe { read::<Second>((&raw const old).cast(), "r") });
    let read_new = read_new.expect("a record");
    assert!(status == MRV_OK && (read_new.a, read_new.b) == (5, 0));
    let mut new = Second { struct_size: 24, a: 6, b: 0 };
    // SAFETY: as above.
    let (status, read_old, _) = run(|| unsafe { read::<First>((&raw const new).cast(), "r") });
    assert!(status == MRV_OK && read_old.expect("a record").a == 6);
    new.b = 1;
    // SAFETY: as above.
    let (status, _, message) = run(|| unsafe { read::<First>((&raw const new).cast(), "r") });
    assert!(status == MRV_ERROR_UNSUPPORTED && message.contains("First"), "{message}");
    for size in [0, 8, 15, 1 << 20, usize::MAX] {
        let wrong = First { struct_size: size, a: 0 };
        // SAFETY: nothing behind the first member is read.
        let (status, _, message) = run(|| unsafe { read::<First>(&raw const wrong, "r") });
        assert!(
            status == MRV_ERROR_INPUT && message.contains(&format!("`r.struct_size` {size}")),
            "{message}"
        );
    }
    // SAFETY: NULL stands for the default.
    assert_eq!(run(|| unsafe { read_optional::<Second>(std::ptr::null(), "r") }).1.expect("zeros").b, 0);
}

/// Results are written into records of other versions, and not behind them.
#[test]
fn results_fit_records_of_other_versions() {
    let mut all = [16u64, 7, 7];
    let value = Second { struct_size: 0, a: 1, b: 2 };
    let write = |all: &mut [u64]| {
        // SAFETY: the record has the size that it states.
        run(|| unsafe { RecordPlace::of(all.as_mut_ptr().cast::<Second>(), "r")?.set(value) }).0
    };
    assert_eq!((write(&mut all), all), (MRV_OK, [16, 1, 7]));
    let mut newer = [32u64, 7, 7, 7, 7];
    assert_eq!((write(&mut newer), newer), (MRV_OK, [32, 1, 2, 0, 7]));
}

/// After a defect the handles of the call are refused, but for their release.
#[test]
fn defects_are_a_status() {
    let mut scene: *mut mrv_scene = std::ptr::null_mut();
    // SAFETY: text and a place; a handle; room for eight bytes.
    unsafe {
        assert_eq!(mrv_scene_generate(c"cornell".as_ptr(), &raw mut scene), MRV_OK);
        let status = guard("test", |call| {
            object(call, scene.cast_const(), "scene")?;
            panic!("an oversight {}", 7)
        });
        assert_eq!(status, MRV_ERROR_INTERNAL);
        let message = CStr::from_ptr(mrv_error_message()).to_str().expect("text");
        assert_eq!(message, "test: a defect of mrvis, please report it: an oversight 7");
        let mut unit = [0 as c_char; 8];
        assert_eq!(mrv_scene_get_unit(scene, unit.as_mut_ptr(), 8), MRV_ERROR_INTERNAL);
        mrv_scene_release(scene);
        assert_eq!(mrv_scene_retain(scene), MRV_ERROR_INPUT);
    }
}

#[test]
fn text_is_cut_between_characters() {
    for (size, want) in [(1, ""), (2, "a"), (3, "a"), (4, "aé"), (9, "aé")] {
        let mut room = [1u8; 10];
        // SAFETY: `room` has at least `size` bytes.
        let (status, ..) = run(|| unsafe { put_text("aé", room.as_mut_ptr().cast(), size, "t") });
        assert_eq!((status, &room[..want.len()], room[want.len()]), (MRV_OK, want.as_bytes(), 0));
        assert!(room[size..].iter().all(|&b| b == 1));
    }
    assert_eq!(run(|| check_pointer(4097 as *const u32, "p")).0, MRV_ERROR_INPUT);
}
