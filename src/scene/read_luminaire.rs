//! Photometric files of luminaires: IES LM-63 (type C) and EULUMDAT.
//!
//! Parsed here, because the crates for these formats are under licences that this crate cannot use, or are not maintained.

use super::mtl::shorten;
use super::profile::{Distribution, Symmetry};
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;

/// Largest number of angles of a kind: a table of a tenth of a degree.
const MAX_ANGLES: usize = 3600;
/// Largest size of a file: a table of 3,600 × 3,600 values is not measured; 16 MB hold 2 million values.
const MAX_BYTES: u64 = 16 << 20;
/// Largest difference between the flux that a file states and that of its table. Interpolation in steps h of γ loses
/// h²/12, 0.6 % at 15°, and files round to whole percent; a wrong multiplier is off by more.
const FLUX_TOLERANCE: f64 = 0.05;

/// A luminaire as measured.
#[derive(Clone, Debug)]
pub struct Luminaire {
    pub distribution: Distribution,
    /// Length along C = 0, width along C = 90° and height of the luminous opening, metres; 0 for a point.
    pub opening: [f64; 3],
    /// A sentence if the file's own flux and the integral of its table disagree.
    pub note: Option<String>,
}

/// Reads a file by its extension: `.ies`, or `.ldt` and `.eul`.
pub fn read(path: &Path) -> Result<Luminaire> {
    let data = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    let wrong = |what: String| Error::format(path, None, what);
    if !data.is_file() || data.len() > MAX_BYTES {
        return Err(wrong(format!("must be a regular file of at most {MAX_BYTES} bytes")));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let text = String::from_utf8_lossy(&bytes);
    let kind = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match kind.as_str() {
        "ies" => ies(&text),
        "ldt" | "eul" => eulumdat(&text),
        _ => Err((None, "the extension must be .ies, .ldt or .eul".into())),
    }
    .map_err(|(line, what)| Error::format(path, line, what))
}

/// What is wrong, with the line if one is known.
type Wrong = (Option<usize>, String);

/// Numbers of a text, with their lines.
struct Numbers<'a>(Box<dyn Iterator<Item = (usize, &'a str)> + 'a>);

impl Numbers<'_> {
    fn next(&mut self, what: &str) -> Result<f64, Wrong> {
        let (line, word) = self.0.next().ok_or_else(|| (None, format!("the file ends before {what}")))?;
        let value: Option<f64> = word.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| (Some(line), format!("`{}` is not a number ({what})", shorten(word, 40))))
    }

    fn list(&mut self, count: usize, what: &str) -> Result<Vec<f64>, Wrong> {
        (0..count).map(|_| self.next(what)).collect()
    }

    fn count(&mut self, what: &str) -> Result<usize, Wrong> {
        let n = self.next(what)?;
        if n.fract() == 0.0 && (1.0..=MAX_ANGLES as f64).contains(&n) {
            Ok(n as usize)
        } else {
            Err((None, format!("{what}: {n} is not a whole number in 1..{MAX_ANGLES}")))
        }
    }
}

fn ies(text: &str) -> Result<Luminaire, Wrong> {
    let mut lines = (1..).zip(text.lines());
    let tilt = lines.find(|(_, l)| l.trim_start().starts_with("TILT="));
    let (line, tilt) = tilt.ok_or((None, "no line TILT=: not an IES LM-63 file".to_owned()))?;
    let tilt = tilt.trim().trim_start_matches("TILT=").trim().to_owned();
    let words = lines.flat_map(|(n, l)| {
        l.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty()).map(move |w| (n, w))
    });
    let mut numbers = Numbers(Box::new(words));
    match tilt.as_str() {
        "NONE" => {}
        "INCLUDE" => {
            numbers.next("the lamp's geometry")?;
            let pairs = numbers.count("the number of tilt angles")?;
            numbers.list(2 * pairs, "the tilt table")?;
        }
        _ => return Err((Some(line), "the tilt table is in another file; put it into this one".into())),
    }
    let lamps = numbers.next("the number of lamps")?;
    let lumens = numbers.next("the lumens per lamp")?;
    let multiplier = numbers.next("the candela multiplier")?;
    let (down, around) = (numbers.count("vertical angles")?, numbers.count("horizontal angles")?);
    if numbers.next("the photometric type")? != 1.0 {
        return Err((None, "only type C photometry is read; convert types A and B".into()));
    }
    let metres = if numbers.next("the type of units")? == 1.0 { 0.3048 } else { 1.0 };
    let size = numbers.list(3, "the opening")?;
    let factors = numbers.list(2, "the ballast factors")?;
    numbers.next("the input power")?;
    let gammas = numbers.list(down, "the vertical angles")?;
    let planes = numbers.list(around, "the horizontal angles")?;
    let scale = multiplier * factors[0] * if factors[1] > 0.0 { factors[1] } else { 1.0 };
    let mut rows = Vec::with_capacity(around);
    for _ in 0..around {
        let row = numbers.list(down, "the candelas")?;
        rows.push(row.into_iter().map(|v| v * scale).collect());
    }
    let symmetry = match (planes[0], planes[around - 1]) {
        _ if around == 1 => Symmetry::Axis,
        (0.0, 90.0) => Symmetry::Both,
        (0.0, 180.0) => Symmetry::C0C180,
        (90.0, 270.0) => Symmetry::C90C270,
        (0.0, _) => Symmetry::None,
        _ => return Err((None, "horizontal angles must begin with 0, or go from 90 to 270".into())),
    };
    let distribution = Distribution::new(&planes, &gammas, &rows, symmetry).map_err(|e| (None, e))?;
    // A negative number of lumens: absolute photometry, without a flux of lamps.
    let lamp = lamps * lumens * factors[0] * multiplier;
    let flux = distribution.flux(0.0, PI);
    let note = (lamp > 0.0 && flux > (1.0 + FLUX_TOLERANCE) * lamp)
        .then(|| format!("its table sums to {flux:.0} lm, more than the {lamp:.0} lm of its lamps"));
    // Length is along C = 0; negative sizes are diameters of round openings.
    let [width, length, height] = [size[0], size[1], size[2]].map(|v| v * metres);
    Ok(Luminaire { distribution, opening: opening(length, width, height), note })
}

fn eulumdat(text: &str) -> Result<Luminaire, Wrong> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let number = |n: usize, what: &str| -> Result<f64, Wrong> {
        let line =
            lines.get(n - 1).ok_or_else(|| (None, format!("the file ends before line {n}, {what}")))?;
        let value: Option<f64> = line.replace(',', ".").parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| (Some(n), format!("`{}` is not a number ({what})", shorten(line, 40))))
    };
    let count = |n: usize, what: &str, most: usize| -> Result<usize, Wrong> {
        let v = number(n, what)?;
        if v.fract() == 0.0 && (1.0..=most as f64).contains(&v) {
            Ok(v as usize)
        } else {
            Err((Some(n), format!("{what}: {v} is not a whole number in 1..{most}")))
        }
    };
    let (all, down) =
        (count(4, "the number of C planes", MAX_ANGLES)?, count(6, "the number of angles", MAX_ANGLES)?);
    let (symmetry, first, planes) = match number(3, "the symmetry")? {
        0.0 => (Symmetry::None, 0, all),
        1.0 => (Symmetry::Axis, 0, 1),
        2.0 if all % 2 == 0 => (Symmetry::C0C180, 0, all / 2 + 1),
        3.0 if all % 4 == 0 => (Symmetry::C90C270, all / 4, all / 2 + 1),
        4.0 if all % 4 == 0 => (Symmetry::Both, 0, all / 4 + 1),
        _ => return Err((Some(3), "the symmetry must be 0 to 4 and divide the number of C planes".into())),
    };
    let sets = count(26, "the number of lamp sets", 20)?;
    let mut lamp = 0.0;
    for set in 0..sets {
        lamp += number(29 + 6 * set, "the flux of the lamps")?;
    }
    let angles = 27 + 6 * sets + 10;
    let list = |from: usize, n: usize, what: &str| -> Result<Vec<f64>, Wrong> {
        (from..from + n).map(|line| number(line, what)).collect()
    };
    let c = list(angles, all, "C angle")?;
    let gammas = list(angles + all, down, "angle from the axis")?;
    let scale = lamp / 1000.0 * number(24, "the conversion factor")?;
    let mut rows = Vec::with_capacity(planes);
    for plane in 0..planes {
        let row = list(angles + all + (1 + plane) * down, down, "candelas per 1000 lm")?;
        rows.push(row.into_iter().map(|v| v * scale).collect());
    }
    // All planes from 270 on are the mirror images of those from 90 on.
    let listed = &c[first..(first + planes).min(all)];
    let mut listed = listed.to_vec();
    if listed.len() < planes {
        return Err((Some(4), "fewer C planes than its symmetry requires".into()));
    }
    listed.truncate(planes);
    let distribution = Distribution::new(&listed, &gammas, &rows, symmetry).map_err(|e| (None, e))?;
    let stated = lamp * number(23, "the light output ratio")? / 100.0;
    let flux = distribution.flux(0.0, PI);
    let note = (stated > 0.0 && (flux / stated - 1.0).abs() > FLUX_TOLERANCE)
        .then(|| format!("its table sums to {flux:.0} lm, its light output ratio to {stated:.0} lm"));
    let [length, width] = [number(16, "the luminous length")?, number(17, "the luminous width")?];
    let width = if width == 0.0 { -length } else { width };
    let length = if width < 0.0 { -length } else { length };
    let height = number(18, "the luminous height")?;
    Ok(Luminaire { distribution, opening: opening(length * 1e-3, width * 1e-3, height * 1e-3), note })
}

/// Sides of a rectangle with the area of the opening: a round one (negative sizes) becomes a square.
fn opening(length: f64, width: f64, height: f64) -> [f64; 3] {
    let side = |v: f64| if v < 0.0 { -v * (0.25 * PI).sqrt() } else { v };
    let (length, width) = (side(length), side(width));
    // Linear openings state one side only.
    let thin = 0.01 * length.max(width);
    [length.max(thin), width.max(thin), height.abs()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const IES: &str =
        "IESNA:LM-63-2002\n[TEST] x\nTILT=NONE\n1 1000 2 3 1 1 2 0.1 0.2 0\n1 1 20\n0 45 90\n0\n100, 80 0\n";

    #[test]
    fn ies_file() {
        let l = ies(IES).unwrap();
        assert_eq!(l.opening, [0.2, 0.1, 0.0]);
        assert!((l.distribution.intensity(0.0, 1.0) - 200.0).abs() < 1e-9);
        assert!((l.distribution.intensity(45f64.to_radians(), 1.0) - 160.0).abs() < 1e-9);
        assert!(l.note.is_none());
        let wrong = |text: String| ies(&text).unwrap_err();
        assert_eq!(wrong(IES.replace("80 0", "80 x")).0, Some(8));
        assert!(wrong(IES.replace("100, 80 0", "100")).1.contains("ends before"));
        assert!(wrong(IES.replace(" 3 1 1 2", " 1e9 1 1 2")).1.contains("vertical"));
        assert!(wrong(IES.replace(" 3 1 1 2", " 3 1 2 2")).1.contains("type C"));
        assert!(ies(&IES.replace("1 1000", "1 100")).unwrap().note.is_some());
    }

    #[test]
    fn eulumdat_file_sums_to_its_own_light_output_ratio() {
        // A diffuse plate of 80 % of 2000 lm: I(0) = Φ / π per 1000 lm.
        let mut lines: Vec<String> = vec!["x".into(); 12];
        lines.extend("0 0 0 500 0 0 0 0 0 100 80 1 0 1".split(' ').map(str::to_owned));
        (lines[1], lines[2], lines[3], lines[5]) = ("1".into(), "1".into(), "1".into(), "91".into());
        lines.extend("1 LED 2000 3000 80 20".split(' ').map(str::to_owned));
        lines.extend(vec!["1".to_owned(); 10]);
        lines.push("0".into());
        lines.extend((0..=90).map(|g| g.to_string()));
        let row = (0..=90).map(|g| 800.0 / PI * f64::from(g).to_radians().cos());
        lines.extend(row.map(|v| format!("{v:.4}").replace('.', ",")));
        let l = eulumdat(&lines.join("\r\n")).unwrap();
        assert!((l.distribution.flux(0.0, PI) / 1600.0 - 1.0).abs() < 1e-4);
        assert!(l.note.is_none());
        assert!((l.opening[0] - 0.5 * (0.25 * PI).sqrt()).abs() < 1e-9);
        lines[22] = "60".into();
        assert!(eulumdat(&lines.join("\n")).unwrap().note.is_some());
        assert!(eulumdat(&lines[..100].join("\n")).is_err());
    }
}
