//! Conversion of a soup to a checked scene, for all formats.
//!
//! Order: materials, origin and f32, merging of vertices, dropping of faces (transparent, duplicate, without area),
//! triangulation, parts and sides, emission, compaction. There are no absolute tolerances, so that scenes of 50 km
//! and of millimetres both work.

use super::{
    Emitter, LoadOptions, MAX_COORDINATE, MAX_REFLECTANCE, MIN_EXTENT, Material, Object, Repairs, Scene,
    Soup, SoupMaterial,
    added::{self, Curved},
    compact::{compact, used_objects, used_parts},
    connect::{self, Edges, Parts},
    divide::divide,
    emitters::{self, Faces},
    faces::{Triangles, triangulate},
    keep::KeptPolygons,
    luminaires, moves, names,
    overlap::{self, FaceProperties},
    part_shapes::shapes_of_parts,
    plane_order::{may_hide, plane_order},
    power::{self, Surfaces},
    size::{areas, ends},
    stack::{Stacks, stack},
};
use crate::{
    Error, Result,
    error::quote,
    math::{Aabb, MAX_RADIANCE, Sets, triangle_normal, weld::weld},
};
use glam::{DVec3, Vec3};

/// Checks, repairs and converts a soup.
///
/// # Errors
/// See [`Scene::load`].
pub fn resolve(mut soup: Soup, options: &LoadOptions) -> Result<Scene> {
    added::add(&mut soup, &options.added, &[])?;
    moves::move_objects(&mut soup, &options.moves, options.up)?;
    resolve_moved(soup, options)
}

/// [`resolve`] for a soup whose objects are where the options want them.
///
/// # Errors
/// As [`resolve`].
pub(super) fn resolve_moved(mut soup: Soup, options: &LoadOptions) -> Result<Scene> {
    luminaires::add_placed(&mut soup, options);
    luminaires::question_unit(&mut soup, options);
    let metres = power::unit_in_metres(&options.unit).unwrap_or(1.0);
    let lower = |factor| Curved::lower(&mut soup, factor, options.up, metres);
    let curved = options.curvature.map(lower).transpose()?;
    let ground = soup.ground.take();
    let role = if ground.is_some() { Role::Ground } else { Role::Whole };
    let mut scene = resolve_as(soup, options, role)?;
    scene.curved = curved;
    scene.refine_ground(ground);
    scene.light_by_suns()?;
    Ok(scene)
}

/// [`resolve`] for a shared mesh. Repairs are counted, but only overlaps give a message: the scene that places it writes the others.
///
/// # Errors
/// As [`resolve`].
pub(super) fn resolve_mesh(soup: Soup, options: &LoadOptions) -> Result<Scene> {
    // Named emitters are the scene's own faces.
    resolve_as(soup, &LoadOptions { emitters: Vec::new(), ..options.clone() }, Role::Mesh)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Whole,
    /// A scene with fine ground, whose polygons are known by number.
    Ground,
    /// A shared mesh.
    Mesh,
}

fn resolve_as(mut soup: Soup, options: &LoadOptions, role: Role) -> Result<Scene> {
    let mut repairs = std::mem::take(&mut soup.repairs);
    let mut materials = check_sides(options).and_then(|()| check_materials(&soup, role, &mut repairs))?;
    let origin = origin(&soup)?;
    let (number, mut positions) = weld(&seen_from(origin, &std::mem::take(&mut soup.positions)));
    let kept = KeptPolygons::of(&soup, &number, &positions, &mut repairs);
    let (mut faces, edges, parts) = faces_and_parts(&soup, &kept, &mut positions, role, &mut repairs)?;
    let area = areas(&faces.triangles, &positions);
    power::apply(
        Surfaces {
            objects: &soup.objects,
            materials: &mut materials,
            triangle_object: &faces.object,
            triangle_material: &mut faces.material,
            triangle_area: &area,
        },
        options,
    )?;
    let (emitters, triangle_emitter) = group_emitters(&soup, &edges, &faces, &positions, &materials);
    summarise(role, &soup, &faces, &mut repairs);
    let mut triangles = faces.triangles;
    compact(&number, &mut positions, &mut triangles, &mut repairs);
    let (objects, triangle_object) = used_objects(soup.objects, faces.object);
    let (component, closed) = used_parts(&parts, &faces.polygon);
    let part = |t: usize| parts.part[faces.polygon[t] as usize];
    let lamps = places_before(&emitters, &positions, &triangles);
    let shapes = shapes_of_parts(&parts, &faces.polygon, &positions, &triangles, &lamps);
    let sides = |t: usize| options.sides.unwrap_or(if parts.closed[part(t) as usize] { 1 } else { 2 });
    let looks = |t: usize| (faces.reflectance[t], materials[faces.material[t] as usize].emission);
    let properties = FaceProperties {
        object: &triangle_object,
        emitter: &triangle_emitter,
        two_sided: &|t| sides(t) == 2,
        part: &part,
        shapes: &shapes,
        appear_alike: &|s, t| looks(s) == looks(t),
    };
    let stacks =
        stack_overlapping(&properties, &mut positions, &mut triangles, &objects, &options.unit, &mut repairs);
    let wound = (0..triangles.len()).filter(|&t| stacks.wound.contains(&part(t)));
    let wound_parts = wound.map(|t| component[t]).collect();
    Ok(Scene {
        path: soup.path,
        cameras: soup.cameras,
        files: Vec::new(),
        unread_files: Vec::new(),
        unit: options.unit.clone(),
        two_sided_emission: options.two_sided_emission,
        up: options.up,
        origin,
        bounds: Aabb::of(positions.iter().copied()),
        positions,
        triangles,
        triangle_object,
        triangle_material: faces.material,
        triangle_polygon: faces.polygon.iter().map(|&p| kept.polygon[p as usize]).collect(),
        triangle_reflectance: faces.reflectance,
        triangle_sides: (0..area.len()).map(sides).collect(),
        triangle_component: component,
        closed_parts: closed.iter().filter(|&&c| c).count(),
        sheet_parts: closed.iter().filter(|&&c| !c).count(),
        objects,
        materials,
        emitters,
        environment: None,
        stack_moves: stacks.moves,
        wound_parts,
        contacts: stacks.contacts,
        curved: None,
        fine_ground: None,
        suns: soup.suns,
        triangle_emitter,
        triangle_texcoords: faces.texcoords,
        repairs,
        shared: Vec::new(),
        placements: Vec::new(),
        instances: Vec::new(),
    })
}

/// Moves overlapping faces off each other and reports those that cover others, by the names of objects and the unit of length. See
/// [`stack`].
fn stack_overlapping(
    properties: &FaceProperties,
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
    objects: &[Object],
    unit: &str,
    repairs: &mut Repairs,
) -> Stacks {
    let faces = overlap::Faces { positions, triangles, properties };
    let found = overlap::find(&faces);
    let order = plane_order(&found, &faces);
    let covers = |&(s, t, _): &overlap::Overlap| may_hide(&order, s, t, overlap::faces_alike(&faces, [s, t]));
    overlap::report(&faces, found.iter().copied().filter(covers), objects, unit, repairs);
    stack(&found, properties, &order, positions, triangles)
}

/// Places in front of up to four faces of each emitter, a thousandth of an edge above them.
fn places_before(emitters: &[Emitter], positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let before = |t: &u32| {
        let [a, b, c] = triangles[*t as usize].map(|v| positions[v as usize]);
        (a + b + c) / 3.0 + 1e-3 * (b - a).length() * triangle_normal(a, b, c)
    };
    let spread = |emitter: &Emitter| emitter.triangles.len().div_ceil(4);
    emitters
        .iter()
        .flat_map(|emitter| emitter.triangles.iter().step_by(spread(emitter)).map(before))
        .collect()
}

/// The triangles of the kept polygons, divided where they are too coarse, the edges of the polygons and the parts that these connect.
fn faces_and_parts(
    soup: &Soup,
    kept: &KeptPolygons,
    positions: &mut Vec<Vec3>,
    role: Role,
    repairs: &mut Repairs,
) -> Result<(Triangles, Edges, Parts)> {
    let (mut faces, broken) = triangulate(soup, kept, positions, repairs);
    // A broken polygon leaves a hole, so its edges do not count. A polygon without area leaves none, so they count.
    let edges =
        Edges::of((0..kept.polygon.len()).map(|i| if broken[i] { &[] } else { &kept.corners[kept.span(i)] }));
    let parts = connect::parts(&edges, &kept.object, |edge, pair| are_folded(kept, positions, edge, pair));
    if faces.triangles.is_empty() {
        return Err(empty(soup, repairs));
    }
    if role == Role::Whole {
        divide(&mut faces, &parts, positions, soup, repairs);
    }
    Ok((faces, edges, parts))
}

/// Largest distance between the unit vectors from an edge into two polygons that lie on each other: .006 degrees, which nobody models.
const MAX_FOLD: f32 = 1e-4;

/// Whether two polygons lie on the same side of a common edge, in one plane.
fn are_folded(kept: &KeptPolygons, positions: &[Vec3], edge: [u32; 2], pair: [u32; 2]) -> bool {
    let [start, end] = edge.map(|v| positions[v as usize]);
    let along = (end - start).normalize_or_zero();
    let into = |polygon: u32| {
        let corners = kept.corners[kept.span(polygon as usize)].iter();
        let beyond = corners.map(|&v| (positions[v as usize] - start).reject_from_normalized(along));
        beyond.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
    };
    let [a, b] = pair.map(|polygon| into(polygon).unwrap_or_default().normalize_or_zero());
    a != Vec3::ZERO && a.distance(b) < MAX_FOLD
}

fn check_sides(options: &LoadOptions) -> Result<()> {
    match options.sides {
        None | Some(1 | 2) => Ok(()),
        Some(_) => Err(Error::argument("sides", "", "must be 1 (closed solids) or 2 (sheets)")),
    }
}

fn check_materials(soup: &Soup, role: Role, repairs: &mut Repairs) -> Result<Vec<Material>> {
    let mut clamped = Vec::new();
    let materials = soup.materials.iter().map(|m| {
        let finite = m.reflectance.iter().all(|v| v.is_finite());
        if !finite || m.emission.iter().any(|&e| !(0.0..=MAX_RADIANCE).contains(&f64::from(e))) {
            let what = format!("a reflectance or emission that is not a number from 0 to {MAX_RADIANCE:e}; mend its Kd and Ke");
            return Err(Error::format(&soup.path, None, format!("material `{}` has {what}", quote(&m.name))));
        }
        let reflectance = m.reflectance.map(|v| v.clamp(0.0, MAX_REFLECTANCE));
        if reflectance != m.reflectance {
            clamped.push(&m.name);
        }
        Ok(Material { name: m.name.clone(), reflectance, emission: m.emission, profile: m.profile.clone() })
    });
    let materials = materials.collect::<Result<Vec<_>>>()?;
    // The scene that places a mesh has the same materials and counts their repairs.
    if role != Role::Mesh && !clamped.is_empty() {
        repairs.clamped_reflectances += clamped.len();
        let names = names::some_names(clamped.iter().copied());
        repairs.messages.push(format!("reflectance clamped to 0..{MAX_REFLECTANCE} in {names}"));
    }
    Ok(materials)
}

/// The positions relative to the origin.
fn seen_from(origin: DVec3, positions: &[DVec3]) -> Vec<Vec3> {
    positions.iter().map(|p| (p - origin).as_vec3()).collect()
}

/// Smallest ratio of the scene's size to the median size of its polygons for which the origin is a median vertex. Above this ratio rays
/// would start 1 % of a median polygon above a face of the size of the scene.
const MIN_SCENE_RATIO: f64 = 5e3;

/// Offset of the positions: zero unless the scene is far from zero relative to its size; otherwise its centre. In a scene that is much
/// larger than most of its polygons, as a lamp on a plain, a median vertex, so that these have small coordinates. Rounded so that the
/// subtraction is exact.
fn origin(soup: &Soup) -> Result<DVec3> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (i, p) in soup.positions.iter().enumerate() {
        if !p.is_finite() || p.abs().max_element() > MAX_COORDINATE {
            let of = soup.object_with(i).map_or_else(String::new, |name| format!(" of `{}`", quote(name)));
            let vertex = i + 1;
            let what = format!(
                "vertex {vertex}{of} has a coordinate that is not finite or beyond {MAX_COORDINATE:e}"
            );
            return Err(Error::format(&soup.path, None, what));
        }
        (min, max) = (min.min(*p), max.max(*p));
    }
    if soup.ends.is_empty() || soup.positions.is_empty() {
        return Err(empty(soup, &Repairs::default()));
    }
    let extent = (max - min).max_element();
    if extent == 0.0 {
        return Err(empty(soup, &Repairs { zero_area_faces: soup.ends.len(), ..Repairs::default() }));
    }
    if extent < MIN_EXTENT {
        let what = format!("all vertices lie within {extent:e} units; scale the scene up");
        return Err(Error::format(&soup.path, None, what));
    }
    let (centre, step) = (0.5 * (min + max), extent.log2().floor().exp2());
    if extent > MIN_SCENE_RATIO * median_size(soup) {
        let step = step / 4096.0;
        return Ok((median_vertex(soup) / step).round() * step);
    }
    if centre.abs().max_element() <= extent {
        return Ok(DVec3::ZERO);
    }
    Ok((centre / step).round() * step)
}

/// Median of the largest extents of polygons, scene units.
fn median_size(soup: &Soup) -> f64 {
    let starts = std::iter::once(&0).chain(&soup.ends);
    let size = |(&from, &to): (&u32, &u32)| {
        let (low, high) =
            ends(soup.corners[from as usize..to as usize].iter().map(|&v| soup.positions[v as usize]));
        (high - low).max_element()
    };
    median(starts.zip(&soup.ends).map(size).collect())
}

/// The medians of the coordinates of all corners.
fn median_vertex(soup: &Soup) -> DVec3 {
    let along =
        |axis: usize| median(soup.corners.iter().map(|&v| soup.positions[v as usize][axis]).collect());
    DVec3::new(along(0), along(1), along(2))
}

/// The lower median; 0 without values.
fn median(mut values: Vec<f64>) -> f64 {
    let Some(middle) = values.len().checked_sub(1).map(|last| last / 2) else { return 0.0 };
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn empty(soup: &Soup, repairs: &Repairs) -> Error {
    let dropped = repairs.zero_area_faces + repairs.broken_polygons + repairs.transparent_faces;
    if dropped > 0 && dropped == repairs.transparent_faces {
        let what =
            "faces are transparent (d below 0.5) and are left out: nothing remains that light could fall on";
        return Error::format(&soup.path, None, format!("all {dropped} {what}; raise d in their materials"));
    }
    let what = if dropped == 0 { String::new() } else { format!(" ({dropped} unusable ones were dropped)") };
    Error::format(&soup.path, None, format!("no face with an area{what}; is it a scene of polygons?"))
}

fn group_emitters(
    soup: &Soup,
    edges: &Edges,
    faces: &Triangles,
    positions: &[Vec3],
    materials: &[Material],
) -> (Vec<Emitter>, Vec<u32>) {
    let emission = |t: u32| materials[faces.material[t as usize] as usize].emission;
    // Named emitters change materials of triangles; all triangles of a polygon have the same material.
    let polygons = faces.polygon.last().map_or(0, |&p| p as usize + 1);
    let mut material = vec![u32::MAX; polygons];
    for (t, &p) in faces.polygon.iter().enumerate() {
        if emission(t as u32) != [0.0; 3] {
            material[p as usize] = faces.material[t];
        }
    }
    let mut sets = Sets::new(polygons);
    if material.iter().any(|&m| m != u32::MAX) {
        let mut bright = Vec::new();
        for (_, faces) in edges.faces() {
            bright.clear();
            bright.extend(
                faces
                    .filter_map(|f| material.get(f as usize).map(|&m| (m, f)))
                    .filter(|&(m, _)| m != u32::MAX),
            );
            bright.sort_unstable();
            bright.windows(2).filter(|w| w[0].0 == w[1].0).for_each(|w| sets.join(w[0].1, w[1].1));
        }
    }
    let geometry = Faces { positions, triangles: &faces.triangles, polygon: &faces.polygon };
    emitters::group(&geometry, &mut sets, emission, |t| {
        soup.objects[faces.object[t as usize] as usize].clone()
    })
}

/// Writes one message for each kind of repair without one. Those of a shared mesh are written with those of its scene.
fn summarise(role: Role, soup: &Soup, faces: &Triangles, r: &mut Repairs) {
    if role == Role::Mesh {
        return;
    }
    let mut say = |count: usize, noun: &str, what: &str| {
        if count > 0 {
            r.messages.push(format!("{} {what}", names::counted(count, noun)));
        }
    };
    say(r.zero_area_faces, "face", "without area dropped");
    say(r.duplicate_faces, "face", "left out: another face has the same corners");
    say(r.broken_polygons, "polygon", "dropped: some of the edges cross each other");
    say(r.transparent_faces, "face", "of transparent materials (d < 0.5) dropped: they do not block light");
    if r.faces_without_material > 0 {
        let missing = soup.materials.iter().filter(|m| m.missing).map(|m| &m.name);
        let names = names::some_names(missing);
        let kd = SoupMaterial::DEFAULT_REFLECTANCE[0];
        r.messages.push(format!(
            "{} without a material got reflectance {kd} ({names})",
            names::counted(r.faces_without_material, "face")
        ));
    }
    let mut used = vec![false; soup.materials.len()];
    for &m in &faces.material {
        // Copies of materials of named emitters are beyond the end of the list.
        used.get_mut(m as usize).into_iter().for_each(|u| *u = true);
    }
    let sheer =
        soup.materials.iter().zip(used).filter(|(m, used)| *used && m.opacity < 1.0).map(|(m, _)| &m.name);
    report_transparent(sheer, r);
}

/// Writes a message that partly transparent materials count as opaque, if there are any.
pub(super) fn report_transparent<'a>(names: impl Iterator<Item = &'a String>, r: &mut Repairs) {
    let names = names::some_names(names);
    if !names.is_empty() {
        r.messages.push(format!("transparency is not modelled: materials that are partly transparent (d from 0.5 to 1) are treated as opaque: {names}"));
    }
}
