//! `--mpi` with Open MPI: several processes give the files of one, and a lost process leaves nothing half-written and no finished job
//! behind.

use super::run::{self, Line, Outcome, Scratch, assert_same_files, job_files, wait, wait_until, words};
use mrvis::internals::scene::generate::Spec;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const POINTS: &str =
    "x,y,z,nx,ny,nz\n278,0,280,0,1,0\n100,0,100,0,1,0\n400,300,559,0,0,-1\n20,0,30,0,1,0\n500,0,500,0,1,0\n";

/// Many short jobs and one that needs another.
const JOBS: &str = "
[defaults]
options = { unit = 'mm' }

[[job]]
name = 'solve-{error}-{seed}'
command = 'solve'
scene = 'cornell.obj'
options = { audit = 0, local-rays = 0, output = ['ply'], cache = 'off', points = 'points.csv' }
[job.sweep]
error = [0.4, 0.3, 0.2, 0.1]
seed = [1, 2, 3]

[[job]]
name = 'reference'
command = 'reference'
scene = 'cornell.obj'
options = { points = 'points.csv', samples = 64 }

[[job]]
name = 'compared'
command = 'compare'
inputs = ['{out:reference}/irradiance.csv', '{out:solve-0.4-1}/irradiance.csv']
";
const COUNT: usize = 14;

fn prepared() -> Scratch {
    let scratch = Scratch::new();
    scratch.generate(&Spec::new("cornell"));
    scratch.forest(3, 100);
    scratch.write("points.csv", POINTS);
    scratch.write("jobs.toml", JOBS);
    scratch
}

/// The command on so many ranks. Root, as in containers, is a user like others; one machine has as many places as are asked for.
fn ranks(scratch: &Scratch, count: usize, line: &(impl Line + ?Sized)) -> Command {
    let mut command = Command::new("mpirun");
    command.args([
        "-n",
        &count.to_string(),
        "--oversubscribe",
        "--bind-to",
        "none",
        env!("CARGO_BIN_EXE_mrvis"),
    ]);
    command.args(line.words()).current_dir(scratch.path("")).env("XDG_CACHE_HOME", scratch.path("cache"));
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    // Ranks of a container may not read each other's memory.
    command.env("OMPI_MCA_btl_vader_single_copy_mechanism", "none");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn on_ranks(scratch: &Scratch, count: usize, line: &(impl Line + ?Sized)) -> Outcome {
    Outcome::of(ranks(scratch, count, line).output().expect("mpirun runs"))
}

/// Files below a folder, without those that hold times.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    job_files(folder, |name, content| (!name.ends_with(".json")).then_some(content))
}

fn assert_same(found: &Path, want: &Path) {
    assert_same_files(&files(found), &files(want));
}

/// Sends a signal to rank 1 of a running command: `KILL` ends it without a word.
fn signal_rank_1(signal: &str, scratch: &Scratch) {
    let folder = scratch.path("").canonicalize().expect("a folder");
    let is_it = |process: &Path| {
        let environment = std::fs::read(process.join("environ")).unwrap_or_default();
        environment.split(|b| *b == 0).any(|line| line == b"OMPI_COMM_WORLD_RANK=1")
            && std::fs::read_link(process.join("cwd")).is_ok_and(|cwd| cwd == folder)
    };
    wait_until(60, "rank 1 does not run", || {
        let processes =
            std::fs::read_dir("/proc").expect("Linux").map(|entry| entry.expect("an entry").path());
        let found = processes.filter(|process| process.join("environ").exists()).find(|p| is_it(p));
        if let Some(process) = &found {
            run::signal(signal, process.file_name().expect("a number").to_string_lossy());
        }
        found.is_some()
    });
}

/// Lines of the journal, and how many of them are about jobs that are done.
fn journal(out: &Path) -> [usize; 2] {
    let text = std::fs::read_to_string(out.join(".mrvis-batch/journal.jsonl")).unwrap_or_default();
    ["\n", "\"status\":\"done\""].map(|sign| text.matches(sign).count())
}

#[test]
fn files_are_those_of_one_process() {
    let scratch = prepared();
    let commands = [
        "solve cornell.obj --points points.csv --error 0.2 --min-area 1e-3 --local-rays 20000 --audit 50 \
         --output ply,vtu,lightmap --lightmap-texels 64",
        "solve forest.obj --error 0.3 --min-area 1e-3 --local-rays 20000 --audit 20 --visibility mr --output ply \
         --cache off",
        "reference cornell.obj --points points.csv --samples 200",
        "form-factors forest.obj --rays 16",
    ];
    for (k, words) in commands.map(words).iter().enumerate() {
        let out = |count: usize| {
            let folder = format!("{k}-{count}");
            std::fs::create_dir(scratch.path(&folder)).expect("made");
            let file = ["", "", "irradiance.csv", "factors.csv"][k];
            [folder.clone(), format!("{folder}/{file}"), format!("{folder}/record.json")]
        };
        let line = |out: &[String; 3]| {
            let more = ["--threads", "1", "--unit", "mm", "--out", &out[1], "--json", &out[2]];
            words.iter().copied().chain(more).map(str::to_owned).collect::<Vec<_>>()
        };
        let one = out(1);
        let alone = scratch.mrvis(&line(&one).iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(alone.code, Some(0), "{words:?} {}", alone.stderr);
        assert!(!files(&scratch.path(&one[0])).is_empty());
        let count = if k == 0 { 3 } else { 2 };
        let several = out(count);
        let line = [line(&several), vec!["--mpi".into()]].concat();
        let ran = on_ranks(&scratch, count, &line.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(ran.code, Some(0), "{words:?} {}", ran.stderr);
        assert_same(&scratch.path(&several[0]), &scratch.path(&one[0]));
        // One rank prints, and all have shared the rows.
        assert_eq!(ran.stdout.lines().count(), alone.stdout.lines().count(), "{}", ran.stdout);
        let sharing = &scratch.json(&several[2])["sharing"];
        assert_eq!(sharing["ranks"], count);
        assert!(sharing["bytes"].as_u64().is_some_and(|bytes| bytes > 0), "{sharing}");
    }
}

#[test]
fn jobs_of_a_batch_run_on_all_ranks() {
    let scratch = prepared();
    let line = |out| ["batch", "jobs.toml", "--threads", "1", "--out", out];
    scratch.mrvis(&line("one")).exits(0);
    for (out, count) in [("two", 2), ("four", 4)] {
        let line = [&line(out)[..], &["--mpi"]].concat();
        on_ranks(&scratch, count, &line).exits(0);
        assert_eq!(journal(&scratch.path(out)), [COUNT; 2]);
        assert_same(&scratch.path(out), &scratch.path("one"));
        on_ranks(&scratch, count, &line).prints("14 done before");
    }
    on_ranks(&scratch, 2, &[&line("two")[..], &["--mpi", "--dry-run"]].concat())
        .prints("14 of 14 jobs, 0 to do");
}

#[test]
fn a_batch_goes_on_after_a_rank_has_died() {
    let whole = prepared();
    whole.mrvis("batch jobs.toml --out whole").exits(0);
    // An interrupted rank ends all: the solve that it was at is not done.
    ["KILL", "INT"].into_iter().for_each(|signal| goes_on_after(signal, &whole.path("whole")));
}

fn goes_on_after(signal: &str, whole: &Path) {
    let line = ["batch", "jobs.toml", "--threads", "1", "--jobs-at-once", "1", "--out", "o"];
    // On a busy machine all jobs may end before the signal.
    for _ in 0..5 {
        let scratch = prepared();
        let child = ranks(&scratch, 2, &[&line[..], &["--mpi"]].concat()).spawn().expect("mpirun runs");
        wait_until(120, "no jobs end", || journal(&scratch.path("o"))[1] >= 3);
        signal_rank_1(signal, &scratch);
        let code = Outcome::at_end(child).code;
        let [_, before] = journal(&scratch.path("o"));
        if before == COUNT {
            continue;
        }
        assert!(code != Some(0) && before >= 3, "{signal}: {code:?}, {before} jobs were done");
        let ran = scratch.mrvis(&line).exits(0);
        assert!(ran.stdout.contains(&format!("{before} done before")), "{before}: {}", ran.stdout);
        assert_eq!(journal(&scratch.path("o"))[1], COUNT);
        assert_same(&scratch.path("o"), whole);
        return;
    }
    panic!("{signal}: all jobs ended before the signal");
}

/// A job that fails on any rank is told and run again as often as is asked for; the others are done.
#[test]
fn failed_jobs_of_all_ranks_are_kept() {
    let scratch = prepared();
    scratch.write("bad.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = '{scene}-{unit}'\ncommand = 'info'\nscene = ['bad.obj', 'cornell.obj']\nretry = 1\n\
         [job.sweep]\nunit = ['m', 'cm', 'mm', 'km']\n",
    );
    let line = ["batch", "jobs.toml", "--threads", "1", "--jobs-at-once", "1", "--out", "o", "--mpi"];
    let ran = on_ranks(&scratch, 2, &line).exits(2);
    ran.prints("4 jobs done").prints("4 failed");
    assert_eq!(ran.stderr.matches("failed and runs again").count(), 4, "{}", ran.stderr);
    assert_eq!(journal(&scratch.path("o")), [8, 4]);
}

#[test]
fn a_lost_rank_ends_a_solve_without_outputs() {
    let scratch = prepared();
    let line =
        ["solve", "cornell.obj", "--unit", "mm", "--error", "0.01", "--threads", "1", "--out", "o", "--mpi"];
    let child = ranks(&scratch, 2, &line).spawn().expect("mpirun runs");
    // The first rank makes the folder before its work, which takes seconds.
    wait_until(60, "the folder is not made", || scratch.path("o").exists());
    wait(0.3);
    signal_rank_1("KILL", &scratch);
    let outcome = Outcome::at_end(child);
    assert_ne!(outcome.code, Some(0));
    outcome.warns("rank 1");
    assert_eq!(std::fs::read_dir(scratch.path("o")).expect("a folder").count(), 0);
}

#[test]
fn errors_are_said_once_and_name_the_cure() {
    let scratch = prepared();
    let missing = on_ranks(&scratch, 2, "solve missing.obj --out o --mpi").exits(2);
    assert_eq!(missing.stderr.matches("mrvis: missing.obj: ").count(), 1, "{}", missing.stderr);
    on_ranks(&scratch, 2, "solve cornell.obj --max-seconds 9 --out o --mpi")
        .warns("mrvis: --max-seconds: not with --mpi");
    let copies = on_ranks(&scratch, 2, "form-factors cornell.obj --rays 16 --out f.csv --unit mm").exits(0);
    assert_eq!(copies.stderr.matches("2 copies of this command").count(), 1, "{}", copies.stderr);
    // A job file cannot ask for ranks.
    scratch.write("bad.toml", JOBS.replace("audit = 0", "mpi = true"));
    scratch.mrvis("batch bad.toml --out o").warns("`mpi` is set by the batch itself");
}
