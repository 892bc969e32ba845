//! `mrvis merge DIR... --out OUT`: joins the outputs of the parts of a batch.

use crate::batch::{
    Entries, Entry, Journal, Listed, Status, begin, has_journal, holds, lock, publish, publish_left,
    read_journals, read_listed, seal, sync_up, work, write_results,
};
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Join the outputs of parts of a batch (batch --shard) in one folder with one table.
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
    for folder in &args.folders {
        if !has_journal(folder)? {
            return Err(Error::format(folder, None, "is no output folder of a batch: it has no journal"));
        }
    }
    let _lock = lock(out, "lock", false)?;
    let former = read_journals(out)?;
    let (mut entries, out_listed) = read_listed(out)?;
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
    for folder in args.folders.iter().filter(|folder| !same(folder, out)) {
        let mut others: Vec<Entry> = read_listed(folder)?.0.into_values().collect();
        others.sort_by(|a, b| (a.index, &a.job).cmp(&(b.index, &b.job)));
        for entry in others {
            let made = former.get(&entry.job).is_some_and(|former| former.made);
            take((folder, out), entry, made, &mut entries, &mut journal)?;
        }
    }
    // A batch or a merge that was ended may have left finished jobs without their place.
    let is_lost =
        |entry: &&Entry| entry.has_outputs() && !publish_left(out, &entry.job, &entry.outputs, true);
    let lost: Vec<String> = entries.values().filter(is_lost).map(|entry| entry.job.clone()).collect();
    lost.iter().for_each(|job| drop(entries.remove(job)));
    write_results(out, entries.values())?;
    if let Some(one) = lost.iter().min() {
        let more = if lost.len() > 1 { format!(" and {} more jobs", lost.len() - 1) } else { String::new() };
        let what = format!(
            "the outputs of {one}{more} are missing: run the batch again, which makes them, then merge again"
        );
        return Err(Error::format(out, None, what));
    }
    if !args.quiet {
        let done = entries.values().filter(|e| e.has_outputs()).count();
        let skipped = entries.values().filter(|e| e.status == Status::Skipped).count();
        let failed = entries.len() - done - skipped;
        let skipped = if skipped > 0 { format!(", {skipped} skipped") } else { String::new() };
        let table = out.join("results.csv");
        super::print(&format!("{done} jobs done, {failed} failed{skipped}; table: {}\n", table.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Copies a job of the folder `from` to `out`, unless it is there. A folder in its place is replaced if a batch has `made` it.
fn take(
    (from, out): (&Path, &Path),
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
            || is_same && (!known.has_outputs() || publish_left(out, &known.job, &known.outputs, true))
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
        copy(from, out, &entry, made)?;
    }
    // It says what happened to the folder in `from`.
    entry.withdrawn = false;
    journal.append(&[&entry])?;
    if entry.has_outputs() {
        publish(out, &entry.job)?;
        sync_up(&out.join(&entry.job), out)?;
    }
    entries.insert(entry.job.clone(), entry);
    Ok(())
}

/// Copies the outputs of a job into its work folder. A folder in its place is replaced if a batch has `made` it.
fn copy(from: &Path, out: &Path, entry: &Entry, made: bool) -> Result<()> {
    let target = out.join(&entry.job);
    if !made && target.symlink_metadata().is_ok() {
        return Err(Error::format(target, None, "exists and was not made by a batch; remove it"));
    }
    // The part may have been ended between the journal and the renaming of the folder.
    let finished = Some(work(from, &entry.job)).filter(|folder| holds(folder, &entry.outputs, true));
    let folder = finished.unwrap_or_else(|| from.join(&entry.job));
    begin(out, &entry.job)?;
    let aside = work(out, &entry.job);
    for file in &entry.outputs {
        let (source, target) = (folder.join(&file.path), aside.join(&file.path));
        let copied = std::fs::create_dir_all(target.parent().unwrap_or(&aside))
            .and_then(|()| std::fs::copy(&source, &target));
        copied.map_err(|e| Error::io(source, e))?;
    }
    seal(out, &entry.job)?;
    if !holds(&aside, &entry.outputs, true) {
        return Err(Error::format(folder, None, "was changed since the batch made it"));
    }
    Ok(())
}
