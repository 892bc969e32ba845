//! Files that are read: regular files, or standard input under the name `-`.
//!
//! A pipe or a device under any other name is refused, because reading it could block or never end. Standard input may be a pipe or a
//! terminal, but no other device. Sizes are compared with a limit before anything is read.

use crate::error::{quote, shown};
use crate::{Error, Result};
use std::{
    fs::File,
    io::{self, Read},
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};

/// Largest file of material definitions or settings, bytes. A thousand times the largest library of
/// `scenes/assemble.py` (70 kB).
pub const MAX_SMALL_FILE: u64 = 64 << 20;

/// A file or standard input, opened for reading.
#[derive(Debug)]
pub struct Input {
    path: PathBuf,
    source: Source,
    /// Bytes that may still be read.
    left: u64,
    limit: u64,
}

#[derive(Debug)]
enum Source {
    File(File, u64),
    Standard(io::Stdin),
}

/// Whether the path is that of standard input, `-`.
pub fn is_standard_input(path: &Path) -> bool {
    path == Path::new("-")
}

impl Input {
    /// Opens a regular file, or standard input if `path` is `-`. At most `limit` bytes can be read.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened, [`Error::File`] if it is no regular file (standard input: a device that is no
    /// terminal) or larger than `limit`.
    pub fn open(path: &Path, limit: u64) -> Result<Input> {
        if is_standard_input(path) {
            #[cfg(unix)]
            check_standard(path, std::os::fd::AsFd::as_fd(&io::stdin()), limit)?;
            return Ok(Input {
                path: path.into(),
                source: Source::Standard(io::stdin()),
                left: limit,
                limit,
            });
        }
        let at = |e| Error::io(path, e);
        // Opening a device can change it, so the kind is checked before and, as the file may be exchanged, after.
        check_kind(path, &std::fs::metadata(path).map_err(at)?)?;
        let mut options = File::options();
        options.read(true);
        // A pipe that took the place of the file does not block.
        #[cfg(unix)]
        super::without_waiting(&mut options);
        let file = options.open(path).map_err(at)?;
        let about = file.metadata().map_err(at)?;
        check_kind(path, &about)?;
        let size = about.len();
        if size > limit {
            return Err(too_large(path, &format!("{size} bytes"), limit));
        }
        Ok(Input { path: path.into(), source: Source::File(file, size), left: limit, limit })
    }

    /// All bytes.
    pub fn bytes(mut self) -> Result<Vec<u8>> {
        let expected = match &self.source {
            Source::File(_, size) => *size,
            Source::Standard(_) => 0,
        };
        let mut bytes = Vec::new();
        bytes
            .try_reserve_exact(expected as usize + 1)
            .map_err(|_| Error::OutOfMemory(format!("{}: {expected} bytes", shown(&self.path))))?;
        match self.read_to_end(&mut bytes) {
            Ok(_) => Ok(bytes),
            Err(e) => Err(Error::io(&self.path, e)),
        }
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = match &mut self.source {
            Source::File(file, _) => file.read(buffer)?,
            Source::Standard(stdin) => stdin.lock().read(buffer)?,
        };
        // Standard input has no size before it is read, and a file may grow.
        self.left = self.left.checked_sub(n as u64).ok_or_else(|| {
            io::Error::other(format!("holds more than {} bytes, the limit for such a file", self.limit))
        })?;
        Ok(n)
    }
}

/// All bytes of a regular file or of standard input; see [`Input::open`].
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>> {
    Input::open(path, limit)?.bytes()
}

fn check_kind(path: &Path, about: &std::fs::Metadata) -> Result<()> {
    if about.is_dir() {
        return Err(Error::io(path, io::ErrorKind::IsADirectory.into()));
    }
    if about.is_file() {
        return Ok(());
    }
    let what = "is a pipe or a device; only regular files are read, and - is standard input";
    Err(Error::format(path, None, what))
}

/// Refuses devices as standard input: most never end, and disks hold no scene as a file does. A terminal ends with Ctrl-D.
#[cfg(unix)]
fn check_standard(path: &Path, stream: std::os::fd::BorrowedFd, limit: u64) -> Result<()> {
    use std::os::unix::fs::FileTypeExt;
    // A stream that is closed or cannot be examined fails when it is read.
    let Ok(file) = stream.try_clone_to_owned().map(File::from) else { return Ok(()) };
    let Ok(about) = file.metadata() else { return Ok(()) };
    let kind = about.file_type();
    if kind.is_block_device() || (kind.is_char_device() && !io::IsTerminal::is_terminal(&file)) {
        let what = "standard input is a device, which may never end: redirect a regular file or a pipe to it (`< FILE`)";
        return Err(Error::format(path, None, what));
    }
    match about.len() {
        size if about.is_file() && size > limit => Err(too_large(path, &format!("{size} bytes"), limit)),
        _ => Ok(()),
    }
}

fn too_large(path: &Path, size: &str, limit: u64) -> Error {
    Error::format(path, None, format!("{size}, more than the {limit} bytes that may be read"))
}

/// The result of reading a file by `read`; a panic of the code that decodes it becomes an error of this file.
pub fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|panic| {
        let why = panic.downcast_ref::<String>().map(String::as_str);
        let why = why.or(panic.downcast_ref::<&str>().copied()).unwrap_or("no reason given");
        Err(Error::format(
            path,
            None,
            format!("its decoder failed ({}): the file may be damaged", quote(why)),
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_read() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let path = folder.path().join("a");
        std::fs::write(&path, "12345").expect("written");
        assert_eq!(read(&path, 5).expect("read"), b"12345");
        let message = read(&path, 4).expect_err("too large").to_string();
        assert!(message.contains("5 bytes, more than the 4 bytes"), "{message}");
        assert!(read(folder.path(), 9).is_err());
        for device in ["/dev/zero", "/dev/urandom", "/dev/null"] {
            let message = read(Path::new(device), 9).expect_err(device).to_string();
            assert!(message.contains("pipe or a device"), "{message}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn devices_are_refused_as_standard_input() {
        use std::os::fd::AsFd;
        let check = |file: &File| check_standard(Path::new("-"), file.as_fd(), 4);
        for device in ["/dev/zero", "/dev/urandom", "/dev/null"] {
            let message = check(&File::open(device).expect(device)).expect_err(device).to_string();
            assert!(message.starts_with("-: ") && message.contains("`< FILE`"), "{message}");
        }
        let file = tempfile::tempfile().expect("scratch file");
        check(&file).expect("a regular file");
        file.set_len(5).expect("grown");
        let message = check(&file).expect_err("too large").to_string();
        assert!(message.contains("5 bytes, more than the 4 bytes"), "{message}");
        let (read, _write) = io::pipe().expect("a pipe");
        check_standard(Path::new("-"), read.as_fd(), 4).expect("a pipe");
    }

    #[test]
    fn panics_are_errors_of_the_file() {
        let error = guarded::<()>(Path::new("a.png"), || panic!("{}", "index\n".repeat(90)));
        let text = error.expect_err("panics").to_string();
        assert!(text.starts_with("a.png: its decoder failed (index") && text.len() < 200, "{text}");
        assert_eq!(guarded(Path::new("a.png"), || Ok(3)).expect("no panic"), 3);
    }
}
