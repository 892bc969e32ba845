//! What counts as done, and what is kept when something goes wrong with the outputs of one job.

use super::{COUNT, JOBS, batch, journal, prepared, results};
use crate::run::{Outcome, Scratch, signal, wait_until};
use serde_json::Value;
use std::path::{Path, PathBuf};

const TRIANGLE: &str = "mtllib m.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Runs the batch, which must succeed; returns the jobs that ran.
fn ran(scratch: &Scratch, out: &str) -> Vec<String> {
    let before = journal(&scratch.path(out)).len();
    batch(scratch, &["--out", out]).exits(0);
    let lines = journal(&scratch.path(out)).into_iter().skip(before);
    lines.map(|line| line["job"].as_str().expect("a name").to_owned()).collect()
}

/// Scenes that lie below the output folder, such as with `--out .`, are inputs as all others.
#[test]
fn inputs_below_the_output_folder_are_noticed() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("scenes")).expect("made");
    scratch.write("scenes/a.obj", TRIANGLE);
    scratch.write("scenes/m.mtl", "newmtl red\nKd 0.5 0.1 0.1\n");
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = 'made'\ncommand = 'generate'\ninputs = 'cubes'\n\
         [[job]]\nname = 'own'\ncommand = 'info'\nscene = 'scenes/a.obj'\n\
         [[job]]\nname = 'of-made'\ncommand = 'info'\nscene = '{out:made}/scene.obj'\n",
    );
    assert_eq!(ran(&scratch, ".").len(), 3);
    assert!(ran(&scratch, ".").is_empty());
    // The library is named by the scene only.
    scratch.write("scenes/m.mtl", "newmtl red\nKd 0.1 0.1 0.5\n");
    assert_eq!(ran(&scratch, "."), ["own"]);
    assert!(ran(&scratch, ".").is_empty());
}

/// A library or a texture that was missing is an input when it appears.
#[test]
fn files_that_appear_are_noticed() {
    let scratch = Scratch::new();
    scratch.write("a.obj", TRIANGLE);
    scratch.write("other.obj", TRIANGLE.replace("mtllib m.mtl\n", ""));
    scratch.write("jobs.toml", "[[job]]\nname = '{scene}'\ncommand = 'info'\nscene = '*.obj'\n");
    assert_eq!(ran(&scratch, "o").len(), 2);
    assert!(ran(&scratch, "o").is_empty());
    scratch.write("m.mtl", "newmtl red\nKd 1 1 1\nmap_Kd t.png\n");
    assert_eq!(ran(&scratch, "o"), ["a"]);
    assert!(ran(&scratch, "o").is_empty());
    scratch.write("t.png", "no picture, but a file");
    assert_eq!(ran(&scratch, "o"), ["a"]);
    std::fs::remove_file(scratch.path("m.mtl")).expect("removed");
    assert_eq!(ran(&scratch, "o"), ["a"]);
}

/// A folder that is moved with its scenes and results is done.
#[test]
fn a_moved_folder_is_done() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("here")).expect("made");
    scratch.write("here/a.obj", TRIANGLE);
    scratch.write("here/m.mtl", "newmtl red\nKd 0.5 0.1 0.1\n");
    scratch.write("here/jobs.toml", "[[job]]\ncommand = 'info'\nscene = 'a.obj'\n");
    let done = |folder: &str, want: &str| {
        scratch
            .mrvis(&["batch", &format!("{folder}/jobs.toml"), "--out", &format!("{folder}/o")])
            .prints(want);
    };
    done("here", "1 job done, 0 done before");
    std::fs::rename(scratch.path("here"), scratch.path("there")).expect("moved");
    done("there", "0 jobs done, 1 done before");
    let full = scratch.path("there");
    done(&full.to_string_lossy(), "0 jobs done, 1 done before");
    scratch.write("there/m.mtl", "newmtl red\nKd 0.1 0.1 0.5\n");
    done("there", "1 job done, 0 done before");
}

/// What a job made with other options is no result of a run in which it fails or is skipped.
#[test]
fn results_of_other_options_do_not_stay() {
    let scratch = Scratch::new();
    let jobs = |seed: u32| {
        scratch.write(
            "jobs.toml",
            format!(
                "[[job]]\nname = 'first'\ncommand = 'generate'\ninputs = 'cubes'\noptions = {{ seed = {seed} }}\n\
                 [[job]]\nname = 'second'\ncommand = 'info'\nscene = '{{out:first}}/scene.obj'\n\
                 [[job]]\nname = 'third'\ncommand = 'info'\nscene = 'a.obj'\n"
            ),
        );
    };
    scratch.write("a.obj", TRIANGLE);
    jobs(1);
    assert_eq!(ran(&scratch, "o").len(), 3);
    // A file has the place of the folder of all work: the first job fails because its work folder cannot be made.
    jobs(2);
    std::fs::remove_dir_all(scratch.path("o/.mrvis-batch/work")).expect("removed");
    scratch.write("o/.mrvis-batch/work", "in the way");
    batch(&scratch, &["--out", "o"]).exits(2).warns("failed first: ").warns("skipped second");
    for job in ["first", "second"] {
        assert!(!scratch.path("o").join(job).exists(), "{job}");
    }
    assert!(scratch.path("o/third/info.json").exists());
    let table = scratch.text("o/results.jsonl");
    let rows = table.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let status: Vec<String> = rows.map(|row| row["status"].as_str().expect("a status").to_owned()).collect();
    assert_eq!(status, ["failed", "skipped", "done"]);
    std::fs::remove_file(scratch.path("o/.mrvis-batch/work")).expect("removed");
    // A folder that appears in the place of a job without outputs is the user's own.
    std::fs::create_dir(scratch.path("o/first")).expect("made");
    batch(&scratch, &["--out", "o"]).warns("o/first: exists and was not made by this batch");
    std::fs::remove_dir(scratch.path("o/first")).expect("removed");
    assert_eq!(ran(&scratch, "o"), ["first", "second"]);
}

/// The outputs of one job cannot take their place; the others are finished.
#[test]
fn an_output_without_a_place_fails_its_job_only() {
    let scratch = prepared();
    std::fs::create_dir(scratch.path("o")).expect("made");
    // The folder of `compared/coarse` cannot be made.
    scratch.write("o/compared", "in the way");
    batch(&scratch, &["--out", "o"])
        .exits(2)
        .prints("10 jobs done, 0 done before, 2 failed")
        .warns("failed compared/coarse: ");
    std::fs::remove_file(scratch.path("o/compared")).expect("removed");
    assert_eq!(ran(&scratch, "o").len(), 2);
    batch(&scratch, &["--out", "p"]).exits(0);
    super::assert_same_files(&results(&scratch.path("o")), &results(&scratch.path("p")));
    // The batch was killed between the line of a finished job and that of its failure.
    unpublish(&scratch.path("p"), &["compared/coarse", "compared/fine"]);
    std::fs::remove_dir(scratch.path("p/compared")).expect("removed");
    scratch.write("p/compared", "in the way");
    batch(&scratch, &["--out", "p"]).exits(2).prints("0 jobs done, 10 done before, 2 failed");
}

/// Moves the folders of finished jobs back into the work folder, as a crash between the journal and the renaming leaves them.
fn unpublish(out: &Path, jobs: &[&str]) {
    for job in jobs {
        let aside = out.join(".mrvis-batch/work").join(job);
        std::fs::create_dir_all(aside.parent().expect("a folder")).expect("made");
        std::fs::rename(out.join(job), aside).expect("moved");
    }
}

/// Whether a part or the merge itself was ended between a line and its folder: no job is lost, and none is in the table without outputs.
#[test]
fn a_merge_after_a_crash_has_all_jobs() {
    let scratch = prepared();
    batch(&scratch, &["--out", "whole"]).exits(0);
    let want = results(&scratch.path("whole"));
    for (part, out) in [("1/2", "first"), ("2/2", "second")] {
        batch(&scratch, &["--out", out, "--shard", part]).exits(0);
    }
    let jobs = |out: &str| {
        let folders = ["solve-0.3-mr", "solve-0.3-exact", "solve-0.3-average"];
        folders.into_iter().filter(|job| scratch.path(out).join(job).exists()).collect::<Vec<_>>()
    };
    for out in ["first", "second"] {
        unpublish(&scratch.path(out), &jobs(out));
    }
    let merge = |folders: &[&str], out: &str| scratch.mrvis(&[&["merge"], folders, &["--out", out]].concat());
    merge(&["first", "second"], "all").exits(0);
    super::assert_same_files(&results(&scratch.path("all")), &want);
    // The merge was ended after a line.
    let own = jobs("all");
    assert_eq!(own.len(), 3);
    unpublish(&scratch.path("all"), &own);
    merge(&["all"], "all").exits(0);
    super::assert_same_files(&results(&scratch.path("all")), &want);
    // Outputs that are nowhere in the folder are copied again, or the merge says so.
    std::fs::remove_dir_all(scratch.path("all/solve-0.3-mr")).expect("removed");
    merge(&["all"], "all").exits(2).warns("solve-0.3-mr: its folder is missing: run the batch again");
    let table = scratch.text("all/results.csv");
    assert_eq!(table.lines().count(), COUNT);
    merge(&["first", "second"], "all").prints("12 jobs done, 0 failed");
    super::assert_same_files(&results(&scratch.path("all")), &want);
}

/// Parts of two splits would run the same jobs at the same time.
#[test]
fn parts_of_two_splits_do_not_run_together() {
    let scratch = prepared();
    scratch.forest(60, 2000);
    scratch.write(
        "jobs.toml",
        JOBS.replace("'*.obj'", "'forest.obj'")
            .replace("error = [0.4, 0.3, 0.2]", "error = [0.001]")
            .replace("solve-0.4-exact", "solve-0.001-exact")
            .replace("solve-0.2-exact", "solve-0.001-exact"),
    );
    let mut child = scratch.started("batch jobs.toml --out o --shard 1/2 --threads 1");
    wait_until(60, "the first part does not start", || scratch.path("o/.mrvis-batch/work").exists());
    let refused = batch(&scratch, &["--out", "o", "--shard", "2/3"]);
    child.kill().expect("ended");
    child.wait().expect("ended");
    refused.exits(2).warns("parts of another split are running in this folder");
}

/// The process that `parent` has started and that has worked for half a second: by then it handles interruptions.
#[cfg(target_os = "linux")]
fn process_at_work(parent: u32) -> Option<String> {
    let processes = std::fs::read_dir("/proc").expect("Linux lists processes").flatten();
    processes.map(|entry| entry.file_name().to_string_lossy().into_owned()).find(|pid| {
        let line = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        // After the name: state, ppid; and utime in hundredths of a second, of proc_pid_stat(5).
        let fields: Vec<&str> = line.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let number = |field: usize| fields.get(field).and_then(|n| n.parse::<u64>().ok());
        number(1) == Some(parent.into()) && number(11).is_some_and(|hundredths| hundredths > 50)
    })
}

/// A job whose own process is interrupted has failed: its solution is that of half of the work.
#[test]
#[cfg(target_os = "linux")]
fn an_interrupted_process_of_a_job_has_failed() {
    let scratch = prepared();
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = 'long'\ncommand = 'solve'\nscene = 'cornell.obj'\nlimits = { seconds = 500 }\n\
         options = { unit = 'mm', error = 0.0002, output = ['none'], cache = 'off' }\n",
    );
    let mut batch = scratch.started("batch jobs.toml --out o");
    let job = loop {
        if let Some(pid) = process_at_work(batch.id()) {
            break pid;
        }
        assert!(batch.try_wait().expect("a child").is_none(), "the job is not at work");
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    signal("INT", job);
    Outcome::at_end(batch).exits(2).warns("was interrupted");
    assert_eq!(journal(&scratch.path("o"))[0]["status"], "failed");
}

/// A job that an ended batch had begun may have ended it, for want of memory: it runs as a process of its own.
#[test]
fn begun_jobs_run_apart() {
    let scratch = prepared();
    scratch.write("jobs.toml", "[[job]]\nname = '{unit}'\ncommand = 'info'\nscene = 'cornell.obj'\n[job.sweep]\nunit = ['m', 'cm']\n");
    std::fs::create_dir_all(scratch.path("o/.mrvis-batch/work/cm")).expect("made");
    assert_eq!(ran(&scratch, "o").len(), 2);
    for line in journal(&scratch.path("o")) {
        assert_eq!(line["peak_bytes"].is_number(), line["job"] == "cm", "{line}");
    }
}

/// A tolerance that was missed is reported by every run, not only by the one that ran the job.
#[test]
fn missed_tolerances_are_reported_again() {
    let scratch = prepared();
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = 'missed'\ncommand = 'solve'\nscene = 'cornell.obj'\n\
         options = { unit = 'mm', error = 0.4, target-error = 1e-5, max-seconds = 0.1, output = ['none'], cache = 'off' }\n",
    );
    for _ in 0..2 {
        batch(&scratch, &["--out", "o"]).exits(1);
    }
    assert_eq!(journal(&scratch.path("o")).len(), 1);
}

/// The log never becomes a part of what the batch reads or writes.
#[test]
fn the_log_replaces_no_input() {
    let scratch = prepared();
    let before = std::fs::read(scratch.path("cornell.obj")).expect("the scene");
    for log in ["cornell.obj", "jobs.toml", "o/results.csv"] {
        let refused = batch(&scratch, &["--out", "o", "--log", log]);
        assert_eq!(refused.code, Some(2), "{log}: {}", refused.stdout);
        refused.warns("--log");
    }
    assert_eq!(std::fs::read(scratch.path("cornell.obj")).expect("the scene"), before);
}

/// Scenes of one name in several folders have names of their own by `{folder}`; a name with brackets is a file first.
#[test]
fn scenes_of_one_name_are_told_apart() {
    let scratch = Scratch::new();
    for folder in ["a", "b"] {
        std::fs::create_dir(scratch.path(folder)).expect("made");
        scratch.write(&format!("{folder}/room[1].obj"), TRIANGLE);
    }
    let job = |name: &str| {
        format!("[[job]]\nname = '{name}'\ncommand = 'info'\nscene = ['a/room[1].obj', 'b/room[[]1].obj']\n")
    };
    scratch.write("jobs.toml", job("{scene}"));
    batch(&scratch, &["--out", "o"]).warns("`a/room[1].obj` and `b/room[1].obj`");
    scratch.write("jobs.toml", job("{folder}-{scene}"));
    // They run side by side.
    let mut jobs = ran(&scratch, "o");
    jobs.sort();
    assert_eq!(jobs, ["a-room_1_", "b-room_1_"]);
}

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
        .prints("1 job done, 2 done before");
    for command in ["merge", "report"] {
        scratch.mrvis(&format!("{command} o")).exits(0);
    }
}

/// A damaged line whose job has another line takes nothing away, and is said all the same.
#[test]
fn damaged_lines_of_journals_are_said() {
    let scratch = finished();
    let path = scratch.path("o/.mrvis-batch/journal.jsonl");
    let whole = std::fs::read_to_string(&path).expect("a journal");
    std::fs::write(&path, format!("{whole}not JSON\n")).expect("written");
    for command in ["merge o", "report o"] {
        scratch.mrvis(command).exits(1).prints("journal.jsonl:4: is damaged");
    }
    batch(&scratch, &["--out", "o"]).exits(2).warns("journal.jsonl:4: is damaged");
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
    std::fs::write(&path, lines[0]).expect("written");
    // Nothing says how many jobs there are.
    let list = [scratch.path("o/.mrvis-batch/jobs.json"), scratch.path("jobs.json")];
    std::fs::rename(&list[0], &list[1]).expect("moved");
    for command in [&["merge", "o"][..], &["report", "o"]] {
        scratch.mrvis(command).exits(2).warns("jobs.json: is missing").warns("run the batch again");
    }
    std::fs::rename(&list[1], &list[0]).expect("moved back");
    // Nothing says who made the folders whose lines are lost.
    batch(&scratch, &["--out", "o"])
        .exits(2)
        .warns("o/cm: exists and was not made by this batch")
        .warns("as do 1 more: mm; remove them");
    for folder in ["o/cm", "o/mm"] {
        std::fs::remove_dir_all(scratch.path(folder)).expect("removed");
    }
    batch(&scratch, &["--out", "o"]).prints("2 jobs done, 1 done before");
}
