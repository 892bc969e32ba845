//! The columns of the arena.

use std::ops::{Deref, DerefMut};

/// One column of the arena of elements. All may read and change its entries; only the arena adds any, to all columns at once
/// ([`Elements::split`](super::Elements::split)), so that an index means the same element in each.
///
/// Columns are apart because most loops need either geometry or light: with both in one row the solution of a living room of
/// 377,000 faces by links took 3 % more CPU time (`mrvis solve livingroom.obj --local-rays 0`).
#[derive(Clone, Debug)]
pub struct Column<T>(Vec<T>);

impl<T> Column<T> {
    pub(super) fn new(entries: Vec<T>) -> Column<T> {
        Column(entries)
    }

    pub(super) fn push(&mut self, entry: T) {
        self.0.push(entry);
    }

    /// Size in memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.0.capacity() * size_of::<T>()
    }
}

impl<T> Deref for Column<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T> DerefMut for Column<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.0
    }
}
