//! Names and dependencies of all jobs.

use super::expand::outputs_of;
use super::job::{Job, TomlSource};
use super::names::{fault, suggestion};
use mrvis::Result;
use mrvis::internals::error::quote;
use std::collections::{BTreeMap, HashMap};

/// Checks names and dependencies, and fills in [`Job::needs`].
///
/// # Errors
/// Two jobs have one folder, a name leaves the output folder, a dependency is unknown, or dependencies form a circle.
pub fn check(source: &TomlSource, jobs: &mut [Job]) -> Result<()> {
    check_names(source, jobs)?;
    let by_name: HashMap<&str, usize> =
        jobs.iter().enumerate().map(|(k, job)| (job.name.as_str(), k)).collect();
    let mut by_tag: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (k, job) in jobs.iter().enumerate() {
        job.tags.iter().for_each(|tag| by_tag.entry(tag).or_default().push(k));
    }
    let mut needs = Vec::with_capacity(jobs.len());
    for (k, job) in jobs.iter().enumerate() {
        let mut own: Vec<usize> = Vec::new();
        for (wanted, span) in &job.after {
            match (by_name.get(wanted.as_str()), by_tag.get(wanted.as_str())) {
                (Some(&other), _) => own.push(other),
                (None, Some(others)) => own.extend(others.iter().filter(|other| **other != k)),
                (None, None) => {
                    let similar = suggestion(wanted, by_name.keys().copied().chain(by_tag.keys().copied()));
                    let what = format!("`{}` is no name or tag of a job{similar}", quote(wanted));
                    return Err(source.error(span, what));
                }
            }
        }
        for (text, span) in job.texts() {
            for name in outputs_of(text) {
                let Some(&other) = by_name.get(name) else {
                    let similar = suggestion(name, by_name.keys().copied());
                    let what = format!("`{{out:{}}}` is the output of no job{similar}", quote(name));
                    return Err(source.error(span, what));
                };
                own.push(other);
            }
        }
        own.sort_unstable();
        own.dedup();
        needs.push(own);
    }
    for (job, own) in jobs.iter_mut().zip(needs) {
        job.needs = own;
    }
    match circle(jobs) {
        None => Ok(()),
        Some(circle) => {
            let names: Vec<&str> = circle.iter().map(|&k| jobs[k].name.as_str()).collect();
            let what = format!("these jobs wait for each other: {}", names.join(" -> "));
            Err(source.error(&jobs[circle[0]].span, what))
        }
    }
}

fn check_names(source: &TomlSource, jobs: &[Job]) -> Result<()> {
    // Some file systems do not distinguish cases.
    let mut known: BTreeMap<String, &Job> = BTreeMap::new();
    for job in jobs {
        if let Some(what) = fault(&job.name) {
            return Err(source.error(&job.span, format!("the name `{}` {what}", quote(&job.name))));
        }
        if let Some(other) = known.insert(job.name.to_lowercase(), job) {
            let what = format!(
                "two jobs have the folder `{}`{}{}: name what they differ in, as in `{{folder}}-{{scene}}-{{error}}`",
                quote(&job.name),
                scenes_of(other, job),
                if other.name == job.name {
                    ""
                } else {
                    " (some file systems do not distinguish upper and lower case)"
                }
            );
            return Err(source.error(&job.span, what));
        }
    }
    for job in jobs {
        let name = job.name.to_lowercase();
        let outer = name.match_indices('/').find_map(|(i, _)| known.get(&name[..i]));
        if let Some(outer) = outer {
            let what =
                format!("the folder `{}` lies in that of the job `{}`", quote(&job.name), quote(&outer.name));
            return Err(source.error(&job.span, what));
        }
    }
    Ok(())
}

/// The scenes of two jobs of one name, if they differ.
fn scenes_of(one: &Job, other: &Job) -> String {
    match (one.inputs.first(), other.inputs.first()) {
        (Some(a), Some(b)) if a != b => format!(" (of `{}` and `{}`)", quote(a), quote(b)),
        _ => String::new(),
    }
}

/// Jobs in an order in which each comes after those that it needs; those on circles are left out.
pub fn order(jobs: &[Job]) -> Vec<usize> {
    let mut missing: Vec<usize> = jobs.iter().map(|job| job.needs.len()).collect();
    let mut followers = vec![Vec::new(); jobs.len()];
    for (k, job) in jobs.iter().enumerate() {
        job.needs.iter().for_each(|&need| followers[need].push(k));
    }
    let mut order: Vec<usize> = (0..jobs.len()).filter(|&k| missing[k] == 0).collect();
    let mut next = 0;
    while let Some(&done) = order.get(next) {
        next += 1;
        for &follower in &followers[done] {
            missing[follower] -= 1;
            if missing[follower] == 0 {
                order.push(follower);
            }
        }
    }
    order
}

/// Jobs that wait for each other; the first is repeated at the end.
fn circle(jobs: &[Job]) -> Option<Vec<usize>> {
    let mut left = vec![true; jobs.len()];
    order(jobs).into_iter().for_each(|k| left[k] = false);
    let mut at = left.iter().position(|left| *left)?;
    let mut path = Vec::new();
    // Every job that is left needs another one that is left.
    while !path.contains(&at) {
        path.push(at);
        at = *jobs[at].needs.iter().find(|&&need| left[need])?;
    }
    let start = path.iter().position(|&k| k == at)?;
    Some([&path[start..], &[at]].concat())
}
