//! One run from a scene to a record and images.

use super::measure::{Questions, Sample, Timer};
use super::options::Options;
use super::page::ReceiverImages;
use super::progress::Progress;
use super::record::{self, Record, SceneFacts};
use super::rows::{Bench, plain_curve};
use super::sizes::default_sizes;
use super::workload::{Workload, surface_points};
use crate::cache::{self, Table};
use crate::characterise::{Extinction, Traits, characterise};
use crate::embree::{CommittedScene, Device, SceneBuilder};
use crate::hierarchy::{self, Hierarchy};
use crate::scene::Scene;
use crate::visibility::{Leaf, MultiResolution, Workspace};
use crate::{Error, Result};
use std::time::Instant;

/// Measures a scene.
///
/// The record has everything but `build.load_s`, which only the caller knows. Everything in it but times, ratios of
/// times, the choice of Embree's call and where the clusters came from is the same for the same options, whatever the
/// threads.
///
/// # Errors
/// An option is out of range, a name is unknown, nothing emits or receives light, Embree refuses.
pub fn run(
    scene: &Scene,
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Record, Vec<ReceiverImages>)> {
    options.check_for(scene)?;
    let timer = Timer::new(options.threads)?;
    let mut build = record::Build::default();
    let device = Device::new(0)?;
    progress.stage("Embree's tree", 0);
    let traced = timed(&mut build.embree_s, || -> Result<CommittedScene> {
        let mut builder = SceneBuilder::new(&device, Default::default())?;
        builder.add_triangles(&scene.positions, &scene.triangles, 1)?;
        builder.commit()
    })?;
    build.embree_bytes = device.bytes() as u64;
    let Table { hierarchy, traits } = table(scene, options, &mut build, progress);

    let points = surface_points(scene, options.points, options.seed)?;
    let workload = Workload::new(scene, points, options.seed);
    if workload.pairs.is_empty() {
        return Err(Error::Scene(format!(
            "{}: no surface faces an emitter; check the winding of the emitters' faces (front sides emit) or add \
             --two-sided-emission",
            scene.path.display()
        )));
    }
    let sizes = sizes(scene, options, &hierarchy, &traits);
    let mut warnings = Vec::new();
    let bench =
        Bench { scene, options, timer, traced: &traced, width: device.native_width(), sizes, progress };
    let engine = |workload: &Workload, seconds: &mut f64| {
        let traversal = bench.traversal(workload, options.rays);
        let engine = MultiResolution::new(scene, &hierarchy, &traits, &traced, traversal, Leaf::Exact);
        let sample = Sample::of(scene, workload, options.rays);
        timed(seconds, || engine.with_budget(&sample.bundles().concat(), &mut Workspace::default()))
    };
    let mr = engine(&workload, &mut build.budget_s);
    build.hierarchy_bytes =
        (hierarchy.micro.bytes() + hierarchy.large.bytes() + size_of_val(traits.as_slice()) + mr.bytes())
            as u64;

    let every: Vec<usize> = (0..workload.pairs.len()).collect();
    let questions = Questions { scene, workload: &workload, pairs: &every };
    let (reference, exact, mut rows) = bench.points(questions, &mr);
    let unbiased = match options.unbiased {
        true => bench.unbiased(questions, &mr, &reference, &plain_curve(&exact)),
        false => Vec::new(),
    };
    let (receivers, images) = bench.images(&mr, &mut rows, &mut warnings)?;
    let record = Record {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        embree: device.version(),
        threads: options.threads,
        isa: mr.isa().name().into(),
        unit: scene.unit.clone(),
        seed: options.seed,
        scene: facts(scene, &hierarchy),
        scene_repairs: serde_json::to_value(&scene.repairs).unwrap_or_default(),
        warnings,
        clusters: record::Clusters {
            extinction: match options.clusters.extinction {
                Extinction::Measured => "measured".into(),
                Extinction::Analytic => "analytic".into(),
            },
            tolerance: options.clusters.tolerance.into(),
        },
        build,
        workload: record::Workload {
            points: options.points,
            rays: options.rays,
            segments: (workload.pairs.len() * options.rays) as u64,
            reference_rays: reference.rays,
            reference_rms: reference.standard_error(),
        },
        exact,
        mr: rows,
        unbiased,
        receivers,
    };
    Ok((record, images))
}

/// Clusters and their measures: made, or from the cache.
fn table(scene: &Scene, options: &Options, build: &mut record::Build, progress: &dyn Progress) -> Table {
    let how = cache::Options { characterise: options.clusters, ..Default::default() };
    let start = Instant::now();
    progress.stage("looking for measured clusters", 0);
    let (table, origin, note) = cache::table(scene, &options.cache, &how, || {
        progress.stage("hierarchy", 0);
        let hierarchy = timed(&mut build.hierarchy_s, || hierarchy::build(scene, &how.hierarchy));
        progress.stage("measuring clusters", 0);
        let traits =
            timed(&mut build.characterise_s, || characterise(scene, &hierarchy.micro, &how.characterise));
        Table { hierarchy, traits }
    });
    build.cache_s = start.elapsed().as_secs_f64() - build.hierarchy_s - build.characterise_s;
    (build.cache, build.cache_note) = (origin.name().into(), note);
    table
}

/// The result and, added up, the seconds it took.
fn timed<R>(seconds: &mut f64, make: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = make();
    *seconds += start.elapsed().as_secs_f64();
    result
}

fn facts(scene: &Scene, hierarchy: &Hierarchy) -> SceneFacts {
    SceneFacts {
        path: scene.path.display().to_string(),
        triangles: scene.triangles.len(),
        objects: scene.objects.len(),
        emitters: scene.emitters.len(),
        closed_parts: scene.closed_parts,
        sheet_parts: scene.sheet_parts,
        clusters: hierarchy.micro.clusters.len() + hierarchy.large.clusters.len(),
        levels: hierarchy.micro.levels().max(hierarchy.large.levels()),
    }
}

/// Feature sizes asked for or found, ascending, each once.
fn sizes(scene: &Scene, options: &Options, hierarchy: &Hierarchy, traits: &[Traits]) -> Vec<f64> {
    let mut sizes = match &options.feature_sizes[..] {
        [] => default_sizes(scene, &hierarchy.micro, traits),
        sizes => sizes.to_vec(),
    };
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    sizes
}
