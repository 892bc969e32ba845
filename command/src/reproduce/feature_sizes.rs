//! Multi-resolution visibility at four feature sizes: Figure 9 of the paper and its bar charts.

use super::cubes::{COLUMNS, COVERAGE, EDGES, TEXEL, covering_scene, shadow_widths, wall};
use super::feature_verdict::{Measured, PAPER_SECONDS, SIZES, judge, judge_coverage};
use super::item::{Cell, Chart, ChartRow, Item, Panel, Table, VISIBLE, number};
use super::plain::{Descent, Leaves, PlainTree, Visits};
use super::shadow::{Wall, mean, paper_features};
use super::umbra::blocker_sizes;
use super::{Context, MIN_STANDARD_ERRORS, Repeated, fixed, list};
use glam::Vec3;
use mrvis::internals::metrics::{FeatureSet, norms};
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Series};
use mrvis::internals::visibility::LeafMode;
use mrvis::metrics::{FbemOptions, Image, fbem};
use mrvis::{Detail, Model, Result};

/// Other coverages of the groups, for which the work is counted as well.
const OTHER_COVERAGES: [f64; 2] = [0.3, 0.5];
/// Repetitions of each of two measurements of this engine's times, which are short, of which the shortest counts.
const ENGINE_REPEAT: usize = 2;
/// Segments a texel with which it is counted: the ratio of two numbers of visits needs no more.
const COUNTED_RAYS: usize = 4;
/// The unit of the sizes, metres: the smallest in which single cubes of no group have shadows, penumbra included, that are wider than the
/// size of the group's number.
fn unit() -> f64 {
    EDGES.iter().zip(SIZES).map(|(&edge, s)| shadow_widths(edge)[1] / s).fold(0.0, f64::max)
}

/// Images of the four groups by one method.
struct Walls {
    images: Vec<Image<'static>>,
    /// Of two repetitions.
    seconds: [f64; 2],
    visits: Visits,
}

/// All that Figure 9 compares, for one treatment of leaves.
struct Series9 {
    reference: Walls,
    /// By feature size.
    sized: Vec<Walls>,
    /// Seconds of this engine by feature size, in two repetitions, and its images.
    engine: Vec<([f64; 2], Vec<Image<'static>>)>,
}

/// Texels as in Figure 1, a 13th of the smallest feature size wide; in tests twice as wide.
fn walls(context: &Context) -> Vec<Wall> {
    let fine = if context.small { 2 } else { 1 };
    (0..4).map(|k| wall(k, COLUMNS / fine, TEXEL * fine as f64)).collect()
}

/// Images by the plain descent of all groups, with a feature size or without one.
fn plain_walls(
    context: &Context,
    model: &Model,
    tree: &PlainTree,
    leaves: Leaves,
    s: Option<f64>,
    rays: usize,
    repeat: usize,
) -> Result<Walls> {
    let (mut images, mut seconds, mut visits) = (Vec::new(), [0.0; 2], Visits::default());
    for wall in walls(context) {
        let descent = |e| Descent { leaves, sizes: s.map(|s| (e, (s * unit()) as f32)) };
        let grid = wall.grid(model);
        for (k, seconds) in seconds.iter_mut().enumerate().take(repeat) {
            let (rendered, more) = grid.by_plain_tree(tree, descent, rays, 1)?;
            *seconds += rendered.seconds;
            if k == 0 {
                images.push(rendered.image);
                visits.add(more);
            }
        }
    }
    Ok(Walls { images, seconds, visits })
}

impl Series9 {
    fn new(context: &Context, model: &Model, leaves: Leaves) -> Result<Series9> {
        let tree = &model.base().hierarchy().micro;
        let sizes = blocker_sizes(model.scene(), tree, Vec3::Y);
        let plain = PlainTree::new(model.scene(), tree, &sizes);
        let rays = rays(context);
        let by = |s: Option<f64>| plain_walls(context, model, &plain, leaves, s, rays, 2);
        let mode = if leaves == Leaves::Surfaces { LeafMode::Exact } else { LeafMode::Average };
        let engine = model.engine(model.widest_packets(), mode).expect("optics");
        let engine = SIZES.iter().map(|s| {
            let (mut seconds, mut images) = ([0.0; 2], Vec::new());
            for wall in walls(context) {
                let grid = wall.grid(model);
                let [one, two] = [0, 1].map(|_| grid.by_clusters(&engine, s * unit(), rays, ENGINE_REPEAT));
                let (one, two) = (one?, two?);
                seconds = [seconds[0] + one.seconds, seconds[1] + two.seconds];
                images.push(one.image);
            }
            Ok((seconds, images))
        });
        Ok(Series9 {
            reference: by(None)?,
            sized: SIZES.iter().map(|&s| by(Some(s))).collect::<Result<_>>()?,
            engine: engine.collect::<Result<_>>()?,
        })
    }

    /// The numbers that checks judge; `noise` of the images, per cent.
    fn measured(&self, leaves: Leaves, reference: &[Image], noise: f64) -> Result<Measured> {
        let light = |walls: &Walls| walls.images.iter().map(|image| 100.0 * mean(image) / 4.0).sum::<f64>();
        let wide = SIZES.iter().map(|s| -> Result<[f64; 4]> {
            let mut parts = [0.0; 4];
            for (part, image) in parts.iter_mut().zip(reference) {
                let mut features = FeatureSet::new(image, &paper_features())?;
                let [all, above] = [0.0, s * unit()].map(|size| features.mask(size).count() as f64);
                *part = 100.0 * above / all.max(1.0);
            }
            Ok(parts)
        });
        Ok(Measured {
            leaves,
            visits: self.sized.iter().map(|walls| walls.visits.all() as f64 / 1e6).collect(),
            times: Repeated(self.sized.iter().map(|walls| walls.seconds).collect()),
            errors: self.errors(reference)?,
            noise,
            light: [light(&self.reference), light(&self.sized[3])],
            wide: wide.collect::<Result<_>>()?,
        })
    }

    /// L2 and FBEM(s) by size and group, per cent.
    fn errors(&self, reference: &[Image]) -> Result<Vec<[[f64; 2]; 4]>> {
        let of = |walls: &Walls, s: f64| -> Result<[[f64; 2]; 4]> {
            let (mut errors, mut options) = ([[0.0; 2]; 4], FbemOptions::default());
            options.features = paper_features();
            for (k, error) in errors.iter_mut().enumerate() {
                let l2 = norms(&reference[k], &walls.images[k])?.l2;
                *error = [l2, fbem(&reference[k], &walls.images[k], &[s * unit()], &options)?[0].value]
                    .map(|v| 100.0 * v);
            }
            Ok(errors)
        };
        self.sized.iter().zip(SIZES).map(|(walls, s)| of(walls, s)).collect()
    }
}

/// Segments a texel.
fn rays(context: &Context) -> usize {
    if context.small { 4 } else { 16 }
}

/// Figure 9, once with extinction in the leaves as in the paper and once with exact leaves.
pub fn figure_9(context: &Context) -> Result<Item> {
    let mut item = Item::of(format!(
        "The scene of Figure 1; s in units of {} mm (the paper does not give its unit), in which the shadows of single cubes, penumbra \
             included, are {} wide, none wider than the size of its group's number. The paper's rule descends the clusters segment by \
             segment with κ = ΣA/4V and one BSIZE, at the centre of the cluster projected onto the segment; its time is that of one core. \
             Times are means of two repetitions, whose differences, pooled over sizes, tell the noise. The times of this engine (sixteen \
             segments at a time, measured extinction) stand beside, with the largest FBEM of its images against exact rays. L2 counts as risen \
             above three times the noise of the images, which is the L2 of those by {} exact rays a texel. The paper does not give the part of \
             its images that the cubes hide, {} % here; work is counted with others as well.",
        fixed(1000.0 * unit(), 0),
        list(&EDGES.map(|edge| shadow_widths(edge)[1] / unit()), 1),
        rays(context),
        fixed(100.0 * COVERAGE, 0)
    ));
    let model = context.model(covering_scene(COVERAGE)?, Detail::Optics)?;
    let by_rays = |rays: usize, stream: u64| -> Result<Vec<Image<'static>>> {
        walls(context).iter().map(|wall| Ok(wall.grid(&model).by_rays(rays, stream, 1)?.image)).collect()
    };
    let exact = by_rays(if context.small { 64 } else { 128 }, 1)?;
    let mut noise = 0.0f64;
    for (exact, sampled) in exact.iter().zip(by_rays(rays(context), 0)?) {
        noise = noise.max(100.0 * norms(exact, &sampled)?.l2);
    }
    for leaves in [Leaves::Extinction, Leaves::Surfaces] {
        let made = Series9::new(context, &model, leaves)?;
        let reference = if leaves == Leaves::Surfaces { &exact } else { &made.reference.images };
        let measured = made.measured(leaves, reference, noise)?;
        show(&mut item, leaves.name(), &made, reference, &exact)?;
        judge(&mut item, &measured);
        if leaves == Leaves::Extinction {
            let factors = OTHER_COVERAGES.map(|part| work_factor(context, part).map(|factor| (part, factor)));
            judge_coverage(&mut item, &factors.into_iter().collect::<Result<Vec<_>>>()?);
        }
    }
    Ok(item)
}

/// Work at the smallest feature size relative to that at the largest, with groups that cover this fraction of the wall.
fn work_factor(context: &Context, coverage: f64) -> Result<f64> {
    let model = context.model(covering_scene(coverage)?, Detail::Clusters)?;
    let tree = &model.base().hierarchy().micro;
    let sizes = blocker_sizes(model.scene(), tree, Vec3::Y);
    let plain = PlainTree::new(model.scene(), tree, &sizes);
    let visits = |s: f64| -> Result<f64> {
        let walls = plain_walls(context, &model, &plain, Leaves::Extinction, Some(s), COUNTED_RAYS, 1)?;
        Ok(walls.visits.all() as f64)
    };
    Ok(visits(SIZES[0])? / visits(SIZES[3])?)
}

fn show(item: &mut Item, name: &str, made: &Series9, reference: &[Image], exact: &[Image]) -> Result<()> {
    let errors = made.errors(reference)?;
    let panels = |images: &[Image]| -> Vec<Panel> {
        images
            .iter()
            .enumerate()
            .map(|(k, image)| Panel::visible(image, format!("group {}", k + 1)))
            .collect()
    };
    item.row(format!("{name}: reference without multi-resolution ({VISIBLE})"), panels(reference));
    for (walls, s) in made.sized.iter().zip(SIZES) {
        item.row(
            format!("{name}: s = {s}, {} s ({VISIBLE})", fixed(mean_of(walls.seconds), 2)),
            panels(&walls.images),
        );
    }
    item.tables.push(times(name, made, exact)?);
    item.here += &engine_times(name, made);
    let columns = "s | L2 of 1, % | L2 of 2, % | L2 of 3, % | L2 of 4, % | FBEM of 1, % | FBEM of 2, % | FBEM of 3, % | FBEM of 4, %";
    let mut table = Table::new(format!("{name}: errors of the groups, per cent of the light"), columns);
    for (row, s) in errors.iter().zip(SIZES) {
        let numbers = [0, 1].into_iter().flat_map(|m| row.iter().map(move |e| number(e[m], 2)));
        table.push([number(s, 1)].into_iter().chain(numbers));
    }
    item.tables.push(table);
    item.charts.push(ChartRow { title: format!("{name}: errors by group"), charts: bars(&errors) });
    Ok(())
}

/// Bar charts of the errors, one a size.
fn bars(errors: &[[[f64; 2]; 4]]) -> Vec<Chart> {
    let y_reach = errors.iter().flatten().flatten().fold(0.0f64, |largest, e| largest.max(*e));
    let chart = |(row, s): (&[[f64; 2]; 4], f64)| {
        let series = ["L2".into(), format!("FBEM({s})")].into_iter().enumerate().map(|(m, name)| {
            Series::new(
                name,
                (0..4).map(|k| PlotPoint { x: (k + 1) as f64, y: row[k][m], label: String::new() }).collect(),
                Marks::Bars,
            )
        });
        let plot = Plot {
            x_label: "group".into(),
            y_label: "% of the light".into(),
            series: series.collect(),
            y_reach,
            ..Plot::default()
        };
        Chart { plot, caption: format!("s = {s}") }
    };
    errors.iter().zip(SIZES).map(chart).collect()
}

/// Times and work by size, of the paper's rule and of this engine, whose images are compared with those by exact rays.
fn times(name: &str, made: &Series9, exact: &[Image]) -> Result<Table> {
    let columns = "feature size | time, s | paper, s | visits, millions | this engine, s | its FBEM against exact rays, %";
    let mut times = Table::new(format!("{name}: times"), columns);
    let millions = |walls: &Walls| number(walls.visits.all() as f64 / 1e6, 2);
    let blank = || Cell::from("–");
    let seconds = |walls: &Walls| number(mean_of(walls.seconds), 2);
    let first =
        ["none".into(), seconds(&made.reference), blank(), millions(&made.reference), blank(), blank()];
    times.push(first);
    for (k, walls) in made.sized.iter().enumerate() {
        let (own, images) = &made.engine[k];
        let mut options = FbemOptions::default();
        options.features = paper_features();
        let mut worst = 0.0f64;
        for (exact, image) in exact.iter().zip(images) {
            worst = worst.max(100.0 * fbem(exact, image, &[SIZES[k] * unit()], &options)?[0].value);
        }
        times.push([
            number(SIZES[k], 1),
            seconds(walls),
            number(PAPER_SECONDS[k], 0),
            millions(walls),
            number(mean_of(*own), 3),
            number(worst, 2),
        ]);
    }
    Ok(times)
}

/// A sentence about the times of this engine.
fn engine_times(name: &str, made: &Series9) -> String {
    let times = Repeated(made.engine.iter().map(|(seconds, _)| *seconds).collect());
    let [first, last] = [times.mean(0), times.mean(3)];
    let noise = 2.0f64.sqrt() * times.noise();
    format!(
        " {name}: this engine's time at s = {} is {} % of that at s = {}, ± {} %{}.",
        SIZES[3],
        fixed(100.0 * last / first, 0),
        SIZES[0],
        fixed(100.0 * noise, 0),
        match 1.0 - last / first > MIN_STANDARD_ERRORS * noise {
            true => "",
            false => ", so that it does not certainly fall with s",
        }
    )
}

fn mean_of(pair: [f64; 2]) -> f64 {
    0.5 * (pair[0] + pair[1])
}
