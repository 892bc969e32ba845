//! `mrvis merge DIR... --out OUT`: joins the outputs of the parts of a batch.

use crate::batch::{
    Entries, Entry, Journal, Status, begin, holds, lock, publish, read_journals, seal, work, write_results,
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
        if read_journals(folder)?.is_empty() {
            return Err(Error::format(folder, None, "is no output folder of a batch: it has no journal"));
        }
    }
    let _lock = lock(out, "lock", false)?;
    let mut entries = read_journals(out)?;
    let mut journal = Journal::open(out, "journal.jsonl")?;
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    for folder in args.folders.iter().filter(|folder| !same(folder, out)) {
        let mut others: Vec<Entry> = read_journals(folder)?.into_values().collect();
        others.sort_by(|a, b| (a.index, &a.job).cmp(&(b.index, &b.job)));
        for entry in others {
            take(folder, out, entry, &mut entries, &mut journal)?;
        }
    }
    write_results(out, entries.values())?;
    if !args.quiet {
        let done = entries.values().filter(|e| e.status != Status::Failed).count();
        super::print(&format!(
            "{done} jobs done, {} failed; table: {}\n",
            entries.len() - done,
            out.join("results.csv").display()
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Copies a job of another folder, unless it is there.
fn take(from: &Path, out: &Path, entry: Entry, entries: &mut Entries, journal: &mut Journal) -> Result<()> {
    let known = entries.get(&entry.job).filter(|known| known.status != Status::Failed);
    if let Some(known) = known {
        if known.key == entry.key || entry.status == Status::Failed {
            return Ok(());
        }
        let what = format!("the job `{}` is also in another folder, with other options or inputs", entry.job);
        return Err(Error::format(from, None, what));
    }
    if entry.status != Status::Failed {
        let target = out.join(&entry.job);
        if target.symlink_metadata().is_ok() {
            return Err(Error::format(target, None, "exists and was not made by a batch; remove it"));
        }
        begin(out, &entry.job)?;
        let aside = work(out, &entry.job);
        for file in &entry.outputs {
            let (source, target) = (from.join(&entry.job).join(&file.path), aside.join(&file.path));
            let copied = std::fs::create_dir_all(target.parent().unwrap_or(&aside))
                .and_then(|()| std::fs::copy(&source, &target));
            copied.map_err(|e| Error::io(source, e))?;
        }
        seal(&aside)?;
        if !holds(&aside, &entry.outputs, true) {
            return Err(Error::format(from.join(&entry.job), None, "was changed since the batch made it"));
        }
    }
    journal.append(&[&entry])?;
    if entry.status != Status::Failed {
        publish(out, &entry.job)?;
    }
    entries.insert(entry.job.clone(), entry);
    Ok(())
}
