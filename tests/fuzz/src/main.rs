//! Feeds inputs that libFuzzer makes to the reader of files that the variable `READER` names.
#![no_main]

use std::sync::LazyLock;

static READER: LazyLock<String> = LazyLock::new(|| std::env::var("READER").expect("READER names a reader"));

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // An error is a result like any other.
    let _ = mrvis::internals::readers::read(&READER, bytes);
});
