//! Growth of cost with the size of the scene: both engines in forests of 10,000, 100,000, 1,000,000, ... triangles.
//!
//! Two series at one feature size. *Wider*: more trees over more ground, at constant density, with a sky panel of
//! constant solid angle and as many points per tree. The surroundings of a bundle stay the same, so time grows with
//! the depth of the hierarchies only. *Finer*: as many trees with more and smaller leaves of constant total area.
//! Only detail below the feature size is added, which should not change the time of MR.

use super::context::Bench;
use super::measure::{MrRun, Queries, Run, Timer};
use super::options::Options;
use super::prepare::build_of;
use super::record::{ScalingRecord, ScalingRow};
use super::rounds::{MAX_TIME, rounds, timed};
use super::workload::{ReceiverPoint, Workload, surface_points};
use crate::model::Model;
use crate::model::cache::CacheLocation;
use crate::progress::Progress;
use crate::scene::generate::{self, Spec, ground_and_sky};
use crate::{Error, Result};

/// Triangles of the smallest forest: at some 300 bytes per triangle, 3 MB no longer fit into the caches of a core.
const MIN_TRIANGLES: usize = 10_000;
/// Largest number of triangles: limits memory to some 30 GB, at 300 bytes per triangle (line `memory` of `mrvis
/// bench`).
const MAX_TRIANGLES: usize = 100_000_000;
/// Default feature size, metres: a quarter of the mean radius of a crown, 2 m.
const FEATURE_SIZE: f64 = 0.5;
/// Leaves per tree of series *wider*: two triangles each, so that [`MIN_TRIANGLES`] make ten trees.
const LEAVES_PER_TREE: usize = 500;
/// Number of trees of series *finer*: five rows of five.
const TREES: usize = 25;
/// Edge of the sky panel relative to its height, so that its solid angle from the ground is the same in all forests.
const SKY: f64 = 0.8;
/// Largest number of receiver points: limits the time of a row to 8,000 pairs per emitter.
const MAX_POINTS: usize = 8000;
/// Largest number of reference rays: noise of at most 1 / (2 √256) = 3 %; times are compared, errors only shown.
const MAX_REFERENCE_RAYS: usize = 256;
/// Number of places in the forest with receiver points: samples centre and border of the forest, four in each
/// direction.
const PLACES: usize = 16;

/// Series of forests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Series {
    Wider,
    Finer,
}

impl Series {
    fn name(self) -> &'static str {
        match self {
            Series::Wider => "wider",
            Series::Finer => "finer",
        }
    }

    /// The forest with about this many triangles. The number of trees is a square, so that they cover the ground.
    fn forest(self, triangles: usize, seed: u64) -> Spec {
        let leaves = triangles as f64 / 2.0;
        let (trees, leaves) = match self {
            Series::Wider => {
                (((leaves / LEAVES_PER_TREE as f64).sqrt().round() as usize).max(1).pow(2), LEAVES_PER_TREE)
            }
            Series::Finer => (TREES, ((leaves / TREES as f64).round() as usize).max(1)),
        };
        // The panel has the same solid angle over every forest.
        let (_, height) = ground_and_sky(trees);
        Spec { seed, trees, leaves, light_size: Some(SKY * height), ..Spec::new("forest") }
    }
}

/// Checks the size of the largest forest.
///
/// # Errors
/// [`Error::Argument`]: too few or too many triangles.
pub fn check_scaling(largest: usize) -> Result<()> {
    if !(MIN_TRIANGLES..=MAX_TRIANGLES).contains(&largest) {
        return Err(Error::Argument(format!(
            "scaling {largest}: must lie in {MIN_TRIANGLES}..{MAX_TRIANGLES} triangles"
        )));
    }
    Ok(())
}

/// Measures both series up to `largest` triangles, from 10,000 in steps of ten.
///
/// Uses these options: the first feature size (default: half a metre), segments, points, reference rays, threads and
/// seed. Writes no files.
///
/// # Errors
/// An option is out of range, or Embree fails.
pub fn scaling(options: &Options, largest: usize, progress: &dyn Progress) -> Result<ScalingRecord> {
    options.check()?;
    check_scaling(largest)?;
    let mut record = ScalingRecord { seed: options.seed, threads: options.threads, ..Default::default() };
    let options = Options {
        points: options.points.min(MAX_POINTS),
        reference_rays: options.reference_rays.min(MAX_REFERENCE_RAYS),
        ..options.clone()
    };
    for series in [Series::Wider, Series::Finer] {
        for triangles in
            std::iter::successors(Some(MIN_TRIANGLES), |n| n.checked_mul(10)).take_while(|&n| n <= largest)
        {
            let row = measure(series, triangles, &options, &mut record, progress)?;
            record.scaling.push(row);
        }
    }
    Ok(record)
}

/// Measures one forest; writes versions and unit to `record`.
fn measure(
    series: Series,
    triangles: usize,
    options: &Options,
    record: &mut ScalingRecord,
    progress: &dyn Progress,
) -> Result<ScalingRow> {
    let options = &Options { cache: CacheLocation::Off, ..options.clone() };
    let spec = series.forest(triangles, options.seed);
    progress.stage(&format!("forest of {triangles}"), 0);
    let scene = generate::build(&spec)?;
    let model = Model::prepare(scene, &options.prepare(), progress)?;
    let (scene, mut build) = (model.scene(), build_of(&model));
    let s = options.feature_sizes.first().copied().unwrap_or(FEATURE_SIZE);
    let bench = Bench {
        model: &model,
        scene,
        options,
        timer: Timer::new(options.threads)?,
        sizes: vec![s],
        progress,
    };
    let density = spec.trees as f64 / series.forest(MIN_TRIANGLES, options.seed).trees as f64;
    let workload = Workload::new(&model, points(&model, options, density)?, options.seed);
    let sample = timed(&mut build.budget_s, || bench.sample(&workload));
    let engine = bench.engine(&workload, &sample, &mut build);
    let (bundles, rays) = (workload.pairs.len(), options.rays);
    let every: Vec<usize> = (0..bundles).collect();
    let queries = Queries { scene, workload: &workload, pairs: &every };
    let reference = bench.reference(&format!("reference of {triangles}"), queries, options.reference_rays);
    progress.stage(&format!("both engines, {triangles}"), 2 * (bundles * rays) as u64);
    let (call, _) = bench.embree_timed(&workload, rays);
    let asked = bench.decide(&sample, &engine, s, rays);
    let (mut exact, mut mr) = (Run::default(), MrRun::default());
    let timed = rounds(options.rounds, MAX_TIME, if asked.pays() { 2 } else { 1 }, |row, first| {
        let run = match row {
            0 => MrRun { run: bench.exact(queries, &call, rays, first), ..MrRun::default() },
            _ => bench.mr(queries, &engine, &asked, first),
        };
        let sections = run.run.sections.clone();
        match (first, row) {
            (true, 0) => exact = run.run,
            (true, _) => mr = run,
            _ => {}
        }
        sections
    });
    if !asked.pays() {
        mr = MrRun::handed_over(exact.clone(), rays);
    }
    let seconds = [0, timed.seconds.len() - 1].map(|k| timed.seconds[k]);
    record.embree = model.embree_version();
    record.isa = engine.isa().name().into();
    (record.mrvis, record.unit) = (env!("CARGO_PKG_VERSION").into(), scene.unit.clone());
    let per_bundle = |seconds: f64| seconds / bundles.max(1) as f64;
    let segments = mr.cost.segments.max(1) as f64;
    Ok(ScalingRow {
        series: series.name().into(),
        triangles: scene.triangles.len(),
        trees: spec.trees,
        leaves: spec.leaves,
        feature_size: s,
        rays,
        bundles,
        seconds_per_bundle_mr: per_bundle(seconds[1]),
        seconds_per_bundle_exact: per_bundle(seconds[0]),
        rms_mr: reference.errors(&mr.run.visible).0,
        rms_exact: reference.errors(&exact.visible).0,
        nodes_per_segment: mr.cost.nodes as f64 / segments,
        handed_over: mr.cost.handed_over as f64 / segments,
        bytes: (build.bytes_per_triangle.total * scene.triangles.len() as f64).round() as u64,
        bytes_per_triangle: build.bytes_per_triangle,
        build_s: build.embree_s + build.hierarchy_s + build.characterise_s,
        embree_s: build.embree_s,
        hierarchy_s: build.hierarchy_s,
        characterise_s: build.characterise_s,
    })
}

/// Receiver points in a few places of the forest, with the same density in every forest. Points spread over a large
/// forest would measure cache misses instead of the engines.
fn points(model: &Model, options: &Options, density: f64) -> Result<Vec<ReceiverPoint>> {
    let all = surface_points(model, (options.points as f64 * density.max(1.0)) as usize, options.seed)?;
    let run = (options.points / PLACES).max(1);
    let places = (0..PLACES).map(|k| (all.len() - run) * k / (PLACES - 1));
    Ok(places.flat_map(|first| &all[first..first + run]).copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(series: Series, sizes: &[usize], s: f64) -> Vec<ScalingRow> {
        let options = Options {
            points: 500,
            rays: 64,
            reference_rays: 64,
            feature_sizes: vec![s],
            rounds: 1,
            ..Options::default()
        };
        let mut record = ScalingRecord::default();
        let row = |&n| measure(series, n, &options, &mut record, &()).expect("a forest");
        sizes.iter().map(row).collect()
    }

    #[test]
    fn forests_have_the_size_asked_for() {
        for triangles in [MIN_TRIANGLES, 100_000, 1_000_000, 10_000_000] {
            for series in [Series::Wider, Series::Finer] {
                let spec = series.forest(triangles, 1);
                let made = 2 * spec.trees * spec.leaves;
                assert!((made as f64 / triangles as f64 - 1.0).abs() < 0.11, "{series:?}: {made}");
                assert_eq!((spec.trees as f64).sqrt().fract(), 0.0, "{series:?}: {} trees", spec.trees);
            }
        }
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for n in [0, MIN_TRIANGLES - 1, MAX_TRIANGLES + 1] {
            assert!(check_scaling(n).is_err() && scaling(&Options::default(), n, &()).is_err(), "{n}");
        }
    }

    /// Measured in visited clusters, independent of the clock: a forest of nine times the size is less than one
    /// level deeper.
    #[test]
    fn a_wider_forest_costs_a_level_and_memory_in_proportion() {
        let rows = rows(Series::Wider, &[4_000, 36_000], 0.5);
        let [small, large] = &rows[..] else { panic!("two rows") };
        let [few, many] = [small, large].map(|r| r.rays as f64 * r.nodes_per_segment);
        assert!(few > 0.0 && many - few < 3.0, "{few} and {many} clusters a bundle");
        let bytes = [small, large].map(|r| {
            let b = r.bytes_per_triangle;
            // Embree's blocks of memory are large relative to small scenes.
            b.scene + b.hierarchy + b.optics + b.wide
        });
        assert!((bytes[1] / bytes[0] - 1.0).abs() < 0.1, "{bytes:?} bytes a triangle");
        let b = large.bytes_per_triangle;
        let total = b.scene + b.hierarchy + b.optics + b.wide + b.embree;
        assert!((b.total / total - 1.0).abs() < 1e-9 && b.scene >= 60.0 && b.optics > 0.0, "{b:?}");
    }

    /// Detail far below the feature size does not add visited clusters.
    #[test]
    fn finer_leaves_cost_nothing() {
        let rows = rows(Series::Finer, &[10_000, 40_000], 1.0);
        let nodes: Vec<f64> = rows.iter().map(|r| r.nodes_per_segment).collect();
        assert!(nodes[0] > 0.0 && nodes[1] < 1.15 * nodes[0], "{nodes:?} clusters a segment");
    }
}
