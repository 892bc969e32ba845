//! `mrvis batch`: nothing is lost, nothing is repeated, and outputs are those of single commands.

mod bad_input;
mod kept;
mod results;

use crate::determinism::strip;
use crate::install::project;
use crate::run::{Outcome, Scratch, assert_same_files, job_files, signal, wait_until};
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Twelve short jobs, of which two need others.
const JOBS: &str = "
[defaults]
options = { unit = 'mm' }

[[job]]
name = 'solve-{error}-{visibility}'
command = 'solve'
scene = '*.obj'
options = { audit = 0, local-rays = 0, output = ['none'], cache = 'off', points = 'points.csv' }
[job.sweep]
error = [0.4, 0.3, 0.2]
visibility = ['exact', 'mr', 'average']

[[job]]
name = 'reference'
command = 'reference'
scene = 'cornell.obj'
options = { points = 'points.csv', samples = 16 }

[[job]]
name = 'compared/coarse'
command = 'compare'
inputs = ['{out:reference}/irradiance.csv', '{out:solve-0.4-exact}/irradiance.csv']
[[job]]
name = 'compared/fine'
command = 'compare'
inputs = ['{out:reference}/irradiance.csv', '{out:solve-0.2-exact}/irradiance.csv']
";
/// Number of jobs in it.
const COUNT: usize = 12;

/// A scratch folder with the jobs and their scene.
fn prepared() -> Scratch {
    let scratch = Scratch::new();
    scratch.generate(&Spec::new("cornell"));
    scratch.write("points.csv", "x,y,z,nx,ny,nz\n278,0,280,0,1,0\n100,0,100,0,1,0\n400,300,559,0,0,-1\n");
    scratch.write("jobs.toml", JOBS);
    scratch
}

fn batch(scratch: &Scratch, more: &[&str]) -> Outcome {
    scratch.mrvis(&[&["batch", "jobs.toml"], more].concat())
}

/// All files of finished jobs by their names, without times.
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    job_files(out, |name, content| {
        Some(match name.ends_with(".json") {
            true => {
                let mut value: Value = serde_json::from_slice(&content).expect("JSON");
                strip(&mut value);
                value.to_string().into()
            }
            false => content,
        })
    })
}

/// Lines of the journal.
fn journal(out: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(out.join(".mrvis-batch/journal.jsonl")).unwrap_or_default();
    let whole = text.rfind('\n').map_or(0, |i| i + 1);
    text[..whole].lines().map(|line| serde_json::from_str(line).expect("a line")).collect()
}

/// However jobs are packed, their files are those of the single commands.
#[test]
fn outputs_are_those_of_single_commands() {
    let scratch = prepared();
    for (out, threads, at_once) in [("a", "1", "1"), ("b", "2", "2"), ("c", "4", "3")] {
        batch(&scratch, &["--out", out, "--threads", threads, "--jobs-at-once", at_once])
            .exits(0)
            .prints("12 jobs done, 0 done before");
    }
    let lines = journal(&scratch.path("a"));
    assert_eq!(lines.len(), COUNT);
    for line in &lines {
        let words = line["command"].as_str().expect("a command line").replace(" a/", " single/");
        let words: Vec<&str> = words.split(' ').skip(1).collect();
        std::fs::create_dir_all(scratch.path("single").join(line["job"].as_str().expect("a name")))
            .expect("made");
        let ran = scratch.mrvis(&words);
        assert_eq!(ran.code, Some(0), "{words:?} {}", ran.stderr);
    }
    let single = results(&scratch.path("single"));
    for out in ["a", "b", "c"] {
        assert_same_files(&results(&scratch.path(out)), &single);
    }
    let table = scratch.text("a/results.csv");
    assert_eq!(table.lines().count(), 1 + COUNT);
    assert!(table.starts_with("job,command,scene,inputs,tags,option.audit,"), "{table}");
    assert!(table.contains(",option.visibility,status,job_seconds,"), "{table}");
    // One job prepared the scene for all solves.
    let rows = scratch.text("a/results.jsonl");
    let rows = rows.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let times: Vec<f64> = rows.filter_map(|row| row["seconds.embree"].as_f64()).collect();
    assert_eq!(times.len(), 9);
    assert!(times.iter().filter(|t| **t > 0.0).count() <= 1, "{times:?}");
}

/// A second run repeats what changed, and only that.
#[test]
fn only_what_changed_is_repeated() {
    let scratch = prepared();
    batch(&scratch, &["--out", "o"]).exits(0);
    let repeated = |want: usize| {
        let before = journal(&scratch.path("o")).len();
        let ran = batch(&scratch, &["--out", "o"]).exits(0);
        assert_eq!(journal(&scratch.path("o")).len() - before, want, "{}", ran.stderr);
    };
    repeated(0);
    // Another time of the file is no change.
    scratch.write("jobs.toml", JOBS);
    repeated(0);
    scratch.write("jobs.toml", JOBS.replace("samples = 16", "samples = 17"));
    repeated(3);
    std::fs::remove_file(scratch.path("o/solve-0.3-mr/irradiance.csv")).expect("removed");
    repeated(1);
    // The materials are in a file that only the scene names.
    let materials = scratch.text("cornell.mtl");
    scratch.write("cornell.mtl", materials.replace("Kd ", "Kd 0"));
    repeated(COUNT);
}

/// Kills the batch at random moments; whatever is there is whole, and in the end everything is there once.
#[test]
fn nothing_is_lost_when_the_batch_is_killed() {
    // `make kills` kills it 50 times.
    let kills: u64 = std::env::var("MRVIS_KILLS").map_or(6, |n| n.parse().expect("MRVIS_KILLS is a number"));
    let scratch = prepared();
    let start = Instant::now();
    batch(&scratch, &["--out", "undisturbed"]).exits(0);
    let longest = start.elapsed().as_secs_f64();
    let want = results(&scratch.path("undisturbed"));
    let (mut rounds, mut cut) = (0, 0);
    // A linear congruential generator (Knuth, MMIX).
    let mut random = 7u64;
    for _ in 0..kills {
        let out = format!("killed-{rounds}");
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        // After a random number of jobs, and a random part of the time of one: other load of the machine does not matter.
        let before = journal(&scratch.path(&out)).len();
        let jobs = before + (random >> 40) as usize % (COUNT - before);
        let seconds = longest / COUNT as f64 * (random >> 33) as f64 / (1u64 << 31) as f64;
        let mut child = scratch.started(&format!("batch jobs.toml --out {out}"));
        while journal(&scratch.path(&out)).len() < jobs && child.try_wait().expect("a child").is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let ended = child.try_wait().expect("a child").is_some();
        child.kill().expect("killed");
        child.wait().expect("ended");
        cut += usize::from(!ended);
        for (name, bytes) in
            if scratch.path(&out).exists() { results(&scratch.path(&out)) } else { BTreeMap::new() }
        {
            assert!(
                bytes == want[&name],
                "{} is not whole after {jobs} jobs and {seconds} s",
                name.display()
            );
        }
        if journal(&scratch.path(&out)).len() == COUNT {
            rounds += 1;
        }
    }
    assert!(cut as u64 > kills / 3, "only {cut} of {kills} calls were killed before their end");
    for round in 0..=rounds {
        let out = format!("killed-{round}");
        batch(&scratch, &["--out", &out]).exits(0);
        assert_same_files(&results(&scratch.path(&out)), &want);
        // No job whose line was written has run again.
        let mut names: Vec<String> =
            journal(&scratch.path(&out)).iter().map(|l| l["job"].to_string()).collect();
        names.sort();
        let lines = names.len();
        names.dedup();
        assert_eq!((lines, names.len()), (COUNT, COUNT));
    }
}

/// Ctrl-C ends the batch soon; the next run does the rest.
#[test]
fn an_interrupted_batch_goes_on() {
    let scratch = prepared();
    scratch.forest(60, 2000);
    let long =
        "[[job]]\nname = 'long'\ncommand = 'solve'\nscene = 'forest.obj'\noptions = { error = 0.001 }\n";
    scratch.write("long.toml", JOBS.replace("'*.obj'", "'cornell.obj'") + long);
    let child = scratch.started("batch long.toml --out o --threads 2");
    wait_until(60, "no job ends", || !journal(&scratch.path("o")).is_empty());
    signal("INT", child.id());
    let sent = Instant::now();
    Outcome::at_end(child).exits(130).warns("the same command goes on");
    // A second on an idle machine; tests share a loaded one.
    assert!(sent.elapsed() < Duration::from_secs(20));
    let done = journal(&scratch.path("o")).len();
    assert!((1..=COUNT).contains(&done));
    scratch.write("jobs.toml", JOBS.replace("'*.obj'", "'cornell.obj'"));
    batch(&scratch, &["--out", "o"]).prints(&format!("done, {done} done before"));
}

/// A job that fails, takes too long or too much memory does not touch the others; what needs it is skipped.
#[test]
fn failures_are_kept_to_one_job() {
    let scratch = Scratch::new();
    scratch.generate(&Spec::new("cornell"));
    scratch.forest(60, 2000);
    scratch.write("dark.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    scratch.write("bad.obj", "f 1 2 3\n");
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = 'fine'\ncommand = 'info'\nscene = 'cornell.obj'\n\
         [[job]]\nname = 'bad'\ncommand = 'info'\nscene = 'bad.obj'\nretry = 2\n\
         [[job]]\nname = 'after'\ncommand = 'info'\nscene = 'dark.obj'\nafter = 'bad'\n\
         [[job]]\nname = 'last'\ncommand = 'info'\nscene = 'dark.obj'\nafter = 'after'\n\
         [[job]]\nname = 'late'\ncommand = 'solve'\nscene = 'forest.obj'\noptions = { error = 0.001 }\nlimits = { seconds = 0.5 }\n\
         [[job]]\nname = 'large'\ncommand = 'solve'\nscene = 'forest.obj'\noptions = { error = 0.001 }\nlimits = { memory = '300M', seconds = 100 }\n\
         [[job]]\nname = 'within'\ncommand = 'info'\nscene = 'cornell.obj'\nlimits = { memory = '4G', seconds = 100 }\n",
    );
    let ran = batch(&scratch, &["--out", "o", "--log", "log.jsonl"]).exits(2);
    for part in [
        "failed bad: ",
        "failed late: the time limit of 0.5 s",
        "failed large: ",
        "skipped after: it needs bad, which failed",
        "skipped last: it needs after, which was skipped",
    ] {
        assert!(ran.stderr.contains(part), "{} lacks {part}", ran.stderr);
    }
    ran.prints("2 jobs done, 0 done before, 3 failed, 2 skipped");
    assert!(scratch.path("o/within/info.json").exists() && !scratch.path("o/late").exists());
    let log = scratch.text("log.jsonl");
    let events: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(events.iter().filter(|e| e["event"] == "retried").count(), 2);
    assert_eq!(events.iter().filter(|e| e["event"] == "failed").count(), 3);
    let line = journal(&scratch.path("o")).into_iter().find(|line| line["job"] == "within").expect("a line");
    assert!(line["peak_bytes"].as_u64().expect("a peak") > 1 << 20);
    let table = scratch.text("o/results.jsonl");
    // Those of all jobs, the skipped ones among them.
    assert_eq!(table.lines().count(), 7);
    assert!(
        table.contains("\"status\":\"skipped\"") && table.contains("it needs bad, which failed"),
        "{table}"
    );
}

/// Memory that a limit of the address space refuses ends one job: each has a process of its own.
#[test]
#[cfg(target_os = "linux")]
fn a_limit_of_the_address_space_is_that_of_each_job() {
    let scratch = prepared();
    scratch.write("jobs.toml", "[[job]]\ncommand = 'info'\nscene = 'cornell.obj'\n");
    scratch.bash("ulimit -v 900000; exec \"$0\" batch jobs.toml --out o").exits(0);
    let lines = journal(&scratch.path("o"));
    assert!(lines.len() == 1 && lines[0]["peak_bytes"].is_number(), "{lines:?}");
}

/// Nothing starts, and nothing is overwritten, when something is wrong.
#[test]
fn nothing_starts_if_something_is_wrong() {
    let scratch = prepared();
    let refused = |more: &[&str], want: &str| {
        crate::hostile::refused(&batch(&scratch, more), want);
        assert!(journal(&scratch.path("o")).is_empty());
    };
    std::fs::create_dir_all(scratch.path("o/reference")).expect("made");
    refused(&["--out", "o"], "o/reference: exists and was not made by this batch");
    refused(&["--out", "jobs.toml"], "jobs.toml");
    refused(&["--out", "o", "--only", "referense"], "did you mean `reference`?");
    scratch.write("jobs.toml", JOBS.replace("error = [0.4", "eror = [0.4"));
    refused(&["--out", "o"], "jobs.toml:6:8: `{error}` is no value of this job; did you mean `eror`?");
    scratch.write("jobs.toml", JOBS.replace("[0.4, 0.3, 0.2]", "[0.4, 0.3, 0.2, 'x']"));
    refused(&["--out", "o"], "invalid value 'x'");
    scratch.write("jobs.toml", JOBS);
    let listed = batch(&scratch, &["--out", "new", "--dry-run", "--only", "compared/fine"]);
    assert!(
        listed.stdout.contains("3 of 12 jobs, 3 to do") && !scratch.path("new").exists(),
        "{}",
        listed.stdout
    );
}

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
        batch(&scratch, &["--out", out]).prints("0 jobs done, 12 done before");
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
    scratch.mrvis("merge first second --out all").prints("1 job done, 0 failed");
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
    batch(&scratch, &["--out", "o"]).prints("0 jobs done, 12 done before");
}

/// A job array of a real Slurm on this machine.
#[test]
fn slurm_runs_the_parts() {
    let scratch = prepared();
    let arguments = [env!("CARGO_BIN_EXE_mrvis"), "jobs.toml", "o", "3"];
    if script(&scratch, "tests/slurm/run-array", &arguments).is_some() {
        batch(&scratch, &["--out", "o"]).prints("0 jobs done, 12 done before");
    }
}
