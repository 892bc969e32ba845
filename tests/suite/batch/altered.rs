//! Results that were altered and journals that lost lines: every command says the same of them, and how to mend it.

use super::{batch, prepared};
use crate::run::Scratch;
use std::path::PathBuf;

/// A finished batch of three jobs, and the folder of the output `o`.
fn finished() -> Scratch {
    let scratch = prepared();
    scratch.write("jobs.toml", "[[job]]\nname = '{unit}'\ncommand = 'info'\nscene = 'cornell.obj'\n[job.sweep]\nunit = ['m', 'cm', 'mm']\n");
    let ran = batch(&scratch, &["--out", "o", "--threads", "1"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
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

    let merged = scratch.mrvis(&["merge", "o"]);
    assert_eq!(merged.code, Some(2), "{}", merged.stdout);
    for part in ["o/cm", &what, "run the batch again, which repeats the job, then merge again"] {
        assert!(merged.stderr.contains(part), "{}", merged.stderr);
    }
    let copied = scratch.mrvis(&["merge", "o", "--out", "all"]);
    assert!(copied.code == Some(2) && copied.stderr.contains(&what), "{}", copied.stderr);
    let reported = scratch.mrvis(&["report", "o"]);
    assert_eq!(reported.code, Some(1), "{}", reported.stderr);
    assert!(reported.stdout.contains(&format!("2 of 3 jobs; cm: {what}")), "{}", reported.stdout);
    let planned = batch(&scratch, &["--out", "o", "--dry-run"]);
    assert!(planned.stdout.contains(&format!("cm [to do again: {what}")), "{}", planned.stdout);

    let again = batch(&scratch, &["--out", "o"]);
    assert!(again.stderr.contains(&format!("cm runs again: {what}")), "{}", again.stderr);
    assert!(again.stdout.contains("1 jobs done, 2 were done before"), "{}", again.stdout);
    for command in ["merge", "report"] {
        let ended = scratch.mrvis(&[command, "o"]);
        assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
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
            assert!(ended.stdout.contains(why), "{}", ended.stdout);
        }
        let page = std::fs::read_to_string(scratch.path("o/report.html")).expect("a page");
        assert!(page.contains(&format!("<strong>{known}</strong> of <strong>3</strong>")), "{page}");
        std::fs::remove_dir_all(scratch.path("all")).expect("removed");
    }
    // Nothing says who made the folders whose lines are lost.
    std::fs::write(&path, lines[0]).expect("written");
    let refused = batch(&scratch, &["--out", "o"]);
    assert_eq!(refused.code, Some(2), "{}", refused.stdout);
    assert!(refused.stderr.contains("o/cm: exists and was not made by this batch"), "{}", refused.stderr);
    assert!(refused.stderr.contains("as do 1 more: mm; remove them"), "{}", refused.stderr);
    for folder in ["o/cm", "o/mm"] {
        std::fs::remove_dir_all(scratch.path(folder)).expect("removed");
    }
    let again = batch(&scratch, &["--out", "o"]);
    assert!(again.stdout.contains("2 jobs done, 1 were done before"), "{}{}", again.stdout, again.stderr);
}
