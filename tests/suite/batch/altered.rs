//! Results that were altered and journals that lost lines: every command says the same of them, and how to mend it.

use super::{batch, prepared};
use crate::run::Scratch;
use std::path::PathBuf;

/// A finished batch of three jobs, and the folder of the output `o`.
fn finished() -> Scratch {
    let scratch = prepared();
    scratch.write("jobs.toml", "[[job]]\nname = '{unit}'\ncommand = 'info'\nscene = 'cornell.obj'\n[job.sweep]\nunit = ['m', 'cm', 'mm']\n");
    batch(&scratch, &["--out", "o", "--threads", "1"]).exits(0);
    scratch
}

/// The only file of the job `cm`.
fn output(scratch: &Scratch) -> PathBuf {
    let mut files = std::fs::read_dir(scratch.path("o/cm")).expect("its folder");
    files.next().expect("a file").expect("readable").path()
}

#[test]
fn an_altered_result_is_repeated() {
    let scratch = finished();
    let path = output(&scratch);
    let name = path.file_name().expect("a name").to_string_lossy().into_owned();
    let text = std::fs::read_to_string(&path).expect("a record");
    let altered = text.replacen('1', "2", 1);
    assert!(altered != text && altered.len() == text.len());
    std::fs::write(&path, altered).expect("written");
    let what = format!("{name} was changed since the batch made it");

    let merged = scratch.mrvis("merge o").exits(2);
    for part in ["o/cm", &what, "run the batch again, which repeats the job, then merge again"] {
        merged.warns(part);
    }
    scratch.mrvis("merge o --out all").exits(2).warns(&what);
    scratch.mrvis("report o").exits(1).prints(&format!("2 of 3 jobs; cm: {what}"));
    batch(&scratch, &["--out", "o", "--dry-run"]).prints(&format!("cm [to do again: {what}"));

    batch(&scratch, &["--out", "o"])
        .warns(&format!("cm runs again: {what}"))
        .prints("1 jobs done, 2 were done before");
    for command in ["merge", "report"] {
        scratch.mrvis(&format!("{command} o")).exits(0);
    }
}

#[test]
fn a_short_or_damaged_journal_says_how_many_jobs_it_has() {
    let scratch = finished();
    let path = scratch.path("o/.mrvis-batch/journal.jsonl");
    let whole = std::fs::read_to_string(&path).expect("a journal");
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let damaged = [lines[0], &lines[1][..40], "\n", lines[2]].concat();
    for (text, known, why) in [
        (lines[0].to_owned(), 1, "2 without a line in the journal: run the batch again"),
        (String::new(), 0, "3 without a line in the journal"),
        (damaged, 2, "journal.jsonl:2: is damaged"),
    ] {
        std::fs::write(&path, &text).expect("written");
        for command in [&["merge", "o"][..], &["report", "o"], &["merge", "o", "--out", "all"]] {
            let ended = scratch.mrvis(command);
            assert_eq!(ended.code, Some(1), "{command:?}: {}{}", ended.stdout, ended.stderr);
            assert!(ended.stdout.starts_with(&format!("{known} of 3 jobs")), "{}", ended.stdout);
            ended.prints(why);
        }
        let page = scratch.text("o/report.html");
        assert!(page.contains(&format!("<strong>{known}</strong> of <strong>3</strong>")), "{page}");
        std::fs::remove_dir_all(scratch.path("all")).expect("removed");
    }
    // Nothing says who made the folders whose lines are lost.
    std::fs::write(&path, lines[0]).expect("written");
    batch(&scratch, &["--out", "o"])
        .exits(2)
        .warns("o/cm: exists and was not made by this batch")
        .warns("as do 1 more: mm; remove them");
    for folder in ["o/cm", "o/mm"] {
        std::fs::remove_dir_all(scratch.path(folder)).expect("removed");
    }
    batch(&scratch, &["--out", "o"]).prints("2 jobs done, 1 were done before");
}
