//! Feeds inputs that libFuzzer makes to the reader of files that the variable `READER` names.
#![no_main]

use mrvis_command::readers::{read, sample_cache};
use std::{env::var, path::Path, sync::LazyLock};

static READER: LazyLock<String> = LazyLock::new(|| var("READER").expect("READER names a reader"));

/// Cache files depend on the program, so that one is made as a beginning.
fn prepare() {
    // The hook of the library would end the process at a panic that the reader catches.
    std::panic::set_hook(Box::new(|info| eprintln!("{info}")));
    if *READER == "cache" {
        let folder = var("SEEDS").expect("SEEDS names the folder of inputs");
        std::fs::write(Path::new(&folder).join("sample"), sample_cache()).expect("written");
    }
}

libfuzzer_sys::fuzz_target!(
    init: prepare(),
    |bytes: &[u8]| {
        // An error is a result like any other.
        let _ = read(&READER, bytes);
    }
);
