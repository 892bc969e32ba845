//! Another static library in Rust, which a host links beside that of mrvis. It uses threads, unwinding and hash tables of its own copy
//! of the standard library.

use std::collections::HashMap;

#[unsafe(no_mangle)]
pub extern "C" fn other_sum(count: u64) -> u64 {
    let halves = [0, 1].map(|half| {
        std::thread::spawn(move || {
            let table: HashMap<u64, u64> = (0..count).filter(|i| i % 2 == half).map(|i| (i, i)).collect();
            table.values().sum::<u64>()
        })
    });
    halves.into_iter().map(|thread| thread.join().unwrap_or(0)).sum()
}

#[unsafe(no_mangle)]
pub extern "C" fn other_catches() -> i32 {
    std::panic::set_hook(Box::new(|_| ()));
    i32::from(std::panic::catch_unwind(|| panic!("caught")).is_err())
}
