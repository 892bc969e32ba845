//! `mrvis info SCENE`: contents of a scene and its repairs.

use super::args::{Common, SceneArgs, counted, grouped};
use super::flags::with_flags;
use super::inputs::Inputs;
use super::values::ClusterArgs;
use mrvis::internals::clusters;
use mrvis::internals::error::{quote, shown};
use mrvis::internals::scene::{Emitter, Photometry};
use mrvis::internals::sky::Environment;
use mrvis::{Builder, Result, Scene};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// List all objects instead of the 20 with the most faces.
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    clusters: ClusterArgs,
    #[command(flatten)]
    pub common: Common,
}

pub fn run(args: &Args) -> Result<ExitCode> {
    let start = Instant::now();
    let scene = args.scene.load(&args.common)?;
    let seconds = start.elapsed().as_secs_f64();
    args.common.check_outputs(&Inputs::of(scene.parts().files), [])?;
    let counts = {
        let _spinner = args.common.spinner("clustering");
        ClusterCounts::of(&scene, args.clusters.builder)
    };
    let photometry = args.scene.photometry();
    let mut json = summary_json(&scene, counts, seconds);
    if let (Some(photometry), Some(list)) = (photometry, json["emitters"].as_array_mut()) {
        for (emitter, entry) in scene.parts().emitters.iter().zip(list) {
            entry["flux_lm"] = photometry.of(scene.power(emitter)).into();
        }
    }
    args.common.write_json(&json)?;
    args.common.print(&text(&scene, counts, photometry, seconds, if args.all { usize::MAX } else { 20 }))?;
    Ok(ExitCode::SUCCESS)
}

/// All sections as text.
fn text(
    scene: &Scene,
    counts: ClusterCounts,
    photometry: Option<Photometry>,
    seconds: f64,
    objects: usize,
) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = summary(&mut out, scene, seconds)
        .and_then(|()| clusters(&mut out, counts))
        .and_then(|()| emitters(&mut out, scene, photometry))
        .and_then(|()| list_materials(&mut out, scene, objects))
        .and_then(|()| list_objects(&mut out, scene, objects))
        .and_then(|()| list_meshes(&mut out, scene, objects))
        .and_then(|()| outside_files(&mut out, scene))
        .and_then(|()| repairs(&mut out, scene));
    out
}

/// Files that were read and do not lie in the folder of the scene or below.
fn outside(s: &Scene) -> Vec<&PathBuf> {
    let full = |path: &Path| path.canonicalize().ok();
    let folder = full(s.parts().path).and_then(|scene| Some(scene.parent()?.to_owned()));
    let outside = |file: &&PathBuf| match (&folder, full(file)) {
        (Some(folder), Some(file)) => !file.starts_with(folder),
        // Standard input has no folder.
        _ => *file != s.parts().path,
    };
    s.parts().files.iter().filter(outside).collect()
}

fn outside_files(out: &mut String, s: &Scene) -> std::fmt::Result {
    let files = outside(s);
    if files.is_empty() {
        return Ok(());
    }
    writeln!(out, "read from outside the folder of the scene")?;
    files.iter().try_for_each(|file| writeln!(out, "  {}", shown(file)))
}

fn summary(out: &mut String, s: &Scene, seconds: f64) -> std::fmt::Result {
    let p = s.parts();
    let (bounds, unit) = (s.world_bounds(), &p.unit);
    let e = bounds.extent();
    let (min, max) = (p.origin + bounds.min.as_dvec3(), p.origin + bounds.max.as_dvec3());
    writeln!(out, "{} (read in {seconds:.2} s, unit {unit})", shown(p.path))?;
    writeln!(out, "  triangles   {:>12}", grouped(p.triangles.len()))?;
    if !p.placements.is_empty() {
        let meshes = match p.shared.len() {
            1 => "one shared mesh".into(),
            n => format!("{} shared meshes", grouped(n)),
        };
        writeln!(out, "  instances   {:>12} of {meshes}", grouped(p.placements.len()))?;
        writeln!(
            out,
            "  stored      {:>12} triangles, those of shared meshes once",
            grouped(s.triangle_count())
        )?;
        writeln!(out, "  visible     {:>12} triangles", grouped(s.visible_triangles() as usize))?;
    }
    let r = p.repairs;
    let some = |n: usize, what: &str| if n > 0 { format!(", {} {what}", grouped(n)) } else { String::new() };
    if r.polygons_triangulated > 0 {
        let concave = some(r.concave_polygons, "of them concave");
        writeln!(
            out,
            "  polygons    {:>12} divided into triangles{concave}",
            grouped(r.polygons_triangulated)
        )?;
    }
    let (welded, unused) = (some(r.welded_vertices, "welded"), some(r.unused_vertices, "unused"));
    let vertices = grouped(stored(s, |m| m.parts().positions.len()));
    writeln!(out, "  vertices    {vertices:>12}{welded}{unused}")?;
    writeln!(out, "  objects     {:>12}", grouped(p.objects.len()))?;
    writeln!(out, "  materials   {:>12}", grouped(p.materials.len()))?;
    writeln!(
        out,
        "  parts       {:>12} closed, {}",
        grouped(stored(s, |m| m.parts().closed_parts)),
        counted(stored(s, |m| m.parts().sheet_parts), "sheet")
    )?;
    writeln!(out, "  size        {} x {} x {} {unit}", round(e.x), round(e.y), round(e.z))?;
    let (up, from) = s.up_from();
    writeln!(out, "  up          {} ({})", up.name(), from.words())?;
    for line in p.sky.iter().flat_map(|sky| &sky.notes) {
        writeln!(out, "  light       {line}")?;
    }
    writeln!(out, "  from        {} {} {} {unit}", round64(min.x), round64(min.y), round64(min.z))?;
    writeln!(out, "  to          {} {} {} {unit}", round64(max.x), round64(max.y), round64(max.z))?;
    if p.origin != glam::DVec3::ZERO {
        writeln!(
            out,
            "  origin      {} {} {} {unit}, to which stored positions are relative",
            p.origin.x, p.origin.y, p.origin.z
        )?;
    }
    Ok(())
}

/// A count summed over the scene's own geometry and, once each, its shared meshes.
fn stored(s: &Scene, count: impl Fn(&Scene) -> usize) -> usize {
    count(s) + s.parts().shared.iter().map(|m| count(m)).sum::<usize>()
}

fn clusters(out: &mut String, counts: ClusterCounts) -> std::fmt::Result {
    let ClusterCounts { clusters, levels, large, .. } = counts;
    writeln!(out, "  clusters    {:>12} in {}", grouped(clusters), counted(levels, "level"))?;
    let triangles = if large == 1 { "triangle" } else { "triangles" };
    writeln!(out, "  large       {:>12} {triangles} of large surfaces, never averaged", grouped(large))
}

/// Clusters of the scene's own triangles and of its shared meshes, each once.
#[derive(Clone, Copy, Default)]
struct ClusterCounts {
    clusters: usize,
    /// Levels of the deepest hierarchy.
    levels: usize,
    /// Triangles of large surfaces.
    large: usize,
    /// Algorithm that built them.
    builder: &'static str,
}

impl ClusterCounts {
    fn of(scene: &Scene, builder: Builder) -> ClusterCounts {
        let options = clusters::Options { builder, ..Default::default() };
        let mut counts = ClusterCounts { builder: builder.name(), ..ClusterCounts::default() };
        for mesh in std::iter::once(scene).chain(scene.parts().shared.iter().map(|mesh| mesh.as_ref())) {
            let h = clusters::build(mesh, &options);
            counts.clusters += h.micro.clusters.len() + h.large.clusters.len();
            counts.levels = counts.levels.max(h.micro.levels()).max(h.large.levels());
            counts.large += h.large.order.len();
        }
        counts
    }
}

fn emitters(out: &mut String, s: &Scene, photometry: Option<Photometry>) -> std::fmt::Result {
    let p = s.parts();
    let is_lit = |sky: &Environment| !sky.suns().is_empty() || sky.sky().is_some();
    if p.emitters.is_empty() && p.sky.is_some_and(is_lit) {
        return Ok(());
    }
    if p.emitters.is_empty() {
        return writeln!(out, "no emitter: nothing has Ke; make one with --emitter NAME=W");
    }
    let sides = if p.two_sided_emission { "both sides" } else { "front side" };
    writeln!(out, "emitters      {} ({sides})", p.emitters.len())?;
    for e in p.emitters.iter().take(20) {
        let n = e.normal;
        let normal = if n.length() < 0.01 {
            "all round".to_owned()
        } else {
            format!("{:.2} {:.2} {:.2}", n.x, n.y, n.z)
        };
        let power = s.power(e).map(round64).join(" ");
        let lumens = photometry.map_or(String::new(), |p| format!(", {} lm", round64(p.of(s.power(e)))));
        let factors = factors(s, e).filter(|factors| *factors != [1.0; 2]).map_or(String::new(), |[d, m]| {
            format!(", dimming {} and maintenance factor {} included", round64(d), round64(m))
        });
        writeln!(
            out,
            "  {:24} area {} {u}², width {} {u}, normal {normal}, power {power} W (RGB){lumens}{factors}",
            quote(&e.name),
            round64(e.area),
            round(e.min_width),
            u = p.unit,
        )?;
    }
    if p.emitters.len() > 20 {
        writeln!(out, "  and {} more", p.emitters.len() - 20)?;
    }
    Ok(())
}

/// Dimming and maintenance factor of an emitter that is a luminaire.
fn factors(s: &Scene, emitter: &Emitter) -> Option<[f64; 2]> {
    let material = s.parts().triangle_material[*emitter.triangles.first()? as usize];
    Some(s.parts().materials[material as usize].profile.as_ref()?.factors)
}

fn list_objects(out: &mut String, s: &Scene, limit: usize) -> std::fmt::Result {
    let counts = face_counts(s);
    writeln!(out, "objects by number of triangles")?;
    for &(object, count) in counts.iter().take(limit) {
        writeln!(out, "  {:>12}  {}", grouped(count), quote(&s.parts().objects[object].name))?;
    }
    left_out(out, counts.len(), limit)
}

fn list_meshes(out: &mut String, s: &Scene, limit: usize) -> std::fmt::Result {
    if s.parts().placements.is_empty() {
        return Ok(());
    }
    writeln!(out, "shared meshes by number of visible triangles")?;
    let meshes = mesh_counts(s);
    for &(mesh, instances) in meshes.iter().take(limit) {
        let (triangles, name) = (s.parts().shared[mesh].parts().triangles.len(), quote(mesh_name(s, mesh)));
        let visible = grouped(triangles * instances);
        writeln!(
            out,
            "  {visible:>12}  {name}: {} triangles, {} instances",
            grouped(triangles),
            grouped(instances)
        )?;
    }
    left_out(out, meshes.len(), limit)
}

/// Shared meshes with their numbers of visible instances, those with most visible triangles first.
fn mesh_counts(s: &Scene) -> Vec<(usize, usize)> {
    let mut counts: Vec<(usize, usize)> = (0..s.parts().shared.len()).map(|i| (i, 0)).collect();
    s.parts().placements.iter().filter(|p| p.visible).for_each(|p| counts[p.mesh as usize].1 += 1);
    counts.sort_by_key(|&(i, n)| (std::cmp::Reverse(n * s.parts().shared[i].parts().triangles.len()), i));
    counts
}

/// The name of a shared mesh: that of its first object.
fn mesh_name(s: &Scene, mesh: usize) -> &str {
    s.parts().shared[mesh].parts().objects.first().map_or("", |object| &object.name)
}

fn repairs(out: &mut String, s: &Scene) -> std::fmt::Result {
    let r = &s.parts().repairs;
    if r.messages.is_empty() {
        return writeln!(out, "nothing had to be repaired");
    }
    writeln!(out, "repaired or assumed")?;
    with_flags(&r.messages).iter().try_for_each(|m| writeln!(out, "  {m}"))
}

/// Objects with their numbers of triangles, in descending order.
fn face_counts(s: &Scene) -> Vec<(usize, usize)> {
    let mut counts: Vec<(usize, usize)> = (0..s.parts().objects.len()).map(|i| (i, 0)).collect();
    s.parts().triangle_object.iter().for_each(|&o| counts[o as usize].1 += 1);
    counts.sort_by_key(|&(i, n)| (std::cmp::Reverse(n), i));
    counts
}

/// A number with four significant digits.
fn round(value: f32) -> String {
    round64(f64::from(value))
}

fn round64(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".into();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12);
    let text = format!("{value:.*}", digits as usize);
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if value.abs() < 1e-9 { format!("{value:.3e}") } else { short.to_owned() }
}

fn summary_json(s: &Scene, counts: ClusterCounts, seconds: f64) -> Value {
    let ClusterCounts { clusters, levels, large, builder } = counts;
    let p = s.parts();
    let emitters: Vec<Value> = p
        .emitters
        .iter()
        .map(|e| {
            let mut emitter = json!({
                "name": e.name, "triangles": e.triangles.len(), "area": e.area, "normal": e.normal.to_array(),
                "min_width": e.min_width, "radiance": e.emission, "power_w": s.power(e),
            });
            if let Some([dimming, maintenance]) = factors(s, e) {
                emitter["dimming"] = dimming.into();
                emitter["maintenance"] = maintenance.into();
            }
            emitter
        })
        .collect();
    let objects: Vec<Value> =
        face_counts(s).iter().map(|&(i, n)| json!({ "name": p.objects[i].name, "triangles": n })).collect();
    let materials: Vec<Value> = reflectances(s)
        .into_iter()
        .map(|(m, rgb)| {
            let mean = rgb.iter().sum::<f64>() / 3.0;
            json!({ "name": p.materials[m].name, "reflectance": rgb, "mean_reflectance": mean })
        })
        .collect();
    let bounds = s.world_bounds();
    let mut scene = json!({
        "path": p.path, "triangles": p.triangles.len(), "vertices": stored(s, |m| m.parts().positions.len()),
        "objects": p.objects.len(), "materials": p.materials.len(), "emitters": p.emitters.len(),
        "closed_parts": stored(s, |m| m.parts().closed_parts), "sheet_parts": stored(s, |m| m.parts().sheet_parts),
        "clusters": clusters, "levels": levels, "large_surface_triangles": large, "builder": builder,
        "origin": p.origin.to_array(), "min": bounds.min.to_array(), "max": bounds.max.to_array(),
        "two_sided_emission": p.two_sided_emission, "up": s.up_axis(), "up_from": s.up_from().1.words(),
        "files": p.files, "files_outside": outside(s),
    });
    if let Some(sky) = p.sky {
        scene["sky"] = json!(sky.notes);
    }
    if !p.placements.is_empty() {
        scene["instances"] = json!(p.placements.len());
        scene["shared_meshes"] = json!(p.shared.len());
        scene["stored_triangles"] = json!(s.triangle_count());
        scene["visible_triangles"] = json!(s.visible_triangles());
        let meshes = mesh_counts(s).into_iter().map(|(mesh, instances)| {
            json!({
                "name": mesh_name(s, mesh), "triangles": p.shared[mesh].parts().triangles.len(), "instances": instances,
            })
        });
        scene["meshes"] = meshes.collect();
    }
    json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "unit": p.unit,
        "scene": scene,
        "build": { "load_s": seconds },
        "emitters": emitters,
        "objects": objects,
        "materials": materials,
        "repairs": p.repairs,
    })
}

/// Reflectances, the materials of the largest area first.
fn list_materials(out: &mut String, s: &Scene, limit: usize) -> std::fmt::Result {
    let materials = reflectances(s);
    writeln!(out, "materials by area: reflectance, mean and RGB")?;
    for (material, [r, g, b]) in materials.iter().take(limit) {
        let mean = (r + g + b) / 3.0;
        writeln!(
            out,
            "  {mean:>12.3}  {r:.3} {g:.3} {b:.3}  {}",
            quote(&s.parts().materials[*material].name)
        )?;
    }
    left_out(out, materials.len(), limit)
}

/// The last line of a list of `limit` things if there are more.
pub(super) fn left_out(out: &mut String, all: usize, limit: usize) -> std::fmt::Result {
    if all > limit { writeln!(out, "  and {} more (--all)", all - limit) } else { Ok(()) }
}

/// Materials that faces have, with the reflectance of these faces in the mean over their area, that of textures included; by area in
/// descending order. Faces of shared meshes count once.
pub(super) fn reflectances(s: &Scene) -> Vec<(usize, [f64; 3])> {
    let mut sums = vec![[0.0; 4]; s.parts().materials.len()];
    for mesh in std::iter::once(s).chain(s.parts().shared.iter().map(|mesh| mesh.as_ref())) {
        for t in 0..mesh.parts().triangles.len() {
            let [a, b, c] = mesh.corners(t as u32).map(|p| p.as_dvec3());
            let area = (b - a).cross(c - a).length();
            // Shared meshes have the materials of the scene that places them.
            let [r, g, b] = mesh.parts().triangle_reflectance[t].map(f64::from);
            if let Some(sum) = sums.get_mut(mesh.parts().triangle_material[t] as usize) {
                sum.iter_mut().zip([area, area * r, area * g, area * b]).for_each(|(sum, part)| *sum += part);
            }
        }
    }
    let mut order: Vec<usize> = (0..sums.len()).filter(|&m| sums[m][0] > 0.0).collect();
    order.sort_by(|&a, &b| sums[b][0].total_cmp(&sums[a][0]));
    order.into_iter().map(|m| (m, [1, 2, 3].map(|c| sums[m][c] / sums[m][0]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        let check = |v, want: &str| assert_eq!(round64(v), want);
        check(0.0, "0");
        check(12.0, "12");
        check(1234.5678, "1235");
        check(0.00123456, "0.001235");
        check(-5_000_000.25, "-5000000");
        check(1e-11, "1.000e-11");
    }
}
