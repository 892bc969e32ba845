//! Cancellation of files that are being written.

use crate::progress::Progress;
use std::io::{Error, Result, Seek, SeekFrom, Write};

/// Bytes that are written between two checks for cancellation: a millisecond.
const BYTES_PER_CHECK: usize = 1 << 20;

/// A writer that fails once `progress` has stopped.
pub struct Stoppable<'a, W> {
    /// Output of the bytes.
    pub out: W,
    /// The caller.
    pub progress: &'a dyn Progress,
}

impl<W: Write> Write for Stoppable<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        match self.progress.stopped() {
            true => Err(Error::other("interrupted")),
            false => self.out.write(&bytes[..bytes.len().min(BYTES_PER_CHECK)]),
        }
    }

    fn flush(&mut self) -> Result<()> {
        self.out.flush()
    }
}

impl<W: Seek> Seek for Stoppable<'_, W> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.out.seek(to)
    }
}
