//! Estimates of the memory and time of jobs before they run.

use super::command_line::{Line, scene_of};
use crate::batch::{Entries, Job, Status};
use crate::cli::Command;
use std::path::Path;

/// Bytes of memory that a job takes for each byte of its scene file: a solve takes about 1 kB for each triangle, and a triangle of a
/// binary file is about 40 bytes long (an OBJ file has 70 to 100, for which this is an upper bound).
const MEMORY_PER_BYTE: u64 = 25;
/// Bytes of a polygon in a scene file: a rectangle in a grid of an OBJ file has one vertex (`v x y z`, 30 bytes) and one line of four
/// indices (20 bytes). For the largest number of form factors.
const BYTES_PER_FACET: u64 = 50;
/// Bytes that any job takes: the program, Embree and a small scene (`mrvis solve` of cornell.obj, resident size).
pub const MIN_MEMORY: u64 = 60 << 20;

/// Processor seconds of commands on scenes: of a small one, and more for each MB of the scene file. `time mrvis COMMAND` with default
/// options took 1.7 s (Cornell box), 6.7 s (a room with 1,200 triangles and overlapping boxes), 18 s (Sponza, 5.6 MB) and 17 s (garden,
/// 9.9 MB) to solve, 26 s, 43 s (Sponza) and 277 s (garden) for a benchmark, 1.5 s and 8.8 s (forest of 9,000 leaves, 1.4 MB) for
/// form factors, and .01 s and .34 s (garden) for `info`.
const SECONDS: [(&str, f64, f64); 4] =
    [("solve", 3.4, 2.0), ("bench", 26.0, 15.0), ("form-factors", 1.5, 5.0), ("info", 0.01, 0.04)];
/// Exponent of the time of a solve in 1 / `--error`: from .05 over .02 to .01 the box took 1.1, 1.7 and 3.5 s, the room 1.8, 6.7 and
/// 33 s, Sponza 8, 18 and 54 s; the mean of the six exponents is 1.29.
const ERROR_EXPONENT: f64 = 1.3;
/// Processor seconds of a path of `reference` (1,000 points, 256 paths each, in a Cornell box: 2.5 s), and bytes of a line of a point
/// file whose positions have six digits behind the point.
const SECONDS_PER_PATH: f64 = 1e-5;
const BYTES_PER_POINT: f64 = 35.0;

/// Estimated resources of a job before it runs.
pub struct Estimate {
    /// Memory, bytes; `None` if the batch makes its scene.
    pub memory: Option<u64>,
    /// Processor seconds, of most options those of the default; `None` if the batch makes its scene, or for commands of less than a second.
    pub seconds: Option<f64>,
    /// Threads that it asks for.
    pub threads: Option<usize>,
}

impl Estimate {
    /// Estimates from the sizes of the existing input files.
    pub fn of(job: &Job, line: &Line, command: &Command) -> Estimate {
        let size = |path: &Path| Some(std::fs::metadata(path).ok()?.len());
        let scene_bytes = scene_of(job, line).and_then(size);
        let own = match command {
            Command::Solve(args) => args.outputs.picture_bytes(),
            Command::FormFactors(args) => {
                let facets = scene_bytes.unwrap_or(0) / BYTES_PER_FACET;
                // The command refuses more than its limit.
                let limit = crate::cli::limits::bytes(args.common.max_memory).unwrap_or(u64::MAX);
                args.matrix_bytes(facets as usize).min(limit)
            }
            _ => 0,
        };
        let memory = scene_bytes.map(|bytes| own.saturating_add(MIN_MEMORY + MEMORY_PER_BYTE * bytes));
        let by_size = SECONDS.iter().find(|(name, ..)| *name == job.command.name);
        let by_size = by_size.and_then(|(_, least, each)| Some(least + each * scene_bytes? as f64 / 1e6));
        let seconds = match command {
            Command::Solve(args) => {
                let default = mrvis::internals::radiosity::Options::default().error;
                by_size.map(|seconds| seconds * (default / args.error).powf(ERROR_EXPONENT))
            }
            Command::Reference(args) => size(&args.points)
                .map(|bytes| SECONDS_PER_PATH * f64::from(args.samples) * bytes as f64 / BYTES_PER_POINT),
            _ => by_size,
        };
        let threads = command.common().and_then(|common| common.threads).map(usize::from);
        Estimate { memory, seconds, threads }
    }
}

/// How much longer jobs of each command took than estimated: the median of those that ran before, 1 without any.
pub struct Corrections(Vec<(&'static str, f64)>);

impl Corrections {
    /// From the journal.
    pub fn of(jobs: &[Job], estimates: &[Estimate], entries: &Entries) -> Corrections {
        let mut found = Vec::<(&'static str, Vec<f64>)>::new();
        for (job, estimate) in jobs.iter().zip(estimates) {
            let entry = entries.get(&job.name).filter(|e| matches!(e.status, Status::Done | Status::Missed));
            let (Some(entry), Some(guess)) = (entry, estimate.seconds) else { continue };
            let ratio = entry.seconds * entry.threads.max(1) as f64 / guess.max(f64::MIN_POSITIVE);
            match found.iter_mut().find(|(name, _)| *name == job.command.name) {
                Some((_, ratios)) => ratios.push(ratio),
                None => found.push((job.command.name, vec![ratio])),
            }
        }
        let median = |mut ratios: Vec<f64>| {
            ratios.sort_by(f64::total_cmp);
            ratios[ratios.len() / 2]
        };
        Corrections(found.into_iter().map(|(name, ratios)| (name, median(ratios))).collect())
    }

    /// Estimated seconds of a job on this number of threads, or on the number that the job states.
    pub fn seconds(&self, job: &Job, estimate: &Estimate, threads: usize) -> Option<f64> {
        let factor = self.0.iter().find(|(name, _)| *name == job.command.name).map_or(1.0, |c| c.1);
        let threads = estimate.threads.unwrap_or(threads).clamp(1, threads.max(1));
        Some(factor * estimate.seconds? / threads as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{TomlSource, expand, parse};
    use crate::cli::batch::command_line::Grammar;

    /// Estimates grow with the scene, and jobs that ran correct those of the same command.
    #[test]
    fn times_are_estimated_from_sizes_and_from_other_jobs() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, bytes) in [("a.obj", 1_000), ("b.obj", 10_000_000)] {
            std::fs::write(folder.path().join(name), vec![b'#'; bytes]).expect("written");
        }
        let text = "[[job]]\ncommand = 'solve'\nscene = '*.obj'\n[[job]]\ncommand = 'form-factors'\nscene = '*.obj'\n\
                    [[job]]\ncommand = 'solve'\nscene = 'b.obj'\nname = 'alone'\noptions = { threads = 1 }";
        let source = TomlSource { path: folder.path().join("jobs.toml"), text: text.into() };
        let jobs = expand(&source, &parse(&source).expect("a job file")).expect("jobs");
        let grammar = Grammar::new();
        let of = |job: &Job| {
            let line = grammar.line(&source, job, Path::new("out"), Path::new("work")).expect("a line");
            Estimate::of(job, &line, &line.parse().expect("a command"))
        };
        let estimates: Vec<Estimate> = jobs.iter().map(of).collect();
        let named = |name: &str| jobs.iter().position(|job| job.name == name).expect(name);
        let [small, large, matrix, alone] = ["solve-a", "solve-b", "form-factors-b", "alone"].map(named);
        let none = Corrections::of(&jobs, &estimates, &Entries::new());
        let seconds = |corrections: &Corrections, k: usize| {
            corrections.seconds(&jobs[k], &estimates[k], 2).expect("an estimate")
        };
        assert!((seconds(&none, small) - 1.7).abs() < 0.01 && (seconds(&none, large) - 11.7).abs() < 0.01);
        assert!((seconds(&none, alone) - 23.4).abs() < 0.01);
        // 200,000 polygons could have 45 bytes for each of 2,048 partners.
        assert!(estimates[matrix].memory > estimates[large].memory);
        // The large scene took twice as long as estimated.
        let entry = serde_json::json!({
            "version": 1, "job": "solve-b", "time": 0.0, "key": "", "status": "done", "index": 1, "about": {}, "record": "",
            "command": "", "seconds": 23.4, "threads": 2, "attempt": 1, "inputs": [], "outputs": [],
        });
        let entry = serde_json::from_value(entry).expect("an entry");
        let known = Corrections::of(&jobs, &estimates, &Entries::from([("solve-b".to_owned(), entry)]));
        assert!((seconds(&known, small) - 3.4).abs() < 0.02);
        assert_eq!(seconds(&known, matrix), seconds(&none, matrix));
    }
}
