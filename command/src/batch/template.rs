//! Templates: `{key}` stands for a value of the job, `{out:NAME}` for the output folder of another job.

use super::names::suggestion;
use mrvis::internals::error::quote;
use std::collections::BTreeMap;

/// Values by key.
pub type Fields = BTreeMap<String, String>;

/// A part of a template.
enum Part<'a> {
    Text(&'a str),
    /// The content of a pair of braces, which may hold others.
    Braces(&'a str),
}

/// Splits a template at its outer braces.
fn parts(text: &str) -> Result<Vec<Part<'_>>, String> {
    let (mut parts, mut rest) = (Vec::new(), text);
    while let Some(start) = rest.find(['{', '}']) {
        parts.push(Part::Text(&rest[..start]));
        let mut depth = 0;
        let end = rest[start..].char_indices().find_map(|(i, c)| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            (depth <= 0).then_some(start + i)
        });
        let Some(end) = end.filter(|_| rest[start..].starts_with('{')) else {
            return Err(format!("`{}` has a brace without its partner", quote(text)));
        };
        parts.push(Part::Braces(&rest[start + 1..end]));
        rest = &rest[end + 1..];
    }
    parts.push(Part::Text(rest));
    Ok(parts)
}

/// The text with values for keys. Names in `{out:NAME}` are filled in and stay in their braces.
///
/// # Errors
/// A key is unknown, or braces do not match.
pub fn fill(text: &str, fields: &Fields) -> Result<String, String> {
    let mut out = String::new();
    for part in parts(text)? {
        match part {
            Part::Text(text) => out += text,
            Part::Braces(inner) => match inner.strip_prefix("out:") {
                Some(name) => out += &format!("{{out:{}}}", fill(name, fields)?),
                None => {
                    out += fields.get(inner).ok_or_else(|| {
                        let similar = suggestion(inner, fields.keys().map(String::as_str));
                        format!("`{{{}}}` is no value of this job{similar}", quote(inner))
                    })?
                }
            },
        }
    }
    Ok(out)
}

/// Names of the jobs whose outputs a filled text names.
pub fn outputs_of(text: &str) -> Vec<&str> {
    let parts = parts(text).unwrap_or_default();
    parts
        .into_iter()
        .filter_map(|part| match part {
            Part::Braces(inner) => inner.strip_prefix("out:"),
            Part::Text(_) => None,
        })
        .collect()
}

/// A filled text with the folders of the jobs that it names.
pub fn resolve_outputs(text: &str, folder: impl Fn(&str) -> String) -> String {
    let parts = parts(text).unwrap_or_default();
    let resolved = parts.into_iter().map(|part| match part {
        Part::Text(text) => text.to_owned(),
        Part::Braces(inner) => inner.strip_prefix("out:").map_or_else(|| format!("{{{inner}}}"), &folder),
    });
    resolved.collect()
}
