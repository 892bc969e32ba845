//! Objects and nodes that options move.

use super::instances::{file, orchard, read_with};
use super::*;
use glam::DAffine3;
use std::f64::consts::SQRT_2;

/// Two squares that share an edge at x = 1: `a` is on the left, `b` on the right.
const SQUARES: &str =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\no a\nf 1 2 3 4\no b\nf 2 5 6 3\n";

fn moved(text: &str, moves: &[&str], up: Option<UpAxis>) -> Result<Scene> {
    let moves = moves.iter().map(|m| Move::parse(m)).collect::<Result<_>>()?;
    load_with(text, &[], &LoadOptions { moves, up, ..LoadOptions::default() })
}

/// Corners of the object, absolute coordinates, sorted.
fn corners(scene: &Scene, name: &str) -> Vec<[f64; 3]> {
    let faces = scene.faces_named(name).expect("an object");
    let vertices = faces.iter().flat_map(|&t| scene.triangles[t as usize]);
    let mut all: Vec<[f64; 3]> =
        vertices.map(|v| (scene.origin + scene.positions[v as usize].as_dvec3()).to_array()).collect();
    all.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
    all.dedup();
    all
}

fn close(a: &[[f64; 3]], b: &[[f64; 3]]) -> bool {
    a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(x, y)| (x - y).abs() < 1e-6)
}

#[test]
fn moved_objects_leave_their_neighbours_in_place() {
    let scene = moved(SQUARES, &["b=0.5,0,0.25", "b=0,1,0"], None).expect("a scene");
    let left = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let right = [[1.5, 1.0, 0.25], [1.5, 2.0, 0.25], [2.5, 1.0, 0.25], [2.5, 2.0, 0.25]];
    assert!(close(&corners(&scene, "a"), &left), "{:?}", corners(&scene, "a"));
    assert!(close(&corners(&scene, "b"), &right), "{:?}", corners(&scene, "b"));
}

#[test]
fn objects_turn_about_their_centres() {
    let scene = moved(SQUARES, &["a=0,0,2,45"], Some(UpAxis::Z)).expect("a scene");
    let reach = SQRT_2 / 2.0;
    let want =
        [[0.5 - reach, 0.5, 2.0], [0.5, 0.5 - reach, 2.0], [0.5, 0.5 + reach, 2.0], [0.5 + reach, 0.5, 2.0]];
    assert!(close(&corners(&scene, "a"), &want), "{:?}", corners(&scene, "a"));
    // A quarter turn about y takes +x to -z.
    let scene = moved(SQUARES, &["b=0,0,0,90"], Some(UpAxis::Y)).expect("a scene");
    let want = [[1.5, 0.0, -0.5], [1.5, 0.0, 0.5], [1.5, 1.0, -0.5], [1.5, 1.0, 0.5]];
    assert!(close(&corners(&scene, "b"), &want), "{:?}", corners(&scene, "b"));
}

/// Instances, also mirrored and scaled ones, move as their copies do.
#[test]
fn instances_move_as_their_triangles() {
    let file = file(orchard());
    let load = |moves: &[&str]| {
        let moves = moves.iter().map(|m| Move::parse(m).expect("a move")).collect();
        let scene = read_with(&file, &LoadOptions { moves, ..LoadOptions::default() }).expect("a scene");
        let place = |name: &str| {
            let found = scene.placements.iter().find(|p| p.name == name).expect("an instance");
            DAffine3::from_translation(scene.origin) * found.transform
        };
        ["oak", "elm", "mirrored"].map(place)
    };
    let [oak, elm, mirrored] = load(&[]);
    let [moved_oak, moved_elm, moved_mirrored] = load(&["elm=1,2,3", "mirrored=0,0,1,180"]);
    assert!(moved_oak.abs_diff_eq(oak, 1e-9));
    assert_eq!(moved_elm.matrix3, elm.matrix3);
    assert!((moved_elm.translation - elm.translation - glam::DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    // A half turn about the y axis of glTF, twice, is none.
    assert!(moved_mirrored.matrix3.x_axis.x * mirrored.matrix3.x_axis.x < 0.0);
    let [.., twice] = load(&["mirrored=0,0,0,180", "mirrored=0,0,0,180"]);
    assert!(twice.abs_diff_eq(mirrored, 1e-9), "{twice:?}");
}

#[test]
fn wrong_moves_are_refused() {
    for text in ["", "a", "a=", "a=1", "a=1,2", "a=1,2,3,4,5", "a=1,2,x", "a=1,2,inf", "a=nan,0,0", "=1,2,3"]
    {
        let refused = Move::parse(text).expect_err(text).to_string();
        assert!(refused.contains("NAME=X,Y,Z") && refused.contains(text), "{refused}");
    }
    assert_eq!(Move::parse("a=b=1, 2,3").expect("a move"), Move::parse("a=b=1,2,3,0").expect("a move"));
    let unknown = moved(SQUARES, &["c=1,2,3"], None).expect_err("no such object").to_string();
    assert!(unknown.contains("called `c`") && unknown.contains("`a`"), "{unknown}");
    let turned = moved(SQUARES, &["a=1,2,3,4"], None).expect_err("no upward axis").to_string();
    assert!(turned.contains("`up`"), "{turned}");
    assert!(moved(SQUARES, &["a=1e300,0,0"], None).is_err());
}
