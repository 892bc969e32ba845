//! Shadow images of a run by both engines, and their feature-based errors.
//!
//! The images of the report have as many texels as the feature sizes need. Rows are timed on the middle of the images
//! only: each row of every number of rays makes an image there, and their errors give the speed-up at the same
//! feature-based error.

use super::context::{Bench, PlannedRow};
use super::lights;
use super::measure::{MAX_ROUNDS, MAX_TIME, MrRun, Queries, Timer, rounds};
use super::page::{MrImage, ReceiverImages};
use super::receivers::{Crop, ReceiverGrid, Surfaces};
use super::record::{self, MrRow, ReceiverFbem, interpolate_log_log, ratio, speedup};
use super::workload::Workload;
use crate::embree::Traversal;
use crate::metrics::{Image, fbem::fbem_at, missing_features, norms};
use crate::model::Model;
use crate::visibility::{Cost, Exact, MultiResolution, Route};
use crate::{Error, Result, error::quote};

/// Rays per texel of the exact image in the report: as many as the default number of segments of MR.
const SHOWN_RAYS: usize = 16;
/// Pairs of the parts of the images on which rows are timed, fewer in proportion where fewer rounds are asked for: about 70 million
/// segments of all rows a round, some ten seconds on one core.
const TIMED_PAIRS: usize = 40_000;
/// Rays per pair of the shown reference that decide whether the emitter is partly visible there, and rays where it is.
/// Where the first agree, they miss less than about 1/64 of the emitter. 256 stratified rays have an error of less than
/// one step of 8-bit grey in the mean.
const SHOWN_REFERENCE_RAYS: [usize; 2] = [64, 256];

/// Shadow images of a run.
#[derive(Default)]
pub(super) struct Imaged {
    /// Errors by receiver.
    pub errors: Vec<record::ReceiverErrors>,
    /// Images by receiver.
    pub shown: Vec<ReceiverImages>,
    /// Whether a segment of an MR image met an averaged cluster.
    pub averaged: bool,
    /// Whether clusters were asked for every texel at the largest size and all of them were opened.
    pub all_opened: bool,
}

/// Images by receiver.
struct ShownImages {
    reference: Vec<Image<'static>>,
    exact16: Vec<Image<'static>>,
    /// By feature size, with whether all bundles were handed to Embree.
    mr: Vec<(bool, Vec<Image<'static>>)>,
    /// If that is so at all sizes: what clusters answer at the largest.
    clusters: Option<Vec<Image<'static>>>,
    /// See [`Imaged::averaged`].
    averaged: bool,
    /// See [`Imaged::all_opened`].
    all_opened: bool,
}

/// Exact rays that select receivers.
pub(super) fn single_rays(model: &Model) -> Exact {
    Exact { scene: model.traced().clone(), traversal: Traversal { width: 1, coherent: false } }
}

impl Bench<'_> {
    /// Measures shadow images of the receivers, and `speedup_at_same_fbem` of the rows.
    pub fn images(
        &self,
        surfaces: &Surfaces,
        engine: &MultiResolution,
        rows: &mut [MrRow],
        warnings: &mut Vec<String>,
    ) -> Result<Imaged> {
        self.progress.stage("receivers", 0);
        let sizes = [self.sizes[0], self.sizes[self.sizes.len() - 1]];
        let receivers = surfaces.grids(self.model, &single_rays(self.model), sizes);
        if receivers.is_empty() {
            warnings.push("There are no shadow images: no emitter is visible from a plane surface or a terrain, which they need.".into());
        }
        for receiver in receivers.iter().filter(|r| !r.lit) {
            warnings.push(format!("No light arrives at the receiver `{}`.", quote(&receiver.name)));
        }
        let texels: usize = receivers.iter().map(|r| r.points.len()).sum();
        let pairs = TIMED_PAIRS * self.options.rounds / MAX_ROUNDS;
        let part = pairs as f64 / (texels * lights::shown(self.scene)).max(1) as f64;
        let parts: Vec<Crop> = receivers.iter().map(|r| r.middle(part)).collect();
        let timed: Vec<ReceiverGrid> = receivers.iter().zip(&parts).map(|(r, part)| r.only(*part)).collect();
        let workload = self.texels(&timed);
        if workload.pairs.is_empty() {
            return Ok(Imaged::default());
        }
        self.progress.stage("choosing", 0);
        let sample = self.sample(&workload);
        let asked = self.decisions(&sample, engine);
        let shown = self.shown(&receivers, engine, &asked)?;
        let certified = self.certified_rays(&sample, engine);
        self.time(engine, rows, &asked, certified, &Gallery { receivers: &timed, workload: &workload })?;
        self.gather(&receivers, shown)
    }

    /// The texels of receivers as one workload.
    fn texels(&self, receivers: &[ReceiverGrid]) -> Workload {
        let points = receivers.iter().flat_map(|r| r.points.iter().copied()).collect();
        Workload::shown(self.model, points, self.options.seed ^ 0x696d_6167_6573)
    }

    /// The images of the report, on all cores.
    fn shown(
        &self,
        receivers: &[ReceiverGrid],
        engine: &MultiResolution,
        asked: &[PlannedRow],
    ) -> Result<ShownImages> {
        let workload = self.texels(receivers);
        let gallery = Gallery { receivers, workload: &workload };
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let queries = Queries { scene: self.scene, workload: &workload, pairs: &every };
        let [few, many] = SHOWN_REFERENCE_RAYS.map(|rays| rays.min(self.options.reference_rays));
        let first = self.reference("reference images", queries, few);
        let mut means: Vec<f32> = every.iter().map(|&pair| first.mean(pair)).collect();
        let partly: Vec<usize> =
            every.iter().copied().filter(|&k| means[k] > 0.0 && means[k] < 1.0).collect();
        let more = Queries { pairs: &partly, ..queries };
        let full = self.reference("reference images", more, many);
        for (k, &pair) in partly.iter().enumerate() {
            means[pair] = full.mean(k);
        }
        let shown: Vec<PlannedRow> =
            asked.iter().filter(|row| row.rays == self.options.rays).copied().collect();
        let timer = Timer::new(rayon::current_num_threads())?;
        self.progress.stage("images", (every.len() * (SHOWN_RAYS + self.options.rays * shown.len())) as u64);
        let exact = |rays: usize| {
            let advance = |pairs: usize| self.progress.advance((pairs * rays) as u64);
            gallery.images(&timer.exact(queries, &self.embree(&workload, rays), rays, &advance).visible)
        };
        let exact16 = exact(SHOWN_RAYS)?;
        let walked = |row: &PlannedRow, route: Route| {
            let advance = |pairs: usize| self.progress.advance((pairs * row.rays) as u64);
            let engine = &engine.with_route(route);
            let MrRun { run, cost, .. } =
                timer.multi_resolution(queries, engine, row.s as f32, row.rays, &advance);
            Ok::<_, Error>((gallery.images(&run.visible)?, cost))
        };
        let shows_exact = self.options.rays != SHOWN_RAYS && shown.iter().any(|row| !row.pays());
        let as_rows = if shows_exact { exact(self.options.rays)? } else { exact16.clone() };
        let mut mr: Vec<_> = shown.iter().map(|row| (!row.averages(), as_rows.clone())).collect();
        let mut averaged = false;
        for run in PlannedRow::runs(&shown) {
            let (images, cost) = walked(&shown[run[0]], shown[run[0]].route)?;
            averaged |= cost.aggregated > 0;
            run.iter().for_each(|&k| mr[k].1.clone_from(&images));
        }
        let largest = shown.last().filter(|_| shown.iter().all(|row| !row.averages()));
        let (clusters, cost) = largest.map(|row| walked(row, Route::WALKS)).transpose()?.unzip();
        let all_opened = cost.is_some_and(|cost: Cost| cost.aggregated == 0 && cost.handed_over == 0);
        Ok(ShownImages { reference: gallery.images(&means)?, exact16, mr, clusters, averaged, all_opened })
    }

    /// Times all rows on a gallery, and fills in `speedup_at_same_fbem`.
    fn time(
        &self,
        engine: &MultiResolution,
        rows: &mut [MrRow],
        asked: &[PlannedRow],
        certified: Vec<usize>,
        gallery: &Gallery,
    ) -> Result<()> {
        let workload = gallery.workload;
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let queries = Queries { scene: self.scene, workload, pairs: &every };
        let reference = self.reference("reference images", queries, self.options.reference_rays);
        let means: Vec<f32> = every.iter().map(|&pair| reference.mean(pair)).collect();
        let references = gallery.images(&means)?;
        let call = |rays| (rays, self.embree(workload, rays));
        let calls: Vec<(usize, Exact)> = self.exact_rays().into_iter().map(call).collect();
        let runs = PlannedRow::runs(asked);
        let first_mr = calls.len() + certified.len();
        let numbers = calls.iter().map(|call| call.0).chain(certified.iter().copied());
        let all_rays: usize = numbers.chain(runs.iter().map(|run| asked[run[0]].rays)).sum();
        self.progress.stage("timing images", (every.len() * all_rays) as u64);
        let (mut exact, mut mr) = (Vec::new(), Vec::new());
        let timed = rounds(self.options.rounds, MAX_TIME, first_mr + runs.len(), |k, first| {
            let (run, made) = match (calls.get(k), certified.get(k.wrapping_sub(calls.len()))) {
                (Some((rays, call)), _) => (self.exact(queries, call, *rays, first), &mut exact),
                (_, Some(&rays)) => (self.certified(queries, engine, rays, first).run, &mut exact),
                _ => (self.mr(queries, engine, &asked[runs[k - first_mr][0]], first).run, &mut mr),
            };
            if first {
                made.push(gallery.images(&run.visible));
            }
            run.sections
        });
        let exact = exact.into_iter().collect::<Result<Vec<Vec<Image<'static>>>>>()?;
        let mr = mr.into_iter().collect::<Result<Vec<Vec<Image<'static>>>>>()?;
        // For each feature size: time and feature-based error of the exact images, with and without certificates.
        let mut curves = Vec::new();
        for &s in &self.sizes {
            let mut curve = Vec::new();
            for (images, &seconds) in exact.iter().zip(&timed.seconds) {
                curve.push((seconds, gallery.pooled_fbem(&references, images, s)?));
            }
            curves.push(curve);
        }
        for ((k, row), curve) in rows.iter_mut().enumerate().zip(curves.iter().cycle()) {
            let (images, seconds) = match runs.iter().position(|run| run.contains(&k)) {
                Some(run) => (&mr[run], timed.seconds[first_mr + run]),
                None => {
                    let as_many = calls.iter().position(|call| call.0 == row.rays);
                    let k = as_many.expect("exact has all numbers of rays");
                    (&exact[k], timed.seconds[k])
                }
            };
            let error = gallery.pooled_fbem(&references, images, row.feature_size)?;
            let same = interpolate_log_log(curve, error);
            row.speedup_at_same_fbem = speedup(&row.route, same.and_then(|t| ratio(t.seconds, seconds)));
        }
        Ok(())
    }

    /// Errors and images by receiver.
    fn gather(&self, receivers: &[ReceiverGrid], shown: ShownImages) -> Result<Imaged> {
        let (mut figures, mut images) = (Vec::new(), Vec::new());
        let ShownImages { reference, exact16, mr, clusters, averaged, all_opened } = shown;
        for (i, ((receiver, reference), exact16)) in receivers.iter().zip(reference).zip(exact16).enumerate()
        {
            let l2 = norms(&reference, &exact16)?.l2;
            let mut errors = Vec::new();
            let mut own = Vec::new();
            for (&s, (handed_over, images)) in self.sizes.iter().zip(&mr) {
                let image = images[i].clone();
                let features = missing_features(&reference, &image, s)?;
                errors.push(ReceiverFbem {
                    feature_size: s,
                    exact16: fbem_at(&reference, &exact16, s)?.value,
                    mr: fbem_at(&reference, &image, s)?.value,
                    l2_exact16: l2,
                    l2_mr: norms(&reference, &image)?.l2,
                    features: features.features(),
                    missing_features: features.missing(),
                });
                own.push(MrImage { size: s as f32, image, handed_over: *handed_over });
            }
            let ReceiverGrid { name, width, height, texel, surface, .. } = receiver;
            figures.push(record::ReceiverErrors {
                name: name.clone(),
                width: *width,
                height: *height,
                texel: *texel,
                surface: *surface,
                l2,
                fbem: errors,
            });
            let (name, surface) = (name.clone(), *surface);
            let clusters = clusters.as_ref().map(|images| images[i].clone());
            images.push(ReceiverImages { name, surface, reference, exact16, mr: own, clusters });
        }
        Ok(Imaged { errors: figures, shown: images, averaged, all_opened })
    }
}

/// The texels of all receivers as one workload.
struct Gallery<'a> {
    receivers: &'a [ReceiverGrid],
    workload: &'a Workload,
}

impl Gallery<'_> {
    /// An image per receiver: fraction of the unoccluded irradiance, from the visible fraction of each pair.
    fn images(&self, visible: &[f32]) -> Result<Vec<Image<'static>>> {
        let mut values = self.workload.weighted(visible).into_iter();
        let image = |r: &ReceiverGrid| {
            let texels: Vec<f32> = values.by_ref().take(r.width * r.height).collect();
            Image::new(r.width, r.height, r.texel, texels)
        };
        self.receivers.iter().map(image).collect()
    }

    /// Feature-based error, root mean square over the area of all receivers.
    fn pooled_fbem(&self, references: &[Image], images: &[Image], size: f64) -> Result<f64> {
        let (mut sum, mut area) = (0.0, 0.0);
        for (reference, image) in references.iter().zip(images) {
            let a = (reference.width() * reference.height()) as f64 * reference.texel() * reference.texel();
            sum += a * fbem_at(reference, image, size)?.value.powi(2);
            area += a;
        }
        Ok((sum / f64::max(area, f64::MIN_POSITIVE)).sqrt())
    }
}
