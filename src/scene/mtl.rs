//! Material libraries (MTL): the statements that radiosity needs, parsed by `tobj`.

use super::{
    Repairs, SoupMaterial,
    sources::{Sources, TextureKey, beside, text_of},
};
use crate::error::{quote, shown};
use crate::{Error, Result, files::input::guarded};
use std::{collections::HashMap, fmt::Write, path::Path};

/// Materials that were read.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, SoupMaterial>,
}

impl Library {
    /// The material `name`, or the substitute of a missing one.
    pub fn get(&self, name: &str) -> SoupMaterial {
        self.materials.get(name).cloned().unwrap_or_else(|| SoupMaterial::missing(name))
    }

    /// Reads a library. A missing library is a counted repair; an invalid one is an error.
    pub fn read(&mut self, path: &Path, sources: &mut Sources, repairs: &mut Repairs) -> Result<()> {
        let bytes = match sources.small(path) {
            Ok(bytes) => bytes,
            Err(Error::Io { source, .. }) => {
                repairs.unreadable(&format!("material library {}: {source}", shown(path)));
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        self.parse(path, &bytes, sources, repairs)
    }

    /// Reads the content of a library.
    fn parse(
        &mut self,
        path: &Path,
        bytes: &[u8],
        sources: &mut Sources,
        repairs: &mut Repairs,
    ) -> Result<()> {
        let cleaned = clean(path, &text_of(bytes))?;
        let text = &cleaned.text;
        let (materials, _) = guarded(path, || {
            tobj::load_mtl_buf(&mut text.as_bytes())
                .map_err(|e| Error::format(path, None, format!("not a material library ({e})")))
        })?;
        repairs.messages.extend(cleaned.notes());
        for m in materials {
            let texture = match m.diffuse_texture {
                Some(statement) => {
                    let file = beside(path, texture_file(&statement));
                    let key = TextureKey::File(file.clone());
                    sources.texture(path, &key, repairs, |sources| sources.bytes(&file))?
                }
                None => None,
            };
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
}

/// Reads the content of a material library; the number of materials. Textures are looked for in `folder`.
///
/// # Errors
/// It is no material library, or has an invalid colour.
#[cfg(any(test, feature = "internals"))]
pub fn read_materials(folder: &Path, bytes: &[u8]) -> Result<usize> {
    let mut library = Library::default();
    let path = folder.join("scene.mtl");
    library.parse(&path, bytes, &mut Sources::new(None), &mut Repairs::default())?;
    Ok(library.materials.len())
}

/// Statements of a material library in the form that `tobj` accepts.
#[derive(Debug, Default)]
struct Cleaned {
    text: String,
    /// Numbers of `map_Ke` and of `map_d` statements, which are not read.
    emission_maps: usize,
    opacity_maps: usize,
}

impl Cleaned {
    /// What was left out.
    fn notes(&self) -> impl Iterator<Item = String> {
        let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
        let emission = count(
            self.emission_maps,
            "map_Ke textures are not read: these materials emit evenly, as Ke says",
        );
        let opacity = count(
            self.opacity_maps,
            "map_d textures are not read: these materials are opaque or not, as d says",
        );
        emission.into_iter().chain(opacity)
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
fn clean(path: &Path, text: &str) -> Result<Cleaned> {
    let mut cleaned = Cleaned { text: String::with_capacity(text.len()), ..Cleaned::default() };
    let out = &mut cleaned.text;
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let numbers = || -> Result<Vec<f64>> {
            let words = rest.split('#').next().unwrap_or_default().split_whitespace();
            let values: Option<Vec<f64>> =
                words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite() && v.abs() < 1e30)).collect();
            values.filter(|v| !v.is_empty()).ok_or_else(|| {
                Error::format(path, Some(i + 1), format!("`{}` is not a finite number", quote(rest)))
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
            "map_ke" if !rest.is_empty() => {
                cleaned.emission_maps += 1;
                Ok(())
            }
            "map_d" if !rest.is_empty() => {
                cleaned.opacity_maps += 1;
                Ok(())
            }
            "map_kd" if !rest.is_empty() => writeln!(out, "map_Kd {rest}"),
            _ => Ok(()),
        };
    }
    Ok(cleaned)
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
            assert_eq!(clean(Path::new("a.mtl"), text).map_or_else(|e| e.to_string(), |c| c.text), want);
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
