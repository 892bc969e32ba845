//! Parts of a batch for several processes or machines: `--shard 2/8`.

use crate::batch::Job;
use std::collections::BTreeMap;

/// One part of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    part: usize,
    of: usize,
}

/// Largest number of parts: a part has a journal of its own, and all are read at the start.
const MAX_PARTS: usize = 10_000;

/// The value of `--shard`.
pub fn parse(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    let shard = numbers.map(|(part, of)| Shard { part, of });
    shard
        .filter(|s| (1..=MAX_PARTS).contains(&s.of) && (1..=s.of).contains(&s.part))
        .ok_or_else(|| "a part and the number of parts, such as 2/8".into())
}

impl Shard {
    /// Number of parts.
    pub fn parts(self) -> usize {
        self.of
    }

    /// Ending of the names of its journal and its lock.
    pub fn suffix(self) -> String {
        format!("-{}of{}", self.part, self.of)
    }

    /// The chosen jobs of this part. Jobs that need each other are in one part; these groups are dealt out in turn.
    pub fn jobs(self, jobs: &[Job], chosen: &[usize]) -> Vec<usize> {
        let mut group: Vec<usize> = (0..jobs.len()).collect();
        fn root(group: &mut [usize], mut k: usize) -> usize {
            while group[k] != k {
                group[k] = group[group[k]];
                k = group[k];
            }
            k
        }
        for &k in chosen {
            for &need in &jobs[k].needs {
                let (a, b) = (root(&mut group, k), root(&mut group, need));
                group[a.max(b)] = a.min(b);
            }
        }
        let mut parts = BTreeMap::new();
        let mut own = Vec::new();
        for &k in chosen {
            let groups = parts.len();
            let part = *parts.entry(root(&mut group, k)).or_insert(groups % self.of);
            own.extend((part + 1 == self.part).then_some(k));
        }
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{TomlSource, check, expand, parse as parse_file};

    #[test]
    fn parts_are_complete_and_keep_groups_together() {
        let text = "[[job]]\nname = 'a{count}'\ncommand = 'generate'\ninputs = 'cubes'\n\
                    [job.sweep]\ncount = [1, 2, 3, 4, 5]\n\
                    [[job]]\nname = 'i{seed}'\ncommand = 'info'\nscene = '{out:a{seed}}/scene.obj'\n[job.sweep]\nseed = [1, 2]\n";
        let source = TomlSource { path: "jobs.toml".into(), text: text.into() };
        let mut jobs = expand(&source, &parse_file(&source).expect("parsed")).expect("jobs");
        check(&source, &mut jobs).expect("checked");
        let chosen: Vec<usize> = (0..jobs.len()).collect();
        let part = |text: &str| parse(text).expect("a part").jobs(&jobs, &chosen);
        assert_eq!([part("1/2"), part("2/2")], [vec![0, 2, 4, 5], vec![1, 3, 6]]);
        assert_eq!(part("1/1"), chosen);
        for wrong in ["0/2", "3/2", "1", "1/0", "a/b", "1/20000"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
