//! `mrvis merge DIR... --out OUT`: joins the outputs of the parts of a batch.

use crate::batch::{
    Entries, Entry, Journal, Journals, Listed, Status, begin, check_has_journal, check_outputs, lock,
    publish, publish_left, read_journals, read_listed, seal, sync_up, work, write_results,
};
use mrvis::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Join the outputs of parts of a batch (batch --shard) in one folder with one table. The exit code is 1 if jobs are missing or lines of a
/// journal are damaged.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Output folders of the parts. One folder that all parts shared only gets its tables.
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// Folder for all jobs [default: the first DIR]
    #[arg(long, value_name = "OUT")]
    out: Option<PathBuf>,
    /// Print nothing.
    #[arg(long)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<ExitCode> {
    let out = args.out.as_ref().unwrap_or(&args.folders[0]);
    args.folders.iter().try_for_each(|folder| check_has_journal(folder))?;
    let _lock = lock(out, "lock", false)?;
    let former = read_journals(out)?.entries;
    let (Journals { mut entries, mut damaged }, out_listed) = read_listed(out)?;
    let mut listed = Listed::default();
    let mut journal = Journal::open(out, "journal.jsonl")?;
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    for folder in &args.folders {
        listed.add(read_listed(folder)?.1);
    }
    // What an earlier merge took counts as long as a folder has the same job file.
    listed.add_same_files(out_listed);
    entries.retain(|_, entry| listed.has(entry));
    // Before the lines: without it a merge that is ended would leave lines that do not count.
    listed.write(out)?;
    for (k, folder) in args.folders.iter().enumerate() {
        if same(folder, out) || args.folders[..k].iter().any(|other| same(other, folder)) {
            continue;
        }
        let journals = read_listed(folder)?.0;
        damaged.extend(journals.damaged);
        let mut others: Vec<Entry> = journals.entries.into_values().collect();
        others.sort_by(|a, b| (a.index, &a.job).cmp(&(b.index, &b.job)));
        for entry in others {
            let made = former.get(&entry.job).is_some_and(|former| former.made);
            take(folder, out, entry, made, &mut entries, &mut journal)?;
        }
    }
    // A batch or a merge that was ended may have left finished jobs without their place.
    let lost = take_out_spoilt(out, &mut entries, true);
    write_results(out, entries.values())?;
    if let Some((job, what)) = lost.first() {
        let more =
            if lost.len() > 1 { format!(" (and {} more jobs)", lost.len() - 1) } else { String::new() };
        return Err(spoilt(&out.join(job), &format!("{what}{more}")));
    }
    let in_all = listed.names().len();
    if !args.quiet {
        let done = entries.values().filter(|e| e.has_outputs()).count();
        let skipped = entries.values().filter(|e| e.status == Status::Skipped).count();
        let failed = entries.len() - done - skipped;
        let of = if entries.len() < in_all { format!(" of {in_all}") } else { String::new() };
        let mut text = format!(
            "{done}{of} {} done, {failed} failed",
            if of.is_empty() && done == 1 { "job" } else { "jobs" }
        );
        text += &if skipped > 0 { format!(", {skipped} skipped") } else { String::new() };
        text += &missing(in_all - entries.len(), &damaged).map_or(String::new(), |what| format!("; {what}"));
        super::print(&format!("{text}; table: {}\n", out.join("results.csv").display()))?;
    }
    Ok(if entries.len() < in_all || !damaged.is_empty() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Takes out jobs whose outputs are not as they were made; returns them by name, with what is wrong. See [`publish_left`].
pub fn take_out_spoilt(out: &Path, entries: &mut Entries, may_publish: bool) -> Vec<(String, String)> {
    let with_outputs = entries.values().filter(|entry| entry.has_outputs());
    let fault = |entry: &Entry| publish_left(out, &entry.job, &entry.outputs, may_publish).err();
    let mut found: Vec<(String, String)> =
        with_outputs.filter_map(|entry| Some((entry.job.clone(), fault(entry)?))).collect();
    found.sort();
    found.iter().for_each(|(job, _)| drop(entries.remove(job)));
    found
}

/// What is wrong with the journals: `count` jobs of the job file have no line, and lines are damaged; nothing if all is well.
pub fn missing(count: usize, damaged: &[Error]) -> Option<String> {
    let lines = match damaged {
        [] => return (count > 0).then(|| format!("{count} without a line in the journal: {MISSING_CURE}")),
        [one] => one.to_string(),
        [first, more @ ..] => format!("{first} (damaged lines in all: {})", more.len() + 1),
    };
    Some(match count {
        0 => lines,
        _ => format!("{count} without a line in the journal; {lines}"),
    })
}

const MISSING_CURE: &str =
    "run the batch again, which names folders to be removed first, or merge its other parts";

/// The error of a job whose outputs are not as they were made.
fn spoilt(folder: &Path, what: &str) -> Error {
    let cure = "run the batch again, which repeats the job, then merge again";
    Error::format(folder, None, format!("{what}: {cure}"))
}

/// Copies a job of the folder `from` to `out`, unless it is there. A folder in its place is replaced if a batch has `made` it.
fn take(
    from: &Path,
    out: &Path,
    mut entry: Entry,
    made: bool,
    entries: &mut Entries,
    journal: &mut Journal,
) -> Result<()> {
    if let Some(known) = entries.get(&entry.job) {
        let is_same = known.key == entry.key && known.status == entry.status;
        let is_better = known.has_outputs() && !entry.has_outputs();
        // A merge that was ended may have written the line only.
        if is_better
            || is_same
                && (!known.has_outputs() || publish_left(out, &known.job, &known.outputs, true).is_ok())
        {
            return Ok(());
        }
        if known.has_outputs() && known.key != entry.key {
            let what =
                format!("the job `{}` is also in another folder, with other options or inputs", entry.job);
            return Err(Error::format(from, None, what));
        }
    }
    if entry.has_outputs() {
        let made = made || entries.get(&entry.job).is_some_and(|known| known.made);
        copy(from, out, &mut entry, made)?;
    }
    // The flag is about the folder in `from`.
    entry.withdrawn = false;
    journal.append(&[&entry])?;
    if entry.has_outputs() {
        publish(out, &entry.job)?;
        sync_up(&out.join(&entry.job), out)?;
    }
    entries.insert(entry.job.clone(), entry);
    Ok(())
}

/// Copies the outputs of a job into its work folder and notes their times. A folder in its place is replaced if a batch has `made` it.
fn copy(from: &Path, out: &Path, entry: &mut Entry, made: bool) -> Result<()> {
    let target = out.join(&entry.job);
    if !made && target.symlink_metadata().is_ok() {
        return Err(Error::format(target, None, "exists and was not made by a batch; remove it"));
    }
    // The part may have been ended between the journal and the renaming of the folder.
    let finished =
        Some(work(from, &entry.job)).filter(|folder| check_outputs(folder, &entry.outputs).is_ok());
    let folder = finished.unwrap_or_else(|| from.join(&entry.job));
    check_outputs(&folder, &entry.outputs).map_err(|what| spoilt(&folder, &what))?;
    begin(out, &entry.job)?;
    let aside = work(out, &entry.job);
    for file in &entry.outputs {
        let (source, target) = (folder.join(&file.path), aside.join(&file.path));
        let copied = std::fs::create_dir_all(target.parent().unwrap_or(&aside))
            .and_then(|()| std::fs::copy(&source, &target));
        copied.map_err(|e| Error::io(source, e))?;
    }
    let copies = seal(out, &entry.job)?;
    // What was read may be something else than what was checked.
    check_outputs(&aside, &entry.outputs).map_err(|what| spoilt(&folder, &what))?;
    entry.outputs = copies;
    Ok(())
}
