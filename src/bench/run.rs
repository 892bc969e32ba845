//! One run from a scene to a record and images.

use super::measure::{MrRun, Reference, Run, Sample, Timer};
use super::page::ReceiverImages;
use super::receivers::{self, Receiver};
use super::record::{self, ExactRow, MrRow, ReceiverFbem, Record, SceneFacts, interpolate_log_log};
use super::sizes::default_sizes;
use super::workload::{Workload, surface_points};
use crate::characterise::{Traits, characterise};
use crate::embree::{CommittedScene, Device, SceneBuilder, Traversal};
use crate::hierarchy::{self, Hierarchy};
use crate::metrics::{FbemOptions, Image, fbem, norms};
use crate::ray::Packet;
use crate::scene::Scene;
use crate::visibility::{Exact, Leaf, MultiResolution, Workspace, fastest_traversal};
use crate::{Error, Result};
use std::time::Instant;

/// Rays of the exact rows.
const EXACT_RAYS: [usize; 5] = [1, 4, 16, 64, 256];
/// The exact image that is shown and compared in the record.
const SHOWN_RAYS: usize = 16;
/// Multi-resolution rows have this many times the segments asked for.
const MR_FACTORS: [usize; 3] = [1, 4, 16];
/// Most segments from a point to an emitter: what one scrambled sequence holds.
const MAX_RAYS: usize = 1 << 16;
/// Most receiver points.
const MAX_POINTS: usize = 100_000_000;
/// Rows faster than this many seconds are run again, this often in all; the least time of each section counts.
const SHORT: f64 = 0.3;
const REPEATS: usize = 6;
/// Seconds after which they are not, with the time for making segments: a run shall end.
const PATIENCE: f64 = 1.0;
/// Pairs that are asked, untimed, before each timed row.
const WARM_UP: usize = 1024;
/// Segments that a traversal is chosen on.
const TRIAL: usize = 1 << 14;
/// Part of the memory at hand that results may take.
const MEMORY_PART: f64 = 0.7;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Options {
    /// Feature sizes, scene units; none: [`default_sizes`].
    pub feature_sizes: Vec<f64>,
    /// Segments from a point to an emitter for the multi-resolution engine; 4 and 16 times as many are measured too.
    pub rays: usize,
    /// Receiver points.
    pub points: usize,
    /// Names of the receivers of shadow images; none: [`choose_receivers`](super::choose_receivers) says which.
    pub receivers: Vec<String>,
    /// Rays from a point to an emitter in the reference.
    pub reference_rays: usize,
    /// Threads of the timed sections; everything else uses all cores.
    pub threads: usize,
    /// Seed of every random choice.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            feature_sizes: Vec::new(),
            rays: 16,
            points: 20_000,
            receivers: Vec::new(),
            reference_rays: 1024,
            threads: 1,
            seed: 1,
        }
    }
}

impl Options {
    /// Whether the options make sense for any scene.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the option and its range.
    pub fn check(&self) -> Result<()> {
        let counts = [
            ("--rays", self.rays, MAX_RAYS),
            ("--reference-rays", self.reference_rays, MAX_RAYS),
            ("--points", self.points, MAX_POINTS),
            ("--threads", self.threads, 1024),
        ];
        for (name, count, most) in counts {
            if count == 0 || count > most {
                return Err(Error::Argument(format!("{name} {count}: must lie in 1..{most}")));
            }
        }
        let usable = |s: f64| s.is_finite() && s > 0.0 && (s as f32).is_normal();
        if let Some(s) = self.feature_sizes.iter().find(|&&s| !usable(s)) {
            return Err(Error::Argument(format!(
                "--feature-size {s}: must be a length above 0 in scene units"
            )));
        }
        Ok(())
    }

    /// The same for this scene.
    fn check_for(&self, scene: &Scene) -> Result<()> {
        self.check()?;
        if scene.emitters.is_empty() {
            let names: Vec<&str> = scene.objects.iter().take(4).map(|o| o.name.as_str()).collect();
            return Err(Error::Scene(format!(
                "{}: nothing emits light; add --emitter NAME=W with the name of an object, group or material and its \
                 power in watts (there are `{}`{})",
                scene.path.display(),
                names.join("`, `"),
                if scene.objects.len() > names.len() { ", …" } else { "" },
            )));
        }
        let diagonal = f64::from(scene.bounds.diagonal());
        if let Some(s) = self.feature_sizes.iter().find(|&&s| s > 10.0 * diagonal) {
            return Err(Error::Argument(format!(
                "--feature-size {s}: the whole scene is only {diagonal:.3} {} across",
                scene.unit
            )));
        }
        for name in &self.receivers {
            scene.faces_named(name)?;
        }
        // Points, pairs, both halves of the reference and the largest row with its intervals.
        let bytes = self.points as f64 * (32.0 + scene.emitters.len() as f64 * 40.0);
        match available_memory() {
            Some(available) if bytes > MEMORY_PART * available => Err(Error::Argument(format!(
                "--points {} with {} emitters need about {:.1} GB of memory, {:.1} GB are available: lower --points",
                self.points,
                scene.emitters.len(),
                bytes / 1e9,
                available / 1e9
            ))),
            _ => Ok(()),
        }
    }
}

/// Bytes that could be allocated now, where the system says so.
fn available_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<f64>().ok()? * 1024.0)
}

/// Is told how far a run has come. `()` ignores it.
pub trait Progress: Sync {
    /// A stage of so many steps begins; 0 if nobody knows.
    fn stage(&self, name: &str, steps: u64);
    /// So many more steps are done. Never called inside a timed section.
    fn advance(&self, steps: u64);
}

impl Progress for () {
    fn stage(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}

/// Measures a scene.
///
/// The record has everything but `build.load_s`, which only the caller knows. Everything in it but times, ratios of
/// times and the choice of Embree's call is the same for the same options, whatever the threads.
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
    progress.stage("hierarchy", 0);
    let hierarchy = timed(&mut build.hierarchy_s, || hierarchy::build(scene, &Default::default()));
    progress.stage("measuring clusters", 0);
    let traits =
        timed(&mut build.characterise_s, || characterise(scene, &hierarchy.micro, &Default::default()));

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

    let (reference, exact, mut rows) = bench.points(&workload, &mr);
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
        receivers,
    };
    Ok((record, images))
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

/// What all rows of a run share.
struct Bench<'a> {
    scene: &'a Scene,
    options: &'a Options,
    timer: Timer,
    traced: &'a CommittedScene,
    /// The widest packet that Embree traces on this machine.
    width: usize,
    sizes: Vec<f64>,
    progress: &'a dyn Progress,
}

impl Bench<'_> {
    /// Numbers of segments of the multi-resolution rows.
    fn mr_rays(&self) -> Vec<usize> {
        MR_FACTORS.iter().map(|f| f * self.options.rays).filter(|&n| n <= MAX_RAYS).collect()
    }

    /// Numbers of rays of the exact rows: the fixed ones and those that multi-resolution rows are compared with.
    fn exact_rays(&self) -> Vec<usize> {
        let mut rays: Vec<usize> = EXACT_RAYS.into_iter().chain(self.mr_rays()).collect();
        rays.sort_unstable();
        rays.dedup();
        rays
    }

    /// The fastest way of tracing packets like those of a row, on a sample spread over the workload.
    fn traversal(&self, workload: &Workload, rays: usize) -> Traversal {
        let pairs = workload.pairs.len();
        let run = (1024 / rays).clamp(1, 256).min(pairs);
        let runs = (TRIAL / (run * rays)).max(1).min(pairs.div_ceil(run));
        let (mut sample, mut part): (Vec<Packet>, Vec<Packet>) = (Vec::new(), Vec::new());
        for k in 0..runs {
            let first = (pairs - run) * k / runs;
            workload.packed(self.scene, first..first + run, rays, 0, &mut part);
            sample.append(&mut part);
        }
        fastest_traversal(self.traced, self.width, &sample)
    }

    fn reference(&self, stage: &str, workload: &Workload, rays: usize) -> Reference {
        self.progress.stage(stage, 2 * workload.pairs.len() as u64);
        let exact = Exact { scene: self.traced, traversal: self.traversal(workload, rays) };
        Reference::trace(self.scene, workload, exact, rays, &|n| self.progress.advance(n as u64))
    }

    /// An exact row: warm, then the least time of one or several runs.
    fn exact(&self, workload: &Workload, rays: usize) -> (Traversal, Run) {
        let engine = Exact { scene: self.traced, traversal: self.traversal(workload, rays) };
        let pairs = workload.pairs.len();
        let ask = |n: usize, advance: &dyn Fn(usize)| {
            self.timer.exact(self.scene, workload, 0..n, engine, rays, advance)
        };
        ask(pairs.min(WARM_UP), &|_| ());
        let run = least(
            |first| {
                ask(pairs, &|n| {
                    if first {
                        self.progress.advance((n * rays) as u64)
                    }
                })
            },
            |run: &mut Run| run,
        );
        (engine.traversal, run)
    }

    /// A multi-resolution row, likewise.
    fn mr(&self, workload: &Workload, engine: &MultiResolution, s: f64, rays: usize) -> MrRun {
        let pairs = workload.pairs.len();
        let ask = |n: usize, advance: &dyn Fn(usize)| {
            self.timer.multi_resolution(self.scene, workload, 0..n, engine, s as f32, rays, advance)
        };
        ask(pairs.min(WARM_UP), &|_| ());
        least(
            |first| {
                ask(pairs, &|n| {
                    if first {
                        self.progress.advance((n * rays) as u64)
                    }
                })
            },
            |run: &mut MrRun| &mut run.run,
        )
    }

    /// All rows over the receiver points.
    fn points(
        &self,
        workload: &Workload,
        engine: &MultiResolution,
    ) -> (Reference, Vec<ExactRow>, Vec<MrRow>) {
        let pairs = workload.pairs.len() as u64;
        let reference = self.reference("reference", workload, self.options.reference_rays);
        let all_rays: usize = self.exact_rays().iter().sum();
        self.progress.stage("exact", pairs * all_rays as u64);
        let exact: Vec<ExactRow> = self
            .exact_rays()
            .into_iter()
            .map(|rays| {
                let (traversal, run) = self.exact(workload, rays);
                let (rms, bias) = reference.errors(&run.visible);
                let mode = format!("occluded{}", traversal.width);
                ExactRow { rays, seconds: run.seconds(), mode, coherent: traversal.coherent, rms, bias }
            })
            .collect();
        let curve: Vec<(f64, f64)> = exact.iter().map(|row| (row.seconds, row.rms)).collect();
        let mr_rays: usize = self.mr_rays().iter().sum();
        self.progress.stage("multi-resolution", pairs * (mr_rays * self.sizes.len()) as u64);
        let mut rows = Vec::new();
        for rays in self.mr_rays() {
            for &s in &self.sizes {
                let result = self.mr(workload, engine, s, rays);
                let seconds = result.run.seconds();
                let (rms, bias) = reference.errors(&result.run.visible);
                let same_rms = interpolate_log_log(&curve, rms);
                let cost = result.cost;
                let segments = cost.segments.max(1) as f64;
                let as_many = exact.iter().find(|row| row.rays == rays).map_or(0.0, |row| row.seconds);
                rows.push(MrRow {
                    feature_size: s,
                    rays,
                    seconds,
                    rms,
                    bias,
                    interval_coverage: reference.coverage(&result.intervals),
                    aggregated_fraction: cost.aggregated as f64 / segments,
                    exact_rays: cost.exact_rays,
                    handed_over: cost.handed_over as f64 / segments,
                    decide_s: result.decide_s,
                    nodes_per_segment: cost.nodes as f64 / segments,
                    speedup_per_segment: ratio(as_many, seconds).unwrap_or(0.0),
                    speedup_at_same_rms: same_rms.and_then(|t| ratio(t.seconds, seconds)),
                    speedup_at_same_fbem: None,
                    extrapolated: same_rms.is_some_and(|t| t.extrapolated),
                });
            }
        }
        (reference, exact, rows)
    }

    /// Shadow images of the receivers, their errors, and `speedup_at_same_fbem` of the rows.
    fn images(
        &self,
        engine: &MultiResolution,
        rows: &mut [MrRow],
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<record::Receiver>, Vec<ReceiverImages>)> {
        self.progress.stage("receivers", 0);
        let single = Exact { scene: self.traced, traversal: Traversal { width: 1, coherent: false } };
        let receivers = receivers::choose(self.scene, &single, &self.options.receivers)?;
        if receivers.is_empty() {
            warnings.push("No planar surface sees an emitter: there are no shadow images.".into());
        }
        for receiver in receivers.iter().filter(|r| !r.lit) {
            warnings.push(format!("No light arrives at the receiver `{}`.", receiver.name));
        }
        let points = receivers.iter().flat_map(Receiver::points).collect();
        let workload = Workload::new(self.scene, points, self.options.seed ^ 0x696d_6167_6573);
        if workload.pairs.is_empty() {
            return Ok((Vec::new(), Vec::new()));
        }
        let gallery = Gallery { receivers: &receivers, workload: &workload };
        let pairs = workload.pairs.len() as u64;
        let reference = self.reference("reference images", &workload, self.options.reference_rays);
        let means: Vec<f32> = (0..workload.pairs.len()).map(|pair| reference.mean(pair)).collect();
        let references = gallery.images(&means)?;

        let all_rays: usize = self.exact_rays().iter().sum();
        self.progress.stage("exact images", pairs * all_rays as u64);
        let mut exact = Vec::new();
        for rays in self.exact_rays() {
            let (_, run) = self.exact(&workload, rays);
            exact.push((rays, run.seconds(), gallery.images(&run.visible)?));
        }
        let shown = &exact.iter().find(|e| e.0 == SHOWN_RAYS).expect("one of the fixed numbers").2;
        // The feature-based error of the exact images by size: one curve against time for each.
        let mut curves = Vec::new();
        for &s in &self.sizes {
            let mut curve = Vec::new();
            for (_, seconds, images) in &exact {
                curve.push((*seconds, gallery.pooled_fbem(&references, images, s)?));
            }
            curves.push(curve);
        }

        let mr_rays: usize = self.mr_rays().iter().sum();
        self.progress.stage("multi-resolution images", pairs * (mr_rays * self.sizes.len()) as u64);
        let mut shown_mr: Vec<Vec<Image>> = Vec::new();
        let mut row = rows.iter_mut();
        for rays in self.mr_rays() {
            for (&s, curve) in self.sizes.iter().zip(&curves) {
                let run = self.mr(&workload, engine, s, rays).run;
                let images = gallery.images(&run.visible)?;
                let error = gallery.pooled_fbem(&references, &images, s)?;
                let same = interpolate_log_log(curve, error);
                let row = row.next().expect("rows have the same order");
                debug_assert!(row.rays == rays && row.feature_size == s);
                row.speedup_at_same_fbem = same.and_then(|t| ratio(t.seconds, run.seconds()));
                if rays == self.options.rays {
                    shown_mr.push(images);
                }
            }
        }
        self.gather(&receivers, references, shown, shown_mr)
    }

    /// Figures and images, receiver by receiver.
    fn gather(
        &self,
        receivers: &[Receiver],
        references: Vec<Image>,
        shown: &[Image],
        mut shown_mr: Vec<Vec<Image>>,
    ) -> Result<(Vec<record::Receiver>, Vec<ReceiverImages>)> {
        let (mut figures, mut images) = (Vec::new(), Vec::new());
        for (i, (receiver, reference)) in receivers.iter().zip(references).enumerate().rev() {
            let exact16 = shown[i].clone();
            let l2 = norms(&reference, &exact16)?.l2;
            let mut errors = Vec::new();
            let mut mr = Vec::new();
            for (&s, images) in self.sizes.iter().zip(&mut shown_mr) {
                let image = images.pop().expect("an image a receiver");
                errors.push(ReceiverFbem {
                    feature_size: s,
                    exact16: fbem_of(&reference, &exact16, s)?,
                    mr: fbem_of(&reference, &image, s)?,
                    l2_exact16: l2,
                    l2_mr: norms(&reference, &image)?.l2,
                });
                mr.push((s as f32, image));
            }
            let Receiver { name, width, height, texel, .. } = receiver.clone();
            figures.push(record::Receiver { name: name.clone(), width, height, texel, l2, fbem: errors });
            images.push(ReceiverImages { name, reference, exact16, mr });
        }
        figures.reverse();
        images.reverse();
        Ok((figures, images))
    }
}

/// One run or, if it is short, several, with the least times. `run` is told whether it is the first; `times` finds the
/// times in what it returns.
fn least<R>(mut run: impl FnMut(bool) -> R, times: impl Fn(&mut R) -> &mut Run) -> R {
    let start = Instant::now();
    let mut best = run(true);
    let mut total = times(&mut best).seconds();
    for _ in 1..REPEATS {
        if total >= SHORT || start.elapsed().as_secs_f64() >= PATIENCE {
            break;
        }
        let mut again = run(false);
        let again = times(&mut again);
        total += again.seconds();
        times(&mut best).shorten(again);
    }
    best
}

/// `a / b` if that is a number.
fn ratio(a: f64, b: f64) -> Option<f64> {
    let ratio = a / b;
    ratio.is_finite().then_some(ratio)
}

fn fbem_of(reference: &Image, image: &Image, size: f64) -> Result<f64> {
    Ok(fbem(reference, image, &FbemOptions { size, ..FbemOptions::default() })?.value)
}

/// The receivers' images as one workload.
struct Gallery<'a> {
    receivers: &'a [Receiver],
    workload: &'a Workload,
}

impl Gallery<'_> {
    /// An image a receiver of the part of the light that arrives, from the visible fraction of each pair.
    fn images(&self, visible: &[f32]) -> Result<Vec<Image>> {
        let mut values = self.workload.weighted(visible).into_iter();
        let image = |r: &Receiver| {
            let texels = values.by_ref().take(r.width * r.height).collect();
            Image::new(r.width, r.height, r.texel, texels)
        };
        self.receivers.iter().map(image).collect()
    }

    /// Root mean square over all receivers' areas of the feature-based error.
    fn pooled_fbem(&self, references: &[Image], images: &[Image], size: f64) -> Result<f64> {
        let (mut sum, mut area) = (0.0, 0.0);
        for (reference, image) in references.iter().zip(images) {
            let a = (reference.width() * reference.height()) as f64 * reference.texel() * reference.texel();
            sum += a * fbem_of(reference, image, size)?.powi(2);
            area += a;
        }
        Ok((sum / f64::max(area, f64::MIN_POSITIVE)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_range_are_errors() {
        let good = Options::default();
        good.check().unwrap();
        let bad = [
            Options { rays: 0, ..good.clone() },
            Options { rays: 100_000, ..good.clone() },
            Options { points: 0, ..good.clone() },
            Options { points: 1_000_000_000, ..good.clone() },
            Options { reference_rays: 0, ..good.clone() },
            Options { threads: 0, ..good.clone() },
        ];
        assert!(bad.iter().all(|o| o.check().is_err()));
        for s in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
            assert!(Options { feature_sizes: vec![s], ..good.clone() }.check().is_err(), "{s}");
        }
    }

    #[test]
    fn short_runs_are_repeated_and_the_least_times_count() {
        let run = |seconds: f64| Run { visible: Vec::new(), sections: vec![seconds] };
        let mut next = [0.04, 0.02, 0.03, 0.05, 0.06, 0.07, 0.001].into_iter();
        assert_eq!(least(|_| run(next.next().unwrap()), |r| r).seconds(), 0.02);
        let mut calls = 0;
        let long = |first: bool| {
            assert!(first);
            calls += 1;
            run(1.0)
        };
        assert_eq!(least(long, |r| r).seconds(), 1.0);
        assert_eq!(calls, 1);
    }
}
