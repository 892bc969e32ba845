//! Files that a command reads and writes: no output may replace an input or another output, and outputs can be written. Both are checked
//! before the computation.

use mrvis::internals::error::shown;
use mrvis::internals::files::input::is_standard_input;
use mrvis::{Error, Result};
use std::path::{Path, PathBuf};

/// Files that are read.
#[derive(Default)]
pub struct Inputs(Vec<PathBuf>);

/// A file that will be written, and the option that asks for it.
pub struct Output {
    option: &'static str,
    path: PathBuf,
}

impl Output {
    /// A file of `option`.
    pub fn new(option: &'static str, path: impl Into<PathBuf>) -> Output {
        Output { option, path: path.into() }
    }

    /// Files of these names in the folder of `option`.
    pub fn within<'a>(
        option: &'static str,
        folder: &'a Path,
        names: impl IntoIterator<Item = String> + 'a,
    ) -> impl Iterator<Item = Output> + 'a {
        names.into_iter().map(move |name| Output::new(option, folder.join(name)))
    }

    /// Where the file appears; `None` for devices, which are written and not replaced. Links are replaced, not followed.
    fn place(&self) -> Option<PathBuf> {
        if std::fs::metadata(&self.path).is_ok_and(|about| !about.is_file()) {
            return None;
        }
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // A folder that does not exist yet has one name only.
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.into());
        Some(folder.join(self.path.file_name()?))
    }
}

impl Inputs {
    /// These files; those that do not exist and standard input are left out.
    pub fn of(files: impl IntoIterator<Item: AsRef<Path>>) -> Inputs {
        let files = files.into_iter().filter(|file| !is_standard_input(file.as_ref()));
        Inputs(files.filter_map(|file| file.as_ref().canonicalize().ok()).collect())
    }

    /// Refuses outputs that would replace an input or each other.
    ///
    /// # Errors
    /// [`Error::Argument`] with the file and the options of the outputs.
    pub fn check(&self, outputs: impl IntoIterator<Item = Output>) -> Result<()> {
        let mut places: Vec<(PathBuf, &str)> = Vec::new();
        for output in outputs {
            let Output { option, path } = &output;
            if path.canonicalize().is_ok_and(|full| self.0.contains(&full)) {
                return Err(Error::arguments(format!(
                    "{}: is read by this command and would be replaced; choose another place for {option}",
                    shown(path)
                )));
            }
            let Some(place) = output.place() else { continue };
            if let Some((_, other)) = places.iter().find(|(known, _)| *known == place) {
                return Err(Error::arguments(format!(
                    "{}: {other} and {option} would replace each other's file; choose another place for one of them",
                    shown(path)
                )));
            }
            places.push((place, option));
        }
        Ok(())
    }
}

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
    #[cfg(unix)]
    fn devices_are_not_replaced() {
        let outputs = ["--out", "--json"].map(|option| Output::new(option, "/dev/null"));
        Inputs::default().check(outputs).expect("both write into it");
    }

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
