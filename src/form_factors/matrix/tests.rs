use super::rays::Traced;
use super::*;
use crate::embree::Hits;
use crate::form_factors::analytic::polygon_to_polygon;
use crate::form_factors::testing::{obstructed, opposed_rectangles, quad, unobstructed};
use crate::model::{Detail, testing::model};
use crate::ray::Packet;
use crate::scene::Scene;
use crate::scene::generate::{Spec, build};
use crate::scene::testing::{Pieces, on_threads};
use glam::{DVec3, dvec3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::io::Read;

fn quads(list: &[(DVec3, DVec3, DVec3)]) -> Scene {
    let mut pieces = Pieces::empty();
    for (i, &(corner, u, v)) in list.iter().enumerate() {
        pieces.grey(&format!("quad {i}"), 0.5).rectangle(corner, u, v);
    }
    pieces.scene()
}

impl FormFactors {
    fn get(&self, from: usize, to: usize) -> f64 {
        f64::from(self.factor(from, to))
    }
}

fn run(scene: &Scene, change: impl FnOnce(&mut Settings)) -> (FormFactors, Report) {
    let facets = Facets::new(scene);
    let mut settings = Settings::new(facets.count());
    change(&mut settings);
    compute(&model(scene, Detail::Rays), &facets, &settings, &()).expect("a matrix")
}

fn town(count: usize) -> Scene {
    build(&Spec { count: Some(count), ..Spec::new("urban-block") }).expect("a town")
}

fn near(got: f64, want: f64, relative: f64, what: &str) {
    assert!((got - want).abs() <= relative * want.abs() + 1e-12, "{what}: {got} instead of {want}");
}

#[test]
fn polygons_that_see_all_of_each_other_have_closed_forms() {
    // A floor, a wall, and a roof over the floor.
    let scene = quads(&[
        (DVec3::ZERO, 2.0 * DVec3::X, DVec3::Y),
        (DVec3::ZERO, DVec3::Y, 1.5 * DVec3::Z),
        (1.5 * DVec3::Z, DVec3::Y, 2.0 * DVec3::X),
    ]);
    let (m, report) = run(&scene, |_| ());
    assert_eq!(m.len(), 3, "a quad is one facet");
    let (floor, wall) =
        (quad(DVec3::ZERO, 2.0 * DVec3::X, DVec3::Y), quad(DVec3::ZERO, DVec3::Y, 1.5 * DVec3::Z));
    near(m.get(0, 1), polygon_to_polygon(&floor, &wall), 1e-6, "floor");
    near(m.get(1, 0) * 1.5, m.get(0, 1) * 2.0, 1e-6, "reciprocity");
    near(m.get(1, 0), m.get(1, 2), 1e-6, "symmetry");
    // The rest escapes, as measured by discovery rays.
    assert!(report.row_sum_error < 2e-3, "{}", report.row_sum_error);
    assert_eq!((report.closed_rows, report.closure_steps > 1), (0, false), "open rows are left alone");
}

#[test]
fn published_obstructed_pairs_at_default_settings() {
    let plates = |low: DVec3, u: f64| {
        quads(&[
            (DVec3::ZERO, DVec3::X, DVec3::Y),
            (DVec3::Z, DVec3::Y, DVec3::X),
            (low, u * DVec3::X, u * DVec3::Y),
            (low, u * DVec3::Y, u * DVec3::X),
        ])
    };
    let (shapiro, _) = run(&plates(dvec3(0.25, 0.25, 0.75), 0.5), |_| ());
    let facing = |quantity| obstructed("facet_shapiro", quantity);
    near(shapiro.get(1, 0), facing("F(y=1 -> y=0)"), 5e-3, "blocked");
    near(shapiro.get(3, 0), facing("F(obstruction side facing y=0 -> y=0)"), 1e-3, "below");
    near(shapiro.get(2, 1), facing("F(obstruction side facing y=1 -> y=1)"), 1e-3, "above");
    let (corner, _) = run(&plates(dvec3(0.0, 0.0, 0.5), 0.5), |_| ());
    near(corner.get(0, 1), obstructed("view3d_square_obstruction", "F(z=0 -> z=1)"), 5e-3, "corner");
    let (centred, _) = run(&plates(dvec3(0.25, 0.25, 0.5), 0.5), |_| ());
    near(centred.get(0, 1), obstructed("centred_half_obstruction", "F12"), 5e-3, "centred");
    let (all, _) = run(&plates(dvec3(-0.1, -0.1, 0.5), 1.2), |_| ());
    assert_eq!(all.get(0, 1), 0.0, "fully blocked");
}

/// A regular polygon at height `z` with the area of a disc; `up`: faces upwards.
fn disc(radius: f64, z: f64, up: bool) -> Vec<DVec3> {
    const SIDES: usize = 96;
    let step = TAU / SIDES as f64;
    let r = radius * (step / step.sin()).sqrt();
    let mut corners: Vec<DVec3> =
        (0..SIDES).map(|k| dvec3(r * (k as f64 * step).cos(), r * (k as f64 * step).sin(), z)).collect();
    if !up {
        corners.reverse();
    }
    corners
}

#[test]
fn coaxial_discs_of_the_published_suite() {
    let rows = unobstructed("coaxial-discs-");
    assert!(rows.len() >= 8, "{} cases", rows.len());
    for (id, [one, other, ..], want) in rows {
        let mut pieces = Pieces::empty();
        pieces.grey("one", 0.0).polygon(&disc(one, 0.0, true));
        pieces.object("other").polygon(&disc(other, 1.0, false));
        let scene = pieces.scene();
        let (facets, (matrix, _)) = (Facets::new(&scene), run(&scene, |_| ()));
        let factors = by_groups(matrix, &scene, &facets, Grouping::Object, &()).unwrap();
        near(factors.get(0, 1), want, 1e-3, &id);
    }
}

#[test]
fn a_town_under_the_sky_is_closed() {
    let scene = town(120);
    let (raw, report) = run(&scene, |s| (s.enforce, s.rays) = (false, 512));
    assert_eq!((report.closed_rows, report.bad_facets), (raw.len(), 0), "{report:?}");
    assert!(report.row_sum_error < 0.02, "{}", report.row_sum_error);
    // The error decreases with the number of rays.
    let (truth, fine) = run(&scene, |s| (s.enforce, s.rays) = (false, 8192));
    assert!(
        fine.row_sum_error < 0.4 * report.row_sum_error,
        "{} {}",
        fine.row_sum_error,
        report.row_sum_error
    );
    let (closed, report) = run(&scene, |s| s.rays = 512);
    assert!(report.closed_row_sum_error < 1e-6 && report.reciprocity_residual < 1e-6, "{report:?}");
    let worst = (0..closed.len()).map(|i| (closed.row_sum(i) - 1.0).abs()).fold(0.0, f64::max);
    assert!(worst < 3e-3, "{worst}: only stray rays are missing");
    assert!((0..closed.len()).all(|i| closed.entries(i).all(|(j, f)| j != i && f > 0.0 && f < 1.0)));
    // Compared with many more rays, the adjusted matrix is at least as accurate as the unadjusted one.
    let distance = |m: &FormFactors| -> f64 {
        (0..m.len()).map(|i| (0..m.len()).map(|j| (m.get(i, j) - truth.get(i, j)).powi(2)).sum::<f64>()).sum()
    };
    assert!(distance(&closed) <= 1.05 * distance(&raw));
}

#[test]
fn a_room_cut_into_facets_has_sums_of_closed_forms() {
    // No occlusion: row sums deviate only by the error of closed forms, between touching and distant squares.
    let n = 12;
    let (x, y, z) = (10.0 * DVec3::X, 8.0 * DVec3::Y, 5.0 * DVec3::Z);
    let zero = DVec3::ZERO;
    let mut list = Vec::new();
    for (corner, u, v) in [(zero, x, y), (z, y, x), (zero, z, x), (y, x, z), (zero, y, z), (x, z, y)] {
        for k in 0..n * n {
            let (u, v) = (u / f64::from(n), v / f64::from(n));
            list.push((corner + u * f64::from(k % n) + v * f64::from(k / n), u, v));
        }
    }
    let (m, report) = run(&quads(&list), |s| s.enforce = false);
    assert_eq!(report.entries, m.len() * (m.len() - (n * n) as usize), "each sees all but its own wall");
    assert!(report.worst_row_sum_error < 5e-4 && report.row_sum_error < 1e-4, "{report:?}");
}

/// Form factors of one facet by counting hits of its rays: independent random points and directions, without closed
/// forms and transmittances.
fn counted(scene: &Scene, i: u32, rays: u64) -> Vec<f64> {
    let facets = Facets::new(scene);
    let traced = Traced::new(&model(scene, Detail::Rays));
    let mut counts = vec![0.0; facets.count()];
    let from = facets.get(i);
    let mut random = (0u64..)
        .map(|k| (crate::math::sampling::mix(k ^ u64::from(i) << 40) >> 40) as f32 / (1 << 24) as f32);
    let mut next = || random.next().expect("endless");
    for _ in 0..rays / 16 {
        let mut packet = Packet::EMPTY;
        for lane in 0..16 {
            let (point, k) = from.point(next(), next());
            let normal = from.normals[k].as_vec3();
            let (x, y) = normal.any_orthonormal_pair();
            let (s, (sin, cos)) = (next(), (std::f32::consts::TAU * next()).sin_cos());
            packet.set_ray(
                lane,
                from.end.lifted(point, normal),
                (x * cos + y * sin) * s.sqrt() + normal * (1.0 - s).sqrt(),
            );
        }
        let mut hits = [Hits::NONE];
        traced.first_hits(&[packet], &mut hits);
        for t in hits[0].triangle {
            counts[facets.of_triangle(t) as usize] += 1.0 / rays as f64;
        }
    }
    counts
}

#[test]
fn single_factors_agree_with_counting() {
    let scene = town(900);
    let rays = 1 << 19;
    let (tried, report) = run(&scene, |s| s.enforce = false);
    assert!(report.row_sum_error < 1e-3, "{report:?}");
    let (found, _) = run(&scene, |s| (s.enforce, s.every) = (false, false));
    let rows: Vec<usize> = (0..tried.len()).step_by(tried.len() / 7).collect();
    let counts: Vec<_> = rows.iter().map(|&i| counted(&scene, i as u32, rays)).collect();
    // Sum of squared differences minus the variance of counting (binomial).
    let excess = |m: &FormFactors| -> f64 {
        let of_row = |(&i, counts): (&usize, &Vec<f64>)| -> f64 {
            let excess = |(j, n): (usize, &f64)| (m.get(i, j) - n).powi(2) - n * (1.0 - n) / rays as f64;
            counts.iter().enumerate().map(excess).sum()
        };
        rows.iter().zip(&counts).map(of_row).sum()
    };
    let (tried, found) = (excess(&tried), excess(&found));
    assert!(tried < found, "trying every pair is better than finding them: {tried} {found}");
}

#[test]
fn what_is_found_by_chance_is_right_in_the_mean() {
    // Enough rays to find most pairs, most of them partly hidden: sums over all rows are the most sensitive to bias.
    let scene = town(900);
    for rays in [1024, 4096] {
        let (m, report) = run(&scene, |s| (s.enforce, s.every, s.rays) = (false, false, rays));
        let total: f64 = m.areas.iter().sum();
        let sums: f64 = (0..m.len()).map(|i| m.areas[i] * (m.row_sum(i) + f64::from(m.escaped[i]))).sum();
        assert!((sums / total - 1.0).abs() < 5e-4, "{rays}: {}", sums / total - 1.0);
        assert!(report.row_sum_error < 2.0 * report.row_standard_error, "{report:?}");
    }
}

#[test]
fn groups_are_sums_of_their_facets() {
    let scene = town(80);
    let facets = Facets::new(&scene);
    let (m, _) = run(&scene, |_| ());
    for by in [Grouping::Object, Grouping::Material] {
        let g = by_groups(m.clone(), &scene, &facets, by, &()).unwrap();
        let total: f64 = (0..m.len()).map(|i| m.areas[i] * m.row_sum(i)).sum();
        let summed: f64 = (0..g.len()).map(|i| g.areas[i] * g.row_sum(i)).sum();
        near(summed, total, 1e-6, "exchange in all");
        let sky = g.names.iter().position(|n| n == "light").expect("the sky");
        for i in 0..g.len() {
            near(g.get(sky, i) * g.areas[sky], g.get(i, sky) * g.areas[i], 1e-5, "reciprocity");
        }
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let scene = town(60);
    let on = |threads| on_threads(threads, || run(&scene, |_| ()).0);
    assert_eq!(on(1), on(3));
}

#[test]
fn facets_that_face_the_wrong_way_are_named() {
    // Two parallel faces that both look up: flux from the lower one falls on the back of the upper one.
    let scene = quads(&[(DVec3::ZERO, DVec3::X, DVec3::Y), (0.1 * DVec3::Z, DVec3::X, DVec3::Y)]);
    let (m, report) = run(&scene, |_| ());
    assert_eq!(report.entries, 0);
    assert_eq!(report.bad_facets, 1);
    assert!(report.bad[0].0 == 0 && report.bad[0].1.starts_with("of `"), "{:?}", report.bad);
    assert!(report.bad[0].1.contains("back sides"), "{:?}", report.bad);
    assert!(m.lost[0] > 0.8 && m.escaped[1] == 1.0, "{:?} {:?}", m.lost, m.escaped);
}

#[test]
fn settings_out_of_range_and_memory() {
    let scene = quads(&[(DVec3::ZERO, DVec3::X, DVec3::Y)]);
    let facets = Facets::new(&scene);
    let none = Settings { rays: 0, ..Settings::new(1) };
    assert!(compute(&model(&scene, Detail::Rays), &facets, &none, &()).is_err());
    // 22,000 facets fit in 2 GiB with default settings.
    assert!(memory_bound(22_000, &Settings::new(22_000)) < 2 << 30);
    assert!(Format::of(std::path::Path::new("a.txt")).is_err());
}

#[test]
fn files_hold_the_matrix() {
    let scene = town(100);
    let facets = Facets::new(&scene);
    let m = by_groups(run(&scene, |_| ()).0, &scene, &facets, Grouping::Material, &()).unwrap();
    let (rows, mtx, archive) = files(&m, None);
    assert_eq!((rows[0].as_str(), rows.len()), ("from,to,factor", 1 + m.columns.len()));
    let entry: Vec<&str> = rows[1].split(',').collect();
    assert_eq!(entry[0], m.names[0]);
    assert_eq!(entry[2].parse::<f32>().expect("a number"), m.factors[0]);
    let size = format!("{0} {0} {1}", m.len(), m.columns.len());
    assert!(mtx.starts_with("%%MatrixMarket matrix coordinate real general\n") && mtx.contains(&size));
    let data = &archive["data.npy"];
    assert!(data.starts_with(b"\x93NUMPY\x01\x00"));
    let header = u16::from_le_bytes([data[8], data[9]]) as usize;
    assert_eq!((10 + header) % 64, 0);
    let said = String::from_utf8_lossy(&data[10..10 + header]).into_owned();
    assert!(said.contains("'<f4'") && said.contains(&format!("({},)", m.factors.len())), "{said}");
    let values: Vec<f32> = data[10 + header..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().expect("four")))
        .collect();
    assert_eq!(values, m.factors);
    for name in ["indices", "indptr", "shape", "format", "area", "escaped", "lost", "names"] {
        assert!(archive.contains_key(&format!("{name}.npy")), "{name}");
    }
}

/// The matrix in files of all formats: lines of CSV, MatrixMarket, and names and contents of the members of an archive, whose sums are
/// right.
fn files(m: &FormFactors, labels: Option<&Labels>) -> (Vec<String>, String, BTreeMap<String, Vec<u8>>) {
    let folder = tempfile::tempdir().expect("scratch folder");
    let written = |name: &str, format| {
        let path = folder.path().join(name);
        assert_eq!(Format::of(&path).expect("known"), format);
        write(&path, m, format, labels).expect("written");
        std::fs::read(&path).expect("a file")
    };
    let [csv, mtx] = [written("f.csv", Format::Csv), written("f.mtx", Format::Mtx)]
        .map(|bytes| String::from_utf8(bytes).expect("text"));
    let archive = rawzip::ZipArchive::from_slice(written("f.npz", Format::Npz)).expect("an archive");
    let mut entries = archive.entries();
    let mut found = BTreeMap::new();
    while let Some(entry) = entries.next_entry().expect("a member") {
        let file = archive.get_entry(entry.wayfinder()).expect("content");
        let mut bytes = Vec::new();
        file.verifying_reader(file.data()).read_to_end(&mut bytes).expect("right sums");
        found.insert(String::from_utf8(entry.file_path().as_bytes().to_vec()).expect("a name"), bytes);
    }
    (csv.lines().map(str::to_owned).collect(), mtx, found)
}

/// Facets have numbers; their objects and materials are in the files as well.
#[test]
fn files_name_the_objects_of_facets() {
    let scene = town(100);
    let facets = Facets::new(&scene);
    let (m, labels) = (run(&scene, |_| ()).0, facets.labels(&scene));
    let (rows, mtx, archive) = files(&m, Some(&labels));
    assert_eq!(rows[0], "from,to,factor,from_object,to_object");
    let fields: Vec<&str> = rows[1].split(',').collect();
    let facet: usize = fields[0].parse().expect("a number");
    let object = &scene.objects[scene.triangle_object[facets.triangle(facet)] as usize].name;
    assert_eq!(fields[3], object);
    assert!(mtx.contains(&format!("% {} {object}\n", facet + 1)));
    for name in ["object", "object_names", "material", "material_names"] {
        assert!(archive.contains_key(&format!("{name}.npy")), "{name}");
    }
}

mod curved;
