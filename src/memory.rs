//! Available memory of the machine, and the fraction of it that may be used.

use crate::{Error, Result};
use std::fs::read_to_string;
use std::path::Path;

/// Fraction of the available memory that is used if the caller states no limit: the rest is for the system and for what is not estimated.
pub const USABLE_FRACTION: f64 = 0.8;

/// Bytes that may be used if the caller states no limit; `None` where the system does not report what is available.
pub fn usable() -> Option<u64> {
    Some((USABLE_FRACTION * available()? as f64) as u64)
}

/// Requests below this are granted without reading the state of the system, bytes: reading takes 0.1 ms, half of it for one file
/// (`python3 -m timeit "open('/proc/meminfo').read()"`: 56 µs), about as long as a core takes to fill this memory.
const UNCHECKED_BYTES: u64 = 1 << 20;

/// Refuses work that needs more than [`usable`] bytes at once, or more than the limit of the process's address space leaves: an error
/// instead of a killed process, also where the system overcommits memory. No memory is allocated.
///
/// # Errors
/// [`Error::OutOfMemory`] that names `what`.
pub fn check_room(bytes: u64, what: impl FnOnce() -> String) -> Result<()> {
    lack(bytes).map_or(Ok(()), |lack| Err(Error::OutOfMemory(what() + &lack)))
}

/// What to say after the name of something that takes more bytes than are left.
fn lack(bytes: u64) -> Option<String> {
    let mut room: Vec<u8> = Vec::new();
    let is_given = usize::try_from(bytes).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
    let left = if bytes < UNCHECKED_BYTES { None } else { usable() };
    if left.is_none_or(|left| bytes <= left) && is_given {
        return None;
    }
    let left = left.map(|left| format!("; {left} may be used")).unwrap_or_default();
    Some(format!(" take {bytes} bytes, which are not left{left}: ask for less at once"))
}

/// Memory available for allocation, bytes: the smallest of what the machine, the control groups of the process and its limit of
/// address space leave.
fn available() -> Option<u64> {
    let machine = kilobytes(&read_to_string("/proc/meminfo").ok()?, "MemAvailable:")?;
    let groups = read_to_string("/proc/self/cgroup")
        .ok()
        .and_then(|groups| left_by_groups(Path::new("/sys/fs/cgroup"), &groups));
    Some([groups, left_of_address_space()].into_iter().flatten().fold(machine, u64::min))
}

/// A value of a table of kB in `/proc`, bytes.
fn kilobytes(table: &str, name: &str) -> Option<u64> {
    let line = table.lines().find_map(|line| line.strip_prefix(name))?;
    Some(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?)
}

/// The limit of address space (`ulimit -v`), bytes; `None` without one.
#[cfg(target_os = "linux")]
pub fn address_space_limit() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::As).current.filter(|&bytes| bytes < u64::MAX)
}

#[cfg(not(target_os = "linux"))]
pub fn address_space_limit() -> Option<u64> {
    None
}

/// Address space left below its limit (`ulimit -v`), bytes; `None` without a limit.
#[cfg(target_os = "linux")]
pub fn left_of_address_space() -> Option<u64> {
    let limit = address_space_limit()?;
    let used = kilobytes(&read_to_string("/proc/self/status").ok()?, "VmSize:")?;
    Some(limit.saturating_sub(used))
}

#[cfg(not(target_os = "linux"))]
pub fn left_of_address_space() -> Option<u64> {
    None
}

/// By version of control groups the files of limit and usage, and the line of `memory.stat` about unused pages of files.
const V1: [&str; 3] = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "];
const V2: [&str; 3] = ["memory.max", "memory.current", "inactive_file "];

/// Memory left by the control groups in `/proc/self/cgroup` and their parents, each of which may have a limit, bytes. `root`: mount point.
fn left_by_groups(root: &Path, groups: &str) -> Option<u64> {
    let mut left: Option<u64> = None;
    for line in groups.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else { continue };
        // Version 1 has a hierarchy for memory, version 2 one for everything, which is at `unified` where both are used.
        let mounts: &[(&str, [&str; 3])] = match controllers {
            "" => &[(".", V2), ("unified", V2)],
            _ if controllers.split(',').any(|c| c == "memory") => &[("memory", V1)],
            _ => continue,
        };
        for (mount, names) in mounts {
            for group in Path::new(path.trim_start_matches('/')).ancestors() {
                let found = left_by_group(&root.join(mount).join(group), names);
                left = left.into_iter().chain(found).min();
            }
        }
    }
    left
}

/// Memory left by one control group; `None` without a limit. Unused pages of files count as left: the system reclaims them. `names` are
/// those of the files of limit and usage, and of the line about such pages.
fn left_by_group(folder: &Path, [limit, usage, pages]: &[&str; 3]) -> Option<u64> {
    let number = |name: &str| read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
    let (limit, usage) = (number(limit)?, number(usage)?);
    let statistics = read_to_string(folder.join("memory.stat")).unwrap_or_default();
    let unused = statistics.lines().find_map(|line| line.strip_prefix(*pages)?.trim().parse::<u64>().ok());
    Some(limit.saturating_sub(usage.saturating_sub(unused.unwrap_or(0))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{create_dir_all, write};

    #[test]
    fn too_much_is_an_error() {
        assert!(check_room(1 << 20, || "nothing".into()).is_ok());
        for bytes in [1 << 62, u64::MAX] {
            let message = check_room(bytes, || "9 points".into()).unwrap_err().to_string();
            assert!(message.contains("9 points") && message.contains(&bytes.to_string()), "{message}");
        }
    }

    /// The allocator of a system that overcommits memory grants more than there is.
    #[test]
    fn what_the_system_does_not_have_is_an_error() {
        let Some(left) = usable() else { return };
        // Other programs may free memory meanwhile.
        let error = check_room(left + left / 5, || "points".into());
        assert!(error.is_err_and(|e| e.to_string().contains("may be used")));
        assert!(check_room(left / 2, || "points".into()).is_ok());
    }

    #[test]
    fn the_smallest_control_group_counts() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        assert_eq!(left_by_groups(root, "0::/\n"), None);
        // Version 2: the limit is that of the outer group, and the inner one has none.
        let outer = root.join("user");
        create_dir_all(outer.join("job")).expect("a folder");
        write(outer.join("memory.max"), "1000\n").expect("written");
        write(outer.join("memory.current"), "900\n").expect("written");
        write(outer.join("memory.stat"), "anon 7\ninactive_file 50\n").expect("written");
        write(outer.join("job/memory.max"), "max\n").expect("written");
        write(outer.join("job/memory.current"), "10\n").expect("written");
        assert_eq!(left_by_groups(root, "0::/user/job\n"), Some(150));
        // Version 1 beside it, seen from inside a container: the path of the group does not exist.
        let v1 = root.join("memory");
        create_dir_all(&v1).expect("a folder");
        write(v1.join("memory.limit_in_bytes"), "600\n").expect("written");
        write(v1.join("memory.usage_in_bytes"), "500\n").expect("written");
        assert_eq!(left_by_groups(root, "5:cpu,memory:/docker/1\n0::/user/job\n"), Some(100));
        assert!(usable().is_none_or(|bytes| bytes > 0));
    }
}
