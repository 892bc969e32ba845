//! Placeholder until the reader follows in the next commit.

use super::Soup;
use crate::{Error, Result};
use std::path::Path;

pub(super) fn read(path: &Path) -> Result<Soup> {
    Err(Error::format(path, None, "this format is not read yet"))
}
