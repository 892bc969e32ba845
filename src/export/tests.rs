use super::*;
use crate::model::Model;
use crate::progress::testing::stop_when;
use crate::radiosity::mesh::{Element, PlacedElement, RadiosityMesh};
use crate::scene::testing::{Pieces, facing_up};
use crate::scene::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::path::Path;

/// The front of a grey triangle or quad with an irradiance.
fn grey(corners: [u32; 4], irradiance: f64, area: f64, triangle: u32) -> Element {
    Element {
        corners,
        radiosity: [0.5 * irradiance; 3],
        irradiance: [irradiance; 3],
        error: [0.0; 3],
        albedo: [0.5; 3],
        exitance: [0.0; 3],
        area,
        level: 0,
        links: 1,
        triangle,
        object: 0,
        material: 0,
        front: true,
        crossed: false,
        narrow: false,
        walls: 0,
    }
}

/// Adds a quad as an element with an irradiance.
fn add_quad(solution: &mut RadiosityMesh, corners: [DVec3; 4], irradiance: f64, area: f64, triangle: u32) {
    let first = solution.vertices.len() as u32;
    solution.vertices.extend(corners.map(|p| p.as_vec3()));
    solution.elements.push(grey([first, first + 1, first + 2, first + 3], irradiance, area, triangle));
}

/// The unit square at z = 0, facing up, with one quarter split again; `light` is the irradiance at an element's
/// centre.
fn square(light: impl Fn(Vec3) -> f64) -> (Scene, RadiosityMesh) {
    let mut pieces = Pieces::empty();
    pieces.grey("square", 0.5).rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
    let scene = pieces.scene();
    let mut solution = RadiosityMesh::default();
    let mut places: HashMap<[u32; 3], u32> = HashMap::new();
    let mut add = |low: [f32; 2], side: f32| {
        let at = |x: f32, y: f32| Vec3::new(low[0] + x * side, low[1] + y * side, 0.0);
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)].map(|p| {
            *places.entry(p.to_array().map(f32::to_bits)).or_insert_with(|| {
                solution.vertices.push(p);
                solution.vertices.len() as u32 - 1
            })
        });
        let e = light(at(0.5, 0.5));
        let (error, level, links) = ([0.01; 3], if side < 0.5 { 2 } else { 1 }, 7);
        let plain = grey(corners, e, f64::from(side * side), 0);
        solution.elements.push(Element { error, level, links, ..plain });
    };
    for (x, y) in [(0.5, 0.0), (0.0, 0.5), (0.5, 0.5)] {
        add([x, y], 0.5);
    }
    for (x, y) in [(0.0, 0.0), (0.25, 0.0), (0.0, 0.25), (0.25, 0.25)] {
        add([x, y], 0.25);
    }
    (scene, solution)
}

/// A camera above or below the middle of the square that looks at it.
fn camera(z: f32) -> Camera {
    Camera {
        name: "test".into(),
        eye: Vec3::new(0.5, 0.5, z),
        forward: Vec3::NEG_Z * z.signum(),
        up: Vec3::Y,
        angle: 0.8,
    }
}

#[test]
fn pictures_show_the_lit_side() {
    let (_, solution) = square(|_| 2.0);
    let mesh = Mesh::new(&solution);
    let stage = Stage::new(&mesh, &solution).expect("a stage");
    let frame = render(&stage, &camera(1.0), [21, 15], 2, &());
    assert_eq!((frame.radiance.len(), frame.first.len()), (21 * 15, 21 * 15));
    // 0.5 × 2 W/m² over π; the middle row and column of the picture see the square at distance 1.
    let middle = frame.radiance[7 * 21 + 10];
    assert!((middle[0] - 1.0 / std::f32::consts::PI).abs() < 1e-5, "{middle:?}");
    assert!(frame.first[7 * 21 + 10].is_some_and(|f| (f.distance - 1.0).abs() < 0.01));
    let behind = render(&stage, &camera(-1.0), [21, 15], 1, &());
    assert!(behind.radiance.iter().flatten().all(|&l| l == 0.0), "surfaces cannot be seen from behind");
    let view = best_view(&stage, &solution, Vec3::Z, "m");
    assert!(view.eye.z > 0.0, "{view:?}");
    assert!(render(&stage, &view, [32, 24], 1, &()).first.iter().flatten().count() > 50);
}

#[test]
fn lightmaps_hold_the_light_where_they_say() {
    let (scene, solution) = square(|p| f64::from(p.x));
    let mesh = Mesh::new(&solution);
    let map = lightmap(&mesh, &solution, &scene, 4096, &()).expect("a lightmap");
    let covered = map.covered.iter().filter(|&&c| c).count() as f32 * map.texel * map.texel;
    assert!((covered - 1.0).abs() < 0.05, "{covered}");
    for (t, uv) in mesh.triangles.iter().zip(&map.texcoords) {
        // The texel at the triangle's centre has its light, up to the change over one texel.
        let middle = (uv[0] + uv[1] + uv[2]) / 3.0;
        let x = (middle.x * map.width as f32) as usize;
        let y = ((1.0 - middle.y) * map.height as f32) as usize;
        let want: f32 = t.iter().map(|&v| mesh.irradiance[v as usize][0]).sum::<f32>() / 3.0;
        let got = map.irradiance[y * map.width + x][0];
        assert!((got - want).abs() < 2.0 * map.texel + 1e-3, "{got} instead of {want}");
    }
    assert!(map.irradiance.iter().flatten().all(|e| (0.0..=1.0).contains(e)));
    // The model has the triangles of the scene, not those of the elements.
    assert!(mesh.triangles.len() > scene.triangles.len() && map.sides.len() == scene.triangles.len());
    for side in &map.sides {
        for (p, uv) in scene.corners(side.triangle).into_iter().zip(side.texcoords) {
            let light = bilinear(&map, uv.x, uv.y);
            // At a corner the light is that of the element there, whose centre is up to a quarter away.
            assert!((light - p.x).abs() < 0.25 + 2.0 * map.texel, "{light} at {p}");
        }
    }
    let folder = tempfile::tempdir().expect("scratch folder");
    let model = folder.path().join("lightmap.obj");
    write_lightmap_mesh(&model, &map, &scene, "lightmap.exr", &()).expect("written");
    assert_eq!(Scene::load(&model).expect("an OBJ file").triangles.len(), scene.triangles.len());
}

#[test]
fn a_lightmap_stops_when_the_caller_asks_for_it() {
    let (scene, solution) = square(|p| f64::from(p.x));
    let mesh = Mesh::new(&solution);
    let stop_at = |stop: u64| {
        let progress = stop_when(|c| c.asked > stop);
        let map = lightmap(&mesh, &solution, &scene, 4096, &progress);
        (map.map(|_| ()), progress.asked())
    };
    let (whole, looks) = stop_at(u64::MAX);
    // Margins are filled row by row: 64 rows and margins, twice.
    assert!(whole.is_ok() && looks >= 128, "{looks} looks");
    for stop in [0, 1, looks / 2, looks - 1] {
        let (stopped, looks) = stop_at(stop);
        assert!(matches!(stopped, Err(crate::Error::Cancelled(_))) && looks == stop + 1, "{stop}: {looks}");
    }
}

/// A square and more small triangles than the image has texels: the square keeps its share of the image, and no triangle is black.
#[test]
fn lightmaps_of_crumbs_leave_room_for_walls() {
    let mut pieces = Pieces::new();
    let mut solution = RadiosityMesh::default();
    for k in 0..1001u32 {
        let (at, side) = if k == 0 { (0.0, 1.0) } else { (2.0 + 0.01 * f64::from(k), 1e-3) };
        let corners = facing_up([at, at + side], [0.0, side], 0.01 * f64::from(k));
        pieces.polygon(&corners);
        add_quad(&mut solution, corners, 1.0, side * side, 2 * k);
    }
    let scene = pieces.scene();
    let mesh = Mesh::new(&solution);
    let map = lightmap(&mesh, &solution, &scene, 1000, &()).expect("a lightmap");
    assert!(map.texel < 0.04 && map.width * map.height < 60_000, "{} {}", map.texel, map.width);
    for uv in &map.texcoords {
        let middle = (uv[0] + uv[1] + uv[2]) / 3.0;
        assert!((bilinear(&map, middle.x, middle.y) - 1.0).abs() < 1e-5);
    }
}

/// Two unit squares, the second 100 times as bright, with texture coordinates `gap` apart, and their lightmap.
fn unwrapped(gap: f32, texels: usize) -> Result<Lightmap, String> {
    let mut soup = Soup::new("test");
    soup.object("squares");
    soup.material(SoupMaterial::diffuse("grey", [0.5; 3]));
    let mut solution = RadiosityMesh::default();
    for k in 0..2u32 {
        let corners = facing_up([0.0, 1.0].map(|x| x + 2.0 * f64::from(k)), [0.0, 1.0], 0.0);
        soup.polygon(0, 0, &corners);
        let left = k as f32 * (0.4 + gap) + 0.05;
        let uv = [[left, 0.1], [left + 0.4, 0.1], [left + 0.4, 0.9], [left, 0.9]];
        let start = soup.texcoords.len() as u32;
        soup.texcoords.extend(uv);
        soup.corner_texcoords.extend((0..4).map(|i| start + i));
        add_quad(&mut solution, corners, if k == 0 { 1.0 } else { 100.0 }, 1.0, 2 * k);
    }
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    let mesh = Mesh::new(&solution);
    let stage = Stage::new(&mesh, &solution).expect("a stage");
    unwrapped_lightmap(&stage, &scene, texels, &()).expect("never stopped")
}

/// Bilinear interpolation of a lightmap at texture coordinates.
fn bilinear(map: &Lightmap, u: f32, v: f32) -> f32 {
    let (x, y) = (u * map.width as f32 - 0.5, (1.0 - v) * map.height as f32 - 0.5);
    let (i, j) = (x.floor() as usize, y.floor() as usize);
    let (s, t) = (x - x.floor(), y - y.floor());
    let at = |i: usize, j: usize| map.irradiance[j * map.width + i][0];
    (1.0 - t) * ((1.0 - s) * at(i, j) + s * at(i + 1, j))
        + t * ((1.0 - s) * at(i, j + 1) + s * at(i + 1, j + 1))
}

#[test]
fn lightmaps_in_the_files_coordinates_do_not_bleed() {
    // The charts are five texels apart; their light differs by a factor of 100.
    let map = unwrapped(0.1, 50 * 50).expect("a lightmap");
    assert_eq!((map.width, map.height, map.texcoords.len()), (50, 50, 0));
    let covered = map.covered.iter().filter(|&&c| c).count() as f32 / 2500.0;
    // Edges pass through centres of texels, which count for both sides.
    assert!((covered - 0.64).abs() < 0.06, "{covered}");
    for k in 0..=100 {
        let share = k as f32 / 100.0;
        for (left, want) in [(0.05, 1.0), (0.55, 100.0)] {
            for (u, v) in [(share, 0.0), (share, 1.0), (0.0, share), (1.0, share), (share, share)] {
                let got = bilinear(&map, left + 0.4 * u, 0.1 + 0.8 * v);
                assert!((got / want - 1.0).abs() < 1e-5, "{u} {v}: {got} instead of {want}");
            }
        }
    }
}

#[test]
fn lightmaps_refuse_coordinates_that_cannot_hold_them() {
    let why = |gap: f32| unwrapped(gap, 10_000).map(|_| ()).expect_err("no lightmap");
    assert!(why(-0.2).contains("overlap"), "{}", why(-0.2));
    assert!(why(0.3).contains("leave 0..1"), "{}", why(0.3));
    let (scene, solution) = square(|_| 1.0);
    let mesh = Mesh::new(&solution);
    let stage = Stage::new(&mesh, &solution).expect("a stage");
    assert!(
        unwrapped_lightmap(&stage, &scene, 100, &())
            .expect("never stopped")
            .expect_err("no lightmap")
            .contains("no texture")
    );
    // Shared edges do not overlap.
    assert!(unwrapped(0.0, 10_000).is_ok());
}

#[test]
fn what_is_shown_of_a_solved_room_has_no_cracks() {
    use crate::radiosity::{Options, run};
    use crate::scene::testing::generated;
    let scene = generated("cornell");
    let options = Options { error: 0.05, ..Options::default() };
    let model = Model::prepare(scene.clone(), &options.prepare()).expect("a model");
    let outcome = run(&model, &[], &options, &()).expect("a solution");
    let levels: std::collections::HashSet<u8> = outcome.mesh.elements.iter().map(|e| e.level).collect();
    assert!(levels.len() >= 3, "mixed levels: {levels:?}");
    let mesh = Mesh::new(&outcome.mesh);
    // Each edge is shared by two triangles of equal orientation, or lies on the outline of a wall.
    let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
    let place = |v: u32| (mesh.positions[v as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (place(t[k]), place(t[(k + 1) % 3]));
            *edges.entry(if a < b { [a, b] } else { [b, a] }).or_default() += if a < b { 1 } else { -1 };
        }
    }
    // Open edges of the mesh must lie on open edges of the input, without faces that no light reaches (the lower
    // faces of the blocks).
    let facing = |t: u32| {
        let [a, b, c] = scene.corners(t);
        let normal = (b - a).cross(c - a).normalize().to_array().map(|v| (100.0 * v).round() as i32);
        (scene.triangle_object[t as usize], normal)
    };
    let lit: std::collections::HashSet<_> =
        outcome.mesh.elements.iter().map(|e| facing(e.triangle)).collect();
    let mut open: HashMap<[u32; 2], i32> = HashMap::new();
    for (_, t) in (0u32..).zip(&scene.triangles).filter(|(k, _)| lit.contains(&facing(*k))) {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *open.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let outline: Vec<[Vec3; 2]> =
        open.iter().filter(|(_, n)| **n == 1).map(|(e, _)| e.map(|v| scene.positions[v as usize])).collect();
    let near = |p: Vec3, [a, b]: [Vec3; 2]| {
        let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + along * (b - a)) < 1e-3
    };
    for (edge, _) in edges.iter().filter(|(_, n)| **n != 0) {
        let ends = edge.map(|p| Vec3::from(p.map(f32::from_bits)));
        let along = |&line: &[Vec3; 2]| ends.iter().all(|&p| near(p, line));
        assert!(outline.iter().any(along), "a crack at {ends:?}");
    }
}

#[test]
fn files_are_what_their_formats_say() {
    let (square_scene, solution) = square(|p| f64::from(p.y) + 1.0);
    let mesh = Mesh::new(&solution);
    let tone = Tone::of(mesh.radiosity.iter().copied());
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = |name: &str| folder.path().join(name);
    write_glb(&path("a.glb"), &mesh, DVec3::ZERO, crate::scene::UpAxis::Y, tone, &()).expect("written");
    let (document, buffers, _) = ::gltf::import(path("a.glb")).expect("glTF that its own crate takes");
    let primitive = document.meshes().next().and_then(|m| m.primitives().next()).expect("a mesh");
    let reader = primitive.reader(|b| Some(&buffers[b.index()]));
    let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
    assert_eq!(indices, mesh.triangles.as_flattened());
    assert_eq!(reader.read_positions().expect("positions").len(), mesh.positions.len());
    assert!(
        reader.read_colors(0).expect("colours").into_rgb_f32().flatten().all(|c| (0.0..=1.0).contains(&c))
    );

    write_ply(&path("a.ply"), &mesh, solution.origin, tone, &()).expect("written");
    let scene = Scene::load_with(path("a.ply"), &LoadOptions::default()).expect("PLY that we take ourselves");
    assert_eq!(scene.triangles.len(), mesh.triangles.len());

    write_vtu(&path("a.vtu"), &solution, &square_scene, None, &()).expect("written");
    check_vtu(&path("a.vtu"), &solution);
    let placed = (0..solution.elements.len()).map(|i| PlacedElement { instance: 3, id: 1 << 40 | i as u64 });
    let solution = RadiosityMesh { instances: placed.collect(), ..solution };
    write_vtu(&path("b.vtu"), &solution, &square_scene, None, &()).expect("written");
    check_vtu(&path("b.vtu"), &solution);
}

/// Checks that the offsets in the header lead to arrays of the stated lengths.
fn check_vtu(path: &Path, solution: &RadiosityMesh) {
    let bytes = std::fs::read(path).expect("bytes");
    let mark = b"<AppendedData encoding=\"raw\">\n_";
    let data = bytes.windows(mark.len()).position(|w| w == mark).expect("appended data") + mark.len();
    let header = String::from_utf8_lossy(&bytes[..data]).into_owned();
    let cells = solution.elements.len();
    assert!(header.contains(&format!("NumberOfCells=\"{cells}\"")));
    let array = |name: &str| -> &[u8] {
        let line = header.lines().find(|l| l.contains(&format!("Name=\"{name}\""))).expect("the array");
        let offset = line.split("offset=\"").nth(1).and_then(|r| r.split('"').next()).expect("an offset");
        let at = data + offset.parse::<usize>().expect("a number");
        let length = u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight")) as usize;
        &bytes[at + 8..at + 8 + length]
    };
    let name =
        "Name=\"object_names\" NumberOfTuples=\"1\" NumberOfComponents=\"1\" ComponentName0=\"square\"";
    assert!(header.contains(name), "{header}");
    assert_eq!(array("points").len(), 24 * solution.vertices.len());
    assert_eq!(array("connectivity").len(), 16 * cells, "quads");
    assert!(array("types").iter().all(|&t| t == 9));
    let light: Vec<f32> = array("irradiance")
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().expect("four")))
        .collect();
    assert_eq!(light.len(), 3 * cells);
    assert_eq!(light[0], solution.elements[0].irradiance[0] as f32);
    assert!(array("links").chunks_exact(4).all(|b| b == 7u32.to_le_bytes()));
    let of_instances = ["instance", "id"].map(|name| header.contains(&format!("Name=\"{name}\"")));
    assert_eq!(of_instances, [!solution.instances.is_empty(); 2]);
    if let Some(last) = solution.instances.last() {
        assert!(array("instance").ends_with(&last.instance.to_le_bytes()));
        assert!(array("id").len() == 8 * cells && array("id").ends_with(&last.id.to_le_bytes()));
    }
    for name in ["radiosity", "error", "level", "area", "object", "material", "triangle", "front"] {
        assert!(!array(name).is_empty(), "{name}");
    }
}

#[test]
fn tones_keep_order_and_range() {
    let tone = Tone::of((1..100).map(|i| [i as f32; 3]));
    let shown: Vec<f32> = (0..500).map(|i| tone.linear([i as f32; 3])[0]).collect();
    assert!(shown.windows(2).all(|w| w[0] <= w[1]) && shown[0] == 0.0 && shown[499] == 1.0);
    assert_eq!(Tone::of([]).srgb([0.0; 3]), [0; 3]);
    // A stray pixel in the dark stays dark.
    let mut dark = vec![[0.0; 3]; 100_000];
    dark[7] = [1e-5; 3];
    assert_eq!(Tone::of(dark).srgb([1e-5; 3]), [0; 3]);
    // So does what passes through a wall by rounding, also beside a lit seam.
    let tone = Tone::above(1e-7, (0..1000).map(|i| [if i < 3 { 1e-3 } else { 1e-8 }; 3]));
    assert_eq!(tone.srgb([1e-8; 3]), [0; 3]);
}

#[test]
fn meshes_have_one_light_at_one_place() {
    let (_, mut solution) = square(|p| f64::from(p.x) + 1.0);
    // Light is continuous up to the uncertainty of the elements.
    solution.elements.iter_mut().for_each(|e| e.error = [0.1; 3]);
    let mesh = Mesh::new(&solution);
    let area: f32 = (0..mesh.triangles.len())
        .map(|t| mesh.corners(t))
        .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z)
        .sum();
    assert!((area - 1.0).abs() < 1e-6, "{area}");
    let place = |v: u32| {
        let p = mesh.positions[v as usize];
        [p.x.to_bits(), p.y.to_bits()]
    };
    let mut light: HashMap<[u32; 2], [f32; 3]> = HashMap::new();
    for (v, e) in mesh.irradiance.iter().enumerate() {
        assert_eq!(*light.entry(place(v as u32)).or_insert(*e), *e, "one light at one place");
        assert_eq!(mesh.radiosity[v], e.map(|x| 0.5 * x));
    }
}

#[test]
fn constant_light_stays_constant() {
    let (_, solution) = square(|_| 3.0);
    assert!(Mesh::new(&solution).irradiance.iter().flatten().all(|e| (e - 3.0).abs() < 1e-6));
}

/// Over each element the mesh has the element's mean light within its uncertainty, also where a shadow ends.
#[test]
fn meshes_keep_the_mean_light_of_elements() {
    for light in [|p: Vec3| f64::from(1.0 + p.x), |p: Vec3| if p.x < 0.3 { 5.0 } else { 0.2 }] {
        let (_, solution) = square(light);
        let mesh = Mesh::new(&solution);
        let mut sums = vec![(0.0, 0.0); solution.elements.len()];
        for (k, &e) in mesh.element.iter().enumerate() {
            let [a, b, c] = mesh.corners(k).map(|p| p.as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            let light: f64 =
                mesh.triangles[k].iter().map(|&v| f64::from(mesh.irradiance[v as usize][0])).sum();
            sums[e as usize].0 += area;
            sums[e as usize].1 += area * light / 3.0;
        }
        for (element, (area, sum)) in solution.elements.iter().zip(sums) {
            let allowed = element.error[0].max(element.irradiance[0] / 255.0);
            let difference = (sum / area - element.irradiance[0]).abs();
            assert!(difference < 1.001 * allowed, "{difference} for {allowed}");
        }
    }
}

/// Neighbours that were cut along one plane have corners there that differ by rounding: the mesh has one vertex for them.
#[test]
fn vertices_that_differ_by_rounding_are_one() {
    let (_, mut solution) = square(|_| 1.0);
    let expected = Mesh::new(&solution);
    let corner = solution.elements[0].corners[2];
    let place = solution.vertices[corner as usize];
    solution.vertices.push(Vec3::new(place.x.next_up(), place.y, place.z));
    solution.elements[0].corners[2] = solution.vertices.len() as u32 - 1;
    let mesh = Mesh::new(&solution);
    assert_eq!(
        (mesh.positions.len(), mesh.triangles.len()),
        (expected.positions.len(), expected.triangles.len())
    );
    assert_eq!(mesh.irradiance, expected.irradiance);
}

/// A wall stands between elements of the square that are lit and others that are not: no vertex has the light of both sides, also that in
/// the middle of an edge. The same holds where a narrow gap ends.
#[test]
fn vertices_are_not_shared_across_a_wall() {
    let wall = 0.5;
    let (_, mut solution) = square(|p| if p.x < wall { 1.0 } else { 0.0 });
    let values = |solution: &RadiosityMesh| -> Vec<f32> {
        let mesh = Mesh::new(solution);
        let at_wall = mesh.positions.iter().zip(&mesh.irradiance).filter(|(p, _)| p.x == wall);
        at_wall.map(|(_, e)| e[0]).collect()
    };
    let shared = values(&solution);
    assert!(shared.iter().any(|e| (e * (1.0 - e)).abs() > 1e-3), "{shared:?}");
    for element in &mut solution.elements {
        let x = element.corners.map(|v| solution.vertices[v as usize].x);
        let along = (0..4).filter(|k| x[*k] == wall && x[(k + 1) % 4] == wall);
        element.walls = along.map(|k| 1 << k).sum();
    }
    let check = |solution: &RadiosityMesh| {
        let apart = values(solution);
        assert!(apart.iter().any(|e| *e < 0.5) && apart.iter().any(|e| *e > 0.5), "{apart:?}");
        assert!(apart.iter().all(|e| (e * (1.0 - e)).abs() < 1e-5), "{apart:?}");
    };
    check(&solution);
    for element in &mut solution.elements {
        element.walls = 0;
        element.narrow = element.corners.iter().all(|v| solution.vertices[*v as usize].x >= wall);
    }
    check(&solution);
}

/// A wall cuts the upper left cell in two and passes so near to the corner of the lower left one that this is not cut: the dark elements
/// get nothing of its light at that corner, whether the wall lies along them or not.
#[test]
fn a_corner_that_reaches_through_a_wall_lights_no_vertex_behind_it() {
    let mut solution = RadiosityMesh::default();
    let places = [
        [0.0, 0.0],
        [0.5, 0.0],
        [0.5, 0.5],
        [0.0, 0.5],
        [0.498, 0.5],
        [0.448, 1.0],
        [0.0, 1.0],
        [0.5, 1.0],
        [1.0, 0.5],
        [1.0, 1.0],
    ];
    solution.vertices.extend(places.map(|[x, y]| Vec3::new(x, y, 0.0)));
    // The lower left cell, the lit and the dark part of the upper left one, and the upper right one.
    for (corners, light, walls) in [
        ([0, 1, 2, 3], 1.0, 0),
        ([3, 4, 5, 6], 1.0, 1 << 1),
        ([4, 2, 7, 5], 0.0, 1 << 3),
        ([2, 8, 9, 7], 0.0, 0),
    ] {
        let error = [0.01; 3];
        solution.elements.push(Element { error, walls, ..grey(corners, light, 0.1, 0) });
    }
    let mesh = Mesh::new(&solution);
    for (triangle, &e) in mesh.triangles.iter().zip(&mesh.element) {
        let light = triangle.map(|v| mesh.irradiance[v as usize][0]);
        let is_lit = solution.elements[e as usize].irradiance[0] > 0.0;
        assert!(light.iter().all(|&x| if is_lit { x > 0.5 } else { x == 0.0 }), "{e}: {light:?}");
    }
}

/// Light is not negative: where elements beside each other have none on average they have none anywhere, however uncertain they are.
#[test]
fn elements_without_light_are_black() {
    let (_, mut solution) = square(|p| f64::from(u8::from(p.x > 0.5)));
    solution.elements.iter_mut().for_each(|e| e.error = [0.3; 3]);
    let mesh = Mesh::new(&solution);
    let is_dark = |e: u32| solution.elements[e as usize].irradiance[0] == 0.0;
    let dark = mesh.triangles.iter().zip(&mesh.element).filter(|(_, e)| is_dark(**e));
    let light: Vec<f32> =
        dark.flat_map(|(triangle, _)| triangle.map(|v| mesh.irradiance[v as usize][0])).collect();
    assert!(!light.is_empty() && light.iter().all(|x| *x == 0.0), "{light:?}");
}

/// A wall hides what is behind it from its dark side, unless the picture looks inside.
#[test]
fn walls_are_opaque_from_outside_unless_pictures_look_inside() {
    let above = |look_inside| {
        let (_, mut two) = square(|_| 2.0);
        let count = two.vertices.len() as u32;
        let under: Vec<Vec3> = two.vertices.iter().map(|p| *p - Vec3::Z).collect();
        two.vertices.extend(under);
        let fronts = two.elements.clone();
        for (element, front) in two.elements.iter_mut().zip(&fronts) {
            // Turned over: lit from below.
            let [a, b, c, d] = front.corners;
            element.corners = [a, d, c, b];
        }
        let below = fronts.iter().map(|e| Element { corners: e.corners.map(|v| v + count), ..*e });
        two.elements.extend(below);
        let mesh = Mesh::new(&two);
        let stage = Stage::new(&mesh, &two).expect("a stage").looking_inside(look_inside);
        render(&stage, &camera(1.0), [21, 15], 1, &()).first[7 * 21 + 10].map(|f| f.distance)
    };
    assert!(above(false).is_none() && above(true).is_some_and(|t| (t - 2.0).abs() < 0.01));
}

/// Beside the edge of a shadow a plain wall is no brighter than its elements, nor darker in the shadow.
#[test]
fn shadows_have_no_bright_outline() {
    let count = 8u32;
    let mut solution = RadiosityMesh::default();
    let at = |k: u32| Vec3::new((k % (count + 1)) as f32, (k / (count + 1)) as f32, 0.0);
    solution.vertices.extend((0..(count + 1).pow(2)).map(at));
    for (column, row) in (0..count).flat_map(|row| (0..count).map(move |column| (column, row))) {
        let first = row * (count + 1) + column;
        let corners = [first, first + 1, first + count + 2, first + count + 1];
        solution.elements.push(grey(corners, if column + row / 3 < 4 { 1.0 } else { 10.0 }, 1.0, 0));
    }
    let mesh = Mesh::new(&solution);
    let is_inside = |p: &Vec3| [p.x, p.y].iter().all(|x| (0.5..count as f32 - 0.5).contains(x));
    let lights = mesh.positions.iter().zip(&mesh.irradiance).filter(|(p, _)| is_inside(p));
    let lights: Vec<f32> = lights.map(|(_, e)| e[0]).collect();
    assert!(lights.len() >= 49 && lights.iter().all(|e| (0.999..10.001).contains(e)), "{lights:?}");
}
