//! Files that are written completely or not at all.

use crate::{Error, Result};
use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};
use tempfile::NamedTempFile;

/// A buffered file being written. The data go to a temporary file beside the target until [`WholeFile::commit`]; a file
/// that is dropped before is removed.
pub struct WholeFile {
    target: PathBuf,
    out: BufWriter<Sink>,
}

enum Sink {
    Draft(NamedTempFile),
    /// Pipes and devices (`/dev/stdout`) cannot be replaced by a renamed file.
    Device(File),
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Sink::Draft(file) => file.write(bytes),
            Sink::Device(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Sink::Draft(file) => file.flush(),
            Sink::Device(file) => file.flush(),
        }
    }
}

impl WholeFile {
    /// Starts a file that will replace `target`; symbolic links are followed.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written or `target` is a folder.
    pub fn create(target: &Path) -> Result<WholeFile> {
        let at = |e| Error::io(target, e);
        let resolved = target.canonicalize().unwrap_or_else(|_| target.to_owned());
        let sink = match std::fs::metadata(&resolved) {
            Ok(m) if m.is_dir() => return Err(at(io::ErrorKind::IsADirectory.into())),
            Ok(m) if !m.is_file() => Sink::Device(File::options().write(true).open(&resolved).map_err(at)?),
            _ => {
                let folder =
                    resolved.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                // Checked first: the system's error names the reason better than that of the temporary file.
                std::fs::metadata(folder).map_err(at)?;
                let mut builder = tempfile::Builder::new();
                builder.prefix(".mrvis-");
                // Temporary files are private by default; the result gets the usual permissions.
                #[cfg(unix)]
                builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
                Sink::Draft(
                    builder
                        .tempfile_in(folder)
                        // The error names the target, not the temporary file.
                        .map_err(|e| at(e.kind().into()))?,
                )
            }
        };
        Ok(WholeFile { target: resolved, out: BufWriter::with_capacity(1 << 20, sink) })
    }

    /// Renames the temporary file to the target, replacing an older file.
    ///
    /// # Errors
    /// [`Error::Io`] if the buffered rest cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<()> {
        let at = |e| Error::io(&self.target, e);
        match self.out.into_inner().map_err(|e| at(e.into_error()))? {
            Sink::Draft(file) => file.persist(&self.target).map(drop).map_err(|e| at(e.error)),
            Sink::Device(mut file) => file.flush().map_err(at),
        }
    }

    /// Writes a complete file.
    ///
    /// # Errors
    /// [`Error::Io`] as for [`WholeFile::create`] and [`WholeFile::commit`].
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
    fn errors_name_the_target() {
        let missing = Path::new("/nowhere/at/all/a.txt");
        let text = WholeFile::write(missing, "x").expect_err("no folder").to_string();
        assert!(text.starts_with("/nowhere/at/all/a.txt: No such file"), "{text}");
        assert!(WholeFile::write(Path::new("/"), "x").is_err());
        WholeFile::write(Path::new("/dev/null"), "x").expect("a device is written, not replaced");
    }
}
