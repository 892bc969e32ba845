//! Parts of a batch by several processes: in one folder, in several, with GNU parallel and with Slurm.

use super::{assert_same_files, batch, prepared, results};
use crate::install::project;
use crate::run::{Outcome, Scratch};
use std::process::Command;

/// Parts that run at the same time make what one process makes.
#[test]
fn parts_make_the_whole() {
    let scratch = prepared();
    batch(&scratch, &["--out", "whole"]).exits(0);
    let whole = results(&scratch.path("whole"));
    for folders in [["one", "one", "one"], ["first", "second", "third"]] {
        let children: Vec<_> = ["1/3", "2/3", "3/3"]
            .iter()
            .zip(folders)
            .map(|(part, out)| {
                scratch.started(&format!("batch jobs.toml --out {out} --shard {part} --threads 1"))
            })
            .collect();
        for child in children {
            Outcome::at_end(child).exits(0);
        }
    }
    scratch.mrvis("merge one").exits(0);
    scratch.mrvis("merge first second third --out all").prints("12 jobs done, 0 failed");
    for out in ["one", "all"] {
        assert_same_files(&results(&scratch.path(out)), &whole);
        let table = scratch.text(scratch.path(out).join("results.csv"));
        assert_eq!(table.lines().count(), 13);
        // A batch of all jobs finds them done.
        batch(&scratch, &["--out", out]).prints("0 jobs done, 12 were done before");
    }
    let record = ["first", "second", "third"].map(|out| scratch.path(out).join("solve-0.4-mr/solution.json"));
    let record = record.into_iter().find(|path| path.exists()).expect("one part has the job");
    std::fs::write(record, "{}").expect("changed");
    scratch
        .mrvis("merge first second third --out other")
        .exits(2)
        .warns("solve-0.4-mr: solution.json was changed since");
}

/// Parts without a job are parts nevertheless.
#[test]
fn more_parts_than_jobs_make_the_whole() {
    let scratch = prepared();
    scratch.write("jobs.toml", "[[job]]\nname = 'one'\ncommand = 'info'\nscene = 'cornell.obj'\n");
    for (part, out) in [("1/2", "first"), ("2/2", "second")] {
        batch(&scratch, &["--out", out, "--shard", part]).exits(0);
    }
    scratch.mrvis("merge first second --out all").prints("1 jobs done, 0 failed");
    std::fs::create_dir(scratch.path("empty")).expect("made");
    scratch.mrvis("merge first empty --out all").warns("empty: is no output folder");
}

/// Runs a script of the project; `None` if it says that it cannot run here.
fn script(scratch: &Scratch, name: &str, arguments: &[&str]) -> Option<Outcome> {
    let path = project(name);
    let mut command = Command::new(path);
    command.args(arguments).current_dir(scratch.path(".")).env("MRVIS", env!("CARGO_BIN_EXE_mrvis"));
    let ran = Outcome::of(command.output().expect("the script runs"));
    if ran.code == Some(77) {
        eprintln!("{name}: {}", ran.stderr.trim());
        return None;
    }
    Some(ran.exits(0))
}

#[test]
fn gnu_parallel_runs_the_parts() {
    if Command::new("parallel").arg("--version").output().is_err() {
        eprintln!("skipped: parallel is missing (Debian: apt-get install parallel)");
        return;
    }
    let scratch = prepared();
    script(&scratch, "examples/slurm/parallel.sh", &["jobs.toml", "o", "2"]);
    batch(&scratch, &["--out", "o"]).prints("0 jobs done, 12 were done before");
}

/// A job array of a real Slurm on this machine.
#[test]
fn slurm_runs_the_parts() {
    let scratch = prepared();
    let arguments = [env!("CARGO_BIN_EXE_mrvis"), "jobs.toml", "o", "3"];
    if script(&scratch, "tests/slurm/run-array", &arguments).is_some() {
        batch(&scratch, &["--out", "o"]).prints("0 jobs done, 12 were done before");
    }
}
