//! The shadow images of a run: both engines over the receivers' texels, and the feature-based errors.

use super::measure::Questions;
use super::page::ReceiverImages;
use super::receivers::{self, Receiver};
use super::record::{self, MrRow, ReceiverFbem, interpolate_log_log};
use super::rows::{Bench, ratio};
use super::workload::Workload;
use crate::Result;
use crate::embree::Traversal;
use crate::metrics::{FbemOptions, Image, fbem, missing_features, norms};
use crate::visibility::{Exact, MultiResolution};

/// The exact image that is shown and compared in the record.
const SHOWN_RAYS: usize = 16;

impl Bench<'_> {
    /// Shadow images of the receivers, their errors, and `speedup_at_same_fbem` of the rows.
    pub fn images(
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
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let questions = Questions { scene: self.scene, workload: &workload, pairs: &every };
        let pairs = workload.pairs.len() as u64;
        let reference = self.reference("reference images", questions, self.options.reference_rays);
        let means: Vec<f32> = (0..workload.pairs.len()).map(|pair| reference.mean(pair)).collect();
        let references = gallery.images(&means)?;

        let all_rays: usize = self.exact_rays().iter().sum();
        self.progress.stage("exact images", pairs * all_rays as u64);
        let mut exact = Vec::new();
        for rays in self.exact_rays() {
            let (_, run) = self.exact(questions, rays);
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
                let run = self.mr(questions, engine, s, rays).run;
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
            let Receiver { name, width, height, texel, .. } = receiver.clone();
            figures.push(record::Receiver { name: name.clone(), width, height, texel, l2, fbem: errors });
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
