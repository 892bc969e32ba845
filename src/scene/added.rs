//! Scenes of several files, and the curvature of the earth.

use super::soup::{Soup, SoupMaterial};
use super::{UpAxis, names::UniqueNames, read_grid, read_obj, read_ply, seams, size::ends, sources::Sources};
use crate::terrain::{EARTH_RADIUS, ReadOptions};
use crate::{Error, Result, error::shown, math::Aabb};
use glam::{DAffine3, DVec3, Vec3};
use std::io::BufReader;
use std::path::PathBuf;
use std::sync::Arc;

/// Files whose polygons are added to those of a scene.
#[derive(Clone, Debug, Default)]
pub struct AddedFiles {
    soups: Vec<Arc<Soup>>,
    /// All files that were read.
    pub(super) files: Vec<PathBuf>,
    /// Whether one of them is a height field: the scene has the upward axis z then, to which glTF files are turned.
    pub(super) has_grid: bool,
}

/// Reads files to add: OBJ, PLY and height fields, in the coordinates of the scene.
///
/// # Errors
/// A file is of another kind, or as [`Scene::load`](super::Scene::load).
pub fn read_added(paths: &[PathBuf], grid: &ReadOptions, max_memory: Option<u64>) -> Result<AddedFiles> {
    let mut added = AddedFiles::default();
    for path in paths {
        let mut sources = Sources::new(max_memory);
        let kind = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let is_grid = read_grid::EXTENSIONS.contains(&kind.as_str());
        let soup = match kind.as_str() {
            "obj" => {
                let file = BufReader::with_capacity(1 << 20, sources.open(path)?);
                read_obj::read(path, file, &mut sources)?
            }
            "ply" => read_ply::read(path, &sources.bytes(path)?[..])?,
            _ if is_grid => read_grid::read(path, grid)?,
            _ => {
                let what = "cannot be added to a scene: .obj, .ply and height fields can (.asc, .tif, .png, .npy, .npz); add these to a glTF file";
                return Err(Error::format(path, None, what));
            }
        };
        let (mut files, _) = sources.lists();
        if is_grid {
            files.push(path.clone());
        }
        added.files.extend(files);
        added.soups.push(Arc::new(soup));
        added.has_grid |= is_grid;
    }
    Ok(added)
}

/// Appends the polygons of the files of the options, and closes gaps between height fields. `placed`: the bounds of meshes that the scene
/// places besides.
///
/// # Errors
/// [`Error::Argument`] for several height fields with the distances of samples of the option `cell`.
pub(super) fn add(soup: &mut Soup, added: &AddedFiles, placed: &[Aabb]) -> Result<()> {
    for of in &added.soups {
        append(soup, of, placed);
    }
    if soup.tiles.len() > 1 && soup.tiles.iter().any(|tile| tile.is_cell_given) {
        let what = "⟨cell⟩ with several height fields: where their corners lie is known in the unit of their files alone; write the distances of \
                    samples and the corners into the files (`gdal_translate -a_ullr`)";
        return Err(Error::arguments(what.into()));
    }
    let fillings = seams::fillings(std::mem::take(&mut soup.tiles));
    if !fillings.is_empty() {
        let what = "triangles close gaps of one cell between height fields whose cells touch";
        soup.repairs.messages.push(format!("{} {what}", fillings.len()));
    }
    for (corners, [object, material]) in fillings {
        soup.polygon(object, material, &corners);
    }
    if !soup.corner_texcoords.is_empty() {
        soup.fill_texcoords();
    }
    Ok(())
}

fn append(soup: &mut Soup, of: &Soup, placed: &[Aabb]) {
    let mut objects = UniqueNames::beside(soup.objects.iter());
    let mut materials = UniqueNames::beside(soup.materials.iter().map(|m| &m.name));
    let counts = [soup.positions.len(), soup.corners.len(), soup.objects.len(), soup.materials.len()];
    let [position, corner, object, material] = counts.map(|n| n as u32);
    let all_texcoords = !soup.corner_texcoords.is_empty() || !of.corner_texcoords.is_empty();
    if all_texcoords {
        let mut own = of.clone();
        for soup in [&mut *soup, &mut own] {
            if soup.texcoords.is_empty() {
                soup.texcoords.push([0.0; 2]);
            }
            soup.fill_texcoords();
        }
        let first = soup.texcoords.len() as u32;
        soup.corner_texcoords.extend(own.corner_texcoords.iter().map(|k| first + k));
        soup.texcoords.extend(own.texcoords);
    }
    if let Some(ground) = &of.ground {
        let polygon = soup.polygons() as u32;
        soup.ground.get_or_insert_default().append(ground, polygon, object);
    }
    soup.positions.extend(&of.positions);
    soup.tiles.extend(of.tiles.iter().map(|tile| tile.within([object, material])));
    take_degrees(soup, of, [position, object]);
    note_distance(soup, of, position as usize, placed);
    soup.corners.extend(of.corners.iter().map(|k| position + k));
    soup.ends.extend(of.ends.iter().map(|k| corner + k));
    soup.polygon_object.extend(of.polygon_object.iter().map(|k| object + k));
    soup.polygon_material.extend(of.polygon_material.iter().map(|k| material + k));
    soup.objects.extend(of.objects.iter().map(|name| objects.of(name)));
    let named = |m: &SoupMaterial| SoupMaterial { name: materials.of(&m.name), ..m.clone() };
    soup.materials.extend(of.materials.iter().map(named));
    soup.cameras.extend(of.cameras.iter().cloned());
    soup.suns.extend(of.suns.iter().cloned());
    soup.fluxes.extend(&of.fluxes);
    soup.repairs.add_counts(&of.repairs);
    let messages = &mut soup.repairs.messages;
    let new: Vec<String> = of.repairs.messages.iter().filter(|m| !messages.contains(m)).cloned().collect();
    messages.extend(new);
}

/// Notes that the surfaces of a file, whose positions begin with number `first`, are farther from all before them, `placed` ones
/// included, than both are wide: their coordinates are likely of two systems.
fn note_distance(soup: &mut Soup, of: &Soup, first: usize, placed: &[Aabb]) {
    let (before, own) = soup.positions.split_at(first);
    if before.is_empty() && placed.is_empty() || own.is_empty() {
        return;
    }
    let [a, b] = [before, own].map(|positions| Aabb::of(positions.iter().map(|p| p.as_vec3())));
    let a = placed.iter().copied().fold(a, Aabb::union);
    let apart = (a.min - b.max).max(b.min - a.max).max(Vec3::ZERO).length();
    if apart > a.diagonal() + b.diagonal() {
        let what =
            "farther than both are wide: check that the coordinates of both are of one system and unit";
        soup.repairs.messages.push(format!(
            "{}: its surfaces are {apart:.0} units away from those before, {what}",
            shown(&of.path)
        ));
    }
}

/// Positions of height fields in degrees follow from the metres of a degree of the first one, so that tiles lie beside each other.
/// `first`: where the positions and objects of the added soup begin.
fn take_degrees(soup: &mut Soup, of: &Soup, first: [u32; 2]) {
    let has_others = soup.tiles.len() > of.tiles.len() && !of.tiles.is_empty();
    if has_others && soup.metres_of_degree.is_some() != of.metres_of_degree.is_some() {
        let what = "has another kind of coordinates than a height field before it, degrees or metres: the two do not lie beside each other as on \
                    the earth; convert one of them (`gdalwarp -t_srs`)";
        soup.repairs.messages.push(format!("{}: {what}", shown(&of.path)));
    }
    if let (Some(to), Some(from)) = (soup.metres_of_degree, of.metres_of_degree) {
        let ratio = [0, 1].map(|k| to[k] / from[k]);
        let by = DAffine3::from_scale(DVec3::new(ratio[0], ratio[1], 1.0));
        soup.positions[first[0] as usize..].iter_mut().for_each(|p| *p = by.transform_point3(*p));
        if let Some(ground) = &mut soup.ground {
            ground.transform(first[1], &by);
        }
        soup.tiles.iter_mut().rev().take(of.tiles.len()).for_each(|tile| tile.transform(&by));
        let percent = 100.0 * (ratio[0] - 1.0).abs();
        if percent > 0.01 {
            let what = "a degree has as many metres as in the first height field";
            let path = shown(&of.path);
            soup.repairs
                .messages
                .push(format!("{path}: {what}: columns are {percent:.2} % nearer or farther"));
        }
    }
    soup.metres_of_degree = soup.metres_of_degree.or(of.metres_of_degree);
}

/// Curvature of the earth below a scene that was measured on a map: at the horizontal distance d from the middle, heights are d²/2R less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Curved {
    up: UpAxis,
    middle: DVec3,
    /// Scene units.
    radius: f64,
}

impl Curved {
    /// Lowers the vertices of a soup by the curvature of `factor` times the radius of the earth; `metres`: length of a scene unit.
    ///
    /// # Errors
    /// The factor is out of range, or it is not known which axis is upward.
    pub fn lower(soup: &mut Soup, factor: f64, up: Option<UpAxis>, metres: f64) -> Result<Curved> {
        // Refraction makes the radius seem up to some times as large, and never smaller than half.
        if !(0.5..=1e3).contains(&factor) {
            return Err(Error::argument("curvature", factor, "must lie in 0.5..1000 radii of the earth"));
        }
        let Some(up) = up else {
            let cure = "set ⟨up⟩, unless the scene is a height field";
            return Err(Error::argument("curvature", factor, "needs the upward axis").with_cure(cure));
        };
        let (low, high) = ends(soup.positions.iter().copied());
        let radius = factor * EARTH_RADIUS / metres;
        let curved = Curved { up, middle: 0.5 * (low + high), radius };
        let place = |p: DVec3| curved.place(p, DVec3::ZERO).0;
        soup.positions.iter_mut().for_each(|p| *p = place(*p));
        if let Some(ground) = &mut soup.ground {
            ground.curve(place, radius);
        }
        Ok(curved)
    }

    /// Position of a point of the map on the curved earth, and its turned normal.
    pub fn place(&self, position: DVec3, normal: DVec3) -> (DVec3, DVec3) {
        let up = self.up.vector().as_dvec3();
        let across = (position - self.middle).reject_from_normalized(up);
        let lowered = position - across.length_squared() / (2.0 * self.radius) * up;
        let turned = normal + normal.dot(up) / self.radius * across;
        (lowered, turned.try_normalize().unwrap_or(normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(half: f64) -> Soup {
        let mut soup = Soup::new("square");
        let (material, object) =
            (soup.material(SoupMaterial::diffuse("grey", [0.5; 3])), soup.object("square"));
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        soup.polygon(object, material, &corners.map(|[x, y]| DVec3::new(half * x, half * y, 7.0)));
        soup
    }

    #[test]
    fn the_earth_curves_away_from_the_middle() {
        let mut soup = square(50.0);
        let curved = Curved::lower(&mut soup, 7.0 / 6.0, Some(UpAxis::Z), 1e3).expect("a curved earth");
        // √2 · 50 km from the middle: 5000 km² / 2R.
        let want = 7.0 - 5000.0 / (2.0 * 6371.0088 * 7.0 / 6.0);
        assert!(
            soup.positions.iter().all(|p| (p.z - want).abs() < 1e-9 && p.x.abs() == 50.0),
            "{:?}",
            soup.positions
        );
        let (place, normal) = curved.place(DVec3::new(30.0, 0.0, 7.0), DVec3::Z);
        assert!((place.z - (7.0 - 450.0 / curved.radius)).abs() < 1e-9, "{place}");
        assert!((normal.x - 30.0 / curved.radius).abs() < 1e-6 && normal.is_normalized(), "{normal}");
        assert_eq!(curved.place(DVec3::new(0.0, 0.0, 7.0), DVec3::Z), (DVec3::new(0.0, 0.0, 7.0), DVec3::Z));
        let unknown = Curved::lower(&mut soup, 1.0, None, 1.0);
        assert!(unknown.is_err_and(|e| e.to_string().contains("set `up`")));
    }

    #[test]
    fn files_of_another_coordinate_system_get_a_note() {
        for (offset, is_noted) in [(50.0, false), (5e6, true)] {
            let mut far = square(2.0);
            far.positions.iter_mut().for_each(|p| p.x += offset);
            let mut soup = square(20.0);
            add(&mut soup, &AddedFiles { soups: vec![Arc::new(far)], ..AddedFiles::default() }, &[])
                .expect("added");
            let notes = &soup.repairs.messages;
            assert_eq!(notes.iter().any(|m| m.contains("one system and unit")), is_noted, "{notes:?}");
        }
    }

    #[test]
    fn files_are_appended_under_names_of_their_own() {
        let mut soup = square(1.0);
        let textured = Soup { texcoords: vec![[0.25; 2]], corner_texcoords: vec![0; 4], ..square(2.0) };
        let soups = vec![Arc::new(textured), Arc::new(square(3.0))];
        add(&mut soup, &AddedFiles { soups, ..AddedFiles::default() }, &[]).expect("no height fields");
        assert_eq!(soup.objects, ["square", "square 2", "square 3"]);
        assert_eq!(soup.polygon_object, [0, 1, 2]);
        assert_eq!(soup.polygon_material, [0, 1, 2]);
        assert_eq!(soup.corners, (0..12).collect::<Vec<u32>>());
        assert_eq!(soup.ends, [4, 8, 12]);
        let first: Vec<f32> = soup.corner_texcoords.iter().map(|&k| soup.texcoords[k as usize][0]).collect();
        assert_eq!(first, [[0.0; 4], [0.25; 4], [0.0; 4]].concat());
    }
}
