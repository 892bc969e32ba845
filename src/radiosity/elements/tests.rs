//! Elements tile their surfaces, ids nest, and points find their leaves.

use super::*;
use crate::clusters;
use crate::scene::{LoadOptions, Scene};
use glam::Vec3;

impl Elements {
    /// Whether `part` is `whole` or a part of `whole`.
    pub fn is_part_of(&self, part: u32, whole: u32) -> bool {
        let (part, whole) = (self.elements[part as usize].ids, self.elements[whole as usize].ids);
        whole[0] <= part[0] && part[1] <= whole[1]
    }
}

fn load(obj: &str, emitters: &[(&str, f64)]) -> Scene {
    let folder = tempfile::tempdir().expect("scratch folder");
    let path = folder.path().join("a.obj");
    std::fs::write(&path, obj).expect("written");
    let emitters =
        emitters.iter().map(|&(name, w)| (name.to_owned(), crate::scene::Strength::Watts(w))).collect();
    Scene::load_with(&path, &LoadOptions { emitters, ..LoadOptions::default() }).expect("a scene")
}

fn elements(obj: &str, min_area: f64) -> Elements {
    let scene = load(obj, &[]);
    Elements::build(&scene, &clusters::build(&scene, &Default::default()), min_area, &[])
}

/// A trapezoid, a triangle and a cube.
const MIXED: &str = "v 0 0 0\nv 4 0 0\nv 3 2 0\nv 1 2 0\nf 1 2 3 4\nv 5 0 0\nv 7 0 1\nv 6 2 0\nf 5 6 7\n\
    v 0 5 0\nv 1 5 0\nv 1 6 0\nv 0 6 0\nv 0 5 1\nv 1 5 1\nv 1 6 1\nv 0 6 1\n\
    f 8 11 10 9\nf 12 13 14 15\nf 8 9 13 12\nf 9 10 14 13\nf 10 11 15 14\nf 11 8 12 15\n";

fn divide_some(elements: &mut Elements) {
    let mut e = 0;
    while e < elements.len() as u32 {
        // Uneven: two thirds are split as far as it goes, and many of the others cut.
        if elements.can_open(e) && e % 3 != 1 {
            elements.split(e);
        } else if let (Shape::Surface { side, corners }, true) =
            (&elements.elements[e as usize].shape, e % 3 == 1)
        {
            // A wall that leans, through a place beside the centre.
            let middle = elements.elements[e as usize].centre.lerp(corners[0], 0.3);
            let turned = corners[1].lerp(corners[2], 0.1 * (e % 11) as f32);
            let above = middle + elements.sides[*side as usize].normal + 0.3 * (corners[1] - middle);
            elements.cut(e, &CutPlane::of([middle, turned, above]));
        }
        e += 1;
        if e > 3000 {
            break;
        }
    }
}

#[test]
fn sides_of_sheets_are_two_and_of_solids_one() {
    let elements = elements(MIXED, 0.01);
    // Two sheets from both sides, six faces of the cube from outside: no emitter is inside.
    assert_eq!(elements.sides.len(), 2 * 2 + 6);
    assert!(elements.sides.iter().filter(|s| s.triangles[0] != s.triangles[1]).count() == 2 + 6, "quads");
    let triangle = 0.5 * (Vec3::new(2.0, 0.0, 1.0).cross(Vec3::new(1.0, 2.0, 0.0))).length();
    let area = 2.0 * 6.0 + 2.0 * f64::from(triangle) + 6.0;
    assert!((elements.area - area).abs() < 1e-5, "{} {area}", elements.area);
}

#[test]
fn parts_tile_the_whole_and_ids_nest() {
    let mut elements = elements(MIXED, 0.01);
    divide_some(&mut elements);
    let cut = elements.elements.iter().filter(|e| e.is_irregular).count();
    assert!(elements.len() > 500 && cut > 100, "{} {cut}", elements.len());
    for (e, element) in elements.elements.iter().enumerate() {
        if !element.is_leaf() {
            let sum: f64 = element.child_range().map(|c| elements.elements[c].area).sum();
            assert!(
                (sum - element.area).abs() < 1e-5 * element.area.max(0.01),
                "{e}: {sum} {}",
                element.area
            );
        }
        for c in element.child_range() {
            assert!(elements.is_part_of(c as u32, e as u32) && !elements.is_part_of(e as u32, c as u32));
            assert_eq!(elements.elements[c].parent as usize, e);
        }
    }
    // Ids are disjoint unless one holds the other.
    let leaves: Vec<u32> =
        (0..elements.len() as u32).filter(|&e| elements.elements[e as usize].is_leaf()).collect();
    for pair in leaves.windows(2) {
        assert!(!elements.is_part_of(pair[0], pair[1]));
    }
}

#[test]
fn points_find_the_leaf_that_holds_them() {
    let mut elements = elements(MIXED, 0.01);
    divide_some(&mut elements);
    let lookup = Lookup::new(&elements);
    let mut found = 0;
    for (e, element) in elements.elements.iter().enumerate() {
        if let (Shape::Surface { side, corners }, true) = (&element.shape, element.is_leaf()) {
            // The middle, and a place near each corner.
            for corner in corners {
                for t in [0.0, 0.5, 0.9] {
                    let place = element.centre.lerp(*corner, t);
                    assert_eq!(lookup.leaf(*side, place) as usize, e, "{place}");
                    found += 1;
                }
            }
        }
    }
    assert!(found > 1000);
}

#[test]
fn light_reaches_the_inside_of_what_holds_an_emitter() {
    // A cube wound outward around a lamp, and one without.
    let lamp = "v 0.4 5.4 0.5\nv 0.6 5.4 0.5\nv 0.5 5.6 0.5\no lamp\nf 16 17 18\n";
    let scene = load(&format!("{MIXED}{lamp}"), &[("lamp", 1.0)]);
    let elements = Elements::build(&scene, &clusters::build(&scene, &Default::default()), 0.01, &[]);
    let inward = elements.sides.iter().filter(|s| s.triangles[0] != s.triangles[1] && !s.front).count();
    // The six faces of the cube and the back of the trapezoid.
    assert_eq!(inward, 7);
}

#[test]
fn samples_prefer_what_faces_and_leave_nothing_out() {
    let elements = elements(MIXED, 0.01);
    let root = &elements.clusters[0];
    let towards = Vec3::new(0.3, -0.2, 0.93).normalize();
    // The mean of 1 / density is the area: the density is that of the draws.
    let (mut sum, n) = (0.0, 200);
    for i in 0..n {
        for j in 0..n {
            let (u, v) = ((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32);
            let side = elements.samples().pick(root, towards, u, v);
            sum += 1.0
                / f64::from(elements.samples().density(root, towards, elements.sides[side as usize].normal));
        }
    }
    let mean = sum / f64::from(n * n);
    assert!((mean / elements.area - 1.0).abs() < 0.02, "{mean} {}", elements.area);
}

#[test]
fn a_solid_that_light_enters_has_two_sides() {
    let scene = load(MIXED, &[]);
    let hierarchy = clusters::build(&scene, &Default::default());
    // The cube's faces come last.
    let triangle = scene.triangles.len() as u32 - 1;
    let cube: Vec<u32> = (0..=triangle)
        .filter(|&t| scene.triangle_component[t as usize] == scene.triangle_component[triangle as usize])
        .collect();
    let bounds = crate::math::Aabb::of(cube.iter().flat_map(|&t| scene.corners(t)));
    let outside = bounds.max + 0.1 * (bounds.max - bounds.min);
    let sides = |rays: &[DarkSideHit]| {
        Elements::build(&scene, &hierarchy, 0.01, &lit_inside(&scene, rays)).sides.len()
    };
    let ray = |from, emits| DarkSideHit { triangle, from, emits };
    let (within, beyond) = (ray(bounds.center(), false), ray(outside, false));
    // What starts inside is dark, unless it is a lamp; some of the rays may be.
    assert_eq!(sides(&[within; 20]), sides(&[]));
    assert_eq!(sides(&[within, beyond, within]), sides(&[]) + 6);
    assert_eq!(sides(&[ray(bounds.center(), true)]), sides(&[]) + 6);
}

#[test]
fn parts_lie_in_faces_that_are_bent_a_little() {
    // A file that rounds to a thousandth, a corner up and a corner down.
    for lift in [5e-4, -5e-4] {
        let text = format!("v 0 0 0\nv 1 0 0\nv 1 1 {lift}\nv 0 1 0\nf 1 2 3 4\n");
        let (mut elements, scene) = (elements(&text, 1e-3), load(&text, &[]));
        assert!(elements.sides.len() == 2 && elements.sides[0].triangles == [0, 1], "one quad of two sides");
        divide_some(&mut elements);
        let off_face = |p: Vec3| {
            let off = |t: u32| {
                let [a, b, c] = scene.corners(t);
                let n = (b - a).cross(c - a).normalize();
                let inside =
                    [(a, b), (b, c), (c, a)].iter().all(|(p0, p1)| (*p1 - *p0).cross(p - *p0).dot(n) > -1e-6);
                if inside { n.dot(p - a).abs() } else { f32::MAX }
            };
            off(0).min(off(1))
        };
        for element in elements.elements.iter() {
            let Shape::Surface { corners: c, .. } = element.shape else { continue };
            for p in [c[0], c[1], c[2], c[3], 0.5 * (c[0] + c[2]), (c[0] + c[1] + c[2]) / 3.0] {
                assert!(off_face(p) < 1e-6, "{lift} {p} {}", off_face(p));
            }
        }
    }
}
