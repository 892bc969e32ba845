//! Multi-resolution visibility at four feature sizes: Figure 9 of the paper and its bar charts.

use super::bsize::blocker_sizes;
use super::groups::{EDGES, paper_features, range, scene, shadow_widths, wall};
use super::item::{Chart, Item, Panel, Table, VISIBLE};
use super::plain::{Descent, Leaves, PlainTree, Visits};
use super::shadow::{Wall, mean};
use super::{Context, fixed, list};
use crate::Result;
use crate::metrics::{FbemOptions, Image, fbem, norms};
use crate::model::{Model, PrepareOptions};
use crate::plot::{Marks, Plot, PlotPoint, Series};
use crate::visibility::LeafMode;
use glam::Vec3;

/// Feature sizes of the paper, in its relative unit, and its seconds.
const SIZES: [f64; 4] = [2.0, 2.8, 3.5, 5.0];
const PAPER_SECONDS: [f64; 4] = [1984.0, 1648.0, 1459.0, 1356.0];
/// Name of the images with extinction in leaves.
const EXTINCTION: &str = "Extinction in leaves, as in the paper";
/// Side of a texel, metres: a 13th of the smallest feature size; in tests twice as much.
const TEXEL: f64 = 0.0125;
/// Columns and rows of an image, 2.2 m.
const COLUMNS: usize = 176;

/// The unit of the sizes, metres: the smallest in which the shadows of single cubes of no group, penumbra included, are wider than the size
/// of the group's number, so that each size averages one group more.
fn unit() -> f64 {
    EDGES.iter().zip(SIZES).map(|(&edge, s)| shadow_widths(edge)[1] / s).fold(0.0, f64::max)
}

/// Images of the four groups by one method.
struct Walls {
    images: Vec<Image<'static>>,
    seconds: f64,
    visits: Visits,
}

/// All that Figure 9 compares, for one treatment of leaves.
struct Series9 {
    reference: Walls,
    /// By feature size.
    sized: Vec<Walls>,
    /// Seconds of this engine by feature size, and its images.
    engine: Vec<(f64, Vec<Image<'static>>)>,
}

fn walls(context: &Context) -> Vec<Wall> {
    let fine = if context.small { 2 } else { 1 };
    (0..4).map(|k| wall(k, COLUMNS / fine, TEXEL * fine as f64)).collect()
}

impl Series9 {
    fn new(context: &Context, model: &Model, leaves: Leaves) -> Result<Series9> {
        let tree = &model.base().hierarchy().micro;
        let sizes = blocker_sizes(model.scene(), tree, Vec3::Y);
        let plain = PlainTree::new(model.scene(), tree, &sizes);
        let (rays, repeat) = if context.small { (4, 1) } else { (16, 2) };
        let by = |s: Option<f64>| -> Result<Walls> {
            let (mut images, mut seconds, mut visits) = (Vec::new(), 0.0, Visits::default());
            for wall in walls(context) {
                let descent = |e| Descent { leaves, sizes: s.map(|s| (e, (s * unit()) as f32)) };
                let (rendered, more) = wall.grid(model).by_plain_tree(&plain, descent, (rays, repeat))?;
                images.push(rendered.image);
                seconds += rendered.seconds;
                visits.add(more);
            }
            Ok(Walls { images, seconds, visits })
        };
        let mode = if leaves == Leaves::Surfaces { LeafMode::Exact } else { LeafMode::Average };
        let engine = model.engine(model.widest_packets(), mode).expect("optics");
        let engine = SIZES.iter().map(|s| {
            let (mut seconds, mut images) = (0.0, Vec::new());
            for wall in walls(context) {
                let rendered = wall.grid(model).by_clusters(&engine, s * unit(), (rays, repeat))?;
                seconds += rendered.seconds;
                images.push(rendered.image);
            }
            Ok((seconds, images))
        });
        Ok(Series9 {
            reference: by(None)?,
            sized: SIZES.iter().map(|&s| by(Some(s))).collect::<Result<_>>()?,
            engine: engine.collect::<Result<_>>()?,
        })
    }

    /// L2 and FBEM(s) by size and group, per cent.
    fn errors(&self, reference: &[Image]) -> Result<Vec<[[f64; 2]; 4]>> {
        let of = |walls: &Walls, s: f64| -> Result<[[f64; 2]; 4]> {
            let mut errors = [[0.0; 2]; 4];
            for (k, error) in errors.iter_mut().enumerate() {
                let options = FbemOptions::default().with_features(paper_features()).with_size(s * unit());
                let l2 = norms(&reference[k], &walls.images[k])?.l2;
                *error = [l2, fbem(&reference[k], &walls.images[k], &options)?.value].map(|v| 100.0 * v);
            }
            Ok(errors)
        };
        self.sized.iter().zip(SIZES).map(|(walls, s)| of(walls, s)).collect()
    }
}

/// Figure 9, once with extinction in the leaves as in the paper and once with exact leaves.
pub fn figure_9(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: format!(
            "The scene of Figure 1; s in units of {} mm (the paper does not give its unit), in which the shadows of single cubes, penumbra \
             included, are {} wide, none wider than the size of its group's number. The paper's rule descends the clusters segment by \
             segment with κ = ΣA/4V and one BSIZE; its time is that of one core. The times of this engine (sixteen segments at a time, \
             measured extinction) stand beside.",
            fixed(1000.0 * unit(), 0),
            list(&EDGES.map(|edge| shadow_widths(edge)[1] / unit()), 1)
        ),
        ..Item::default()
    };
    let model = Model::prepare(scene()?, &PrepareOptions::default(), context.progress)?;
    let exact = walls(context)
        .iter()
        .map(|wall| Ok(wall.grid(&model).by_rays(if context.small { 64 } else { 128 }, 1, 1)?.image))
        .collect::<Result<Vec<_>>>()?;
    for (leaves, name) in [(Leaves::Extinction, EXTINCTION), (Leaves::Surfaces, "Exact leaves")] {
        let made = Series9::new(context, &model, leaves)?;
        let reference = if leaves == Leaves::Surfaces { &exact } else { &made.reference.images };
        show(&mut item, name, &made, reference)?;
        judge(&mut item, name, &made, reference)?;
    }
    Ok(item)
}

fn show(item: &mut Item, name: &str, made: &Series9, reference: &[Image]) -> Result<()> {
    let errors = made.errors(reference)?;
    let panels = |images: &[Image]| -> Vec<Panel> {
        images
            .iter()
            .enumerate()
            .map(|(k, image)| Panel::visible(image, format!("group {}", k + 1)))
            .collect()
    };
    item.row(
        format!("{name}: reference without multi-resolution ({VISIBLE})"),
        panels(&made.reference.images),
    );
    for (walls, s) in made.sized.iter().zip(SIZES) {
        item.row(
            format!("{name}: s = {s}, {} s ({VISIBLE})", fixed(walls.seconds, 2)),
            panels(&walls.images),
        );
    }
    let columns = ["s", "seconds", "paper", "visits, millions", "this engine, s", "its FBEM, %"];
    let mut times = Table::new(format!("{name}: times"), &columns);
    let millions = |walls: &Walls| fixed(walls.visits.all() as f64 / 1e6, 2);
    let blank = || String::from("–");
    times.push([
        "none".into(),
        fixed(made.reference.seconds, 2),
        blank(),
        millions(&made.reference),
        blank(),
        blank(),
    ]);
    for (k, walls) in made.sized.iter().enumerate() {
        let (own, images) = &made.engine[k];
        let options = FbemOptions::default().with_features(paper_features()).with_size(SIZES[k] * unit());
        let mut worst = 0.0f64;
        for (reference, image) in reference.iter().zip(images) {
            worst = worst.max(100.0 * fbem(reference, image, &options)?.value);
        }
        times.push([
            fixed(SIZES[k], 1),
            fixed(walls.seconds, 2),
            fixed(PAPER_SECONDS[k], 0),
            millions(walls),
            fixed(*own, 3),
            fixed(worst, 2),
        ]);
    }
    item.tables.push(times);
    let columns =
        ["s", "L2 of 1", "L2 of 2", "L2 of 3", "L2 of 4", "FBEM of 1", "FBEM of 2", "FBEM of 3", "FBEM of 4"];
    let mut table = Table::new(format!("{name}: errors of the groups, per cent of the light"), &columns);
    for (row, s) in errors.iter().zip(SIZES) {
        let numbers = [0, 1].into_iter().flat_map(|m| row.iter().map(move |e| fixed(e[m], 2)));
        table.push([fixed(s, 1)].into_iter().chain(numbers));
    }
    item.tables.push(table);
    let y_reach = errors.iter().flatten().flatten().fold(0.0f64, |largest, e| largest.max(*e));
    for (row, s) in errors.iter().zip(SIZES) {
        let series = ["L2".into(), format!("FBEM({s})")].into_iter().enumerate().map(|(m, name)| Series {
            name,
            points: (0..4)
                .map(|k| PlotPoint { x: (k + 1) as f64, y: row[k][m], label: String::new() })
                .collect(),
            marks: Marks::Bars,
        });
        let plot = Plot {
            x_label: "group".into(),
            y_label: "% of the light".into(),
            series: series.collect(),
            y_reach,
            ..Plot::default()
        };
        item.charts.push(Chart { plot, caption: format!("{name}: s = {s}") });
    }
    Ok(())
}

fn judge(item: &mut Item, name: &str, made: &Series9, reference: &[Image]) -> Result<()> {
    let errors = made.errors(reference)?;
    // The paper's times are of extinction in leaves.
    let paper = PAPER_SECONDS[0] / PAPER_SECONDS[3];
    let (factor, suffix) = match name {
        EXTINCTION => (
            paper,
            format!(
                ", from the first to the last by at least the paper's factor of times, {}",
                fixed(paper, 2)
            ),
        ),
        _ => (1.0, String::new()),
    };
    let falls = |v: &[f64]| v.windows(2).all(|v| v[1] < v[0]);
    let visits: Vec<f64> = made.sized.iter().map(|walls| walls.visits.all() as f64 / 1e6).collect();
    item.check(
        format!("{name}: work falls with s{suffix}"),
        format!("{} million visits, by a factor of {}", list(&visits, 2), fixed(visits[0] / visits[3], 2)),
        falls(&visits) && visits[0] >= factor * visits[3],
    );
    let seconds: Vec<f64> = made.sized.iter().map(|walls| walls.seconds).collect();
    item.check_time(
        format!("{name}: time falls with s{suffix}"),
        format!("{} s, by a factor of {}", list(&seconds, 2), fixed(seconds[0] / seconds[3], 2)),
        falls(&seconds) && seconds[0] >= factor * seconds[3],
    );
    let column = |k: usize, m: usize| errors.iter().map(|row| row[k][m]).collect::<Vec<f64>>();
    let rises = |v: &[f64]| v.windows(2).all(|pair| pair[1] >= 0.98 * pair[0]) && v[3] > v[0];
    item.check(
        format!("{name}: L2 rises with s in all groups"),
        (0..4).map(|k| list(&column(k, 0), 1)).collect::<Vec<_>>().join("; "),
        (0..4).all(|k| rises(&column(k, 0))),
    );
    let onsets: Vec<f64> = (0..4).map(|k| onset(&column(k, 0))).collect();
    item.check(
        format!("{name}: L2 rises later for larger objects"),
        format!("L2 reaches {ONSET} % at s = {}", list(&onsets, 2)),
        onsets[3] > onsets[0] && onsets.windows(2).all(|v| v[1] >= v[0]),
    );
    let averaged: Vec<[f64; 2]> = errors.iter().flatten().filter(|cell| cell[0] >= ONSET).copied().collect();
    let of = |m: usize| range(&averaged.iter().map(|cell| cell[m]).collect::<Vec<f64>>());
    let ((smallest, largest), (_, l2)) = (of(1), of(0));
    item.check(
        format!("{name}: where clusters are averaged, FBEM(s) is of similar magnitude over groups and sizes: within a factor of 2"),
        format!("{} to {} %; the largest where s is just above the size of the shadows", fixed(smallest, 1), fixed(largest, 1)),
        largest <= 2.0 * smallest,
    );
    let light = |walls: &Walls| walls.images.iter().map(|image| 100.0 * mean(image) / 4.0).sum::<f64>();
    item.check(
        format!("{name}: FBEM(s) remains low: the largest is at most half of the largest L2, which Table 1 counts as satisfactory"),
        format!(
            "{} % and {} %; mean light {} % before averaging, {} % at s = 5: e^(−κl) of a cluster is not the mean of those of its parts",
            fixed(largest, 1),
            fixed(l2, 1),
            fixed(light(&made.reference), 1),
            fixed(light(&made.sized[3]), 1)
        ),
        largest <= 0.5 * l2,
    );
    Ok(())
}

/// L2 error that counts as risen, per cent: above the noise of the images.
const ONSET: f64 = 8.0;

/// The size at which the error reaches [`ONSET`], interpolated; the first or last size if it does before or not at all.
fn onset(errors: &[f64]) -> f64 {
    match errors.iter().position(|&v| v >= ONSET) {
        Some(0) => SIZES[0],
        Some(k) => {
            let part = (ONSET - errors[k - 1]) / (errors[k] - errors[k - 1]);
            SIZES[k - 1] + part * (SIZES[k] - SIZES[k - 1])
        }
        None => SIZES[3],
    }
}
