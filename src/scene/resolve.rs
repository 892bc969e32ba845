//! Conversion of a soup to a checked scene, for all formats.
//!
//! Order: materials, origin and f32, merging of vertices, dropping of faces (transparent, duplicate, without area),
//! triangulation, parts and sides, emission, compaction. There are no absolute tolerances, so that scenes of 50 km
//! and of millimetres both work.

use super::{
    Emitter, LoadOptions, MAX_COORDINATE, MAX_REFLECTANCE, MIN_EXTENT, Material, Repairs, Scene, Soup,
    SoupMaterial,
    added::{self, Curved},
    compact::{compact, used_objects, used_parts},
    connect::{self, Edges, Parts, Sets},
    emitters::{self, Faces},
    keep::Kept,
    luminaires, moves, names, overlap,
    power::{self, Surfaces},
    size::{areas, twice_area},
    stack::{Order, stack},
    triangulate::{Shape, Triangulator},
};
use crate::{
    Error, Result,
    error::quote,
    math::{Aabb, weld::weld},
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
    let axes = (options.up, power::unit_in_metres(&options.unit).unwrap_or(1.0));
    let curved = options.curvature.map(|factor| Curved::lower(&mut soup, factor, axes)).transpose()?;
    let (ground, mut scene) = (soup.ground.take(), resolve_as(soup, options, Role::Whole)?);
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
    Mesh,
}

fn resolve_as(mut soup: Soup, options: &LoadOptions, role: Role) -> Result<Scene> {
    let mut repairs = std::mem::take(&mut soup.repairs);
    let mut materials = check_sides(options).and_then(|()| check_materials(&soup, role, &mut repairs))?;
    let origin = origin(&soup)?;
    let (number, positions) = weld(&seen_from(origin, &std::mem::take(&mut soup.positions)));
    let kept = Kept::of(&soup, &number, &positions, &mut repairs);
    let (mut faces, broken) = triangulate(&soup, &kept, &positions, &mut repairs);
    // A broken polygon leaves a hole, so its edges do not count. A polygon without area leaves none, so they count.
    let edges =
        Edges::of((0..kept.polygon.len()).map(|i| if broken[i] { &[] } else { &kept.corners[kept.span(i)] }));
    let parts = connect::parts(&edges, &kept.object);
    if faces.triangles.is_empty() {
        return Err(empty(&soup, &repairs));
    }
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
    let (mut positions, mut triangles) = compact(&number, positions, faces.triangles, &mut repairs);
    let (objects, triangle_object) = used_objects(soup.objects, faces.object);
    let (component, closed) = used_parts(&parts, &faces.polygon);
    let part = |t: usize| parts.part[faces.polygon[t] as usize];
    let sides = |t: usize| options.sides.unwrap_or(if parts.closed[part(t) as usize] { 1 } else { 2 });
    let looks = |t: usize| (faces.reflectance[t], materials[faces.material[t] as usize].emission);
    let planes = overlap::Faces {
        positions: &positions,
        triangles: &triangles,
        object: &triangle_object,
        two_sided: &|t| sides(t) == 2,
        part: &part,
        appear_alike: &|s, t| looks(s) == looks(t),
    };
    let found = overlap::find(&planes, &objects, &options.unit, &mut repairs);
    let part_area = &area_of_parts(&parts, &faces.polygon, &area);
    let order = Order { part: &part, part_area, emitter: &triangle_emitter, two_sided: &|t| sides(t) == 2 };
    stack(&found, order, &mut positions, &mut triangles);
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

/// For each triangle, the area of its part, scene units squared.
fn area_of_parts(parts: &Parts, polygon: &[u32], area: &[f64]) -> Vec<f64> {
    let mut areas = vec![0.0; parts.closed.len()];
    let part = |t: usize| parts.part[polygon[t] as usize] as usize;
    (0..area.len()).for_each(|t| areas[part(t)] += area[t]);
    (0..area.len()).map(|t| areas[part(t)]).collect()
}

fn check_sides(options: &LoadOptions) -> Result<()> {
    match options.sides {
        None | Some(1 | 2) => Ok(()),
        Some(_) => Err(Error::Argument("sides must be 1 (closed solids) or 2 (sheets)".into())),
    }
}

fn check_materials(soup: &Soup, role: Role, repairs: &mut Repairs) -> Result<Vec<Material>> {
    let mut clamped = Vec::new();
    let materials = soup.materials.iter().map(|m| {
        let finite = m.emission.iter().chain(&m.reflectance).all(|v| v.is_finite());
        if !finite || m.emission.iter().any(|&e| e < 0.0) {
            let what = "a reflectance or emission that is not a finite number >= 0; mend its Kd and Ke";
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
    if role == Role::Whole && !clamped.is_empty() {
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

/// Offset of the positions: zero unless the scene is far from zero relative to its size; otherwise its centre,
/// rounded so that the subtraction is exact.
fn origin(soup: &Soup) -> Result<DVec3> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (i, p) in soup.positions.iter().enumerate() {
        if !p.is_finite() || p.abs().max_element() > MAX_COORDINATE {
            let what =
                format!("vertex {} has a coordinate that is not finite or beyond {MAX_COORDINATE:e}", i + 1);
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
    let centre = 0.5 * (min + max);
    if centre.abs().max_element() <= extent {
        return Ok(DVec3::ZERO);
    }
    let step = extent.log2().floor().exp2();
    Ok((centre / step).round() * step)
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

/// Triangles; one entry each.
#[derive(Default)]
struct Triangles {
    triangles: Vec<[u32; 3]>,
    /// Index of the polygon among the kept ones.
    polygon: Vec<u32>,
    object: Vec<u32>,
    material: Vec<u32>,
    reflectance: Vec<[f32; 3]>,
    /// Empty if the soup has none.
    texcoords: Vec<[[f32; 2]; 3]>,
}

/// Triangulates all kept polygons; also returns which of them are broken.
fn triangulate(
    soup: &Soup,
    kept: &Kept,
    positions: &[Vec3],
    repairs: &mut Repairs,
) -> (Triangles, Vec<bool>) {
    let (mut out, mut broken) = (Triangles::default(), vec![false; kept.polygon.len()]);
    let mut triangulator = Triangulator::new();
    let mut points = Vec::new();
    for (i, broken) in broken.iter_mut().enumerate() {
        let span = kept.span(i);
        let corners = &kept.corners[span.clone()];
        points.clear();
        points.extend(corners.iter().map(|&v| positions[v as usize].as_dvec3()));
        match triangulator.polygon(&points) {
            Shape::NoArea => repairs.zero_area_faces += 1,
            Shape::Broken => {
                repairs.broken_polygons += 1;
                *broken = true;
            }
            Shape::Convex if corners.len() == 3 => {}
            Shape::Convex => repairs.polygons_triangulated += 1,
            Shape::Concave => {
                repairs.polygons_triangulated += 1;
                repairs.concave_polygons += 1;
            }
        }
        let polygon = kept.polygon[i] as usize;
        let (object, material) = (soup.polygon_object[polygon], soup.polygon_material[polygon]);
        let mut has_area = false;
        for ordinals in &triangulator.triangles {
            let triangle = ordinals.map(|k| corners[k as usize]);
            // Corners in the middle of an edge cause triangles without area; the other triangles fill the polygon.
            if !self::has_area(triangle.map(|v| positions[v as usize])) {
                continue;
            }
            has_area = true;
            out.triangles.push(triangle);
            out.polygon.push(i as u32);
            out.object.push(object);
            out.material.push(material);
            let sources = ordinals.map(|k| kept.source[span.start + k as usize]);
            if !soup.corner_texcoords.is_empty() {
                out.texcoords.push(texcoords(soup, sources));
            }
            out.reflectance.push(reflectance(soup, &soup.materials[material as usize], sources));
            repairs.faces_without_material += usize::from(soup.materials[material as usize].missing);
        }
        repairs.zero_area_faces += usize::from(!has_area && !triangulator.triangles.is_empty());
    }
    (out, broken)
}

/// Texture coordinates of corners of a soup with texture coordinates.
fn texcoords(soup: &Soup, corners: [u32; 3]) -> [[f32; 2]; 3] {
    corners.map(|k| soup.texcoords[soup.corner_texcoords[k as usize] as usize])
}

/// `Kd` times the mean of the texture over the face. A black `Kd` beside a texture counts as white, because exporters
/// write it for a texture alone.
fn reflectance(soup: &Soup, material: &SoupMaterial, corners: [u32; 3]) -> [f32; 3] {
    let kd = material.reflectance.map(|v| v.clamp(0.0, MAX_REFLECTANCE));
    let (Some(texture), false) = (&material.texture, soup.corner_texcoords.is_empty()) else { return kd };
    let uv = texcoords(soup, corners);
    let (mean, black) = (texture.mean(uv), kd == [0.0; 3]);
    std::array::from_fn(|c| if black { mean[c] } else { mean[c] * kd[c] }.clamp(0.0, MAX_REFLECTANCE))
}

/// Whether the height of the triangle exceeds the f32 resolution at its position and relative to its longest edge.
pub(super) fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let place = a.abs().max(b.abs()).max(c.abs()).max_element();
    let quantum = 0.5 * f64::from(f32::EPSILON) * (longest + place);
    twice_area(corners) > quantum * longest
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
        for edge in edges.faces() {
            bright.clear();
            bright.extend(
                edge.filter_map(|f| material.get(f as usize).map(|&m| (m, f)))
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
    say(r.broken_polygons, "polygon", "dropped, crossed by its own edges");
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
