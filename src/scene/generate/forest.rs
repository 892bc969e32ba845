//! An orchard of leaf crowns under an overcast sky panel.

use super::{
    Spec,
    shapes::{Builder, Random},
};
use crate::{
    Result,
    scene::{PlacedSoup, Placement, Soup},
};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::PI;

/// Mean radius of a crown, metres; radii of trees vary by 15 %.
const RADIUS: f64 = 2.0;
/// Ratio of a crown's height to its width.
const SLENDERNESS: f64 = 1.2;
/// Grid spacing in mean radii. The radii of neighbours add up to 2 on average, so that crowns rarely touch and the
/// ground has lit and shaded parts. Part of the definition of the scene.
const SPACING: f64 = 2.4;
/// Height of the lowest leaves, metres.
const CLEAR_HEIGHT: f64 = 2.0;
/// Scales of the trees of a species.
const MIN_SCALE: f64 = 0.8;
const MAX_SCALE: f64 = 1.25;
/// Optical depth of a crown along the vertical through its middle.
const OPTICAL_DEPTH: f64 = 1.5;

/// Edge (in the unit of `radius`) of the square leaves of a crown whose optical depth does not depend on their number.
///
/// κ = Σ 2A/(4V) for two-sided leaves (docs/method.md, Extinction) = M a²/(2V). With V = 4/3 π R² H and a chord of 2H
/// the optical depth is κ 2H = 3 M a² / (4 π R²), so a = R sqrt(4 π OD / (3 M)).
pub fn leaf_side(radius: f64, leaves: usize) -> f64 {
    radius * (4.0 * PI * OPTICAL_DEPTH / (3.0 * leaves as f64)).sqrt()
}

/// Edge of the ground of a forest with `trees` trees, and height of the sky panel above the ground; metres.
///
/// The panel is as wide as the forest and distant: overcast sky without grazing directions.
pub fn ground_and_sky(trees: usize) -> (f64, f64) {
    let width = (trees as f64).sqrt().ceil() * SPACING * RADIUS;
    (width, 1.25 * width + CLEAR_HEIGHT + 2.0 * SLENDERNESS * RADIUS)
}

pub(super) fn forest(spec: &Spec) -> Result<Soup> {
    let (mut b, mut random) = (Builder::new("forest"), Random::new(spec.seed));
    ground(&mut b, spec);
    b.soup.positions.reserve(4 * spec.trees * spec.leaves);
    for i in 0..spec.trees {
        let foot = foot(&mut random, spec, i);
        let radius = RADIUS * random.between(0.85, 1.15);
        b.object(tree_name(i));
        tree(&mut b, &mut random, foot, radius, spec);
    }
    sky(&mut b, spec);
    Ok(b.soup)
}

/// A forest of `spec.species` meshes of one tree each: every tree is one of them, turned about the vertical and scaled.
/// Matrices are rounded to f32, which is what files hold.
pub(super) fn placed(spec: &Spec) -> PlacedSoup {
    let (mut b, mut random) = (Builder::new("forest"), Random::new(spec.seed));
    ground(&mut b, spec);
    sky(&mut b, spec);
    let mut meshes = Vec::new();
    for i in 0..spec.species {
        let name = format!("species {}", i + 1);
        let mut mesh = Builder::new(&format!("forest#{name}"));
        let radius = RADIUS * random.between(0.85, 1.15);
        mesh.soup.positions.reserve(4 * spec.leaves);
        mesh.object(name);
        tree(&mut mesh, &mut random, DVec3::ZERO, radius, spec);
        meshes.push(mesh.soup);
    }
    let mut place = |i: usize| {
        let mesh = (random.unit() * spec.species as f64) as u32;
        let turn = DMat3::from_rotation_z(random.between(0.0, 2.0 * PI));
        let scale = random.between(MIN_SCALE, MAX_SCALE);
        let transform = DAffine3::from_mat3_translation(turn * scale, foot(&mut random, spec, i));
        Placement { mesh, transform, name: tree_name(i), material: None, visible: true }
    };
    let placements = (0..spec.trees).map(&mut place).collect();
    PlacedSoup { soup: b.soup, meshes, placements }
}

fn tree_name(i: usize) -> String {
    format!("tree {}", i + 1)
}

fn ground(b: &mut Builder, spec: &Spec) {
    let (width, _) = ground_and_sky(spec.trees);
    b.object("ground").material("ground", [0.25, 0.22, 0.18]);
    b.rectangle(DVec3::ZERO, width * DVec3::X, width * DVec3::Y);
}

fn sky(b: &mut Builder, spec: &Spec) {
    let (width, height) = ground_and_sky(spec.trees);
    let size = spec.light_size.unwrap_or(width);
    // Clockwise from above: the panel faces down.
    b.light(height * DVec3::Z, size * DVec3::Y, size * DVec3::X, 30.0);
}

/// Where tree `i` stands: on a grid, moved by up to a tenth of its spacing.
fn foot(random: &mut Random, spec: &Spec, i: usize) -> DVec3 {
    let rows = (spec.trees as f64).sqrt().ceil();
    let spacing = SPACING * RADIUS;
    let (width, _) = ground_and_sky(spec.trees);
    let (row, column) = ((i as f64 / rows).floor(), i as f64 % rows);
    let jitter = 0.1 * spacing * DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.0);
    let place = spacing * (DVec3::new(column, row, 0.0) + DVec3::new(0.5, 0.5, 0.0));
    place + jitter - 0.5 * DVec3::new(width, width, 0.0)
}

fn tree(b: &mut Builder, random: &mut Random, foot: DVec3, radius: f64, spec: &Spec) {
    let half = DVec3::new(radius, radius, SLENDERNESS * radius);
    let centre = foot + (CLEAR_HEIGHT + half.z) * DVec3::Z;
    if spec.trunks {
        b.material("bark", [0.15, 0.1, 0.07]);
        b.prism(foot, 0.06 * radius, CLEAR_HEIGHT + 0.5 * half.z, 8);
    }
    b.material("leaf", [0.08, 0.2, 0.05]);
    let side = leaf_side(radius, spec.leaves);
    for _ in 0..spec.leaves {
        let turn = random.rotation();
        b.rectangle(centre + half * random.in_ball(), side * turn.x_axis, side * turn.y_axis);
    }
}
