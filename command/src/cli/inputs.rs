//! Files that a command reads and writes: no output may replace an input or another output.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn devices_are_not_replaced() {
        let outputs = ["--out", "--json"].map(|option| Output::new(option, "/dev/null"));
        Inputs::default().check(outputs).expect("both write into it");
    }
}
