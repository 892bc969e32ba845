use super::*;

/// 10 million samples within 2 GiB. Counts all of the process: run it alone.
#[test]
#[ignore = "takes a minute in a release build"]
#[cfg(target_os = "linux")]
fn ten_million_samples_fit_two_gibibytes() {
    let grid = fractal(3163, 3163, 10.0, 3000.0, 0.5, 7).expect("a grid");
    let values = sky_view(&grid);
    let status = std::fs::read_to_string("/proc/self/status").expect("status");
    let line = status.lines().find(|l| l.starts_with("VmHWM")).expect("a line");
    let peak: u64 = line.split_ascii_whitespace().nth(1).and_then(|v| v.parse().ok()).expect("kB");
    println!("{} values, {} MiB", values.len(), peak >> 10);
    assert!(peak < 2 << 20);
}
