//! Arguments shared by several subcommands.

use super::inputs::{check_file, check_folder};
use super::values::{CHANNELS, UP, one_of};
use super::{
    flags::with_flags,
    inputs::{Inputs, Output},
    job_context, limits,
};
use indicatif::{ProgressBar, ProgressStyle};
use mrvis::internals::files::{json_text, write_json};
use mrvis::internals::model::CacheLocation;
use mrvis::internals::scene::{Move, Photometry, parse_emitter, read_added, read_placements, unit_in_metres};
use mrvis::internals::terrain::ReadOptions;
use mrvis::internals::threads::{MAX_THREADS, Threads};
use mrvis::{Channels, Error, LoadOptions, Result, Scene, SkyOptions, UpAxis};
use std::{
    collections::HashSet,
    ffi::OsStr,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

/// Options of every subcommand.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Common options")]
pub struct Common {
    /// Number of threads [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=MAX_THREADS as i64))]
    pub threads: Option<u16>,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Also write the results to FILE as JSON; - is the standard output, and the text then goes to standard error.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// No progress and no text: only files and the exit code.
    #[arg(long)]
    pub quiet: bool,
    /// Unit of length of the scene (m, dm, cm, mm, km, in, ft).
    #[arg(long, value_name = "U", default_value = "m", value_parser = unit)]
    pub unit: String,
    /// Stop with an error beyond this memory, in GiB [default: 80 % of what is available]
    #[arg(long, value_name = "G", value_parser = limits::parse)]
    pub max_memory: Option<f64>,
}

/// A known unit of length.
fn unit(name: &str) -> Result<String, String> {
    match unit_in_metres(name) {
        Some(_) => Ok(name.into()),
        None => Err("not a unit of length; there are m, dm, cm, mm, km, in, ft".into()),
    }
}

impl Common {
    /// Shows a spinner on a terminal until it is dropped.
    pub fn spinner(&self, what: impl Into<String>) -> Spinner {
        if self.quiet {
            return Spinner(ProgressBar::hidden());
        }
        // Drawn on standard error, only if that is a terminal.
        let bar = ProgressBar::new_spinner().with_message(what.into());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Spinner(bar)
    }

    /// Runs `work` on the number of threads of `--threads`.
    ///
    /// # Errors
    /// The threads cannot be started, or the work fails.
    pub fn on_threads<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let threads = usize::from(self.threads.unwrap_or(0));
        Threads::new(threads)?.run(work)?
    }

    /// Whether the JSON is written to standard output.
    fn json_is_piped(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    /// Writes text to standard output, or to standard error if the JSON is written to standard output; nothing with
    /// `--quiet`.
    ///
    /// # Errors
    /// The text cannot be written.
    pub fn print(&self, text: &str) -> Result<()> {
        if self.quiet {
            return Ok(());
        }
        if self.json_is_piped() {
            super::say(text.strip_suffix('\n').unwrap_or(text));
            return Ok(());
        }
        super::print(text)
    }

    /// Checks before the work that the JSON file can be written.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn check_json(&self) -> Result<()> {
        match &self.json {
            Some(path) if !self.json_is_piped() => check_file(path),
            _ => Ok(()),
        }
    }

    /// Refuses outputs of the command that would replace an input, each other or the JSON file.
    ///
    /// # Errors
    /// As [`Inputs::check`].
    pub fn check_outputs(&self, inputs: &Inputs, outputs: impl IntoIterator<Item = Output>) -> Result<()> {
        let json = self.json.as_deref().filter(|_| !self.json_is_piped());
        inputs.check(outputs.into_iter().chain(json.map(|path| Output::new("--json", path))))
    }

    /// Writes the JSON if requested.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_json(&self, value: &impl serde::Serialize) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        if !self.json_is_piped() {
            return write_json(path, value);
        }
        super::print(&json_text(value).map_err(|e| Error::format(path, None, e.to_string()))?)
    }
}

/// A spinner on the terminal; see [`Common::spinner`].
pub struct Spinner(ProgressBar);

impl Drop for Spinner {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A scene, and properties that its file does not state.
#[derive(clap::Args, Clone, Debug)]
pub struct SceneArgs {
    /// The scene: .obj, .gltf, .glb or .ply, or a height field .asc, .tif, .png, .npy or .npz.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Let the object, group or material NAME emit W watts (repeatable); with a unit watts, lumens or luminance:
    /// NAME=60W, NAME=800lm, NAME=5000cd/m2.
    #[arg(long = "emitter", value_name = "NAME=W")]
    pub emitters: Vec<String>,
    /// Move the object or glTF node NAME (repeatable): by X, Y, Z scene units, and turn it by DEGREES about the upward axis.
    #[arg(long = "move", value_name = "NAME=X,Y,Z[,DEGREES]")]
    pub moves: Vec<String>,
    /// Add luminaires with IES LM-63 or EULUMDAT files: a TOML file with [[luminaire]] tables of file, at and aim.
    #[arg(long, value_name = "FILE.toml")]
    pub luminaires: Option<PathBuf>,
    /// Also give lux, lumens and cd/m²: rgb by luminance weights and 179 lm/W (default), or one channel that is in
    /// lumens already (red, green, blue).
    #[arg(long, value_name = "CHANNELS", value_parser = one_of(CHANNELS), num_args = 0..=1, require_equals = true,
          default_missing_value = "rgb")]
    pub photometric: Option<Channels>,
    /// Upward axis of the scene's coordinates [default: y in glTF; elsewhere from the light and the extents]
    #[arg(long, value_parser = one_of(UP), value_name = "y|z")]
    pub up: Option<UpAxis>,
    /// Emissive faces emit from both sides instead of the front only.
    #[arg(long)]
    pub two_sided_emission: bool,
    /// Treat all faces as faces of closed solids (1) or as sheets (2) instead of detecting it.
    #[arg(long, value_name = "1|2", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub sides: Option<u8>,
    /// Add the surfaces of another file (repeatable): .obj, .ply or a height field, in the coordinates of the scene.
    #[arg(long, value_name = "FILE", help_heading = TERRAIN)]
    pub add: Vec<PathBuf>,
    /// The earth curves away from the middle of the scene, with N times its radius; 7/6 = 1.1667 allows for refraction. Points of
    /// --points are lowered, too.
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "1", help_heading = TERRAIN)]
    pub curvature: Option<f64>,
    #[command(flatten)]
    pub grid: GridArgs,
    #[command(flatten)]
    pub sky: SkyArgs,
}

/// Heading of the options of height fields.
const TERRAIN: &str = "Terrain";

/// How height fields are read.
#[derive(clap::Args, Clone, Debug)]
pub struct GridArgs {
    /// Distance of the samples of height fields, or of columns and rows, m, instead of that of the file.
    #[arg(long, value_name = "DX[,DY]", help_heading = TERRAIN)]
    cell: Option<String>,
    /// Metres of one unit of height of height fields (of one step of grey in a PNG), instead of the unit of the file.
    #[arg(long, value_name = "M", allow_hyphen_values = true, help_heading = TERRAIN)]
    height_scale: Option<f64>,
}

impl GridArgs {
    /// The options of the readers.
    ///
    /// # Errors
    /// [`Error::Argument`]: the cell is not one or two distances.
    pub fn options(&self) -> Result<ReadOptions> {
        let cell = self.cell.as_deref().map(cell).transpose()?;
        Ok(ReadOptions { cell, height_scale: self.height_scale, ..ReadOptions::default() })
    }
}

/// `DX` or `DX,DY`.
fn cell(text: &str) -> Result<[f64; 2]> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parsed.as_deref() {
        Some([both]) => Ok([*both; 2]),
        Some([dx, dy]) => Ok([*dx, *dy]),
        _ => Err(Error::arguments(format!("--cell {text}: give one distance in m, or two: DX,DY"))),
    }
}

/// Heading of the options of sky and sun.
const SKY: &str = "Sky and sun";

/// The sky and the sun.
#[derive(clap::Args, Clone, Debug)]
pub struct SkyArgs {
    /// The sky: uniform[:E], overcast[:E], cie:N[,E] (types 1 to 16), clear:TURBIDITY, perez:DNI,DHI, an equirectangular map
    /// .exr or .hdr, or sky.toml for all of it; E is the diffuse horizontal irradiance, W/m2.
    #[arg(long, value_name = "SKY", help_heading = SKY)]
    pub sky: Option<String>,
    /// The sun: AZIMUTH,ELEVATION in degrees (from north by east) or a vector X,Y,Z towards it, with :E for its normal
    /// irradiance; none; auto: by --place and --time [default: auto]
    #[arg(long, value_name = "SUN", allow_hyphen_values = true, help_heading = SKY)]
    pub sun: Option<String>,
    /// Latitude and longitude, degrees north and east, and altitude, metres, for the position of the sun.
    #[arg(long, value_name = "LAT,LON[,ALT]", allow_hyphen_values = true, help_heading = SKY)]
    place: Option<String>,
    /// Time for the position of the sun, such as 2026-06-21T12:00+02:00.
    #[arg(long, value_name = "TIME", help_heading = SKY)]
    time: Option<String>,
}

impl SkyArgs {
    /// The first option that is given.
    pub fn first_given(&self) -> Option<&'static str> {
        let SkyArgs { sky, sun, place, time } = self;
        let named = [("--sky", sky), ("--sun", sun), ("--place", place), ("--time", time)];
        named.into_iter().find(|(_, text)| text.is_some()).map(|(name, _)| name)
    }

    /// The sky and the sun that are asked for; those of [`SkyOptions::default`] without any option.
    ///
    /// # Errors
    /// A value is wrong, or a file cannot be read.
    pub fn options(&self) -> Result<SkyOptions> {
        let [sky, sun, place, time] =
            [&self.sky, &self.sun, &self.place, &self.time].map(|text| text.as_deref());
        SkyOptions::of_texts(sky, sun, place, time)
    }
}

impl SceneArgs {
    /// How luminous quantities are reported, if they are asked for.
    pub fn photometry(&self) -> Option<Photometry> {
        self.photometric.map(Photometry::from)
    }

    /// Refuses luminous quantities, for commands that compute no light.
    ///
    /// # Errors
    /// [`Error::Argument`] if they are asked for.
    pub fn without_light(&self) -> Result<()> {
        self.photometric.map_or(Ok(()), |_| {
            let what = "has no effect here: nothing that this command writes is light";
            Err(Error::arguments(format!("--photometric {what}; omit it")))
        })
    }

    /// Reads the scene.
    ///
    /// # Errors
    /// As for [`Scene::load`], or an invalid `--emitter`.
    pub fn load(&self, common: &Common) -> Result<Arc<Scene>> {
        job_context::scene(|| format!("{self:?} {}", common.unit), || self.read(common))
    }

    fn read(&self, common: &Common) -> Result<Scene> {
        let emitters = self.emitters.iter().map(|e| parse_emitter(e)).collect::<Result<Vec<_>>>()?;
        let moves = self.moves.iter().map(|m| Move::parse(m)).collect::<Result<Vec<_>>>()?;
        let luminaires = self.luminaires.as_deref().map(read_placements).transpose()?.unwrap_or_default();
        let grid = self.grid.options()?;
        let max_memory = limits::bytes(common.max_memory);
        let added = read_added(&self.add, &grid, max_memory)?;
        let mut options = LoadOptions::default().with_moves(moves).with_placements(luminaires);
        options = options.with_grid(grid).with_added(added, self.curvature);
        options.unit = common.unit.clone();
        options.emitters = emitters;
        options.two_sided_emission = self.two_sided_emission;
        options.threads = common.threads.map_or(0, usize::from);
        options.channels = self.photometric.unwrap_or_default();
        options.up = self.up;
        options.sides = self.sides;
        options.max_memory = max_memory;
        let _spinner = common.spinner(format!("reading {}", file_name(&self.scene)));
        let mut scene = Scene::load_with(&self.scene, &options)?;
        self.add_sky(&mut scene)?;
        Ok(scene)
    }

    /// Reads the scene for commands that need triangles of its own: placed meshes are copied, with a warning.
    ///
    /// # Errors
    /// As [`SceneArgs::load`], or more than [`MAX_COPIED_TRIANGLES`].
    pub fn load_flat(&self, common: &Common) -> Result<Arc<Scene>> {
        let scene = self.load(common)?;
        if scene.parts().placements.is_empty() {
            return Ok(scene);
        }
        let flatten = || {
            let flat = scene.flattened(MAX_COPIED_TRIANGLES)?;
            let (placed, triangles) =
                (grouped(scene.parts().placements.len()), grouped(flat.parts().triangles.len()));
            warn(common, &[format!("{placed} placed meshes were copied: {triangles} triangles")]);
            Ok(flat)
        };
        job_context::scene(|| format!("{self:?} {} copied", common.unit), flatten)
    }
}

/// Largest number of triangles after placed meshes are copied: limits memory to 20 GB, at about 1 kB per triangle of a
/// solve.
const MAX_COPIED_TRIANGLES: u64 = 20_000_000;

/// Writes warnings to standard error, one per line. A closed standard error is ignored.
pub fn warn(common: &Common, messages: &[String]) {
    for message in with_flags(messages).iter().filter(|_| !common.quiet) {
        super::say(&format!("mrvis: warning: {message}"));
    }
}

/// Location of the cache of measured clusters.
#[derive(clap::Args, Clone, Debug)]
pub struct CacheArgs {
    /// Cache the measured clusters in the folder DIR, or do not cache them (off) [default: mrvis in the user's cache folder]
    #[arg(long, value_name = "DIR|off")]
    pub cache: Option<PathBuf>,
}

impl CacheArgs {
    /// The location; creates the folder if it is missing.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn place(&self) -> Result<CacheLocation> {
        match &self.cache {
            None => Ok(user_cache().map_or(CacheLocation::Off, CacheLocation::Folder)),
            Some(folder) if folder == Path::new("off") => Ok(CacheLocation::Off),
            Some(folder) => check_folder(folder).map(|_| CacheLocation::Folder(folder.clone())),
        }
    }
}

/// The folder of this program in the user's cache folder (`XDG_CACHE_HOME`, else `~/.cache`); `None` if the user has no home.
fn user_cache() -> Option<PathBuf> {
    use etcetera::BaseStrategy;
    etcetera::choose_base_strategy().ok().map(|folders| folders.cache_dir().join("mrvis"))
}

/// The file name of a path, for messages.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Beginning of a name with characters that are valid in file names everywhere.
pub fn plain(name: &str) -> String {
    let valid = |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    name.chars().take(60).map(valid).collect()
}

/// Names of files with numbers behind those that occur more than once, also if only in another case: some file systems do not
/// distinguish cases.
pub fn distinct(names: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut used = HashSet::new();
    let number = |name: String| {
        let numbered = |n: usize| if n == 1 { name.clone() } else { format!("{name}-{n}") };
        (1..).map(numbered).find(|candidate| used.insert(candidate.to_lowercase())).unwrap_or_default()
    };
    names.into_iter().map(number).collect()
}

/// A count with separators of thousands: `1,234,567`.
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

/// A number with its noun: "1 face", "2,000 faces".
pub fn counted(n: usize, noun: &str) -> String {
    format!("{} {noun}{}", grouped(n), if n == 1 { "" } else { "s" })
}

/// The text as one word of a shell command.
fn shell_word(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:,=".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.into()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// The command line of this run or of the job of a batch, for a shell.
pub fn command_line() -> String {
    if let Some(line) = job_context::command_line() {
        return line;
    }
    shell_line(std::env::args_os().skip(1))
}

/// The command line with these arguments, for a shell.
pub fn shell_line(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> String {
    let words = arguments.into_iter().map(|word| shell_word(&word.as_ref().to_string_lossy()));
    let words: Vec<String> = std::iter::once("mrvis".into()).chain(words).collect();
    words.join(" ")
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

    #[test]
    fn names_of_files_are_distinct() {
        let names = ["a b", "a_b", "a/b", "A_b", "a_b-2"].map(plain);
        assert_eq!(distinct(names), ["a_b", "a_b-2", "a_b-3", "A_b-4", "a_b-2-2"]);
    }
}
