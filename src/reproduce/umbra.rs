//! Umbra against the position of the blocker: Figures 5 and 6 of the paper.

use super::blocks::Blocks;
use super::bsize::{PIXELS, sizes};
use super::item::{Item, Panel, Table, VISIBLE};
use super::shadow::Wall;
use super::{Context, fixed};
use crate::Result;
use crate::metrics::{Image, Morphology};
use crate::model::{Model, PrepareOptions};
use crate::plot::{Marks, Plot, PlotPoint, Series};
use crate::raster::{BitImage, Opener};
use glam::{DVec3, Vec3};

/// Distance between emitter and receiver, metres.
const DISTANCE: f64 = 4.0;
/// Side of the receiver, metres: wider than every penumbra.
const RECEIVER: f64 = 6.4;

/// A square emitter of width `e` above the middle of a floor.
fn light(blocks: &mut Blocks, e: f64) {
    blocks.rectangle(DVec3::new(0.0, 0.0, DISTANCE), e * DVec3::Y, e * DVec3::X, true);
}

fn floor(texels: usize) -> Wall {
    let texel = RECEIVER / texels as f64;
    Wall { centre: DVec3::ZERO, right: DVec3::X, up: DVec3::Y, columns: texels, rows: texels, texel }
}

/// Points of the emitter, its border included.
fn lattice(e: f64, n: usize) -> Vec<DVec3> {
    let at = |i: usize| e * (i as f64 / (n - 1) as f64 - 0.5);
    (0..n * n).map(|i| DVec3::new(at(i % n), at(i / n), DISTANCE)).collect()
}

/// Width of the umbra on the receiver, b + (b − e) d2/d1, and of the penumbra's outline; docs/method.md, Umbra criterion.
fn formula(e: f64, b: f64, d1: f64) -> [f64; 2] {
    let d2 = DISTANCE - d1;
    [b + (b - e) * d2 / d1, b + (b + e) * d2 / d1]
}

/// Texels by which the number of centres inside a width may differ from the width; rounded up for widths that end at centres.
const COUNTED: f64 = 1.01;

/// Number of texels on the middle row that a predicate holds for, times their side.
fn width_on_middle_row(image: &Image, holds: impl Fn(f32) -> bool) -> f64 {
    let row = image.height() / 2;
    (0..image.width()).filter(|&x| holds(image.at(x, row))).count() as f64 * image.texel()
}

/// The shadow of a square of width `b` at a distance `d1` from an emitter of width `e`.
fn square_shadow(context: &Context, wall: &Wall, (e, b, d1): (f64, f64, f64)) -> Result<Image<'static>> {
    let mut blocks = Blocks::new("umbra");
    blocks.rectangle(DVec3::ZERO, RECEIVER * DVec3::X, RECEIVER * DVec3::Y, false);
    blocks.rectangle(DVec3::new(0.0, 0.0, DISTANCE - d1), b * DVec3::X, b * DVec3::Y, false);
    light(&mut blocks, e);
    let model = Model::prepare(blocks.scene()?, &rays(), context.progress)?;
    wall.grid(&model).sees(&lattice(e, 17))
}

/// Figure 5: a square blocker between a square emitter and a floor.
pub fn figure_5(context: &Context) -> Result<Item> {
    let texels = if context.small { 65 } else { 129 };
    let mut item = Item {
        here: format!(
            "A square emitter of width e, {DISTANCE} m above a floor, and a square blocker of width b at a distance d1 from the \
             emitter; umbra and penumbra are counted on the middle row of {texels} texels of {} m, each of which sees 289 points \
             of the emitter, border and corners included.",
            fixed(RECEIVER / texels as f64, 3)
        ),
        ..Item::default()
    };
    let positions: &[f64] = if context.small { &[1.0, 2.0, 3.0] } else { &[1.0, 1.5, 2.0, 2.5, 3.0] };
    let mut plot = Plot {
        x_label: "distance d1 of the blocker from the emitter, m".into(),
        y_label: "width of the umbra, m".into(),
        ..Plot::default()
    };
    let mut table =
        Table::new("Widths in metres", &["case", "d1", "umbra", "formula", "penumbra", "formula"]);
    let (wall, mut worst) = (floor(texels), [0.0f64; 2]);
    let mut vanishes = Vec::new();
    for (case, e, b) in [("a: b > e", 0.6, 1.0), ("b: b < e", 1.0, 0.5)] {
        let (mut measured, mut predicted, mut panels) = (Vec::new(), Vec::new(), Vec::new());
        for &d1 in positions {
            let image = square_shadow(context, &wall, (e, b, d1))?;
            let found = [width_on_middle_row(&image, |v| v == 0.0), width_on_middle_row(&image, |v| v < 1.0)];
            let expected = formula(e, b, d1).map(|width| width.max(0.0));
            for k in 0..2 {
                worst[k] = worst[k].max((found[k] - expected[k]).abs() / wall.texel);
            }
            if case.starts_with('b') {
                vanishes.push((d1, found[0], expected[0]));
            }
            measured.push(PlotPoint { x: d1, y: found[0], label: String::new() });
            predicted.push(PlotPoint { x: d1, y: expected[0], label: String::new() });
            table.push([
                case.into(),
                fixed(d1, 1),
                fixed(found[0], 2),
                fixed(expected[0], 2),
                fixed(found[1], 2),
                fixed(expected[1], 2),
            ]);
            panels.push(Panel::visible(&image, format!("d1 = {d1} m, umbra {} m", fixed(found[0], 2))));
        }
        item.row(format!("Case {case}: e = {e} m, b = {b} m ({VISIBLE})"), panels);
        plot.series.push(Series {
            name: format!("{case}, formula"),
            points: predicted,
            marks: Marks::Joined,
        });
        plot.series.push(Series {
            name: format!("{case}, measured"),
            points: measured,
            marks: Marks::Points,
        });
    }
    item.charts
        .push(super::item::Chart { plot, caption: "Umbra against the position of the blocker.".into() });
    item.tables.push(table);
    for (what, worst) in ["umbra", "outline of the penumbra"].into_iter().zip(worst) {
        item.check(
            format!("the {what} has the width of the formula, to the one texel that counting can miss"),
            format!("largest difference {} texels", fixed(worst, 2)),
            worst <= COUNTED,
        );
    }
    item.check(
        "with a blocker smaller than the emitter the umbra is absent at some positions and present at others, as predicted",
        vanishes.iter().map(|(d1, found, _)| format!("{d1} m: {}", fixed(*found, 2))).collect::<Vec<_>>().join(", "),
        vanishes.iter().all(|(_, found, expected)| {
            (*found > 0.0) == (*expected > 0.0) || (found - expected).abs() <= COUNTED * wall.texel
        }) && vanishes.iter().any(|(_, found, _)| *found == 0.0)
            && vanishes.iter().any(|(_, found, _)| *found > 0.0),
    );
    Ok(item)
}

/// Preparation for exact rays.
fn rays() -> PrepareOptions {
    PrepareOptions::default().with_detail(crate::model::Detail::Rays)
}

/// Side of the cluster's box, width of the emitter and edge of the cubes of Figure 6, metres.
const CLUSTER: f64 = 1.0;
const EMITTER: f64 = 0.1;
/// Distances of the cluster from the emitter, metres.
const CLUSTER_AT: [f64; 2] = [2.0, 2.8];

/// The largest umbra in a rendered shadow, those of the fictitious blocker at the cluster's far and near side, and the resolution of
/// both, metres.
struct Between {
    rendered: f64,
    far: f64,
    near: f64,
    slack: f64,
}

/// Figure 6: a cluster of cubes, and the fictitious blocker in its place.
pub fn figure_6(context: &Context) -> Result<Item> {
    let texels = if context.small { 128 } else { 256 };
    let mut item = Item {
        here: format!(
            "Cubes in a box of {CLUSTER} m between an emitter of {EMITTER} m and a floor, {DISTANCE} m apart. BSIZE is measured as \
             in the paper, by erosions of an orthographic projection along the line to the floor; so is the largest umbra in the \
             rendered shadow ({texels} x {texels} texels)."
        ),
        ..Item::default()
    };
    let mut table = Table::new(
        "Diameters in metres",
        &["cubes", "edge", "d1", "BSIZE", "predicted umbra", "rendered umbra"],
    );
    let wall = Wall { texel: 3.2 / texels as f64, columns: texels, rows: texels, ..floor(texels) };
    let (mut panels, mut found) = (Vec::new(), Vec::new());
    for (count, edge) in [(40, 0.15), (12, 0.3)] {
        for d1 in CLUSTER_AT {
            let centre = DVec3::new(0.0, 0.0, DISTANCE - d1);
            let mut blocks = Blocks::new("umbra of a cluster");
            blocks.rectangle(DVec3::ZERO, RECEIVER * DVec3::X, RECEIVER * DVec3::Y, false);
            blocks.random_cubes(count, edge, centre, CLUSTER);
            light(&mut blocks, EMITTER);
            let model = Model::prepare(blocks.scene()?, &rays(), context.progress)?;
            let scene = model.scene();
            let is_cube =
                |&t: &u32| scene.objects[scene.triangle_object[t as usize] as usize].name.starts_with("box");
            let cubes: Vec<u32> = (0..scene.triangles.len() as u32).filter(is_cube).collect();
            let b = f64::from(sizes(scene, &cubes, Vec3::Z)[0]);
            let image = wall.grid(&model).sees(&lattice(EMITTER, 5))?;
            let dark = BitImage::from_fn(texels, texels, |x, y| image.at(x, y) == 0.0);
            let rendered = f64::from(Opener::new(dark, Morphology::Paper8).largest()) * wall.texel;
            let predicted = formula(EMITTER, b, d1)[0];
            let [far, near] = [0.5, -0.5].map(|side| formula(EMITTER, b, d1 + side * CLUSTER)[0]);
            found.push(Between {
                rendered,
                far,
                near,
                slack: wall.texel + CLUSTER / PIXELS as f64 * DISTANCE / d1,
            });
            let numbers = [d1, b, predicted, rendered].map(|v| fixed(v, 3));
            table.push([count.to_string(), fixed(edge, 2)].into_iter().chain(numbers));
            panels.push(Panel::visible(
                &image,
                format!("{count} cubes, d1 = {d1} m: umbra {} m", fixed(rendered, 2)),
            ));
        }
    }
    item.row(format!("Shadows ({VISIBLE})"), panels);
    item.tables.push(table);
    item.check(
        "the umbra of the cluster lies between those of the fictitious blocker at its far and at its near side, to a texel and a pixel of \
         the projection",
        found
            .iter()
            .map(|f| format!("{} m in {} to {}", fixed(f.rendered, 2), fixed(f.far, 2), fixed(f.near, 2)))
            .collect::<Vec<_>>()
            .join("; "),
        found.iter().all(|f| (f.far - f.slack..=f.near + f.slack).contains(&f.rendered)),
    );
    Ok(item)
}
