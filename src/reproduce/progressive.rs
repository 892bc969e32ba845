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
    let (step, max_links) = if context.small { (0.02, 4000) } else { (0.05, 20_000) };
    let links = Options { local_rays: Some(0), audit: 0, ..Options::default() };
    let steps = Options { step_seconds: Some(step), max_links, ..links.clone() };
    let record = radiosity::run(&model, &[], &steps, context.progress)?.record;
    let mut item = Item {
        here: format!(
            "`mrvis generate urban-block --count 7000`, {polygons} polygons, links alone (`solve --step-seconds {step} --max-links {max_links} \
             --local-rays 0`). \
             Each step refines the links above the threshold that a histogram of their errors gives for the time; the RMS error after a \
             step, relative to the mean irradiance, is that of another solve that ends at as many links, measured by independent paths."
        ),
        ..Item::default()
    };
    let errors = measured_errors(context, &model, &links, &record)?;
    let columns = ["iteration", "seconds", "paper, s", "links", "largest link error, %", "RMS error, %"];
    let mut table = Table::new("Iterations", &columns);
    for (k, iteration) in record.iterations.iter().enumerate() {
        let error = errors.iter().find(|e| e.0 == k).map_or("–".into(), |e| fixed(100.0 * e.1, 1));
        table.push([
            (k + 1).to_string(),
            fixed(iteration.seconds, 2),
            fixed(PAPER_SECONDS, 0),
            iteration.links.to_string(),
            fixed(100.0 * iteration.error_bound, 3),
            error,
        ]);
    }
    item.tables.push(table);
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
        "every iteration refines further: links grow from the coarse solution, in more than three iterations",
        format!("{} links, then {} in {} iterations", links[0], links[links.len() - 1], links.len()),
        links.len() > 3 && links.windows(2).all(|n| n[1] >= n[0]) && links[links.len() - 1] > 100 * links[0],
    );
    let found: Vec<f64> = errors.iter().map(|e| 100.0 * e.1).collect();
    item.check(
        "the measured error falls from the first to the last iteration, to less than half",
        list(&found, 1) + " %",
        found.len() > 1 && found[found.len() - 1] < 0.5 * found[0],
    );
    let slowest = record.iterations.iter().map(|i| i.seconds).fold(0.0, f64::max);
    item.check_time(
        "no iteration takes longer than the paper's 2 s",
        format!("at most {} s", fixed(slowest, 2)),
        slowest <= PAPER_SECONDS,
    );
    Ok(item)
}

/// RMS error after the first, some middle and the last iteration, by solves that end at as many links.
fn measured_errors(
    context: &Context,
    model: &Model,
    links: &Options,
    record: &Record,
) -> Result<Vec<(usize, f64)>> {
    let last = record.iterations.len().saturating_sub(1);
    let mut chosen = vec![0, last / 3, 2 * last / 3, last];
    chosen.dedup();
    let mut errors = Vec::new();
    for k in chosen {
        let max_links = record.iterations[k].links.max(1);
        let options = Options { max_links, audit: if context.small { 200 } else { 400 }, ..links.clone() };
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
    let looked = Options { importance: vec!["desk".into()], ..mr(LOOKED) };
    let truth = radiosity::run(&model, &points, &reference, context.progress)?.irradiance;
    let columns = ["solve", "RMS error on the desk, %", "links", "exact rays, thousands", "seconds"];
    let mut table = Table::new("Irradiance on the desk", &columns);
    let mut found = Vec::new();
    for (name, options) in [
        ("0.05 m everywhere", mr(LOOKED)),
        ("2 m everywhere", mr(ELSEWHERE)),
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
    let mut item = Item {
        here: "The office of Figure 7; one looks at the first desk (`solve --visibility mr --importance desk`): errors elsewhere count by \
               their effect on the desk, and feature sizes grow up to 7 times there. The reference is an exact solve with error 0.005."
            .into(),
        ..Item::default()
    };
    item.tables.push(table);
    let [fine, coarse, looked] = [found[0], found[1], found[2]];
    item.check(
        "with a large size everywhere shadows on the desk are lost: over twice the error",
        format!("{} % and {} %", fixed(fine.0, 2), fixed(coarse.0, 2)),
        coarse.0 > 2.0 * fine.0,
    );
    item.check(
        "with importance they are kept: less than 5 % of error, and less than with the large size",
        format!("{} %", fixed(looked.0, 2)),
        looked.0 < 5.0 && looked.0 < coarse.0,
    );
    item.check(
        "and work is saved elsewhere: less than a tenth of the links, and less than a quarter of the rays",
        format!(
            "{} of {} links, {} of {} thousand rays",
            looked.1,
            fine.1,
            fixed(looked.2, 0),
            fixed(fine.2, 0)
        ),
        looked.1 < 0.1 * fine.1 && looked.2 < 0.25 * fine.2,
    );
    Ok(item)
}

/// RMS difference relative to the mean of the reference.
fn difference(reference: &[[f64; 3]], other: &[[f64; 3]]) -> f64 {
    let mean = |v: &[f64; 3]| v.iter().sum::<f64>() / 3.0;
    let square: f64 = reference.iter().zip(other).map(|(a, b)| (mean(a) - mean(b)).powi(2)).sum();
    let sum: f64 = reference.iter().map(mean).sum();
    (square * reference.len() as f64).sqrt() / sum
}
