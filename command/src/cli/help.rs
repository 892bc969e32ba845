//! Help on one screen (`--help`), and at length in groups (`mrvis help COMMAND`).

use super::Cli;
use super::inputs::check_folder;
use clap::{Arg, Command, CommandFactory};
use mrvis::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Options of `solve` by group; the others are in the groups that their definitions state.
const GROUPS: [(&str, &[&str]); 3] = [
    (
        "Accuracy and time",
        &["error", "min_area", "max_seconds", "target_error", "audit", "step_seconds", "max_links"],
    ),
    (
        "Visibility and feature sizes",
        &["visibility", "compare", "feature_size", "feature_sizes", "importance", "importance_camera"],
    ),
    ("Method", &["builder", "light_rays", "gather_rays", "local_rays"]),
];

/// Options of `solve` that `--help` omits and `mrvis help solve` lists.
const HIDDEN_SOLVE: [&str; 26] = [
    "audit",
    "builder",
    "cache",
    "cell",
    "compare",
    "curvature",
    "feature_sizes",
    "gather_rays",
    "height_scale",
    "importance",
    "importance_camera",
    "light_rays",
    "lightmap_texels",
    "local_rays",
    "look_inside",
    "max_links",
    "min_area",
    "moves",
    "mpi",
    "place",
    "seed",
    "sides",
    "step_seconds",
    "target_error",
    "time",
    "two_sided_emission",
];

/// Options of `bench` that `--help` omits and `mrvis help bench` lists.
const HIDDEN_BENCH: [&str; 7] = ["builder", "cell", "extinction", "height_scale", "place", "sides", "time"];

/// The command line, with options in groups and a short help of one sentence an option.
pub fn command() -> Command {
    Cli::command().mut_subcommands(|command| {
        let name = command.get_name().to_owned();
        let solve = name == "solve";
        let advanced = match name.as_str() {
            "solve" => &HIDDEN_SOLVE[..],
            "bench" => &HIDDEN_BENCH,
            _ => &[],
        };
        let command = match name.as_str() {
            "bench" => command.mut_arg("threads", |arg| {
                arg.help("Number of threads [default: one per core, but one for the timed sections]")
            }),
            _ => command,
        };
        let command = command.mut_args(|arg| arranged(arg, solve, advanced));
        // The list of commands has one statement each.
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        let command = command.about(first_sentence(&about).to_owned()).long_about(about);
        command.after_help(format!("mrvis help {name} describes all options at length."))
    })
}

fn arranged(arg: Arg, solve: bool, advanced: &[&str]) -> Arg {
    let id = arg.get_id().as_str().to_owned();
    let group = GROUPS.iter().find(|(_, ids)| solve && ids.contains(&id.as_str()));
    let arg = match group {
        Some((heading, _)) => arg.help_heading(*heading),
        None => arg,
    };
    let Some(text) = arg.get_long_help().or(arg.get_help()).map(ToString::to_string) else { return arg };
    let short = first_sentence(&text).to_owned();
    let hidden = advanced.contains(&id.as_str());
    arg.help(short).long_help(text).hide_short_help(hidden)
}

/// The beginning of a text up to the first sign that ends a statement and is not in parentheses.
fn first_sentence(text: &str) -> &str {
    let ends = [". ", ": ", "; ", ".\n", " [default", " (at least"];
    let is_outside = |&at: &usize| text[..at].matches('(').count() == text[..at].matches(')').count();
    let end =
        ends.iter().filter_map(|sign| text.match_indices(sign).map(|(at, _)| at).find(is_outside)).min();
    text[..end.unwrap_or(text.len())].trim_end_matches('.')
}

#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "SHELL", value_enum)]
    shell: clap_complete::Shell,
}

#[derive(clap::Args, Debug)]
pub struct ManArgs {
    /// Folder for the pages (created if missing).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the script that completes options and subcommands.
///
/// # Errors
/// Standard output cannot be written.
pub fn completions(args: &CompletionsArgs) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command(), "mrvis", &mut script);
    super::print(&String::from_utf8_lossy(&script))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes one page for the command and one for each subcommand.
///
/// # Errors
/// A page cannot be written.
pub fn pages(args: &ManArgs) -> Result<ExitCode> {
    let _folder = check_folder(&args.out)?;
    let command = command().disable_help_subcommand(true);
    clap_mangen::generate_to(command, &args.out).map_err(|e| Error::io(&args.out, e))?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The short help of every command fits on a screen, that of the program on one of 25 lines.
    #[test]
    fn help_fits_on_a_screen() {
        let mut command = command();
        command.build();
        let own = command.render_help().to_string();
        assert!(own.lines().count() <= 25, "{own}");
        for command in command.get_subcommands_mut() {
            let help = command.render_help().to_string();
            let (lines, long) = (help.lines().count(), command.render_long_help().to_string());
            assert!(lines <= 50, "{lines} lines: {help}");
            // Options that a command refuses are described nowhere.
            let offered = command.get_arguments().filter(|a| !a.is_hide_set());
            let hidden = offered.filter_map(Arg::get_long).filter(|l| !help.contains(l));
            for option in hidden {
                assert!(long.contains(&format!("--{option}")), "{option}");
            }
        }
    }

    /// Each line of the list of commands, and each short help of an option, is a whole phrase.
    #[test]
    fn short_help_ends_outside_parentheses() {
        for command in command().get_subcommands() {
            let about = command.get_about().map(ToString::to_string);
            assert!(about.as_ref().is_some_and(|about| !about.is_empty()), "{}", command.get_name());
            let options = command.get_arguments().filter_map(Arg::get_help).map(ToString::to_string);
            for text in options.chain(about) {
                assert_eq!(text.matches('(').count(), text.matches(')').count(), "{text}");
            }
        }
    }

    /// A group of options that does not exist any more is taken from the table.
    #[test]
    fn groups_hold_existing_options() {
        let command = Cli::command();
        let ids: Vec<String> = command
            .get_subcommands()
            .flat_map(|c| c.get_arguments())
            .map(|a| a.get_id().as_str().to_owned())
            .collect();
        for id in GROUPS.iter().flat_map(|(_, ids)| ids.iter()).chain(&HIDDEN_SOLVE).chain(&HIDDEN_BENCH) {
            assert!(ids.iter().any(|i| i == id), "{id}");
        }
    }

    #[test]
    fn sentences_are_short() {
        assert_eq!(first_sentence("Feature size: smaller [default: x]"), "Feature size");
        assert_eq!(first_sentence("Print nothing."), "Print nothing");
        assert_eq!(first_sentence("Write a scene (list: --list)."), "Write a scene (list: --list)");
    }
}
