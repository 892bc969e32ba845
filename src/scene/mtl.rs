//! Material libraries (MTL): the statements that radiosity needs.

use super::{
    Repairs, SoupMaterial,
    sources::{Sources, TextureKey, beside, text_of},
};
use crate::error::{quote, shown};
use crate::{Error, Result};
use std::{collections::HashMap, path::Path};

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
        let stated = statements(path, &text_of(bytes))?;
        repairs.messages.extend(stated.notes());
        for m in stated.materials {
            let texture = match &m.texture {
                Some(statement) => {
                    let file = beside(path, texture_file(statement));
                    let key = TextureKey::File(file.clone());
                    sources.texture(path, &key, repairs, |sources| sources.bytes(&file))?
                }
                None => None,
            };
            let rgb = |v: Option<[f64; 3]>| v.map(|v| v.map(|x| x as f32));
            // The colours of a texture without `Kd` are used unscaled.
            let default = if texture.is_some() { [0.0; 3] } else { SoupMaterial::DEFAULT_REFLECTANCE };
            let material = SoupMaterial {
                emission: rgb(m.emission).unwrap_or_default(),
                opacity: m.opacity.unwrap_or(1.0) as f32,
                texture,
                ..SoupMaterial::diffuse(&m.name, rgb(m.reflectance).unwrap_or(default))
            };
            self.materials.insert(m.name, material);
        }
        Ok(())
    }
}

/// Reads the content of a material library; the number of materials. Textures are looked for in `folder`.
///
/// # Errors
/// A number is not finite, or a value of `Ke` is negative.
pub fn read_materials(folder: &Path, bytes: &[u8]) -> Result<usize> {
    let mut library = Library::default();
    let path = folder.join("scene.mtl");
    library.parse(&path, bytes, &mut Sources::new(None), &mut Repairs::default())?;
    Ok(library.materials.len())
}

/// A material as a library states it.
#[derive(Debug, Default, PartialEq)]
struct Stated {
    name: String,
    /// `Kd` and `Ke`.
    reflectance: Option<[f64; 3]>,
    emission: Option<[f64; 3]>,
    opacity: Option<f64>,
    /// `map_Kd`, with its options.
    texture: Option<String>,
}

/// Statements of a material library.
#[derive(Debug, Default)]
struct Statements {
    materials: Vec<Stated>,
    /// Numbers of `map_Ke` and of `map_d` statements, which are not read.
    emission_maps: usize,
    opacity_maps: usize,
}

impl Statements {
    /// Notes of statements that were left out.
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

/// Reads the relevant statements. Colours may have fewer than three numbers: the first stands for those that are missing.
fn statements(path: &Path, text: &str) -> Result<Statements> {
    let mut all = Statements::default();
    // Before the first name statements belong to no material.
    let mut nameless = Stated::default();
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
        let material = all.materials.last_mut().unwrap_or(&mut nameless);
        match key.to_lowercase().as_str() {
            "newmtl" => {
                let name = if rest.is_empty() { "unnamed" } else { rest }.to_owned();
                all.materials.push(Stated { name, ..Stated::default() });
            }
            // Spectral curves and CIE XYZ are not supported: the default colour remains.
            "kd" | "ke" if rest.starts_with("spectral") || rest.starts_with("xyz") => {}
            "kd" => material.reflectance = Some(rgb(&numbers()?)),
            "ke" => {
                let v = numbers()?;
                if v.iter().any(|&x| x < 0.0) {
                    return Err(Error::format(path, Some(i + 1), "Ke is radiance and cannot be negative"));
                }
                material.emission = Some(rgb(&v));
            }
            // `d -halo 0.5` states an opacity as well.
            "d" => match rest.rsplit(char::is_whitespace).next().and_then(|w| w.parse::<f64>().ok()) {
                Some(d) if d.is_finite() => material.opacity = Some(d),
                _ => drop(numbers()?),
            },
            "tr" => material.opacity = Some(1.0 - numbers()?[0]),
            "map_ke" if !rest.is_empty() => all.emission_maps += 1,
            "map_d" if !rest.is_empty() => all.opacity_maps += 1,
            "map_kd" if !rest.is_empty() => material.texture = Some(rest.to_owned()),
            _ => {}
        }
    }
    Ok(all)
}

/// A colour of one to three numbers.
fn rgb(v: &[f64]) -> [f64; 3] {
    std::array::from_fn(|c| *v.get(c).unwrap_or(&v[0]))
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
    fn statements_of_many_hands() {
        let read = |text| statements(Path::new("a.mtl"), text).map_err(|e| e.to_string());
        let check = |text, name: &str, reflectance, emission, opacity| {
            let want = Stated { name: name.into(), reflectance, emission, opacity, texture: None };
            assert_eq!(read(text).expect(text).materials, [want], "{text}");
        };
        check("newmtl a b\r\n\tKd 0.5\r\n", "a b", Some([0.5; 3]), None, None);
        check(
            "Kd 1\nnewmtl\nillum x\nKd 1 0 0 # red\nTr 0.25",
            "unnamed",
            Some([1.0, 0.0, 0.0]),
            None,
            Some(0.75),
        );
        check("newmtl a\nd -halo 0.5\nke 1 2 3", "a", None, Some([1.0, 2.0, 3.0]), Some(0.5));
        let wrong = |text, want: &str| assert_eq!(read(text).expect_err(text), want);
        wrong("Kd\n", "a.mtl:1: `` is not a finite number");
        wrong("\nKe nan 0 0\n", "a.mtl:2: `nan 0 0` is not a finite number");
        wrong("Ke -1 0 0", "a.mtl:1: Ke is radiance and cannot be negative");
    }
}
