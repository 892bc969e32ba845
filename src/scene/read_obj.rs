//! OBJ files, with line numbers in errors, names of missing materials, comments after statements, continued lines, and names in any
//! encoding.
//!
//! Objects do not become placements of shared meshes, because the format cannot state that two objects are equal;
//! equal objects are not searched.

use super::{
    MAX_COORDINATE, Soup,
    mtl::Library,
    soup::Names,
    sources::{Sources, beside},
};
use crate::error::{figure, quote};
use crate::{Error, Result};
use glam::DVec3;
use std::{
    io::{self, BufRead},
    path::{Path, PathBuf},
};

/// Longest line, bytes: a face of 20 million corners.
const MAX_LINE: usize = 1 << 28;

/// Reads an OBJ file, of which `path` is the name and `file` the content, and its material libraries.
pub(super) fn read(path: &Path, file: impl BufRead, sources: &mut Sources) -> Result<Soup> {
    let mut lines = Lines::new(path, file);
    while lines.advance()? {}
    lines.check_forward_references()?;
    let mut soup = Soup::new(path);
    lines.give_corners(&mut soup);
    lines.give_names(&mut soup, sources)?;
    Ok(soup)
}

/// A run of faces with one object and one material.
struct Run {
    first: usize,
    object: u32,
    material: u32,
}

/// A corner of a face: its vertex and its texture coordinates, if it has any, counted from 0.
struct Corner {
    vertex: u32,
    texcoord: Option<u32>,
}

/// Items of a file in the order of their first use.
struct UsedItems<'a, T> {
    all: &'a [T],
    /// By item, its number among the used ones; `u32::MAX` for others.
    number: Vec<u32>,
    list: Vec<T>,
}

impl<T: Copy> UsedItems<'_, T> {
    fn none(all: &[T]) -> UsedItems<'_, T> {
        UsedItems { all, number: vec![u32::MAX; all.len()], list: Vec::new() }
    }

    /// The number of an item among the used ones.
    fn number_of(&mut self, item: u32) -> u32 {
        let number = &mut self.number[item as usize];
        if *number == u32::MAX {
            *number = self.list.len() as u32;
            self.list.push(self.all[item as usize]);
        }
        *number
    }
}

/// The statements of a file.
struct Lines<'a, R> {
    path: &'a Path,
    file: R,
    /// Current line of the file, from 1.
    number: usize,
    raw: Vec<u8>,
    /// Whether the last line ended with a carriage return, which a line feed may follow.
    returned: bool,
    positions: Vec<DVec3>,
    texcoords: Vec<[f32; 2]>,
    /// Corners of all faces, and where those of each face end.
    corners: Vec<Corner>,
    ends: Vec<u32>,
    /// Largest vertex number used before its definition, and its line.
    forward: (usize, usize),
    objects: Names,
    materials: Names,
    object: Option<u32>,
    material: Option<u32>,
    runs: Vec<Run>,
    libraries: Vec<PathBuf>,
    /// Files of other interpretations of names with spaces, which do not exist.
    missed_libraries: Vec<PathBuf>,
    repairs: super::Repairs,
}

impl<'a, R: BufRead> Lines<'a, R> {
    fn new(path: &'a Path, file: R) -> Self {
        Lines {
            path,
            file,
            number: 0,
            raw: Vec::new(),
            returned: false,
            positions: Vec::new(),
            texcoords: Vec::new(),
            corners: Vec::new(),
            ends: Vec::new(),
            forward: (0, 0),
            objects: Names::default(),
            materials: Names::default(),
            object: None,
            material: None,
            runs: Vec::new(),
            libraries: Vec::new(),
            missed_libraries: Vec::new(),
            repairs: super::Repairs::default(),
        }
    }

    fn wrong(&self, what: impl Into<String>) -> Error {
        Error::format(self.path, Some(self.number), what)
    }

    /// Reads a statement; whether there was one.
    fn advance(&mut self) -> Result<bool> {
        self.raw.clear();
        if !self.read_line()? {
            return Ok(false);
        }
        self.number += 1;
        let mut extra = 0;
        while self.raw.trim_ascii_end().ends_with(b"\\") {
            self.raw.truncate(self.raw.trim_ascii_end().len() - 1);
            self.raw.push(b' ');
            if !self.read_line()? {
                break;
            }
            extra += 1;
        }
        // Moved out temporarily, because `self` is changed while the statement is read.
        let raw = std::mem::take(&mut self.raw);
        let done = self.statement(&String::from_utf8_lossy(&raw));
        self.raw = raw;
        self.number += extra;
        done.map(|()| true)
    }

    /// Appends a line of the file to `raw`, without its end, which is LF, CR LF or CR; whether there was one.
    fn read_line(&mut self) -> Result<bool> {
        let mut any = false;
        loop {
            let buffer = match self.file.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                buffer => buffer.map_err(|e| Error::io(self.path, e))?,
            };
            // The second byte of a line end of two.
            let skip = usize::from(std::mem::take(&mut self.returned) && buffer.first() == Some(&b'\n'));
            let buffer = &buffer[skip..];
            if buffer.is_empty() {
                self.file.consume(skip);
                if skip > 0 {
                    continue;
                }
                return Ok(any);
            }
            any = true;
            let end = buffer.iter().position(|b| matches!(b, b'\n' | b'\r'));
            self.returned = end.is_some_and(|end| buffer[end] == b'\r');
            self.raw.extend_from_slice(&buffer[..end.unwrap_or(buffer.len())]);
            let used = skip + end.map_or(buffer.len(), |end| end + 1);
            self.file.consume(used);
            if self.raw.len() >= MAX_LINE {
                let what = format!("a line of more than {MAX_LINE} bytes: is it an OBJ file?");
                return Err(Error::format(self.path, Some(self.number + 1), what));
            }
            if end.is_some() {
                return Ok(true);
            }
        }
    }

    fn statement(&mut self, line: &str) -> Result<()> {
        let line = line.trim_start_matches('\u{feff}').trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match key {
            "v" => self.vertex(rest),
            "vt" => {
                self.texcoord(rest);
                Ok(())
            }
            "f" | "fo" => self.face(rest),
            "o" | "g" => {
                self.object = Some(self.objects.of(if rest.is_empty() { "default" } else { rest }));
                Ok(())
            }
            "usemtl" => {
                self.material = Some(self.materials.of(rest));
                Ok(())
            }
            "mtllib" => {
                let (found, missed) = libraries(self.path, rest);
                self.libraries.extend(found);
                self.missed_libraries.extend(missed);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn vertex(&mut self, rest: &str) -> Result<()> {
        let mut words = uncommented(rest);
        let mut keep: Vec<&str> = words.by_ref().take(3).collect();
        if keep.len() < 3 {
            return Err(self.wrong(format!("`v {}`: a vertex has three coordinates", quote(rest))));
        }
        // A fourth number is the weight w; three or four more are a colour, which is ignored.
        let more: Vec<&str> = words.take(2).collect();
        if let [w] = more[..] {
            keep.push(w);
        }
        let mut xyzw = [1.0f64; 4];
        for (value, word) in xyzw.iter_mut().zip(&keep) {
            *value = word.parse().map_err(|_| self.wrong(format!("`{}` is not a number", quote(word))))?;
        }
        for c in &xyzw[..3] {
            let c = c / xyzw[3];
            if !c.is_finite() || c.abs() > MAX_COORDINATE {
                let what =
                    format!("the coordinate {} is not finite or beyond ±{MAX_COORDINATE:e}", figure(c));
                return Err(self.wrong(format!("{what}; mend the vertex `v {}`", quote(rest))));
            }
        }
        let [x, y, z, w] = xyzw;
        self.positions.push(DVec3::new(x / w, y / w, z / w));
        Ok(())
    }

    /// An invalid coordinate becomes 0; it only selects a texel.
    fn texcoord(&mut self, rest: &str) {
        let mut words = uncommented(rest);
        let mut next = || {
            let value = words.next().and_then(|w| w.parse::<f32>().ok());
            value.filter(|v| v.is_finite()).unwrap_or(0.0)
        };
        self.texcoords.push([next(), next()]);
    }

    fn face(&mut self, rest: &str) -> Result<()> {
        let first = self.corners.len();
        for word in uncommented(rest) {
            let mut parts = word.split('/');
            let vertex = self.vertex_number(parts.next().unwrap_or_default(), word)?;
            let texcoord = parts.next().and_then(|t| self.texcoord_number(t));
            self.corners.push(Corner { vertex, texcoord });
        }
        if self.corners.len() < first + 3 {
            self.repairs.zero_area_faces += 1;
            self.corners.truncate(first);
        } else {
            self.run();
            self.ends.push(self.corners.len() as u32);
        }
        Ok(())
    }

    /// The vertex that a number means, which may follow later, counted from 0.
    fn vertex_number(&mut self, text: &str, word: &str) -> Result<u32> {
        let number: i64 = text.parse().map_err(|_| {
            self.wrong(format!("`{}` is not a corner of a face (write v, v/vt or v/vt/vn)", quote(word)))
        })?;
        let absolute = if number < 0 { self.positions.len() as i64 + 1 + number } else { number };
        if absolute < 1 || absolute > i64::from(u32::MAX) {
            return Err(
                self.wrong(format!("there is no vertex {number} (numbers start at 1; -1 is the last one)"))
            );
        }
        if absolute as usize > self.forward.0.max(self.positions.len()) {
            self.forward = (absolute as usize, self.number);
        }
        Ok((absolute - 1) as u32)
    }

    /// The texture coordinates before that a number means, counted from 0.
    fn texcoord_number(&self, text: &str) -> Option<u32> {
        let (number, count) = (text.parse::<i64>().ok()?, self.texcoords.len() as i64);
        let absolute = if number < 0 { (count + 1).checked_add(number)? } else { number };
        (1..=count).contains(&absolute).then_some((absolute - 1) as u32)
    }

    /// Starts a new run of faces if the object or the material changes.
    fn run(&mut self) {
        let stem = || self.path.file_stem().unwrap_or_default().to_string_lossy();
        let object = *self.object.get_or_insert_with(|| self.objects.of(&stem()));
        let material = *self.material.get_or_insert_with(|| self.materials.of(""));
        if self.runs.last().is_none_or(|r| r.object != object || r.material != material) {
            self.runs.push(Run { first: self.ends.len(), object, material });
        }
    }

    fn check_forward_references(&self) -> Result<()> {
        let (number, line) = self.forward;
        if number <= self.positions.len() {
            return Ok(());
        }
        let what = format!("there is no vertex {number}, the file has {}", self.positions.len());
        Err(Error::format(self.path, Some(line), what))
    }

    /// Gives the faces with the vertices and the texture coordinates that they use. A corner without texture coordinates has those of the
    /// one before it, the first corner the first of the file.
    fn give_corners(&mut self, soup: &mut Soup) {
        let mut vertices = UsedItems::none(&self.positions);
        soup.corners = self.corners.iter().map(|corner| vertices.number_of(corner.vertex)).collect();
        soup.positions = vertices.list;
        self.repairs.unused_vertices = self.positions.len() - soup.positions.len();
        if !self.texcoords.is_empty() {
            let (mut texcoords, mut last) = (UsedItems::none(&self.texcoords), None);
            let number = |corner: &Corner| match corner.texcoord {
                None => *last.get_or_insert_with(|| texcoords.number_of(0)),
                Some(own) => *last.insert(texcoords.number_of(own)),
            };
            soup.corner_texcoords = self.corners.iter().map(number).collect();
            soup.texcoords = texcoords.list;
        }
        soup.ends = std::mem::take(&mut self.ends);
    }

    /// Reads the libraries and assigns objects and materials to the faces.
    fn give_names(mut self, soup: &mut Soup, sources: &mut Sources) -> Result<()> {
        let mut library = Library::default();
        self.libraries.dedup();
        self.missed_libraries.into_iter().for_each(|path| sources.missed(path));
        for path in &self.libraries {
            library.read(path, sources, &mut self.repairs)?;
        }
        soup.materials = self.materials.list.iter().map(|name| library.get(name)).collect();
        soup.materials.iter_mut().filter(|m| m.name.is_empty()).for_each(|m| m.name = "(none)".into());
        soup.objects = self.objects.list;
        let ends = self.runs.iter().skip(1).map(|r| r.first).chain([soup.ends.len()]);
        for (run, end) in self.runs.iter().zip(ends) {
            soup.polygon_object.resize(end, run.object);
            soup.polygon_material.resize(end, run.material);
        }
        soup.repairs = self.repairs;
        Ok(())
    }
}

/// The words before a comment.
fn uncommented(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace().take_while(|w| !w.starts_with('#'))
}

/// The files of a `mtllib` statement: one name, which may contain spaces, or several names, of which one exists or all end in `.mtl`.
/// Then the files of the other reading that do not exist.
fn libraries(obj: &Path, rest: &str) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let whole = beside(obj, rest);
    let mut several: Vec<PathBuf> = rest.split_whitespace().map(|name| beside(obj, name)).collect();
    let is_library = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mtl"));
    let are_several = || several.iter().any(|path| path.exists()) || several.iter().all(is_library);
    if several.len() > 1 && !whole.exists() && are_several() {
        return (several, vec![whole]);
    }
    // Names of different lengths differ at once; paths are compared part by part.
    several.retain(|path| path.as_os_str() != whole.as_os_str() && !path.exists());
    (vec![whole], several)
}
