//! Arguments that several subcommands share.

use indicatif::{ProgressBar, ProgressStyle};
use mrvis::{
    Error, Result,
    files::WholeFile,
    scene::{LoadOptions, Scene, parse_emitter},
};
use std::{
    io::Write,
    path::{Path, PathBuf},
    time::Duration,
};

/// Options of every subcommand.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Common options")]
pub struct Common {
    /// Number of threads; default one for each core.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Seed of everything random.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Write the results to FILE as JSON too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// No progress and no text: files and exit code only.
    #[arg(long)]
    pub quiet: bool,
    /// Length unit of the scene (m, cm, mm, km, in, ft).
    #[arg(long, value_name = "U", default_value = "m")]
    pub unit: String,
}

impl Common {
    /// Shows on a terminal that something long is going on, until the answer is dropped.
    pub fn spinner(&self, what: impl Into<String>) -> Spinner {
        if self.quiet {
            return Spinner(ProgressBar::hidden());
        }
        // Draws on standard error, and not at all if that is no terminal.
        let bar = ProgressBar::new_spinner().with_message(what.into());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Spinner(bar)
    }

    /// A bar on a terminal that counts to `total`, until it is dropped.
    pub fn bar(&self, what: impl Into<String>, total: usize) -> Bar {
        if self.quiet {
            return Bar(ProgressBar::hidden());
        }
        let bar = ProgressBar::new(total as u64).with_message(what.into());
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} % {eta:>4}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Bar(bar)
    }

    /// Does `work` on as many threads as `--threads` says.
    ///
    /// # Errors
    /// The system refuses that many threads, or the work fails.
    pub fn on_threads<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let threads = usize::from(self.threads.unwrap_or(0));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.map_err(|e| Error::Argument(format!("--threads {threads}: {e}")))?.install(work)
    }

    /// Writes text to standard output unless `--quiet`.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn print(&self, text: &str) -> Result<()> {
        if self.quiet { Ok(()) } else { super::print(text) }
    }

    /// Writes the JSON file if one was asked for.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_json(&self, value: &impl serde::Serialize) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        let text =
            serde_json::to_string_pretty(value).map_err(|e| Error::format(path, None, e.to_string()))?;
        WholeFile::write(path, text + "\n")
    }
}

/// See [`Common::spinner`].
pub struct Spinner(ProgressBar);

impl Drop for Spinner {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// See [`Common::bar`].
pub struct Bar(ProgressBar);

impl Bar {
    /// So much more is done.
    pub fn advance(&self, steps: u64) {
        self.0.inc(steps);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A scene and what its file does not say.
#[derive(clap::Args, Clone, Debug)]
pub struct SceneArgs {
    /// The scene: .obj, .gltf, .glb or .ply.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Make the object, group or material NAME emit W watts (repeatable).
    #[arg(long = "emitter", value_name = "NAME=W")]
    pub emitters: Vec<String>,
    /// Emissive faces emit from both sides instead of from the front only.
    #[arg(long)]
    pub two_sided_emission: bool,
    /// Take all faces as parts of closed solids (1) or as sheets (2) instead of finding out.
    #[arg(long, value_name = "1|2", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub sides: Option<u8>,
}

impl SceneArgs {
    /// Reads the scene.
    ///
    /// # Errors
    /// As for [`Scene::load`], or an `--emitter` that cannot be understood.
    pub fn load(&self, common: &Common) -> Result<Scene> {
        let emitters = self.emitters.iter().map(|e| parse_emitter(e)).collect::<Result<Vec<_>>>()?;
        let options = LoadOptions {
            unit: common.unit.clone(),
            emitters,
            two_sided_emission: self.two_sided_emission,
            sides: self.sides,
        };
        let _spinner = common.spinner(format!("reading {}", file_name(&self.scene)));
        Scene::load(&self.scene, &options)
    }
}

/// Says on standard error what was mended or assumed, a line each.
///
/// A standard error that is closed is nobody's concern.
pub fn warn(common: &Common, messages: &[String]) {
    for message in messages.iter().filter(|_| !common.quiet) {
        let _ = writeln!(std::io::stderr(), "mrvis: warning: {message}");
    }
}

/// The last part of a path, for messages.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A count with thousands set apart: `1,234,567`.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(d);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped() {
        for (n, want) in [(0, "0"), (999, "999"), (1000, "1,000"), (1234567, "1,234,567")] {
            assert_eq!(grouped(n), want);
        }
    }
}
