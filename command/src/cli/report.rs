//! `mrvis report DIR`: the results of a batch on one page.

use super::{
    args::file_name,
    merge::{missing, take_out_spoilt},
    one_line,
};
use crate::batch::{
    Entry, JobPicture, Journals, Report, check_has_journal, grids, read_listed, report_page, rows,
};
use mrvis::Result;
use mrvis::internals::files::WholeFile;
use mrvis::internals::image_io::thumbnail;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write one page about the outputs of a batch: table of all jobs, differences from references against times, grids of points, pictures.
/// The exit code is 1 if jobs are missing or lines of the journal are damaged.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Output folder of `mrvis batch`.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The page [default: report.html in DIR]
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Print nothing.
    #[arg(long)]
    quiet: bool,
}

/// Largest side of the pictures of the page, pixels: a row of five fits into its width, sharp on fine screens.
const SIDE: u32 = 320;
/// Pictures of the page: at about 60 kB each it stays below 6 MB.
const MAX_PICTURES: usize = 96;

pub fn run(args: &Args) -> Result<ExitCode> {
    check_has_journal(&args.folder)?;
    let (Journals { mut entries, damaged }, listed) = read_listed(&args.folder)?;
    let mut faults: Vec<String> = take_out_spoilt(&args.folder, &mut entries, false)
        .into_iter()
        .map(|(job, what)| format!("{job}: {what}: run the batch again, which repeats the job"))
        .collect();
    let (jobs, in_all) = (entries.len(), listed.names().len());
    faults.extend(missing(in_all - jobs - faults.len(), &damaged));
    let page = args.out.clone().unwrap_or_else(|| args.folder.join("report.html"));
    let rows = rows(&args.folder, entries.values());
    let mut entries: Vec<&Entry> = entries.values().filter(|e| e.has_outputs()).collect();
    entries.sort_by(|a, b| (a.index, &a.job).cmp(&(b.index, &b.job)));
    let grids = grids(&args.folder, entries.iter().copied());
    let files: Vec<(&Entry, &Path)> = entries.into_iter().flat_map(pictures).collect();
    let (mut pictures, mut unreadable) = (Vec::new(), Vec::new());
    for (entry, file) in files.iter().take(MAX_PICTURES) {
        match thumbnail(&args.folder.join(&entry.job).join(file), SIDE) {
            Ok((picture, size)) => {
                let (job, file) = (entry.job.clone(), file.display().to_string());
                pictures.push(JobPicture { job, file, size, picture });
            }
            Err(error) => unreadable.push(one_line(&error)),
        }
    }
    let name = args.folder.canonicalize().unwrap_or_else(|_| args.folder.clone());
    let report = Report {
        name: &file_name(&name),
        rows: &rows,
        jobs_in_all: in_all,
        faults: &faults,
        grids: &grids,
        pictures: &pictures,
        unreadable: &unreadable,
        pictures_in_all: files.len(),
    };
    WholeFile::write(&page, report_page(&report)?)?;
    if !args.quiet {
        let of = if jobs < in_all { format!("{jobs} of {in_all} jobs; ") } else { String::new() };
        let what: String = faults.iter().map(|what| format!("{what}; ")).collect();
        super::print(&format!("{of}{what}report: {}\n", page.display()))?;
    }
    Ok(if jobs < in_all || !damaged.is_empty() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// The pictures that a job has made, below its folder.
fn pictures(entry: &Entry) -> impl Iterator<Item = (&Entry, &Path)> {
    let all = entry.outputs.iter().map(|file| file.path.as_path());
    let mut names: Vec<&Path> = all.filter(|path| path.extension().is_some_and(|e| e == "png")).collect();
    names.sort_by(|a, b| {
        let [a, b] = [a, b].map(|path| parts_of_name(path));
        a.partial_cmp(&b).unwrap_or(Ordering::Equal)
    });
    names.into_iter().map(move |path| (entry, path))
}

/// The parts of a file's name between hyphens, of which numbers are compared as such: the mask of 15.4 comes before that of 120.
fn parts_of_name(path: &Path) -> Vec<(String, f64)> {
    let part = |part: &str| match part.parse::<f64>().ok().filter(|number| number.is_finite()) {
        Some(number) => (String::new(), number),
        None => (part.to_owned(), 0.0),
    };
    path.with_extension("").display().to_string().split('-').map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_in_the_order_of_their_numbers() {
        let names = [
            "floor-mask-120.png",
            "floor-mr-15.4-difference.png",
            "floor-mask-15.4.png",
            "floor-mr-120-difference.png",
        ];
        let mut sorted = names.map(Path::new);
        sorted.sort_by(|a, b| parts_of_name(a).partial_cmp(&parts_of_name(b)).expect("comparable"));
        assert_eq!(sorted, [2, 0, 1, 3].map(|k| Path::new(names[k])));
    }
}
