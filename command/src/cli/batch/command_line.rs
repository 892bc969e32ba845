//! Command lines of jobs: options by their long names become arguments, and clap checks them.

use crate::batch::{Job, Opt, Out, Reads, TomlSource, Value, resolve_outputs, suggestion};
use crate::cli::args::shell_line;
use crate::cli::{Cli, Command, usage};
use clap::{Arg, ArgAction, CommandFactory, Parser, error::ContextKind, error::ContextValue};
use mrvis::internals::error::quote;
use mrvis::{Error, Result};
use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Options that the batch itself sets, or that make no sense in it.
const RESERVED: [&str; 6] = ["json", "quiet", "help", "version", "list", "mpi"];

/// The commands, with their options.
pub struct Grammar {
    command: clap::Command,
}

/// A job's command line.
pub struct Line {
    /// All arguments, the command first.
    pub words: Vec<OsString>,
    /// Files that exist before the batch and that the arguments name.
    pub files: Vec<PathBuf>,
}

impl Line {
    /// The command line for a shell.
    pub fn shown(&self) -> String {
        shell_line(&self.words)
    }

    /// The parsed command.
    ///
    /// # Errors
    /// As clap.
    pub fn parse(&self) -> Result<Command, clap::Error> {
        Ok(Cli::try_parse_from(std::iter::once(&OsString::from("mrvis")).chain(&self.words))?.command)
    }
}

/// A path of a job as the program reads it: relative to the job file, or in the outputs of another job.
fn resolved(source: &TomlSource, outputs: &Path, text: &str) -> (PathBuf, bool) {
    if text.contains("{out:") {
        let folder = |name: &str| outputs.join(name).to_string_lossy().into_owned();
        return (resolve_outputs(text, folder).into(), false);
    }
    (source.folder().join(text), true)
}

impl Grammar {
    /// The commands of the program.
    pub fn new() -> Grammar {
        Grammar { command: Cli::command() }
    }

    /// The arguments of a job that writes into `folder`; `outputs` is the output folder of the batch.
    ///
    /// # Errors
    /// An option is unknown, has no such value or is set by the batch.
    pub fn line(&self, source: &TomlSource, job: &Job, outputs: &Path, folder: &Path) -> Result<Line> {
        let kind = job.command;
        let mut words: Vec<OsString> = vec![kind.name.into()];
        let mut files = Vec::new();
        for text in &job.inputs {
            let named = kind.name == "generate";
            let (path, exists) = if named { (text.into(), false) } else { resolved(source, outputs, text) };
            files.extend(exists.then(|| path.clone()));
            words.push(path.into());
        }
        let mut out = match kind.out {
            Out::Missing => None,
            Out::Folder => Some(folder.to_owned()),
            Out::File(name) => Some(folder.join(name)),
        };
        for option in &job.options {
            let arg = self.option(source, job, option)?;
            if option.name == "out" {
                out = Some(folder.join(own_file(source, job, option)?));
                continue;
            }
            let is_path = arg.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>();
            let is_path = is_path && option.value != Value::Text("off".into());
            // A sky is a short text or a file.
            let is_sky_file = |text: &str| {
                let ending = Path::new(text).extension().unwrap_or_default();
                option.name == "sky"
                    && ["toml", "exr", "hdr"].iter().any(|known| ending.eq_ignore_ascii_case(known))
            };
            let mut value = |text: &str| -> String {
                let (path, exists) = resolved(source, outputs, text);
                if !is_path && !is_sky_file(text) {
                    return text.into();
                }
                files.extend((exists && option.name != "cache").then(|| path.clone()));
                path.to_string_lossy().into_owned()
            };
            let flag = format!("--{}", option.name);
            match &option.value {
                Value::Flag(false) => {}
                Value::Flag(true) => words.push(flag.into()),
                Value::Text(text) => words.push(format!("{flag}={}", value(text)).into()),
                Value::List(list) if matches!(arg.get_action(), ArgAction::Append) => {
                    words.extend(list.iter().map(|text| format!("{flag}={}", value(text)).into()));
                }
                Value::List(list) => {
                    let list: Vec<String> = list.iter().map(|text| value(text)).collect();
                    words.push(format!("{flag}={}", list.join(",")).into());
                }
            }
        }
        let given = |flag: &str, path: PathBuf| [OsString::from(flag), path.into()];
        words.extend(out.into_iter().flat_map(|path| given("--out", path)));
        words.extend(kind.json.into_iter().flat_map(|name| given("--json", folder.join(name))));
        words.push("--quiet".into());
        Ok(Line { words, files })
    }

    /// Takes the options of `[defaults]` away from jobs whose command does not have them.
    ///
    /// # Errors
    /// No command of the file has such an option.
    pub fn drop_foreign_defaults(&self, source: &TomlSource, jobs: &mut [Job]) -> Result<()> {
        let names = |job: &Job| -> Vec<&str> {
            let command =
                self.command.find_subcommand(job.command.name).expect("commands of jobs are commands");
            command.get_arguments().filter_map(Arg::get_long).collect()
        };
        let mut known: HashMap<&str, Vec<&str>> = HashMap::new();
        for job in &*jobs {
            known.entry(job.command.name).or_insert_with(|| names(job));
        }
        let somewhere = |name: &str| known.values().flatten().any(|k| *k == name);
        for option in jobs.iter().flat_map(|job| &job.options).filter(|o| o.is_default) {
            if !somewhere(&option.name) {
                let similar = suggestion(&option.name, known.values().flatten().copied());
                let what =
                    format!("no command of this file has the option `{}`{similar}", quote(&option.name));
                return Err(source.error(&option.span, what));
            }
        }
        for job in jobs {
            let own = &known[job.command.name];
            job.options.retain(|o| !o.is_default || own.contains(&o.name.as_str()));
        }
        Ok(())
    }

    /// Gives a job whose pictures need an automatic camera the one that depends on the scene alone: jobs of one scene then have pictures of
    /// the same view. `line` is the job's command line without it; one that is not correct is refused later.
    pub fn fix_camera(job: &mut Job, line: &Line) {
        if job.command.name == "solve"
            && let Ok(Command::Solve(args)) = line.parse()
            && args.choose_camera()
        {
            let (name, value) = ("camera".into(), Value::Text("scene".into()));
            job.options.push(Opt { name, value, span: job.span.clone(), is_default: true });
        }
    }

    /// The definition of an option of a job.
    fn option(&self, source: &TomlSource, job: &Job, option: &Opt) -> Result<&Arg> {
        let name = job.command.name;
        let command = self.command.find_subcommand(name).expect("commands of jobs are commands");
        let open = |arg: &&Arg| !RESERVED.contains(&arg.get_long().unwrap_or("help"));
        let mut options = command.get_arguments().filter(open);
        let fault = |what: String| source.error(&option.span, what);
        let found = options.find(|arg| arg.get_long() == Some(&option.name));
        let Some(arg) = found else {
            if RESERVED.contains(&option.name.as_str()) {
                return Err(fault(format!("`{}` is set by the batch itself; omit it", option.name)));
            }
            let known = command.get_arguments().filter(open).filter_map(Arg::get_long);
            let similar = suggestion(&option.name, known);
            return Err(fault(format!("`{name}` has no option `{}`{similar}", option.name)));
        };
        let takes_value = arg.get_action().takes_values();
        let may_omit = arg.get_num_args().is_some_and(|n| n.min_values() == 0);
        match &option.value {
            Value::Flag(true) if takes_value && !may_omit => {
                Err(fault(format!("`{}` needs a value, not `true`", option.name)))
            }
            Value::Text(_) | Value::List(_) if !takes_value => {
                Err(fault(format!("`{}` is a flag: write `true` or `false`", option.name)))
            }
            value if value.texts().iter().any(|text| text == "-") => {
                Err(fault(format!("`{}`: a job cannot read standard input", option.name)))
            }
            _ => Ok(arg),
        }
    }

    /// Parses the command line of a job and checks what needs no scene.
    ///
    /// # Errors
    /// With the place of the option in the job file, or of the job.
    pub fn check(&self, source: &TomlSource, job: &Job, line: &Line) -> Result<Command> {
        let command = line.parse().map_err(|error| {
            let named = error.get(ContextKind::InvalidArg).map(|value| match value {
                ContextValue::Strings(list) => list.join(" "),
                other => other.to_string(),
            });
            let named = named.unwrap_or_default();
            let of = |o: &&Opt| named.split([' ', '=']).any(|word| word.strip_prefix("--") == Some(&o.name));
            let span = job.options.iter().find(of).map_or(&job.span, |o| &o.span);
            source.error(span, format!("job `{}`: {}", job.name, usage(&error)))
        })?;
        for file in &line.files {
            let fault = |e| source.error(&job.span, format!("job `{}`: {}", job.name, Error::io(file, e)));
            std::fs::File::open(file).map_err(fault)?;
        }
        // Outputs of other jobs cannot be read yet.
        let readable = job.texts().all(|(text, _)| !text.contains("{out:"));
        let checked = match &command {
            Command::Solve(args) if readable => crate::cli::solve::check(args),
            Command::FormFactors(args) => args.format().map(|_| ()),
            Command::Terrain(args) => crate::cli::terrain::check_light(args),
            Command::Generate(args) => args.check_extension(),
            _ => Ok(()),
        };
        let fault = |e: Error| {
            let text = e.worded(crate::cli::flags::word);
            source.error(&job.span, format!("job `{}`: {text}", job.name))
        };
        checked.map_err(fault)?;
        Ok(command)
    }
}

/// The file that `out` of a job names: one in the folder of the job.
fn own_file(source: &TomlSource, job: &Job, option: &Opt) -> Result<String> {
    let fault = |what: &str| source.error(&option.span, what);
    let is_record = |name: &str| name.eq_ignore_ascii_case(job.command.record);
    match (&option.value, job.command.out) {
        (_, Out::Folder) => Err(fault("`out` is set by the batch itself; omit it")),
        (Value::Text(name), _) if is_record(name) => {
            Err(fault(&format!("`{name}` in the folder of the job is its record; name `out` differently")))
        }
        (Value::Text(name), Out::File(_)) if !name.contains(['/', '\\']) && name != ".." && name != "." => {
            Ok(name.clone())
        }
        _ => Err(fault("`out` of a job is the name of a file in its folder")),
    }
}

/// Whether the job reads a scene that exists before the batch.
pub fn scene_of<'a>(job: &Job, line: &'a Line) -> Option<&'a Path> {
    let reads = job.command.reads == Reads::Scene && !job.inputs.iter().any(|text| text.contains("{out:"));
    reads.then(|| line.files.first().map(PathBuf::as_path)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{COMMANDS, check, expand, parse};

    /// The command lines of a job file beside the files `a.obj` and `b.obj`.
    fn lines(text: &str) -> Result<Vec<String>> {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["a.obj", "b.obj", "p.csv"] {
            std::fs::write(folder.path().join(name), "").expect("written");
        }
        let source = TomlSource { path: folder.path().join("jobs.toml"), text: text.into() };
        let mut jobs = expand(&source, &parse(&source)?)?;
        check(&source, &mut jobs)?;
        let grammar = Grammar::new();
        grammar.drop_foreign_defaults(&source, &mut jobs)?;
        let line = |job: &Job| {
            let line = grammar.line(&source, job, Path::new("out"), &Path::new("work").join(&job.name))?;
            grammar.check(&source, job, &line)?;
            Ok(line.shown().replace(&format!("{}/", folder.path().display()), ""))
        };
        jobs.iter().map(line).collect()
    }

    #[test]
    fn options_become_arguments() {
        let found = lines(
            "[[job]]\ncommand = 'solve'\nscene = 'a.obj'\nname = 'x'\n\
             options = { error = 0.1, direct-only = true, gather = false, output = ['vtu', 'ply'], points = 'p.csv', camera = [0, 0, 0, 1, 1, 1, 60], emitter = ['a=1W'] }",
        );
        let found = found.expect("a line").remove(0);
        for part in [
            "mrvis solve a.obj ",
            "--error=0.1 --direct-only --output=vtu --output=ply --points=p.csv --camera=0,0,0,1,1,1,60 --emitter=a=1W",
            " --out work/x --quiet",
        ] {
            assert!(found.contains(part), "{found} lacks {part}");
        }
    }

    #[test]
    fn files_of_skies_lie_beside_the_job_file() {
        let of = |sky: &str| {
            lines(&format!("[[job]]\ncommand = 'solve'\nscene = 'a.obj'\noptions = {{ sky = '{sky}' }}"))
        };
        let found = of("sky.toml").expect_err("no such file").to_string();
        assert!(found.contains("sky.toml") && found.contains("jobs.toml"), "{found}");
        assert!(of("cie:12").expect("a line")[0].contains("--sky=cie:12"));
    }

    #[test]
    fn outputs_of_jobs_are_inputs_of_others() {
        let found = lines(
            "[[job]]\ncommand = 'reference'\nscene = '*.obj'\nname = 'ref-{scene}'\noptions = { points = 'p.csv' }\n\
             [[job]]\ncommand = 'compare'\nname = 'c'\ninputs = ['{out:ref-a}/irradiance.csv', '{out:ref-b}/irradiance.csv']",
        );
        let found = found.expect("three lines");
        assert!(
            found[1].contains("--out work/ref-b/irradiance.csv --json work/ref-b/reference.json"),
            "{found:?}"
        );
        assert!(
            found[2].starts_with("mrvis compare out/ref-a/irradiance.csv out/ref-b/irradiance.csv --json")
        );
    }

    #[test]
    fn defaults_apply_to_commands_that_have_them() {
        let jobs = "[[job]]\ncommand = 'solve'\nscene = 'a.obj'\n\
                    [[job]]\ncommand = 'fbem'\nname = 'f'\ninputs = ['a.obj', 'b.obj']\n";
        let found =
            lines(&format!("[defaults]\noptions = {{ unit = 'mm', seed = 3 }}\n{jobs}")).expect("two lines");
        assert!(found[0].contains("--unit=mm --seed=3"), "{found:?}");
        assert!(!found[1].contains("unit") && !found[1].contains("seed"), "{found:?}");
        let refused =
            lines(&format!("[defaults]\noptions = {{ sed = 3 }}\n{jobs}")).expect_err("refused").to_string();
        let want = "jobs.toml:2:13: no command of this file has the option `sed`; did you mean `seed`?";
        assert!(refused.contains(want), "{refused}");
        // A job's own options must be those of its command.
        let own = lines(&format!("{jobs}options = {{ seed = 3 }}\n")).expect_err("refused").to_string();
        assert!(own.contains("`fbem` has no option `seed`"), "{own}");
    }

    #[test]
    fn errors_name_the_place_of_the_option() {
        let job = |options: &str| {
            let text = format!("[[job]]\ncommand = 'solve'\nscene = 'a.obj'\noptions = {{ {options} }}");
            lines(&text).expect_err("refused").to_string()
        };
        for (options, want) in [
            ("eror = 1", "jobs.toml:4:13: `solve` has no option `eror`; did you mean `error`?"),
            ("seed = 2, error = 'x'", "jobs.toml:4:23: job `solve-a`: invalid value 'x' for '--error"),
            ("gather = 3", "jobs.toml:4:13: `gather` is a flag"),
            ("error = true", "`error` needs a value"),
            ("out = 'x'", "`out` is set by the batch"),
            ("json = 'x'", "`json` is set by the batch"),
            ("points = 'missing.csv'", "missing.csv: No such file"),
            ("points = '-'", "cannot read standard input"),
            ("max-links = 0", "--max-links 0: must lie in"),
        ] {
            let found = job(options);
            assert!(found.contains(want), "{found}\nlacks {want}");
        }
    }

    /// A file that the command would refuse, or that the record of the job would replace, is found before the job runs.
    #[test]
    fn names_of_outputs_are_checked() {
        for (command, options, want) in [
            ("form-factors", "out = 'm.txt'", "m.txt: the extension must be .npz, .csv or .mtx"),
            (
                "reference",
                "points = 'p.csv', out = 'reference.json'",
                "jobs.toml:4:31: `reference.json` in the folder",
            ),
            ("reference", "points = 'p.csv', out = '../e.csv'", "`out` of a job is the name of a file"),
        ] {
            let text = format!("[[job]]\ncommand = '{command}'\nscene = 'a.obj'\noptions = {{ {options} }}");
            let found = lines(&text).expect_err("refused").to_string();
            assert!(found.contains(want), "{found} lacks {want}");
        }
        let generated = |out: &str, more: &str| {
            lines(&format!(
                "[[job]]\ncommand = 'generate'\nname = 'g'\ninputs = ['forest']\noptions = {{ out = '{out}'{more} }}"
            ))
        };
        assert!(generated("f.gltf", ", instances = true").is_ok() && generated("f.obj", "").is_ok());
        let refused = generated("f.obj", ", instances = true").expect_err("refused").to_string();
        assert!(refused.contains("job `g`: ") && refused.contains("must end in .gltf or .glb"), "{refused}");
    }

    /// Every command of jobs is a command, with the options that the batch sets.
    #[test]
    fn commands_of_jobs_are_commands() {
        let grammar = Grammar::new();
        for kind in &COMMANDS {
            let command = grammar.command.find_subcommand(kind.name).expect(kind.name);
            let has = |name: &str| command.get_arguments().any(|a| a.get_long() == Some(name));
            assert_eq!(has("out"), kind.out != Out::Missing, "{}", kind.name);
            assert!(kind.json.is_none() || has("json"), "{}", kind.name);
        }
    }
}
