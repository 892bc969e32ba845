//! Speed of `mrvis batch`: the same solves of a small scene, on two threads, as jobs of a batch and by calls of the library in one process,
//! in turn: `cargo bench -p mrvis-command --bench batch`. Then short jobs, whose time is that of the batch
//! itself, and a batch that is done already.
//!
//! Promised, and an error if it does not hold: at least 95 % of the throughput in one process, at most 5 ms for each job besides its
//! work, and at most 1 s for a batch of 200 jobs that is done. Other load of the machine makes times differ: the ratio is the median of
//! pairs, and that of processor times is printed beside it.

use mrvis::{LoadOptions, Model, PrepareOptions, Scene, SolveOptions};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

const JOBS: u64 = 200;
const THREADS: usize = 2;
/// Error of the solves: they take about 0.1 s each.
const ERROR: f64 = 0.1;
/// Smallest throughput of jobs, as a part of that of calls.
const MIN_THROUGHPUT: f64 = 0.95;
/// Largest time of a short job with its own work, seconds.
const MAX_SHORT: f64 = 0.005;
/// Largest time of a batch that is done already, seconds.
const MAX_DONE: f64 = 1.0;
/// Pairs of measurements; their order alternates.
const PAIRS: usize = 5;

/// Seconds of a clock and of processors.
#[derive(Clone, Copy)]
struct Times {
    wall: f64,
    processor: f64,
}

/// Processor time of this process and of its children that have ended, as Linux reports it in hundredths of a second.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = text.rsplit(')').next().unwrap_or_default();
    // utime, stime, cutime and cstime of proc_pid_stat(5), of which two fields stand before.
    after_name.split_whitespace().skip(11).take(4).filter_map(|field| field.parse::<f64>().ok()).sum::<f64>()
        / 100.0
}

fn timed(work: impl FnOnce()) -> Times {
    let (start, before) = (Instant::now(), processor_seconds());
    work();
    Times { wall: start.elapsed().as_secs_f64(), processor: processor_seconds() - before }
}

/// All solves by calls of the library: one scene and one model for each thread, made once.
fn in_process(folder: &Path) {
    let next = AtomicU64::new(0);
    let solves = || {
        let scene = Scene::load_with(folder.join("cornell.obj"), &LoadOptions::default()).expect("a scene");
        let mut options = PrepareOptions::default();
        options.threads = 1;
        let model = Model::prepare(scene, &options).expect("a model");
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= JOBS {
                break;
            }
            let mut options = SolveOptions::default();
            (options.error, options.seed) = (ERROR, seed);
            model.solve(&options).expect("a solution");
        }
    };
    std::thread::scope(|scope| {
        (0..THREADS).for_each(|_| drop(scope.spawn(solves)));
    });
}

fn batch(folder: &Path, jobs: &str, out: &str) {
    let threads = THREADS.to_string();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mrvis"));
    command.args(["batch", jobs, "--out", out, "--quiet", "--threads", &threads]).current_dir(folder);
    let status = command.stdout(Stdio::null()).status().expect("the command runs");
    assert!(status.success(), "{status}");
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The scene, and files of long and of short jobs that read it.
fn prepare(folder: &Path) {
    let generate = [
        "[[job]]\nname = 'scene'\ncommand = 'generate'\ninputs = 'cornell'\noptions = { out = 'cornell.obj' }\n",
        &format!(
            "[[job]]\nname = '{{seed}}'\ncommand = 'solve'\nscene = 'cornell.obj'\noptions = {{ error = {ERROR}, output = 'none' }}\n\
             [job.sweep]\nseed = {{ from = 0, to = {}, by = 1 }}\n",
            JOBS - 1
        ),
        &format!(
            "[[job]]\nname = '{{samples}}'\ncommand = 'info'\nscene = 'cornell.obj'\n[job.each]\nsamples = {{ from = 1, to = {JOBS}, by = 1 }}\n"
        ),
    ];
    for (name, text) in ["scene.toml", "solves.toml", "short.toml"].iter().zip(generate) {
        std::fs::write(folder.join(name), text).expect("written");
    }
    batch(folder, "scene.toml", "scene");
    for name in ["cornell.obj", "cornell.mtl"] {
        std::fs::copy(folder.join("scene/scene").join(name), folder.join(name)).expect("copied");
    }
}

fn main() -> ExitCode {
    let scratch = tempfile::tempdir().expect("a folder");
    let folder = scratch.path();
    prepare(folder);
    // What is read once is then in memory.
    in_process(folder);
    let mut pairs = Vec::new();
    for k in 0..PAIRS {
        let out = format!("solves-{k}");
        let as_jobs = || timed(|| batch(folder, "solves.toml", &out));
        let as_calls = || timed(|| in_process(folder));
        let (jobs, calls) = if k % 2 == 0 {
            let calls = as_calls();
            (as_jobs(), calls)
        } else {
            let jobs = as_jobs();
            (jobs, as_calls())
        };
        println!(
            "{JOBS} solves: {:.2} s in one process, {:.2} s as jobs (processors: {:.2} s, {:.2} s)",
            calls.wall, jobs.wall, calls.processor, jobs.processor
        );
        pairs.push((calls, jobs));
    }
    let ratio = median(pairs.iter().map(|(calls, jobs)| calls.wall / jobs.wall));
    let work = median(pairs.iter().map(|(calls, jobs)| calls.processor / jobs.processor));
    println!(
        "throughput of jobs / calls: {:.1} % (bar: {:.0} %); of processor time: {:.1} %",
        100.0 * ratio,
        100.0 * MIN_THROUGHPUT,
        100.0 * work
    );
    let short = median((0..PAIRS).map(|k| timed(|| batch(folder, "short.toml", &format!("short-{k}"))).wall));
    let short = short / JOBS as f64;
    println!(
        "{JOBS} short jobs: {:.2} ms each with their own work (bar: {} ms)",
        1e3 * short,
        1e3 * MAX_SHORT
    );
    let again = median((0..PAIRS).map(|_| timed(|| batch(folder, "solves.toml", "solves-0")).wall));
    println!("{JOBS} jobs that are done: {again:.3} s (bar: {MAX_DONE} s)");
    let holds = ratio >= MIN_THROUGHPUT && short <= MAX_SHORT && again <= MAX_DONE;
    if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
