//! Files that are written completely or not at all, and files that are read ([`input`]).

pub mod input;

use crate::{Error, Result, error::is_obeyed};
use rawzip::ZipArchiveWriter;
use rawzip::time::UtcDateTime;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// The text of a JSON file: indented, with a line feed at its end. Characters of names that a terminal obeys are escaped.
pub fn json_text(value: &impl serde::Serialize) -> serde_json::Result<String> {
    Ok(escaped(serde_json::to_string_pretty(value)? + "\n"))
}

/// A JSON text with the characters that a terminal obeys escaped, besides line feeds.
pub fn escaped(text: String) -> String {
    let is_escaped = |c| is_obeyed(c) && c != '\n';
    if !text.contains(is_escaped) {
        return text;
    }
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match is_escaped(c) {
            true => escaped.push_str(&format!("\\u{:04x}", u32::from(c))),
            false => escaped.push(c),
        }
    }
    escaped
}

/// Writes a JSON file.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    WholeFile::write(path, json_text(value).map_err(|e| Error::format(path, None, e.to_string()))?)
}

/// A text for a cell of CSV, without characters that programs obey instead of showing them. Spreadsheets compute texts that begin with
/// these characters as formulas: an apostrophe keeps them texts.
pub fn csv_text(text: &str) -> Cow<'_, str> {
    let shown: Cow<str> = match text.contains(is_obeyed) {
        true => text.chars().filter(|c| !is_obeyed(*c)).collect(),
        false => text.into(),
    };
    match text.starts_with(['\t', '\r']) || shown.starts_with(['=', '+', '-', '@']) {
        true => format!("'{shown}").into(),
        false => shown,
    }
}

/// A buffered file being written. The data go to a temporary file until [`WholeFile::commit`]; a file that is dropped
/// before is removed. On Linux the temporary file has no name until then, so that nothing is left if the program is killed.
pub struct WholeFile {
    target: PathBuf,
    out: BufWriter<Sink>,
}

enum Sink {
    /// A file without a name, in the folder of the target.
    #[cfg(target_os = "linux")]
    Unnamed(File),
    Named(NamedTempFile),
    /// Pipes and devices (`/dev/stdout`) cannot be replaced by a renamed file.
    Device(File),
}

impl Sink {
    fn file(&mut self) -> &mut File {
        match self {
            #[cfg(target_os = "linux")]
            Sink::Unnamed(file) => file,
            // The errors of the file itself do not name it.
            Sink::Named(file) => file.as_file_mut(),
            Sink::Device(file) => file,
        }
    }

    /// A temporary file in a folder that exists.
    fn draft(folder: &Path) -> io::Result<Sink> {
        #[cfg(target_os = "linux")]
        if let Ok(file) = unnamed(folder) {
            return Ok(Sink::Unnamed(file));
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        // Temporary files are private by default; the result gets the usual permissions.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // The kind alone: the message would name the temporary file.
        builder.tempfile_in(folder).map(Sink::Named).map_err(|e| e.kind().into())
    }
}

/// Beginning of the names of temporary files.
const PREFIX: &str = ".mrvis-";

/// A file without a name, which can get one later; not all file systems have them.
#[cfg(target_os = "linux")]
fn unnamed(folder: &Path) -> io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let unnamed = rustix::fs::OFlags::TMPFILE.bits() as i32;
    let file = File::options().write(true).custom_flags(unnamed).mode(0o666).open(folder)?;
    // Its name is given by this link, which needs a mounted `/proc`.
    std::fs::symlink_metadata(descriptor(&file))?;
    Ok(file)
}

/// Makes opening a pipe not wait for its other end.
#[cfg(unix)]
fn without_waiting(options: &mut std::fs::OpenOptions) {
    use std::os::unix::fs::OpenOptionsExt;
    options.custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32);
}

/// The link to an open file of this process.
#[cfg(target_os = "linux")]
fn descriptor(file: &File) -> PathBuf {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd()).into()
}

/// Gives a file without a name the name `target`, replacing another file.
#[cfg(target_os = "linux")]
fn name(file: &File, target: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    let folder = target.parent().unwrap_or(Path::new(""));
    let mut attempt = 0;
    let draft = loop {
        let draft = folder.join(format!("{PREFIX}{}-{attempt}", std::process::id()));
        match linkat(CWD, descriptor(file), CWD, &draft, AtFlags::SYMLINK_FOLLOW) {
            Ok(()) => break draft,
            // Another thread is naming a file.
            Err(rustix::io::Errno::EXIST) if attempt < 10_000 => attempt += 1,
            Err(error) => return Err(error.into()),
        }
    };
    std::fs::rename(&draft, target).inspect_err(|_| drop(std::fs::remove_file(&draft)))
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

impl WholeFile {
    /// Starts a file that will replace `target`. A symbolic link is replaced as well, not followed, unless it leads to
    /// a device.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written, `target` is a folder, or a pipe that nobody reads.
    pub fn create(target: &Path) -> Result<WholeFile> {
        let at = |e| Error::io(target, e);
        let sink = match std::fs::metadata(target) {
            Ok(m) if m.is_dir() => return Err(at(io::ErrorKind::IsADirectory.into())),
            Ok(m) if !m.is_file() => {
                let mut options = File::options();
                options.write(true);
                // A pipe without a reader would block.
                #[cfg(unix)]
                without_waiting(&mut options);
                drop(options.open(target).map_err(at)?);
                Sink::Device(File::options().write(true).open(target).map_err(at)?)
            }
            _ => {
                let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                // Checked first: the system's error names the reason better than that of the temporary file.
                std::fs::metadata(folder).map_err(at)?;
                Sink::draft(folder).map_err(at)?
            }
        };
        Ok(WholeFile { target: target.into(), out: BufWriter::with_capacity(1 << 20, sink) })
    }

    /// Renames the temporary file to the target, replacing an older file.
    ///
    /// # Errors
    /// [`Error::Io`] if the buffered rest cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<()> {
        let at = |e| Error::io(&self.target, e);
        match self.out.into_inner().map_err(|e| at(e.into_error()))? {
            #[cfg(target_os = "linux")]
            Sink::Unnamed(file) => name(&file, &self.target).map_err(at),
            Sink::Named(file) => file.persist(&self.target).map(drop).map_err(|e| at(e.error)),
            Sink::Device(mut file) => file.flush().map_err(at),
        }
    }

    /// Writes a complete file.
    pub fn write(target: &Path, content: impl AsRef<[u8]>) -> Result<()> {
        let mut file = WholeFile::create(target)?;
        file.write_all(content.as_ref()).map_err(|e| Error::io(target, e))?;
        file.commit()
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// An archive of arrays, not compressed. All have the date of [`NO_DATE`].
pub struct NpzWriter<W: Write>(ZipArchiveWriter<W>);

/// The first date that archives can state.
const NO_DATE: UtcDateTime = UtcDateTime::from_components(1980, 1, 1, 0, 0, 0, 0).expect("a date");

impl<W: Write> NpzWriter<W> {
    pub fn new(out: W) -> NpzWriter<W> {
        NpzWriter(ZipArchiveWriter::new(out))
    }

    /// Adds an array; `kind` such as `<f4`. `<` is little endian, as are all machines that Embree supports.
    pub fn array(&mut self, name: &str, kind: &str, shape: &[usize], bytes: &[u8]) -> io::Result<()> {
        let file = self.0.new_file(format!("{name}.npy")).last_modified(NO_DATE).unix_permissions(0o644);
        let (mut entry, sums) = file.start().map_err(io::Error::other)?;
        let mut out = sums.wrap(&mut entry);
        out.write_all(&header(kind, shape))?;
        out.write_all(bytes)?;
        let (_, sums) = out.finish().map_err(io::Error::other)?;
        entry.finish(sums).map_err(io::Error::other)?;
        Ok(())
    }

    pub fn finish(self) -> io::Result<()> {
        self.0.finish().map_err(io::Error::other)?.flush()
    }
}

/// Beginning of a file of version 1.0 of NumPy's format: magic, version, length of the rest of the header, and a Python literal, padded to
/// a multiple of 64 bytes.
pub fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let sides: String = shape.iter().map(|n| format!("{n},")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}");
    let length = (text.len() + 11).next_multiple_of(64) - 10;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((length as u16).to_le_bytes());
    header.extend(text.as_bytes());
    header.push(b'\n');
    header
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_without_commit() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let path = folder.path().join("a.txt");
        WholeFile::write(&path, "old").expect("written");
        let mut file = WholeFile::create(&path).expect("created");
        file.write_all(b"half").expect("written");
        drop(file);
        assert_eq!(std::fs::read_to_string(&path).expect("read"), "old");
        assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn unfinished_files_have_no_name() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let mut file = WholeFile::create(&folder.path().join("a.txt")).expect("created");
        file.write_all(&[1; 3 << 20]).expect("written");
        // The state in which a killed program leaves the folder.
        assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 0);
        file.commit().expect("named");
        assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn links_are_replaced() {
        let folder = tempfile::tempdir().expect("scratch folder");
        let (victim, link) = (folder.path().join("victim"), folder.path().join("link"));
        std::fs::write(&victim, "old").expect("written");
        std::os::unix::fs::symlink(&victim, &link).expect("linked");
        WholeFile::write(&link, "new").expect("written");
        assert_eq!(std::fs::read_to_string(&victim).expect("read"), "old");
        assert_eq!(std::fs::read_to_string(&link).expect("read"), "new");
        assert!(!link.is_symlink());
    }

    #[test]
    fn errors_name_the_target() {
        let missing = Path::new("/nowhere/at/all/a.txt");
        let text = WholeFile::write(missing, "x").expect_err("no folder").to_string();
        assert!(text.starts_with("/nowhere/at/all/a.txt: No such file"), "{text}");
        assert!(WholeFile::write(Path::new("/"), "x").is_err());
        WholeFile::write(Path::new("/dev/null"), "x").expect("a device is written, not replaced");
    }
}
