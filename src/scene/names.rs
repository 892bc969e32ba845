//! Names of objects, groups and materials, and counts, in messages.

use crate::{Error, error::quote};
use std::collections::{HashMap, HashSet};

/// Similarity of two names above which one is suggested for the other, as in clap's suggestions of options.
const MIN_SIMILARITY: f64 = 0.7;
/// Largest number of names that are compared: a microsecond each.
const MAX_COMPARED: usize = 100_000;

/// The error for an unknown name; it has no name of an option yet.
pub(super) fn unknown<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Error {
    let names: Vec<&str> = names.take(MAX_COMPARED).collect();
    let similar = names.iter().map(|n| (strsim::jaro_winkler(name, n), n));
    let similar =
        similar.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(likeness, _)| *likeness > MIN_SIMILARITY);
    let cure = match similar {
        Some((_, similar)) => format!("did you mean `{}`?", quote(similar)),
        None => format!("there are {}", some_names(names.into_iter())),
    };
    Error::arguments(format!("no object, group or material is called `{}`", quote(name))).with_cure(cure)
}

/// A number with its noun: "1 face", "2 faces".
pub(super) fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// The first few distinct names, for messages.
pub(super) fn some_names<'a, S: AsRef<str> + ?Sized + 'a>(names: impl Iterator<Item = &'a S>) -> String {
    let mut seen = HashSet::new();
    let mut list: Vec<String> = names
        .map(AsRef::as_ref)
        .filter(|n: &&str| seen.insert(*n))
        .take(9)
        .map(|n| format!("`{}`", quote(n)))
        .collect();
    if list.len() == 9 {
        list[8] = "others".into();
    }
    list.join(", ")
}

/// Makes names unique.
#[derive(Default)]
pub(super) struct UniqueNames(HashMap<String, usize>);

impl UniqueNames {
    /// Names that must differ from these, which are unique.
    pub fn beside<'a>(taken: impl Iterator<Item = &'a String>) -> UniqueNames {
        UniqueNames(taken.map(|name| (name.clone(), 1)).collect())
    }

    /// `name`, with a number behind it if it is taken.
    pub fn of(&mut self, name: &str) -> String {
        let mut n = self.0.get(name).copied().unwrap_or(0);
        loop {
            n += 1;
            let candidate = if n == 1 { name.to_owned() } else { format!("{name} {n}") };
            if n == 1 || !self.0.contains_key(&candidate) {
                self.0.insert(candidate.clone(), 1);
                self.0.insert(name.to_owned(), n);
                return candidate;
            }
        }
    }
}
