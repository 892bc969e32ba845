//! Memory that the machine has left, and how much of it may be used.

/// Part of the available memory that is used if the caller states no limit: the rest is for the system and for what is
/// not estimated.
pub const PART: f64 = 0.8;

/// Bytes that may be used if the caller states no limit; `None` where the system does not report what is available.
pub fn usable() -> Option<u64> {
    Some((PART * available()? as f64) as u64)
}

/// Memory available for allocation, bytes: of the machine, and of the control group that the process is in.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let machine = line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? * 1024;
    let number =
        |name| std::fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok()?.trim().parse::<u64>().ok();
    let group = number("memory.max").zip(number("memory.current")).map(|(max, now)| max.saturating_sub(now));
    Some(group.map_or(machine, |group| group.min(machine)))
}
