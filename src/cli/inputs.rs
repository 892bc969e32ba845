//! Inputs of a command, which its outputs must not replace.

use crate::{Error, Result, error::quote, files::input::is_standard_input};
use std::path::{Path, PathBuf};

/// Files that are read.
#[derive(Default)]
pub struct Inputs(Vec<PathBuf>);

impl Inputs {
    /// These files; those that do not exist and standard input are left out.
    pub fn of<'a>(files: impl IntoIterator<Item = &'a Path>) -> Inputs {
        let files = files.into_iter().filter(|file| !is_standard_input(file));
        Inputs(files.filter_map(|file| file.canonicalize().ok()).collect())
    }

    /// Refuses an output that would replace an input.
    ///
    /// # Errors
    /// [`Error::Argument`] if `output` is one of the files.
    pub fn check_file(&self, output: &Path) -> Result<()> {
        match output.canonicalize() {
            Ok(full) if self.0.contains(&full) => Err(refused(output)),
            _ => Ok(()),
        }
    }

    /// Refuses a folder of outputs with an input of the name of an output. `writes` tells whether an output has the
    /// name.
    ///
    /// # Errors
    /// [`Error::Argument`] if an input lies in the folder and has the name of an output.
    pub fn check_folder(&self, folder: &Path, writes: impl Fn(&str) -> bool) -> Result<()> {
        let Ok(full) = folder.canonicalize() else { return Ok(()) };
        let within = |file: &&PathBuf| {
            file.parent() == Some(&full)
                && file.file_name().is_some_and(|name| writes(&name.to_string_lossy()))
        };
        self.0.iter().find(within).map_or(Ok(()), |file| Err(refused(file)))
    }
}

fn refused(file: &Path) -> Error {
    let name = quote(&file.display().to_string());
    Error::Argument(format!(
        "{name}: is read by this command and would be replaced; choose another place for the output"
    ))
}
