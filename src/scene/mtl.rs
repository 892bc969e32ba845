//! Material libraries (MTL): the statements that radiosity needs, parsed by `tobj`.

use super::{Repairs, SoupMaterial, texture::Texture};
use crate::{Error, Result};
use std::{
    collections::HashMap,
    fmt::Write,
    path::{Path, PathBuf},
};

/// Materials that were read, and their textures.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, SoupMaterial>,
    textures: HashMap<PathBuf, Option<Texture>>,
}

impl Library {
    /// The material `name`, or the substitute of a missing one.
    pub fn get(&self, name: &str) -> SoupMaterial {
        self.materials.get(name).cloned().unwrap_or_else(|| SoupMaterial::missing(name))
    }

    /// Reads a library. A missing library is a counted repair; an invalid one is an error.
    pub fn read(&mut self, path: &Path, repairs: &mut Repairs) -> Result<()> {
        let bytes = match std::fs::read(path) {
            Ok(bytes) => bytes,
            Err(e) => {
                repairs.missing_files += 1;
                repairs.messages.push(format!("material library {}: {e}", path.display()));
                return Ok(());
            }
        };
        let text = String::from_utf8_lossy(&bytes);
        note_unread_maps(path, &text, repairs);
        let text = clean(path, &text)?;
        let (materials, _) = tobj::load_mtl_buf(&mut text.as_bytes())
            .map_err(|e| Error::format(path, None, format!("not a material library ({e})")))?;
        for m in materials {
            let texture = m.diffuse_texture.and_then(|file| self.texture(path, &file, repairs));
            let rgb = |v: Option<[f64; 3]>| v.map(|v| v.map(|x| x as f32));
            // The colours of a texture without `Kd` are used unscaled.
            let default = if texture.is_some() { [0.0; 3] } else { SoupMaterial::DEFAULT_REFLECTANCE };
            let material = SoupMaterial {
                emission: rgb(m.emissive).unwrap_or_default(),
                opacity: m.dissolve.unwrap_or(1.0) as f32,
                texture,
                ..SoupMaterial::diffuse(&m.name, rgb(m.diffuse).unwrap_or(default))
            };
            self.materials.insert(m.name, material);
        }
        Ok(())
    }

    fn texture(&mut self, library: &Path, statement: &str, repairs: &mut Repairs) -> Option<Texture> {
        // Exporters on Windows write backslashes; a backslash within a file name is not supported.
        let file = library.with_file_name("").join(texture_file(statement).replace('\\', "/"));
        if let Some(known) = self.textures.get(&file) {
            return known.clone();
        }
        let texture = Texture::open(&file).map_err(|why| {
            repairs.missing_files += 1;
            repairs.messages.push(format!("texture {}: {why}", file.display()));
        });
        self.textures.insert(file, texture.clone().ok());
        texture.ok()
    }
}

/// Counts textures of emission and opacity, which are not read, and writes a message for each kind.
fn note_unread_maps(path: &Path, text: &str, repairs: &mut Repairs) {
    for (key, effect) in
        [("map_ke", "these materials emit evenly, by Ke"), ("map_d", "these materials are opaque, or by d")]
    {
        let has = |line: &&str| line.split_whitespace().next().is_some_and(|w| w.eq_ignore_ascii_case(key));
        let count = text.lines().filter(has).count();
        if count > 0 {
            repairs.unread_textures += count;
            let (file, key) = (path.file_name().unwrap_or_default().to_string_lossy(), &key[4..]);
            repairs
                .messages
                .push(format!("{count} textures map_{key} of {} are not read: {effect}", shorten(&file, 80)));
        }
    }
}

/// The file name of a `map_Kd` statement, without options such as `-s 1 1 1`.
fn texture_file(statement: &str) -> &str {
    let mut rest = statement.trim();
    while let Some((option, after)) = rest.split_once(char::is_whitespace).filter(|(o, _)| o.starts_with('-'))
    {
        rest = after.trim_start();
        let numbers = matches!(option, "-s" | "-o" | "-t" | "-mm");
        let limit = if numbers { 3 } else { 1 };
        for _ in 0..limit {
            match rest.split_once(char::is_whitespace) {
                Some((word, after)) if !numbers || word.parse::<f64>().is_ok() => rest = after.trim_start(),
                _ => break,
            }
        }
    }
    rest
}

/// Keeps the relevant statements in a form that `tobj` accepts: `tobj` panics on colours of fewer than three numbers,
/// which MTL allows, and stops at some irrelevant statements.
fn clean(path: &Path, text: &str) -> Result<String> {
    let mut out = String::with_capacity(text.len());
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let numbers = || -> Result<Vec<f64>> {
            let words = rest.split('#').next().unwrap_or_default().split_whitespace();
            let values: Option<Vec<f64>> =
                words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite() && v.abs() < 1e30)).collect();
            values.filter(|v| !v.is_empty()).ok_or_else(|| {
                Error::format(path, Some(i + 1), format!("`{}` is not a finite number", shorten(rest, 40)))
            })
        };
        // Writing to a string cannot fail.
        let _ = match key.to_lowercase().as_str() {
            "newmtl" => writeln!(out, "newmtl {}", if rest.is_empty() { "unnamed" } else { rest }),
            // Spectral curves and CIE XYZ are not supported: the default colour remains.
            "kd" | "ke" if rest.starts_with("spectral") || rest.starts_with("xyz") => Ok(()),
            "kd" | "ke" => {
                let v = numbers()?;
                if v.iter().any(|&x| x < 0.0) && key.eq_ignore_ascii_case("ke") {
                    return Err(Error::format(path, Some(i + 1), "Ke is radiance and cannot be negative"));
                }
                let rgb: [f64; 3] = std::array::from_fn(|c| *v.get(c).unwrap_or(&v[0]));
                writeln!(
                    out,
                    "K{} {} {} {}",
                    if key.ends_with(['d', 'D']) { "d" } else { "e" },
                    rgb[0],
                    rgb[1],
                    rgb[2]
                )
            }
            // `d -halo 0.5` states an opacity as well.
            "d" => match rest.rsplit(char::is_whitespace).next().and_then(|w| w.parse::<f64>().ok()) {
                Some(d) if d.is_finite() => writeln!(out, "d {d}"),
                _ => numbers().map(|_| Ok(()))?,
            },
            "tr" => writeln!(out, "d {}", 1.0 - numbers()?[0]),
            "map_kd" if !rest.is_empty() => writeln!(out, "map_Kd {rest}"),
            _ => Ok(()),
        };
    }
    Ok(out)
}

/// A beginning of the text that is short enough for a message.
pub(super) fn shorten(text: &str, limit: usize) -> String {
    let mut short: String = text.chars().filter(|c| !c.is_control()).take(limit).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_options_are_skipped() {
        let check = |statement, want| assert_eq!(texture_file(statement), want);
        check("wood.png", "wood.png");
        check("my wood floor.png", "my wood floor.png");
        check("-s 1 1 1 -o 0.5 0 wood.png", "wood.png");
        check("-blendu on  -s 2 wood 2.png", "wood 2.png");
        check("-imfchan", "-imfchan");
    }

    #[test]
    fn statements_in_the_form_tobj_reads() {
        let check = |text, want: &str| {
            assert_eq!(
                clean(Path::new("a.mtl"), text).map_err(|e| e.to_string()).unwrap_or_else(|e| e),
                want
            );
        };
        check("newmtl a b\r\n\tKd 0.5\r\n", "newmtl a b\nKd 0.5 0.5 0.5\n");
        check("Ns\nillum x\nKd 1 0 0 # red\nTr 0.25", "Kd 1 0 0\nd 0.75\n");
        check("d -halo 0.5\nke 1 2 3", "d 0.5\nKe 1 2 3\n");
        check("newmtl", "newmtl unnamed\n");
        check("Kd\n", "a.mtl:1: `` is not a finite number");
        check("\nKe nan 0 0\n", "a.mtl:2: `nan 0 0` is not a finite number");
        check("Ke -1 0 0", "a.mtl:1: Ke is radiance and cannot be negative");
    }
}
