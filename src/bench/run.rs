//! A benchmark run: from a model to a record and images.

use super::context::Bench;
use super::context::Measured;
use super::exact_reference::ExactReference;
use super::gallery::single_rays;
use super::measure::{MAX_TIME, Queries, Timer};
use super::options::BenchOptions;
use super::page::ReceiverImages;
use super::prepare::build_of;
use super::receivers::{self, Surfaces};
use super::record::{self, Record, RunSeconds};
use super::sizes::{default_sizes, of_images};
use super::workload::{Workload, surface_points};
use super::{lights, unaveraged};
use crate::model::Model;
use crate::model::summary::SceneSummary;
use crate::optics::{self, Extinction};
use crate::progress::{Progress, timed};
use crate::{Error, Result, error::shown};
use std::time::Instant;

/// The error if no point of a bench faces an emitter: too few points, or no surface that faces one.
fn unlit(model: &Model, options: &BenchOptions) -> Result<Error> {
    /// Points of the search: they find a surface of a thousandth of the scene's area with a probability of 98 %.
    const MIN_POINTS: usize = 4096;
    let points = surface_points(model, MIN_POINTS.max(options.points), options.seed)?;
    let path = shown(&model.scene().path);
    let found = Workload::new(model, points, options.seed);
    Ok(match found.pairs.is_empty() {
        false => {
            let problem = "none of them faces an emitter, though surfaces of the scene do";
            Error::argument("points", options.points, problem).with_cure("ask for more")
        }
        true if found.is_under_a_sky() => Error::Scene(format!(
            "{path}: no surface faces the sky: all of them face downwards; turn them around, or the upward axis (⟨LoadOptions::up⟩)"
        )),
        true => Error::Scene(format!("{path}: no surface faces an emitter: {}", model.cause_of_darkness())),
    })
}

/// Measures a scene.
///
/// The record is complete but for `build.load_s`, which the caller knows. All of it is independent of the number of
/// threads, except times, ratios of times, Embree's ray call and the origin of the clusters.
///
/// # Errors
/// An option is out of range, a name is unknown, the scene has no emitter or no receiver, Embree fails, or `progress` stops the run, which
/// is asked between its stages.
pub fn run(
    model: &Model,
    options: &BenchOptions,
    progress: &dyn Progress,
) -> Result<(Record, Vec<ReceiverImages>)> {
    let scene = model.scene();
    options.check_for(scene)?;
    model.check_clusters("the benchmark")?;
    let timer = Timer::new(options.threads)?;
    let (mut build, mut spent, start) = (build_of(model), RunSeconds::default(), Instant::now());
    let points = surface_points(model, options.points, options.seed)?;
    let workload = Workload::new(model, points, options.seed);
    if workload.pairs.is_empty() {
        return Err(unlit(model, options)?);
    }
    progress.stage("receivers", 0);
    let surfaces = receivers::choose(model, &single_rays(model), &options.receivers)?;
    let sizes = sizes(model, &surfaces, options);
    let mut warnings = Vec::new();
    let bench = Bench { model, scene, options, timer, sizes, progress };
    let sample = timed(&mut build.budget_s, || bench.sample(&workload));
    let mr = bench.engine(&workload, &sample, &mut build);
    bench.go_on()?;
    let every: Vec<usize> = (0..workload.pairs.len()).collect();
    let queries = Queries { scene, workload: &workload, pairs: &every };
    spent.choice_s = start.elapsed().as_secs_f64();
    let measured = timed(&mut spent.points_s, || bench.points(queries, &mr, &sample, MAX_TIME));
    let mut classes = timed(&mut spent.classes_s, || bench.classes(&workload, &mr, &measured))?;
    // Sizes that were asked for keep their rows.
    if options.feature_sizes.is_empty() {
        classes.iter_mut().for_each(|class| class.keep_one_if_unaveraged(options.rays));
    }
    bench.go_on()?;
    warnings.extend(unseen_sky(&workload, &measured.reference));
    let Measured { reference, exact, certified, mr: mut rows, rounds } = measured;
    let mut images = timed(&mut spent.images_s, || bench.images(&surfaces, &mr, &mut rows, &mut warnings))?;
    bench.go_on()?;
    let mut maps = timed(&mut spent.maps_s, || bench.maps(&surfaces, &mr, &build))?;
    build.exact_setup_s = build.embree_s + exact.iter().map(|row| row.setup_s).sum::<f64>();
    build.mr_setup_s = build.mr_preparation() + rows.iter().map(|row| row.decide_s).sum::<f64>();
    let nothing_averaged = unaveraged::sentence(&rows, &classes, &images, &maps, &scene.unit);
    // Sizes that were asked for keep their rows.
    if nothing_averaged.is_some() && options.feature_sizes.is_empty() {
        unaveraged::keep_one(&mut rows, &mut images, &mut maps, options.rays);
    }
    let record = Record {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        embree: model.embree_version(),
        threads: options.threads,
        isa: mr.isa().name().into(),
        unit: scene.unit.clone(),
        seed: options.seed,
        scene: SceneSummary::of(model),
        scene_repairs: serde_json::to_value(&scene.repairs).unwrap_or_default(),
        warnings,
        clusters: clusters_of(model.optics_options()),
        build,
        workload: record::Workload {
            points: options.points,
            rays: options.rays,
            segments: (workload.pairs.len() * options.rays) as u64,
            reference_rays: reference.rays,
            reference_rms: reference.standard_error(),
            rounds,
            sky: lights::record(scene),
        },
        spent,
        exact,
        certified,
        mr: rows,
        classes,
        nothing_averaged,
        receivers: images.errors,
        maps,
    };
    Ok((record, images.shown))
}

/// A note if there are suns or patches of the sky and no point sees any.
fn unseen_sky(workload: &Workload, reference: &ExactReference) -> Option<String> {
    let mut distant = (0..workload.pairs.len()).filter(|&pair| workload.is_distant(pair)).peekable();
    distant.peek()?;
    distant.all(|pair| reference.mean(pair) == 0.0).then(|| {
        "No receiver point sees the sky or the sun: surfaces lie between them everywhere, as in a closed room. Open the room, or light it by \
         emitters in it."
            .into()
    })
}

/// The settings of cluster optics.
fn clusters_of(options: optics::Options) -> record::Clusters {
    record::Clusters {
        extinction: match options.extinction {
            Extinction::Measured => "measured".into(),
            Extinction::Analytic => "analytic".into(),
        },
        tolerance: options.tolerance.into(),
    }
}

/// Feature sizes of the options or by default, ascending, without duplicates.
fn sizes(model: &Model, surfaces: &Surfaces, options: &BenchOptions) -> Vec<f64> {
    let mut sizes = match &options.feature_sizes[..] {
        [] => surfaces.feature_sizes().map_or_else(|| default_sizes(model), of_images),
        sizes => sizes.to_vec(),
    };
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    sizes
}
