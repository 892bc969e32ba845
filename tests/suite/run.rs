//! Runs the executable in a temporary folder.

use mrvis::internals::scene;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Exit code and output of a call.
pub struct Outcome {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Outcome {
    pub fn of(output: Output) -> Outcome {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Outcome { code: output.status.code(), stdout: text(&output.stdout), stderr: text(&output.stderr) }
    }

    /// That of a call at its end.
    pub fn at_end(child: Child) -> Outcome {
        Outcome::of(child.wait_with_output().expect("its output"))
    }

    /// The same, but a call that takes longer is ended; its exit code is then `None`.
    pub fn within(seconds: f64, mut child: Child) -> Outcome {
        let start = Instant::now();
        while child.try_wait().expect("a child").is_none() {
            if start.elapsed().as_secs_f64() > seconds {
                child.kill().expect("ended");
            }
            wait(0.01);
        }
        Outcome::at_end(child)
    }

    /// Asserts this exit code.
    #[track_caller]
    pub fn exits(self, code: i32) -> Outcome {
        assert_eq!(self.code, Some(code), "{}{}", self.stdout, self.stderr);
        self
    }

    /// Asserts that standard output contains these words.
    #[track_caller]
    pub fn prints(&self, words: &str) -> &Outcome {
        assert!(self.stdout.contains(words), "{words:?} is not in: {}{}", self.stdout, self.stderr);
        self
    }

    /// Asserts that standard error contains these words.
    #[track_caller]
    pub fn warns(&self, words: &str) -> &Outcome {
        assert!(self.stderr.contains(words), "{words:?} is not in: {}{}", self.stderr, self.stdout);
        self
    }
}

/// The words of a text.
pub fn words(text: &str) -> Vec<&str> {
    text.split_whitespace().collect()
}

/// A command line: one text if no word has spaces, or its words.
pub trait Line {
    fn words(&self) -> Vec<&str>;
}

impl Line for str {
    fn words(&self) -> Vec<&str> {
        words(self)
    }
}

impl Line for String {
    fn words(&self) -> Vec<&str> {
        words(self)
    }
}

impl Line for [&str] {
    fn words(&self) -> Vec<&str> {
        self.to_vec()
    }
}

impl<const N: usize> Line for [&str; N] {
    fn words(&self) -> Vec<&str> {
        self.to_vec()
    }
}

impl Line for Vec<&str> {
    fn words(&self) -> Vec<&str> {
        self.clone()
    }
}

pub fn wait(seconds: f64) {
    std::thread::sleep(Duration::from_secs_f64(seconds));
}

/// Waits until a condition holds, at most so many seconds; otherwise fails with `what`.
#[track_caller]
pub fn wait_until(seconds: u64, what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(seconds), "{what}");
        wait(0.002);
    }
}

/// Sends a signal such as `INT` to a process.
#[track_caller]
pub fn signal(signal: &str, process: impl ToString) {
    let sent = Command::new("kill").args(["-s", signal, &process.to_string()]).status();
    assert!(sent.expect("kill").success());
}

/// A temporary folder for calls of the command.
pub struct Scratch(TempDir);

impl Scratch {
    pub fn new() -> Scratch {
        Scratch(tempfile::tempdir().expect("scratch folder"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).expect("scratch file");
    }

    /// Writes a generated scene as `NAME.obj`.
    pub fn generate(&self, spec: &scene::generate::Spec) -> String {
        let name = format!("{}.obj", spec.name);
        let soup = scene::generate::soup(spec).expect("a scene");
        scene::write_obj(&self.path(&name), &soup, &[]).expect("written");
        name
    }

    /// Writes a forest of so many trees with so many leaves each as `forest.obj`.
    pub fn forest(&self, trees: usize, leaves: usize) -> String {
        self.generate(&scene::generate::Spec { trees, leaves, ..scene::generate::Spec::new("forest") })
    }

    /// The command in the scratch folder, with a cache folder of its own.
    pub fn command(&self, line: &(impl Line + ?Sized)) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mrvis"));
        command.args(line.words()).current_dir(self.0.path()).env("XDG_CACHE_HOME", self.path("cache"));
        command
    }

    pub fn mrvis(&self, line: &(impl Line + ?Sized)) -> Outcome {
        Outcome::of(self.command(line).output().expect("the command runs"))
    }

    /// A call that goes on.
    pub fn started(&self, line: &(impl Line + ?Sized)) -> Child {
        let mut command = self.command(line);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().expect("the command runs")
    }

    /// A call that is ended after so many seconds; its exit code is then `None`.
    pub fn mrvis_within(&self, seconds: f64, line: &(impl Line + ?Sized)) -> Outcome {
        Outcome::within(seconds, self.started(line))
    }

    /// A call that reads `input` from standard input.
    pub fn mrvis_with_input(&self, input: &str, line: &(impl Line + ?Sized)) -> Outcome {
        let mut command = self.command(line);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the command runs");
        child.stdin.take().expect("a pipe").write_all(input.as_bytes()).expect("written");
        Outcome::at_end(child)
    }

    /// Runs a script of bash, for which the command is `$0`.
    pub fn bash(&self, script: &str) -> Outcome {
        let mut shell = Command::new("bash");
        shell.args(["-c", script, env!("CARGO_BIN_EXE_mrvis")]).current_dir(self.0.path());
        Outcome::of(shell.output().expect("a shell"))
    }

    /// The content of a text file.
    #[track_caller]
    pub fn text(&self, name: impl AsRef<Path>) -> String {
        std::fs::read_to_string(self.0.path().join(name)).expect("a text file")
    }

    /// The rows of a CSV file of numbers, without its header.
    #[track_caller]
    pub fn rows(&self, name: impl AsRef<Path>) -> Vec<Vec<f64>> {
        let row = |line: &str| line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        self.text(name).lines().skip(1).map(row).collect()
    }

    /// The contents of a JSON file.
    #[track_caller]
    pub fn json(&self, name: impl AsRef<Path>) -> serde_json::Value {
        serde_json::from_str(&self.text(name)).expect("JSON")
    }
}

/// The files of finished jobs below a folder by their names: of each what `counted` makes of its content, if it counts.
pub fn job_files(
    folder: &Path,
    counted: impl Fn(&str, Vec<u8>) -> Option<Vec<u8>>,
) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut found, mut waiting) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(at) = waiting.pop() {
        for entry in std::fs::read_dir(&at).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            if path.is_dir() && name != ".mrvis-batch" {
                waiting.push(path);
            } else if path.is_file() && !name.starts_with("results.") {
                let content = counted(&name, std::fs::read(&path).expect("read"));
                found.extend(
                    content.map(|content| (path.strip_prefix(folder).expect("below").into(), content)),
                );
            }
        }
    }
    found
}

/// Compares line by line, so that a failure names the first difference.
#[track_caller]
pub fn assert_same_lines(found: &str, expected: &str, who: &str) {
    for (i, (found, expected)) in found.lines().zip(expected.lines()).enumerate() {
        assert_eq!(found, expected, "{who}: line {}", i + 1);
    }
    assert_eq!(found.lines().count(), expected.lines().count(), "{who}: lines");
}

pub fn assert_same_files(found: &BTreeMap<PathBuf, Vec<u8>>, want: &BTreeMap<PathBuf, Vec<u8>>) {
    assert_eq!(found.keys().collect::<Vec<_>>(), want.keys().collect::<Vec<_>>());
    for (name, bytes) in found {
        assert!(bytes == &want[name], "{} differs", name.display());
    }
}
