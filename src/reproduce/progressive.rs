//! Progressive multi-gridding (section 6.2 of the paper) and importance (section 6).

use super::item::{Chart, Item, Table};
use super::{Context, fixed, list};
use crate::Result;
use crate::model::{Model, PrepareOptions};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};
use crate::points::Point;
use crate::radiosity::{self, Options, Record, Visibility};
use crate::scene::generate::{self, DESKS, Spec};
use glam::DVec3;

/// The paper's seconds per iteration, and polygons.
const PAPER_SECONDS: f64 = 2.0;
const PAPER_POLYGONS: usize = 6000;

/// Section 6.2: steps of a limited number of links.
pub fn multigridding(context: &Context) -> Result<Item> {
    let spec = Spec { count: Some(7000), ..Spec::new("urban-block") };
    let soup = generate::soup(&spec)?;
    let polygons = soup.polygons();
    let model = Model::prepare(generate::build(&spec)?, &PrepareOptions::default(), context.progress)?;
    let (step, max_links) = if context.small { (0.05, 4000) } else { (0.1, 20_000) };
    let links = Options { local_rays: Some(0), audit: 0, ..Options::default() };
    let steps = Options { step_seconds: Some(step), max_links, ..links.clone() };
    let record = radiosity::run(&model, &[], &steps, context.progress)?.record;
    let mut item = Item {
        here: format!(
            "Scene `urban-block` of `mrvis generate` with a count of 7,000, {polygons} polygons; light along links alone (options \
             `step_seconds` {step}, `max_links` {max_links}, `local_rays` 0). Each step refines the links above the threshold that a \
             histogram of their errors gives for the time; the RMS error after a step, relative to the mean irradiance, is that of \
             another solve that ends at as many links, measured by independent paths at {AUDITED} elements."
        ),
        ..Item::default()
    };
    let errors = measured_errors(context, &model, &links, &record)?;
    item.tables.push(iterations(&record, &errors));
    let mut seconds: Vec<f64> = Vec::new();
    for iteration in &record.iterations {
        seconds.push(seconds.last().unwrap_or(&0.0) + iteration.seconds);
    }
    let points =
        errors.iter().map(|&(k, e)| PlotPoint { x: seconds[k], y: 100.0 * e, label: (k + 1).to_string() });
    let series =
        vec![Series { name: "after iteration".into(), points: points.collect(), marks: Marks::Joined }];
    let plot = Plot {
        x_label: "seconds".into(),
        y_label: "RMS error, % of the mean irradiance".into(),
        y_scale: Scale::Log,
        series,
        ..Plot::default()
    };
    item.charts
        .push(Chart { plot, caption: "Measured error after some iterations, with their numbers.".into() });
    item.check(
        format!("the scene has over {PAPER_POLYGONS} polygons"),
        polygons.to_string(),
        polygons > PAPER_POLYGONS,
    );
    let links: Vec<usize> = record.iterations.iter().map(|i| i.links).collect();
    item.check(
        "every iteration that refines adds links to the coarsest solution, a single link",
        format!("{} links", links.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
        links.len() > 2
            && links[0] == 1
            && record.iterations.windows(2).all(|i| i[1].refined == 0 || i[1].links > i[0].links),
    );
    let found: Vec<f64> = errors.iter().map(|e| 100.0 * e.1).collect();
    // The standard error of a root mean square of n independent errors is 1/√(2n) of it.
    let noise = 3.0 / (2.0 * AUDITED as f64).sqrt();
    item.check(
        "the measured error falls: from iteration to iteration, to three standard errors of it, and from the first to the last",
        format!("{} %, standard error {} % of each", list(&found, 1), fixed(100.0 * noise / 3.0, 1)),
        found.len() > 1
            && found.windows(2).all(|e| e[1] < e[0] * (1.0 + noise))
            && found[found.len() - 1] < found[0] * (1.0 - noise),
    );
    let slowest = record.iterations.iter().map(|i| i.seconds).fold(0.0, f64::max);
    item.check_time(
        format!("no iteration takes longer than the paper's 2 s, nor twice the {step} s that were asked for"),
        format!("at most {} s", fixed(slowest, 2)),
        slowest <= PAPER_SECONDS.min(2.0 * step),
    );
    Ok(item)
}

/// The iterations with the errors after them.
fn iterations(record: &Record, errors: &[(usize, f64)]) -> Table {
    let columns = ["iteration", "seconds", "paper, s", "links", "refined", "RMS error, %"];
    let mut table = Table::new("Iterations", &columns);
    for (k, iteration) in record.iterations.iter().enumerate() {
        let error = errors.iter().find(|e| e.0 == k).map_or("–".into(), |e| fixed(100.0 * e.1, 1));
        table.push([
            (k + 1).to_string(),
            fixed(iteration.seconds, 2),
            fixed(PAPER_SECONDS, 0),
            iteration.links.to_string(),
            iteration.refined.to_string(),
            error,
        ]);
    }
    table
}

/// Elements at which the error is measured.
const AUDITED: usize = 400;

/// RMS error after each iteration, by solves that end at as many links.
fn measured_errors(
    context: &Context,
    model: &Model,
    links: &Options,
    record: &Record,
) -> Result<Vec<(usize, f64)>> {
    let mut errors = Vec::new();
    for (k, iteration) in record.iterations.iter().enumerate() {
        let options = Options { max_links: iteration.links, audit: AUDITED, ..links.clone() };
        let found = radiosity::run(model, &[], &options, context.progress)?.record.error_estimate;
        errors.extend(found.map(|error| (k, error)));
    }
    Ok(errors)
}

/// Feature sizes where one looks and elsewhere, metres.
const LOOKED: f32 = 0.05;
const ELSEWHERE: f32 = 2.0;

/// Section 6: feature sizes and errors by importance. One looks at the desks.
pub fn importance(context: &Context) -> Result<Item> {
    let scene = generate::build(&Spec::new("office"))?;
    let model = Model::prepare(scene, &PrepareOptions::default(), context.progress)?;
    let [x, y] = DESKS[0];
    let (columns, rows) = (32, 16);
    let points: Vec<Point> = (0..columns * rows)
        .map(|k| {
            let [u, v] = [k % columns, k / columns].map(|i| f64::from(i) + 0.5);
            let at = DVec3::new(
                x - 0.78 + 1.56 * u / f64::from(columns),
                y - 0.38 + 0.76 * v / f64::from(rows),
                0.74,
            );
            Point { position: at, normal: DVec3::Z }
        })
        .collect();
    let base = Options { local_rays: Some(0), audit: 0, ..Options::default() };
    let reference = Options { error: if context.small { 0.01 } else { 0.005 }, ..base.clone() };
    let mr = |rest: f32| Options { visibility: Visibility::Mr, feature_size: Some(rest), ..base.clone() };
    let named = Options { feature_sizes: vec![("desk".into(), LOOKED)], ..mr(ELSEWHERE) };
    let looked = Options { importance: vec!["desk".into()], ..mr(LOOKED) };
    let truth = radiosity::run(&model, &points, &reference, context.progress)?.irradiance;
    let columns = ["solve", "RMS error on the desk, %", "links", "exact rays, thousands", "seconds"];
    let mut table = Table::new("Irradiance on the desk", &columns);
    let mut found = Vec::new();
    for (name, options) in [
        ("0.05 m everywhere", mr(LOOKED)),
        ("2 m everywhere", mr(ELSEWHERE)),
        ("0.05 m on the desk, 2 m elsewhere", named),
        ("importance of the desk", looked),
    ] {
        let outcome = radiosity::run(&model, &points, &options, context.progress)?;
        let error = 100.0 * difference(&truth, &outcome.irradiance);
        let record = outcome.record;
        let rays = record.bundles.exact_rays as f64 / 1e3;
        let numbers =
            [fixed(error, 2), record.links.to_string(), fixed(rays, 0), fixed(record.seconds.work(), 2)];
        table.push([name.into()].into_iter().chain(numbers));
        found.push((error, record.links as f64, rays));
    }
    let goal = 100.0 * base.error;
    let mut item = Item {
        here: format!(
            "The office of Figure 7; one looks at the first desk. Feature sizes by surface (option `feature_sizes`), and importance (option \
             `importance`: errors elsewhere count by their effect on the desk, and feature sizes grow up to 7 times there). The goal of all \
             solves is an RMS error of {} %; errors on the desk are relative to an exact solve with a goal of {} %.",
            fixed(goal, 0),
            fixed(100.0 * reference.error, 1)
        ),
        ..Item::default()
    };
    item.tables.push(table);
    let [fine, coarse, named, looked] = [found[0], found[1], found[2], found[3]];
    item.check(
        "with the small size everywhere the goal is met on the desk, with the large one it is missed: shadows are lost",
        format!("{} % and {} %", fixed(fine.0, 2), fixed(coarse.0, 2)),
        fine.0 <= goal && coarse.0 > goal,
    );
    for (name, (error, links, rays)) in [("sizes by surface", named), ("importance", looked)] {
        item.check(
            format!("with {name} the image quality on the desk is that of the goal"),
            format!("{} %", fixed(error, 2)),
            error <= goal,
        );
        item.check(
            format!("and with {name} work is saved elsewhere: fewer links and exact rays"),
            format!(
                "{} of {} links, {} of {} thousand rays",
                links,
                fine.1,
                fixed(rays, 0),
                fixed(fine.2, 0)
            ),
            links < fine.1 && rays < fine.2,
        );
    }
    Ok(item)
}

/// RMS difference relative to the mean of the reference.
fn difference(reference: &[[f64; 3]], other: &[[f64; 3]]) -> f64 {
    let mean = |v: &[f64; 3]| v.iter().sum::<f64>() / 3.0;
    let square: f64 = reference.iter().zip(other).map(|(a, b)| (mean(a) - mean(b)).powi(2)).sum();
    let sum: f64 = reference.iter().map(mean).sum();
    (square * reference.len() as f64).sqrt() / sum
}
