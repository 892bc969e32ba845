//! Converts names of options in messages of the library to flags of the command.
//!
//! The library names an option by its field: `max_links 0: must lie in 1..100`, or, within a sentence, option `rays`.

use clap::CommandFactory;
use std::collections::BTreeSet;

/// The text with `--max-links` instead of a leading `max_links` followed by a number, and instead of option
/// `max_links`.
pub fn with_flags(text: &str) -> String {
    let options = long_options();
    let mut text = text.to_owned();
    if let Some((field, rest)) = text.split_once(' ') {
        let value = rest.split([' ', ':']).next().unwrap_or_default();
        if options.contains(&flag(field)) && value.parse::<f64>().is_ok() {
            text = format!("--{} {rest}", flag(field));
        }
    }
    let mut parts = text.split("option `");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once('`') {
            Some(("emitters", rest)) => out += &format!("--emitter NAME=W{rest}"),
            Some((field, rest)) if options.contains(&flag(field)) => {
                out += &format!("--{}{rest}", flag(field))
            }
            _ => out += &format!("option `{part}"),
        }
    }
    out
}

fn flag(field: &str) -> String {
    field.replace('_', "-")
}

/// The long options of all subcommands.
fn long_options() -> BTreeSet<String> {
    let command = super::Cli::command();
    let arguments = command.get_subcommands().flat_map(|c| c.get_arguments());
    arguments.filter_map(|a| a.get_long()).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_become_options() {
        for (text, want) in [
            ("max_links 0: must lie in 1..100", "--max-links 0: must lie in 1..100"),
            ("audit NaN: must be a part", "--audit NaN: must be a part"),
            (
                "points 9 need memory: lower option `points` or option `rays`",
                "--points 9 need memory: lower --points or --rays",
            ),
            ("a.obj: dark; add option `emitters`", "a.obj: dark; add --emitter NAME=W"),
            ("set option `two_sided_emission`", "set --two-sided-emission"),
            ("error bars: 3", "error bars: 3"),
            ("option `nothing` and `sofa`", "option `nothing` and `sofa`"),
            ("", ""),
        ] {
            assert_eq!(with_flags(text), want);
        }
    }
}
