//! Arrays of one call that overlap.

use super::arguments::wrong;
use super::guard::Outcome;

/// Memory of an array.
#[derive(Clone, Copy)]
pub struct Span {
    name: &'static str,
    start: usize,
    end: usize,
}

impl Span {
    /// An array of so many bytes; NULL is no memory.
    pub fn new<T>(name: &'static str, array: *const T, bytes: usize) -> Span {
        let start = array.addr();
        Span { name, start, end: start.saturating_add(bytes) }
    }

    /// An array of so many entries.
    pub fn of<T>(name: &'static str, array: *const T, count: usize) -> Span {
        Span::new(name, array, count.saturating_mul(size_of::<T>()))
    }

    fn overlaps(&self, other: &Span) -> bool {
        self.start != 0 && other.start != 0 && self.start < other.end && other.start < self.end
    }
}

/// Refuses outputs that overlap each other or an input.
pub fn check_apart(inputs: &[Span], outputs: &[Span]) -> Outcome {
    for (i, out) in outputs.iter().enumerate() {
        let others = inputs.iter().chain(&outputs[i + 1..]);
        if let Some(other) = others.into_iter().find(|other| out.overlaps(other)) {
            return wrong(format!(
                "`{}` and `{}` overlap: give each memory of its own",
                out.name, other.name
            ));
        }
    }
    Ok(())
}
