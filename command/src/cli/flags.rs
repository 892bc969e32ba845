//! Flags of the command for the options of the library.

use clap::CommandFactory;
use mrvis::internals::error::{own_word, worded};

/// Notes of the library with flags: `--max-links` for its `max_links`.
pub fn with_flags(notes: &[String]) -> Vec<String> {
    notes.iter().map(|note| worded(note, word)).collect()
}

/// Flag of an option of the library.
pub fn word(name: &str) -> String {
    let field = match name {
        "LoadOptions::emitters" => return "--emitter NAME=W".into(),
        "emitters" => "emitter",
        "receivers" => "receiver",
        "path" => "out",
        "texels" => "lightmap_texels",
        "exponent" => "p",
        "sizes" => "s",
        "name" => return "NAME".into(),
        "earth_radius" => return "--curvature times the radius of the earth,".into(),
        name => name.strip_prefix("LoadOptions::").unwrap_or(name),
    };
    let flag = field.replace('_', "-");
    let command = super::Cli::command();
    let mut arguments = command.get_subcommands().flat_map(|c| c.get_arguments());
    match arguments.any(|a| a.get_long() == Some(&flag)) {
        true => format!("--{flag}"),
        false => own_word(name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_become_options() {
        for (text, want) in [
            ("⟨max_links⟩ 0: must lie in 1..100", "--max-links 0: must lie in 1..100"),
            ("a.obj: dark; add ⟨LoadOptions::emitters⟩", "a.obj: dark; add --emitter NAME=W"),
            ("set ⟨LoadOptions::two_sided_emission⟩", "set --two-sided-emission"),
            ("error bars: 3", "error bars: 3"),
            ("⟨exponent⟩ 0: below 1", "--p 0: below 1"),
            ("⟨indices[3]⟩ and `sofa`", "`indices`[3] and `sofa`"),
            ("", ""),
        ] {
            assert_eq!(worded(text, word), want);
        }
    }
}
