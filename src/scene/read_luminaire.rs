//! Photometric files of luminaires: IES LM-63 (type C) and EULUMDAT.
//!
//! Parsed here: the one maintained crate for both formats, `eulumdat`, is under a licence (AGPL) that this crate cannot use.

use super::profile::{Distribution, Symmetry};
use super::sources::text_of;
use crate::error::{figure, quote, shown};
use crate::files::input;
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
/// Sides of openings, metres: a point source is a millimetre wide, the size of a light-emitting diode, and nothing that was
/// measured is longer than a kilometre.
const MIN_OPENING: f64 = 1e-3;
const MAX_OPENING: f64 = 1e3;
/// Largest intensity, candelas: a million times that of the brightest lighthouses (1e9), so that a radiance stays below the
/// largest f32.
const MAX_CANDELAS: f64 = 1e15;

/// A luminaire as measured.
#[derive(Clone, Debug)]
pub struct Luminaire {
    pub distribution: Distribution,
    /// Length along C = 0, width along C = 90° and height of the luminous opening, metres.
    pub opening: [f64; 3],
    /// A sentence, beginning with the file, if the file contradicts itself: its own flux and the integral of its table, or planes along
    /// the axis that they share.
    pub note: Option<String>,
}

/// Reads a file by its extension: `.ies`, or `.ldt` and `.eul`.
pub fn read(path: &Path) -> Result<Luminaire> {
    parse(path, || input::read(path, MAX_BYTES))
}

/// The luminaire of a file called `path` with the content `bytes`, which is read if the extension is right.
pub fn parse(path: &Path, bytes: impl FnOnce() -> Result<Vec<u8>>) -> Result<Luminaire> {
    let kind = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let parse = match kind.as_str() {
        "ies" => ies,
        "ldt" | "eul" => eulumdat,
        _ => return Err(Error::format(path, None, "the extension must be .ies, .ldt or .eul")),
    };
    let read = parse(&text_of(&bytes()?)).map_err(|(line, what)| Error::format(path, Some(line), what))?;
    let notes: Vec<String> = read.distribution.contradiction().into_iter().chain(read.note).collect();
    let note = (!notes.is_empty()).then(|| format!("{}: {}", shown(path), notes.join("; ")));
    Ok(Luminaire { note, ..read })
}

/// The line, counted from 1, and what is wrong there.
type LineError = (usize, String);

/// A whole number in 1 to `max`.
fn whole(value: f64, line: usize, what: &str, max: usize) -> Result<usize, LineError> {
    if value.fract() == 0.0 && (1.0..=max as f64).contains(&value) {
        Ok(value as usize)
    } else {
        Err((line, format!("{what}: {} is not a whole number in 1 to {max}", figure(value))))
    }
}

fn wrong_intensity(candelas: f64) -> String {
    format!("an intensity of {} cd is not in 0 to {MAX_CANDELAS:e}", figure(candelas))
}

/// Checks a list of angles in degrees.
fn check_angles(angles: &[f64], [min, max]: [f64; 2], line: usize, what: &str) -> Result<(), LineError> {
    if angles.windows(2).any(|w| w[0] >= w[1]) || angles.iter().any(|a| !(min..=max).contains(a)) {
        return Err((line, format!("{what} must ascend within {min} to {max} degrees")));
    }
    Ok(())
}

/// Numbers of a text, with their lines.
struct Numbers<'a> {
    words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    /// Line of the last number.
    line: usize,
}

impl Numbers<'_> {
    fn next(&mut self, what: &str) -> Result<f64, LineError> {
        let (line, word) =
            self.words.next().ok_or_else(|| (self.line, format!("the file ends before {what}")))?;
        self.line = line;
        let value: Option<f64> = word.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| (line, format!("`{}` is not a number ({what})", quote(word))))
    }

    fn list(&mut self, count: usize, what: &str) -> Result<Vec<f64>, LineError> {
        (0..count).map(|_| self.next(what)).collect()
    }

    fn count(&mut self, what: &str) -> Result<usize, LineError> {
        let n = self.next(what)?;
        whole(n, self.line, what, MAX_ANGLES)
    }

    fn angles(&mut self, count: usize, range: [f64; 2], what: &str) -> Result<Vec<f64>, LineError> {
        let angles = self.list(count, what)?;
        check_angles(&angles, range, self.line, what)?;
        Ok(angles)
    }

    /// Candelas of one plane.
    fn candelas(&mut self, count: usize, scale: f64) -> Result<Vec<f64>, LineError> {
        let value = |_| match self.next("the candelas")? * scale {
            v if (0.0..=MAX_CANDELAS).contains(&v) => Ok(v),
            v => Err((self.line, wrong_intensity(v))),
        };
        (0..count).map(value).collect()
    }
}

fn ies(text: &str) -> Result<Luminaire, LineError> {
    let mut lines = (1..).zip(text.lines());
    let tilt = lines.find(|(_, l)| l.trim_start().starts_with("TILT="));
    let (line, tilt) = tilt.ok_or((1, "no line TILT=: not an IES LM-63 file".to_owned()))?;
    let tilt = tilt.trim().trim_start_matches("TILT=").trim().to_owned();
    let words = lines.flat_map(|(n, l)| {
        l.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty()).map(move |w| (n, w))
    });
    let mut numbers = Numbers { words: Box::new(words), line };
    match tilt.as_str() {
        "NONE" => {}
        "INCLUDE" => {
            numbers.next("the lamp's geometry")?;
            let pairs = numbers.count("the number of tilt angles")?;
            numbers.list(2 * pairs, "the tilt table")?;
        }
        _ => return Err((line, "the tilt table is in another file; put it into this one".into())),
    }
    let lamps = numbers.next("the number of lamps")?;
    let lumens = numbers.next("the lumens per lamp")?;
    let multiplier = numbers.next("the candela multiplier")?;
    let down = numbers.count("the number of vertical angles")?;
    let around = numbers.count("the number of horizontal angles")?;
    if numbers.next("the photometric type")? != 1.0 {
        return Err((numbers.line, "only type C photometry is read; convert types A and B".into()));
    }
    let metres = if numbers.next("the type of units")? == 1.0 { 0.3048 } else { 1.0 };
    let size = numbers.list(3, "the opening")?;
    let size_line = numbers.line;
    let factors = numbers.list(2, "the ballast factors")?;
    numbers.next("the input power")?;
    let gammas = numbers.angles(down, [0.0, 180.0], "the vertical angles")?;
    let planes = numbers.angles(around, [0.0, 360.0], "the horizontal angles")?;
    if down < 2 {
        return Err((numbers.line, "one vertical angle is no distribution".into()));
    }
    let symmetry = match (planes[0], planes[around - 1]) {
        _ if around == 1 => Symmetry::Axis,
        (0.0, 90.0) => Symmetry::Both,
        (0.0, 180.0) => Symmetry::C0C180,
        (90.0, 270.0) => Symmetry::C90C270,
        // The plane 360 repeats the plane 0 and may be left out.
        (0.0, last) if 360.0 - last <= 1.5 * (last / (around - 1) as f64) => Symmetry::None,
        _ => {
            let ends = "horizontal angles must go from 0 to 0, 90, 180 or 360, or from 90 to 270";
            return Err((numbers.line, ends.into()));
        }
    };
    let scale = multiplier * factors[0] * if factors[1] > 0.0 { factors[1] } else { 1.0 };
    let rows = (0..around).map(|_| numbers.candelas(down, scale)).collect::<Result<Vec<_>, LineError>>()?;
    let distribution = Distribution::new(&planes, &gammas, &rows, symmetry);
    // A negative number of lumens: absolute photometry, without a flux of lamps.
    let lamp = lamps * lumens * factors[0] * multiplier;
    let flux = distribution.flux(0.0, PI);
    let note = (lamp > 0.0 && flux > (1.0 + FLUX_TOLERANCE) * lamp)
        .then(|| format!("its table sums to {flux:.0} lm, more than the {lamp:.0} lm of its lamps"));
    // Length is along C = 0; negative sizes are diameters of round openings.
    let [width, length, height] = [size[0], size[1], size[2]].map(|v| v * metres);
    Ok(Luminaire { distribution, opening: opening([length, width, height], size_line)?, note })
}

/// The lines of a EULUMDAT file, each with one value.
struct Lines<'a>(Vec<&'a str>);

impl Lines<'_> {
    fn number(&self, n: usize, what: &str) -> Result<f64, LineError> {
        let last = self.0.len().max(1);
        let line =
            self.0.get(n - 1).ok_or_else(|| (last, format!("the file ends before line {n}, {what}")))?;
        let value: Option<f64> = line.replace(',', ".").parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| (n, format!("`{}` is not a number ({what})", quote(line))))
    }

    fn list(&self, from: usize, count: usize, what: &str) -> Result<Vec<f64>, LineError> {
        (from..from + count).map(|line| self.number(line, what)).collect()
    }

    fn angles(&self, from: usize, count: usize, max: f64, what: &str) -> Result<Vec<f64>, LineError> {
        let angles = self.list(from, count, what)?;
        check_angles(&angles, [0.0, max], from, what)?;
        Ok(angles)
    }
}

fn eulumdat(text: &str) -> Result<Luminaire, LineError> {
    let lines = Lines(text.lines().map(str::trim).collect());
    let count = |n: usize, what: &str| whole(lines.number(n, what)?, n, what, MAX_ANGLES);
    let (all, down) = (count(4, "the number of C planes")?, count(6, "the number of angles from the axis")?);
    if down < 2 {
        return Err((6, "one angle from the axis is no distribution".into()));
    }
    // The first plane of the table and the number of planes.
    let (symmetry, first, planes) = match lines.number(3, "the symmetry")? {
        0.0 => (Symmetry::None, 0, all),
        1.0 => (Symmetry::Axis, 0, 1),
        2.0 if all % 2 == 0 => (Symmetry::C0C180, 0, all / 2 + 1),
        3.0 if all % 4 == 0 => (Symmetry::C90C270, 3 * all / 4, all / 2 + 1),
        4.0 if all % 4 == 0 => (Symmetry::Both, 0, all / 4 + 1),
        _ => return Err((3, "the symmetry must be 0 to 4 and divide the number of C planes".into())),
    };
    let sets = whole(lines.number(26, "the number of lamp sets")?, 26, "the number of lamp sets", 20)?;
    // Further sets are alternatives to the first one.
    let lamp = lines.number(29, "the flux of the lamps")?;
    let angles = 27 + 6 * sets + 10;
    let c = lines.angles(angles, all, 360.0, "the C angles")?;
    let gammas = lines.angles(angles + all, down, 180.0, "the angles from the axis")?;
    let scale = lamp / 1000.0 * lines.number(24, "the conversion factor")?;
    let mut rows = Vec::with_capacity(planes);
    for plane in 0..planes {
        let from = angles + all + (1 + plane) * down;
        let row = lines.list(from, down, "candelas per 1000 lm")?;
        let row: Vec<f64> = row.into_iter().map(|v| v * scale).collect();
        if let Some(k) = row.iter().position(|v| !(0.0..=MAX_CANDELAS).contains(v)) {
            return Err((from + k, wrong_intensity(row[k])));
        }
        rows.push(row);
    }
    // Symmetry about C = 90° and 270°: the planes from 270° through 0 to 90°. A table of the plane 0 only has 1 plane.
    let listed: Vec<f64> = (first..first + planes).map(|k| c[k % all]).collect();
    let distribution = Distribution::new(&listed, &gammas, &rows, symmetry);
    let stated = lamp * lines.number(23, "the light output ratio")? / 100.0;
    let flux = distribution.flux(0.0, PI);
    let off = (stated > 0.0 && (flux / stated - 1.0).abs() > FLUX_TOLERANCE)
        .then(|| format!("its table sums to {flux:.0} lm, its light output ratio to {stated:.0} lm"));
    let several = (sets > 1).then(|| format!("the first of its {sets} sets of lamps is used"));
    let notes: Vec<String> = several.into_iter().chain(off).collect();
    let note = (!notes.is_empty()).then(|| notes.join("; "));
    let [length, width] = [lines.number(16, "the luminous length")?, lines.number(17, "the luminous width")?];
    // A width of 0: round, with the length as diameter.
    let [length, width] = if width == 0.0 { [-length; 2] } else { [length, width] };
    let height = lines.number(18, "the luminous height")?;
    let opening = opening([length, width, height].map(|millimetres| 1e-3 * millimetres), 16)?;
    Ok(Luminaire { distribution, opening, note })
}

/// Sides of a rectangle with the area of the opening, metres. A negative size is a diameter: round openings become squares; one
/// of the sizes may be 0 then.
fn opening([length, width, height]: [f64; 3], line: usize) -> Result<[f64; 3], LineError> {
    if [length, width, height].iter().any(|v| v.abs() > MAX_OPENING) {
        return Err((line, format!("an opening of more than {MAX_OPENING} m")));
    }
    let [length, width] = match [length, width] {
        [0.0, d] | [d, 0.0] if d < 0.0 => [d, d],
        sizes => sizes,
    };
    let side = |v: f64| if v < 0.0 { -v * (0.25 * PI).sqrt() } else { v };
    let (length, width) = (side(length), side(width));
    // Linear openings state one side only.
    let thin = (0.01 * length.max(width)).max(MIN_OPENING);
    Ok([length.max(thin), width.max(thin), height.abs()])
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
        assert!(ies(&IES.replace("1 1000", "1 100")).unwrap().note.is_some());
        // A round opening of 0.12 m, as LM-63-1995 writes it.
        let round = ies(&IES.replace("0.1 0.2 0", "-0.12 0 0")).unwrap().opening;
        assert!((round[0] * round[1] / (PI * 0.06 * 0.06) - 1.0).abs() < 1e-9 && round[0] == round[1]);
    }

    #[test]
    fn planes_that_disagree_along_the_axis_are_noted() {
        let note = |gammas: &str, rows: &str| {
            let text = format!("TILT=NONE\n1 -1 1 3 2 1 2 0.1 0.1 0\n1 1 20\n{gammas}\n0 90\n{rows}\n");
            parse(Path::new("lamps/spot.ies"), || Ok(text.into_bytes())).unwrap().note
        };
        let nadir = note("0 45 90", "100 80 0 250.5 80 0").expect("a note");
        assert!(
            nadir.starts_with("lamps/spot.ies: its table states 100 to 250.5 cd at the nadir"),
            "{nadir}"
        );
        let both = note("0 90 180", "100 80 5 250 80 40").expect("a note");
        assert!(both.contains("at the nadir") && both.contains("5 to 40 cd at the zenith"), "{both}");
        // Rounding, and angles that all planes state for themselves.
        assert_eq!(note("0 45 90", "100 80 0 101 80 0"), None);
        assert_eq!(note("5 45 90", "100 80 0 250 80 60"), None);
    }

    #[test]
    fn wrong_ies_files_name_the_line() {
        for (part, instead, line, what) in [
            ("80 0", "80 x", 8, "`x` is not a number"),
            ("80 0", "80 -1", 8, "intensity of -2 cd"),
            ("100, 80 0", "100", 8, "ends before the candelas"),
            (" 3 1 1 2", " 1e9 1 1 2", 4, "vertical"),
            (" 3 1 1 2", " 3 1 2 2", 4, "type C"),
            ("0 45 90", "0 95 90", 6, "ascend"),
            ("0 45 90", "0 45 190", 6, "180"),
            (
                "3 1 1 2 0.1 0.2 0\n1 1 20\n0 45 90\n0\n100, 80 0",
                "2 2 1 2 1 1 0\n1 1 20\n0 90\n0 45\n1 1 1 1",
                7,
                "from 0 to 0, 90",
            ),
            ("TILT=NONE", "TILT=a.tlt", 3, "another file"),
            ("TILT=NONE", "", 1, "not an IES"),
        ] {
            let (at, why) = ies(&IES.replace(part, instead)).unwrap_err();
            assert!(at == line && why.contains(what), "{instead}: {at}: {why}");
        }
    }

    /// `rows[c](γ)` candelas per 1000 lm at every degree of γ to 90, 2000 lm, light output ratio 80 %.
    fn ldt(symmetry: u8, planes: &[f64], rows: &[&dyn Fn(f64) -> f64]) -> Vec<String> {
        let mut lines: Vec<String> = vec!["x".into(); 12];
        lines.extend("0 0 0 500 0 0 0 0 0 100 80 1 0 1".split(' ').map(str::to_owned));
        (lines[1], lines[2], lines[5]) = ("1".into(), symmetry.to_string(), "91".into());
        lines[3] = planes.len().to_string();
        lines.extend("1 LED 2000 3000 80 20".split(' ').map(str::to_owned));
        lines.extend(vec!["1".to_owned(); 10]);
        lines.extend(planes.iter().map(f64::to_string));
        lines.extend((0..=90).map(|g| g.to_string()));
        for row in rows {
            let row = (0..=90).map(|g| row(f64::from(g).to_radians()));
            lines.extend(row.map(|v| format!("{v:.4}").replace('.', ",")));
        }
        lines
    }

    #[test]
    fn eulumdat_file_sums_to_its_own_light_output_ratio() {
        // A diffuse plate of 80 % of 2000 lm: I(0) = Φ / π per 1000 lm.
        let mut lines = ldt(1, &[0.0], &[&|g| 800.0 / PI * g.cos()]);
        let l = eulumdat(&lines.join("\r\n")).unwrap();
        assert!((l.distribution.flux(0.0, PI) / 1600.0 - 1.0).abs() < 1e-4);
        assert!(l.note.is_none());
        assert!((l.opening[0] - 0.5 * (0.25 * PI).sqrt()).abs() < 1e-9);
        lines[22] = "60".into();
        assert!(eulumdat(&lines.join("\n")).unwrap().note.is_some());
        let sets = lines.iter().take(25).cloned().chain(["2".into()]);
        let sets: Vec<String> = sets
            .chain(lines[26..32].iter().cycle().take(12).cloned())
            .chain(lines[32..].iter().cloned())
            .collect();
        let two = eulumdat(&sets.join("\n")).unwrap();
        assert!(
            (two.distribution.flux(0.0, PI) / 1600.0 - 1.0).abs() < 1e-4,
            "sets of lamps are alternatives"
        );
        assert!(two.note.expect("a note").contains("first of its 2 sets"));
        let short = eulumdat(&lines[..100].join("\n")).unwrap_err();
        assert!(short.0 == 100 && short.1.contains("ends before line 101"), "{short:?}");
        lines[140] = "?".into();
        assert_eq!(eulumdat(&lines.join("\n")).unwrap_err().0, 141);
    }

    /// The table of a file with symmetry about C = 90° begins with C = 270°.
    #[test]
    fn eulumdat_symmetry_about_c90() {
        let planes = [0.0, 90.0, 180.0, 270.0];
        let lines = ldt(3, &planes, &[&|_| 270.0, &|_| 0.0, &|_| 90.0]);
        let l = eulumdat(&lines.join("\n")).unwrap();
        let at = |c: f64| l.distribution.intensity(0.5, c.to_radians()) / 2.0;
        for (c, want) in [(270.0, 270.0), (0.0, 0.0), (90.0, 90.0), (180.0, 0.0), (45.0, 45.0), (135.0, 45.0)]
        {
            assert!((at(c) - want).abs() < 1e-6, "C {c}: {} instead of {want}", at(c));
        }
    }
}
