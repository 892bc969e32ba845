//! Shadow images of a run by both engines, and their feature-based errors.

use super::context::{Bench, PlannedRow};
use super::measure::Queries;
use super::page::ReceiverImages;
use super::receivers::{self, ReceiverGrid};
use super::record::{self, MrRow, ReceiverFbem, interpolate_log_log};
use super::rounds::rounds;
use super::rows::ratio;
use super::workload::Workload;
use crate::embree::Traversal;
use crate::metrics::{FbemOptions, Image, fbem, missing_features, norms};
use crate::visibility::{Exact, MultiResolution};
use crate::{Result, error::quote};

/// Rays per texel of the exact image in the report: as many as the default number of segments of MR.
const SHOWN_RAYS: usize = 16;

impl Bench<'_> {
    /// Measures shadow images of the receivers, and `speedup_at_same_fbem` of the rows.
    pub fn images(
        &self,
        engine: &MultiResolution,
        rows: &mut [MrRow],
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<record::ReceiverErrors>, Vec<ReceiverImages>)> {
        self.progress.stage("receivers", 0);
        let single =
            Exact { scene: self.model.traced().clone(), traversal: Traversal { width: 1, coherent: false } };
        let receivers = receivers::choose(self.model, &single, &self.options.receivers)?;
        if receivers.is_empty() {
            warnings.push("No surface that is flat, or faces one way as a terrain does, sees an emitter: there are no shadow images.".into());
        }
        for receiver in receivers.iter().filter(|r| !r.lit) {
            warnings.push(format!("No light arrives at the receiver `{}`.", quote(&receiver.name)));
        }
        let points = receivers.iter().flat_map(ReceiverGrid::points).collect();
        let workload = Workload::new(self.model, points, self.options.seed ^ 0x696d_6167_6573);
        if workload.pairs.is_empty() {
            return Ok((Vec::new(), Vec::new()));
        }
        let gallery = Gallery { receivers: &receivers, workload: &workload };
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let queries = Queries { scene: self.scene, workload: &workload, pairs: &every };
        let pairs = workload.pairs.len() as u64;
        let reference = self.reference("reference images", queries, self.options.reference_rays);
        let means: Vec<f32> = (0..workload.pairs.len()).map(|pair| reference.mean(pair)).collect();
        let references = gallery.images(&means)?;

        self.progress.stage("choosing", 0);
        let sample = self.sample(&workload);
        let call = |rays| (rays, self.embree(&workload, rays));
        let calls: Vec<(usize, Exact)> = self.exact_rays().into_iter().map(call).collect();
        let asked = self.decisions(&sample, engine);
        let walked: Vec<&PlannedRow> = asked.iter().filter(|row| row.pays).collect();
        let all_rays: usize = calls.iter().map(|call| call.0).chain(walked.iter().map(|row| row.rays)).sum();
        self.progress.stage("images", pairs * all_rays as u64);
        let (mut exact, mut mr) = (Vec::new(), Vec::new());
        let timed = rounds(calls.len() + walked.len(), |k, first| {
            let (run, made) = match calls.get(k) {
                Some((rays, call)) => (self.exact(queries, call, *rays, first), &mut exact),
                None => (self.mr(queries, engine, walked[k - calls.len()], first).run, &mut mr),
            };
            if first {
                made.push(gallery.images(&run.visible));
            }
            run.sections
        });
        let exact = exact.into_iter().collect::<Result<Vec<Vec<Image>>>>()?;
        let mr = mr.into_iter().collect::<Result<Vec<Vec<Image>>>>()?;
        let shown = calls.iter().position(|call| call.0 == SHOWN_RAYS).expect("one of the fixed numbers");
        // For each feature size: time and feature-based error of the exact images.
        let mut curves = Vec::new();
        for &s in &self.sizes {
            let mut curve = Vec::new();
            for (images, &seconds) in exact.iter().zip(&timed.seconds) {
                curve.push((seconds, gallery.pooled_fbem(&references, images, s)?));
            }
            curves.push(curve);
        }
        let mut shown_mr: Vec<Vec<Image>> = Vec::new();
        let mut walked = mr.into_iter().zip(&timed.seconds[calls.len()..]);
        for ((row, asked), curve) in rows.iter_mut().zip(&asked).zip(curves.iter().cycle()) {
            let (images, &seconds) = if asked.pays {
                walked.next().expect("a run of every row that was walked")
            } else {
                let k =
                    calls.iter().position(|call| call.0 == row.rays).expect("exact has all numbers of rays");
                (exact[k].clone(), &timed.seconds[k])
            };
            let error = gallery.pooled_fbem(&references, &images, row.feature_size)?;
            let same = interpolate_log_log(curve, error);
            row.speedup_at_same_fbem = same.and_then(|t| ratio(t.seconds, seconds));
            if row.rays == self.options.rays {
                shown_mr.push(images);
            }
        }
        let shown = &exact[shown];
        self.gather(&receivers, references, shown, shown_mr)
    }

    /// Errors and images by receiver.
    fn gather(
        &self,
        receivers: &[ReceiverGrid],
        references: Vec<Image>,
        shown: &[Image],
        mut shown_mr: Vec<Vec<Image>>,
    ) -> Result<(Vec<record::ReceiverErrors>, Vec<ReceiverImages>)> {
        let (mut figures, mut images) = (Vec::new(), Vec::new());
        for (i, (receiver, reference)) in receivers.iter().zip(references).enumerate().rev() {
            let exact16 = shown[i].clone();
            let l2 = norms(&reference, &exact16)?.l2;
            let mut errors = Vec::new();
            let mut mr = Vec::new();
            for (&s, images) in self.sizes.iter().zip(&mut shown_mr) {
                let image = images.pop().expect("an image a receiver");
                let features = missing_features(&reference, &image, s)?;
                errors.push(ReceiverFbem {
                    feature_size: s,
                    exact16: fbem_of(&reference, &exact16, s)?,
                    mr: fbem_of(&reference, &image, s)?,
                    l2_exact16: l2,
                    l2_mr: norms(&reference, &image)?.l2,
                    features: features.features(),
                    missing_features: features.missing(),
                });
                mr.push((s as f32, image));
            }
            let ReceiverGrid { name, width, height, texel, .. } = receiver.clone();
            figures.push(record::ReceiverErrors {
                name: name.clone(),
                width,
                height,
                texel,
                l2,
                fbem: errors,
            });
            images.push(ReceiverImages { name, reference, exact16, mr });
        }
        figures.reverse();
        images.reverse();
        Ok((figures, images))
    }
}

fn fbem_of(reference: &Image, image: &Image, size: f64) -> Result<f64> {
    Ok(fbem(reference, image, &FbemOptions { size, ..FbemOptions::default() })?.value)
}

/// The texels of all receivers as one workload.
struct Gallery<'a> {
    receivers: &'a [ReceiverGrid],
    workload: &'a Workload,
}

impl Gallery<'_> {
    /// An image per receiver: fraction of the unoccluded irradiance, from the visible fraction of each pair.
    fn images(&self, visible: &[f32]) -> Result<Vec<Image>> {
        let mut values = self.workload.weighted(visible).into_iter();
        let image = |r: &ReceiverGrid| {
            let texels = values.by_ref().take(r.width * r.height).collect();
            Image::new(r.width, r.height, r.texel, texels)
        };
        self.receivers.iter().map(image).collect()
    }

    /// Feature-based error, root mean square over the area of all receivers.
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
