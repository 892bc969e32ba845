//! Output files and folders, checked before the work so that it is not done in vain.

use mrvis::{Error, Result};
use std::path::{Path, PathBuf};

/// Checks that a file can be written, without changing it.
pub fn check_file(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::io(path, std::io::ErrorKind::IsADirectory.into()));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).map(drop).map_err(|e| Error::io(path, e))
}

/// A folder for outputs. One that this program made and that is empty is removed: that of a command that failed or was interrupted.
#[derive(Default)]
#[must_use = "the folder is removed if it is empty when this is dropped"]
pub struct OutputFolder(Option<PathBuf>);

impl Drop for OutputFolder {
    fn drop(&mut self) {
        // A folder with files stays: this function does not remove such.
        self.0.take().map(std::fs::remove_dir);
    }
}

/// Checks that files can be written into a folder; creates the folder if it is missing.
pub fn check_folder(folder: &Path) -> Result<OutputFolder> {
    let unusable =
        |what: &str| Error::format(folder, None, format!("{what}; give a folder that can be written"));
    if folder.exists() && !folder.is_dir() {
        return Err(unusable("is not a folder"));
    }
    let made = OutputFolder((!folder.exists()).then(|| folder.to_owned()));
    std::fs::create_dir_all(folder).map_err(|e| unusable(&format!("cannot be made ({e})")))?;
    tempfile::tempfile_in(folder).map_err(|e| unusable(&format!("cannot be written ({e})")))?;
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_checked_without_being_touched() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        check_file(&file).unwrap();
        assert!(!file.exists());
        assert!(check_file(folder.path()).is_err());
        assert!(check_file(&folder.path().join("missing/a.json")).is_err());
        std::fs::write(&file, "x").unwrap();
        assert!(check_folder(&file).is_err());
        let new = folder.path().join("new");
        drop(check_folder(&new).unwrap());
        assert!(!new.exists());
        let made = check_folder(&new).unwrap();
        std::fs::write(new.join("result"), "x").unwrap();
        drop(made);
        assert!(new.join("result").exists());
    }
}
