//! Umbra against the position of the blocker: Figures 5 and 6 of the paper.
//!
//! BSIZE as the paper measures it [SD95 sec 3.3]: erosions of one orthographic projection of a cluster, until all objects have
//! disappeared, and of the free space between them. [`mrvis::internals::optics`] measures the same by direction, and free regions only
//! where they are the smaller share.

use super::blocks::Blocks;
use super::item::{Item, Panel, Table, VISIBLE, count, number};
use super::shadow::Wall;
use super::{Context, fixed};
use glam::{DVec3, Vec2, Vec3};
use mrvis::internals::clusters::Tree;
use mrvis::internals::math::parallel;
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Series};
use mrvis::internals::raster::{BitImage, Opener, fill_triangle};
use mrvis::metrics::{Image, Morphology};
use mrvis::{Detail, Result, Scene};

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
const MAX_COUNT_DIFFERENCE: f64 = 1.01;

/// Number of texels on the middle row that a predicate holds for, times their side.
fn width_on_middle_row(image: &Image, holds: impl Fn(f32) -> bool) -> f64 {
    let row = image.height() / 2;
    (0..image.width()).filter(|&x| holds(image.at(x, row))).count() as f64 * image.texel()
}

/// The shadow of a square of width `b` at a distance `d1` from an emitter of width `e`.
fn square_shadow(context: &Context, wall: &Wall, e: f64, b: f64, d1: f64) -> Result<Image<'static>> {
    let mut blocks = Blocks::new("umbra");
    blocks.rectangle(DVec3::ZERO, RECEIVER * DVec3::X, RECEIVER * DVec3::Y, false);
    blocks.rectangle(DVec3::new(0.0, 0.0, DISTANCE - d1), b * DVec3::X, b * DVec3::Y, false);
    light(&mut blocks, e);
    let model = context.model(blocks.scene()?, Detail::Rays)?;
    wall.grid(&model).sees(&lattice(e, 17))
}

/// Figure 5: a square blocker between a square emitter and a floor.
pub fn figure_5(context: &Context) -> Result<Item> {
    let texels = if context.small { 65 } else { 129 };
    let mut item = Item::of(format!(
        "A square emitter of width e, {DISTANCE} m above a floor, and a square blocker of width b at a distance d1 from the \
             emitter; umbra and penumbra are counted on the middle row of {texels} texels of {} m, each of which sees 289 points \
             of the emitter, border and corners included.",
        fixed(RECEIVER / texels as f64, 3)
    ));
    let positions: &[f64] = if context.small { &[1.0, 2.0, 3.0] } else { &[1.0, 1.5, 2.0, 2.5, 3.0] };
    let mut plot = Plot {
        x_label: "distance d1 of the blocker from the emitter, m".into(),
        y_label: "width of the umbra, m".into(),
        ..Plot::default()
    };
    let mut table = Table::new("Widths", "case | d1, m | umbra, m | formula, m | penumbra, m | formula, m");
    let (wall, mut worst) = (floor(texels), [0.0f64; 2]);
    let mut umbrae = Vec::new();
    for (case, e, b) in [("a: b > e", 0.6, 1.0), ("b: b < e", 1.0, 0.5)] {
        let (mut measured, mut predicted, mut panels) = (Vec::new(), Vec::new(), Vec::new());
        for &d1 in positions {
            let image = square_shadow(context, &wall, e, b, d1)?;
            let found = [width_on_middle_row(&image, |v| v == 0.0), width_on_middle_row(&image, |v| v < 1.0)];
            let expected = formula(e, b, d1).map(|width| width.max(0.0));
            for k in 0..2 {
                worst[k] = worst[k].max((found[k] - expected[k]).abs() / wall.texel);
            }
            if case.starts_with('b') {
                umbrae.push(Umbra { d1, found: found[0], expected: expected[0] });
            }
            measured.push(PlotPoint { x: d1, y: found[0], label: String::new() });
            predicted.push(PlotPoint { x: d1, y: expected[0], label: String::new() });
            let widths = [found[0], expected[0], found[1], expected[1]].map(|width| number(width, 2));
            table.push([case.into(), number(d1, 1)].into_iter().chain(widths));
            panels.push(Panel::visible(&image, format!("d1 = {d1} m, umbra {} m", fixed(found[0], 2))));
        }
        item.row(format!("Case {case}: e = {e} m, b = {b} m ({VISIBLE})"), panels);
        plot.series.push(Series::new(format!("{case}, formula"), predicted, Marks::Joined));
        plot.series.push(Series::new(format!("{case}, measured"), measured, Marks::Points));
    }
    item.chart(plot, "Umbra against the position of the blocker.");
    item.tables.push(table);
    judge_figure_5(&mut item, worst, &umbrae, wall.texel);
    Ok(item)
}

/// The umbra of a blocker that is smaller than the emitter, metres.
#[derive(Clone, Copy)]
struct Umbra {
    /// Distance of the blocker from the emitter.
    d1: f64,
    /// Measured width.
    found: f64,
    /// Width by the formula.
    expected: f64,
}

/// Judges the largest differences between measured and predicted widths of umbrae and of outlines of penumbrae (`worst`, texels), and the
/// umbrae of a blocker smaller than the emitter. `texel` is the side of a texel, metres.
fn judge_figure_5(item: &mut Item, worst: [f64; 2], umbrae: &[Umbra], texel: f64) {
    for (what, worst) in ["umbra", "outline of the penumbra"].into_iter().zip(worst) {
        item.check(
            format!("the {what} has the width of the formula, to the one texel that counting can miss"),
            format!("largest difference {} texels", fixed(worst, 2)),
            worst <= MAX_COUNT_DIFFERENCE,
            || "rays leave out the border of the emitter, or meet the blocker beside its edge".into(),
        );
    }
    let differs = |u: &&Umbra| {
        (u.found > 0.0) != (u.expected > 0.0) && (u.found - u.expected).abs() > MAX_COUNT_DIFFERENCE * texel
    };
    let wrong: Vec<String> = umbrae.iter().filter(differs).map(|u| format!("{} m", u.d1)).collect();
    item.check(
        "with a blocker smaller than the emitter the umbra is absent at some positions and present at others, as predicted",
        umbrae.iter().map(|u| format!("{} m: {}", u.d1, fixed(u.found, 2))).collect::<Vec<_>>().join(", "),
        wrong.is_empty()
            && umbrae.iter().any(|u| u.found == 0.0)
            && umbrae.iter().any(|u| u.found > 0.0),
        || match wrong.is_empty() {
            true => "it is the same at all positions".into(),
            false => format!("the formula predicts another one at {}", wrong.join(", ")),
        },
    );
}

/// Side of the cluster's box, metres.
const CLUSTER: f64 = 1.0;
/// Width of the emitter of Figure 6, metres.
const EMITTER: f64 = 0.1;
/// Distances of the cluster from the emitter, metres.
const CLUSTER_AT: [f64; 2] = [2.0, 2.8];

/// The largest umbra in a rendered shadow, and those of fictitious blockers, metres.
struct RenderedUmbra {
    /// Cubes and distance.
    name: String,
    rendered: f64,
    /// Umbrae of the size of the blocked regions, at the far side, the centre and the near side of the cluster.
    blocked: [f64; 3],
    /// Umbra of BSIZE, the larger of the sizes of blocked and free regions, at the centre.
    bsize: f64,
    /// Resolution of the image and of the projection.
    slack: f64,
}

impl RenderedUmbra {
    /// The fictitious blockers of a cluster with these sizes of blocked and free regions.
    fn new(cubes: usize, [blocked, free]: [f64; 2], d1: f64, rendered: f64, texel: f64) -> RenderedUmbra {
        let at = |b: f64, side: f64| formula(EMITTER, b, d1 + side * CLUSTER)[0];
        RenderedUmbra {
            name: format!("{cubes} cubes, d1 = {d1} m"),
            rendered,
            blocked: [0.5, 0.0, -0.5].map(|side| at(blocked, side)),
            bsize: at(blocked.max(free), 0.0),
            slack: texel + CLUSTER / PIXELS as f64 * DISTANCE / d1,
        }
    }
}

/// Figure 6: a cluster of cubes, and the fictitious blocker in its place.
pub fn figure_6(context: &Context) -> Result<Item> {
    let texels = if context.small { 128 } else { 256 };
    let mut item = Item::of(format!(
        "Cubes in a box of {CLUSTER} m between an emitter of {EMITTER} m and a floor, {DISTANCE} m apart. The sizes of the blocked and \
             of the free regions are measured as in the paper, by erosions of an orthographic projection along the line to the floor; \
             BSIZE is the larger one (section 3.2). The largest umbra in the rendered shadow ({texels} x {texels} texels) is measured by \
             erosions as well; it is a blocked region, so that the size of these stands beside BSIZE."
    ));
    let mut table = Table::new(
        "Diameters",
        "cubes | edge, m | d1, m | blocked size, m | BSIZE, m | umbra of blocked size, m | umbra of BSIZE, m | rendered umbra, m",
    );
    let wall = Wall { texel: 3.2 / texels as f64, columns: texels, rows: texels, ..floor(texels) };
    let (mut panels, mut found) = (Vec::new(), Vec::new());
    for (cubes, edge) in [(40, 0.15), (12, 0.3)] {
        for d1 in CLUSTER_AT {
            let (size, image) = cluster_shadow(context, &wall, cubes, edge, d1)?;
            let dark = BitImage::from_fn(texels, texels, |x, y| image.at(x, y) == 0.0);
            let rendered = f64::from(Opener::new(dark, Morphology::Paper8).largest()) * wall.texel;
            let between = RenderedUmbra::new(cubes, size, d1, rendered, wall.texel);
            let numbers = [size[0], size[0].max(size[1]), between.blocked[1], between.bsize, rendered]
                .map(|v| number(v, 3));
            let first = [count(cubes), number(edge, 2), number(d1, 1)];
            table.push(first.into_iter().chain(numbers));
            found.push(between);
            let caption = format!("{cubes} cubes, d1 = {d1} m: umbra {} m", fixed(rendered, 2));
            panels.push(Panel::visible(&image, caption));
        }
    }
    item.row(format!("Shadows ({VISIBLE})"), panels);
    item.tables.push(table);
    judge_figure_6(&mut item, &found);
    Ok(item)
}

/// Sizes of the blocked and free regions of a cluster of cubes with these number, edge and distance from the emitter, and its shadow.
fn cluster_shadow(
    context: &Context,
    wall: &Wall,
    cubes: usize,
    edge: f64,
    d1: f64,
) -> Result<([f64; 2], Image<'static>)> {
    let centre = DVec3::new(0.0, 0.0, DISTANCE - d1);
    let mut blocks = Blocks::new("umbra of a cluster");
    blocks.rectangle(DVec3::ZERO, RECEIVER * DVec3::X, RECEIVER * DVec3::Y, false);
    blocks.random_cubes(cubes, edge, centre, CLUSTER);
    light(&mut blocks, EMITTER);
    let model = context.model(blocks.scene()?, Detail::Rays)?;
    let scene = model.scene();
    let is_cube = |&t: &u32| {
        scene.parts().objects[scene.parts().triangle_object[t as usize] as usize].name.starts_with("box")
    };
    let cubes: Vec<u32> = (0..scene.parts().triangles.len() as u32).filter(is_cube).collect();
    let image = wall.grid(&model).sees(&lattice(EMITTER, 5))?;
    Ok((sizes(scene, &cubes, Vec3::Z).map(f64::from), image))
}

/// Whether rendered umbrae are those of the fictitious blockers.
fn judge_figure_6(item: &mut Item, found: &[RenderedUmbra]) {
    let listed =
        |text: &dyn Fn(&RenderedUmbra) -> String| found.iter().map(text).collect::<Vec<_>>().join("; ");
    // The cases that fail, with what they show.
    let failing = |fails: &dyn Fn(&RenderedUmbra) -> bool, text: &dyn Fn(&RenderedUmbra) -> String| {
        let failing: Vec<String> =
            found.iter().filter(|f| fails(f)).map(|f| format!("{}: {}", f.name, text(f))).collect();
        failing.join("; ")
    };
    let outside =
        |f: &RenderedUmbra| !(f.blocked[0] - f.slack..=f.blocked[2] + f.slack).contains(&f.rendered);
    item.check(
        "the umbra of the cluster lies between those of a fictitious blocker of the blocked size at its far and at its near side, to a texel \
         and a pixel of the projection",
        listed(&|f| {
            let [far, _, near] = f.blocked;
            format!("{} m in {} to {}", fixed(f.rendered, 2), fixed(far, 2), fixed(near, 2))
        }),
        !found.iter().any(outside),
        || failing(&outside, &|_| "shadows of cubes join on the floor that are apart in the projection, or part".into()),
    );
    let by = |f: &RenderedUmbra, predicted: f64| (f.rendered - predicted) / f.slack;
    let wider = |f: &RenderedUmbra, than: f64| {
        format!(
            "{} resolutions wider: its widest shadows are of cubes that are nearer to the emitter than the centre, where a blocker of that \
             size would have an umbra of up to {} m, or of cubes that lie apart and whose shadows join",
            fixed(by(f, than), 1),
            fixed(f.blocked[2], 2)
        )
    };
    let beyond = |f: &RenderedUmbra| by(f, f.bsize) > 1.0;
    item.check(
        "BSIZE at the centre gives the maximum: no umbra is wider than that of this fictitious blocker, to the same resolution",
        listed(&|f| format!("{} m of {}", fixed(f.rendered, 2), fixed(f.bsize, 2))),
        !found.iter().any(beyond),
        || failing(&beyond, &|f| wider(f, f.bsize)),
    );
    let differs = |f: &RenderedUmbra| by(f, f.blocked[1]).abs() > 1.0;
    item.check(
        "the umbra is that of the blocked size at the centre, to the same resolution",
        listed(&|f| format!("{} m of {}", fixed(f.rendered, 2), fixed(f.blocked[1], 2))),
        !found.iter().any(differs),
        || {
            failing(&differs, &|f| match by(f, f.blocked[1]) {
                more if more > 0.0 => wider(f, f.blocked[1]),
                less => format!(
                    "{} resolutions narrower: its widest shadows are of cubes farther from the emitter than the centre",
                    fixed(-less, 1)
                ),
            })
        },
    );
}

/// Pixels across the longer side of a projected box.
const PIXELS: usize = 64;

/// For each cluster the larger one of the sizes of its blocked and of its free regions in the projection along a unit vector, scene units.
pub fn blocker_sizes(scene: &Scene, tree: &Tree, view: Vec3) -> Vec<f32> {
    let size = |c: usize| {
        let [blocked, free] = sizes(scene, tree.triangles_of(c), view);
        blocked.max(free)
    };
    parallel::map(0..tree.clusters.len(), size)
}

/// Sizes of the blocked and of the free regions of some triangles.
pub fn sizes(scene: &Scene, faces: &[u32], view: Vec3) -> [f32; 2] {
    let (u, v) = view.any_orthonormal_pair();
    let flat = |p: Vec3| Vec2::new(p.dot(u), p.dot(v));
    let corners = || faces.iter().flat_map(|&t| scene.corners(t)).map(flat);
    let low = corners().fold(Vec2::INFINITY, Vec2::min);
    let extent = corners().fold(Vec2::NEG_INFINITY, Vec2::max) - low;
    let pixel = extent.max_element() / PIXELS as f32;
    if pixel <= 0.0 {
        return [0.0; 2];
    }
    let size = (extent / pixel).ceil().max(Vec2::ONE).as_uvec2();
    let mut image = BitImage::new(size.x as usize, size.y as usize);
    for &t in faces {
        fill_triangle(&mut image, scene.corners(t).map(|p| (flat(p) - low) / pixel));
    }
    let free = image.complement();
    [image, free].map(|image| Opener::new(image, Morphology::Paper8).largest() * pixel)
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    #[test]
    fn widths_beside_the_formula_are_found() {
        let failing = |worst: [f64; 2], umbrae: &[Umbra]| {
            failing_checks(|item| judge_figure_5(item, worst, umbrae, 0.05))
        };
        let umbra = |d1, found, expected| Umbra { d1, found, expected };
        let predicted = [umbra(1.0, 0.0, 0.0), umbra(3.0, 0.35, 0.33)];
        assert_eq!(failing([1.0, 1.0], &predicted), [0; 0]);
        assert_eq!(failing([1.1, 1.0], &predicted), [0]);
        assert_eq!(failing([1.0, 1.1], &predicted), [1]);
        assert_eq!(failing([1.0, 1.0], &[umbra(1.0, 0.2, 0.0), predicted[0], predicted[1]]), [2]);
        assert_eq!(failing([1.0, 1.0], &predicted[1..]), [2]);
    }

    #[test]
    fn umbrae_beyond_the_fictitious_blockers_are_found() {
        let failing = |rendered: f64| {
            let mut item = Item::default();
            // Umbrae of 0.37 to 0.25 m of the blocked size, 0.55 m of BSIZE, and a resolution of 0.04 m.
            judge_figure_6(&mut item, &[RenderedUmbra::new(9, [0.2, 0.325], 2.0, rendered, 0.01)]);
            assert!(
                item.checks.iter().all(|check| check.holds || check.failure().contains("9 cubes, d1 = 2 m"))
            );
            (0..3).filter(|&k| !item.checks[k].holds).collect::<Vec<_>>()
        };
        assert_eq!(failing(0.3), [0; 0]);
        assert_eq!(failing(0.36), [2]);
        assert_eq!(failing(0.5), [0, 2]);
        assert_eq!(failing(0.6), [0, 1, 2]);
        assert_eq!(failing(0.1), [0, 2]);
    }
}
