//! Errors of clusters by several builders at the time of exact rays, in one scene.

use super::Context;
use super::shadow::{Grid, Segments};
use super::shaft::part_between;
use crate::Result;
use crate::bench::receivers::{self, ReceiverGrid};
use crate::clusters::{self, Builder};
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{Detail, Model, PrepareOptions};
use crate::scene::Scene;
use crate::visibility::LeafMode;
use std::sync::Arc;

/// Smallest number of segments a pair: fourfold until they take longer than the exact rays, so that errors at equal time are interpolated.
pub const MIN_RAYS: usize = 4;
/// Largest number of segments a pair.
pub const MAX_RAYS: usize = 256;
/// Exact rays a pair, whose time is the equal time.
pub const EQUAL_TIME_RAYS: usize = 64;
/// Feature sizes relative to the largest that images of the receivers show, a fifth of their longest side: 9 and 35 cm on a floor of 7 m.
pub const SIZES: [f64; 2] = [1.0 / 16.0, 1.0 / 4.0];
/// Pairs of texels and emitters, and in tests.
const PAIRS: [usize; 2] = [4000, 1000];
/// Rays a pair of each of two references.
const REFERENCE_RAYS: usize = 128;
/// Repetitions of each measurement, of which the shortest time of each run of texels counts: other processes interrupt some.
const REPEAT: usize = 2;
/// Sets of segments, whose differences tell the sampling error.
const STREAMS: [u64; 2] = [0, 2];
/// Those of the references.
const REFERENCES: [u64; 2] = [1, 3];

/// Errors of the builders in one scene: FBEM, geometric means over feature sizes.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    /// Of exact rays.
    pub exact: f64,
    /// Logarithms by builder and set of segments, at the time of the exact rays.
    pub logs: [[f64; 2]; 4],
    /// FBEM of the reference by its own noise.
    pub noise: f64,
    /// Number of triangles that segments can meet, which clusters are built of.
    pub triangles: usize,
    /// Seconds of clusters and optics by builder.
    pub preparation: [f64; 4],
}

impl Compared {
    /// Logarithm of the error of a builder.
    pub fn log(&self, builder: usize) -> f64 {
        0.5 * (self.logs[builder][0] + self.logs[builder][1])
    }

    /// FBEM of a builder.
    pub fn error(&self, builder: usize) -> f64 {
        self.log(builder).exp()
    }

    /// Half the difference between the two sets of segments in the logarithm of the ratio of two builders: an estimate of the standard
    /// error of their mean with one degree of freedom.
    pub fn half_difference(&self, builder: usize, other: usize) -> f64 {
        let ratio = |set: usize| self.logs[builder][set] - self.logs[other][set];
        0.5 * (ratio(0) - ratio(1))
    }
}

/// `None` if the scene has no emitter or no receiver.
pub fn compare(context: &Context, scene: Arc<Scene>) -> Result<Option<Compared>> {
    if scene.emitters.is_empty() {
        return Ok(None);
    }
    let Some((receiver, sizes)) = receiver(context, &scene)? else { return Ok(None) };
    let scene = part_between(&scene, std::slice::from_ref(&receiver));
    let (mut logs, mut preparation) = ([[0.0; 2]; 4], [0.0; 4]);
    let mut common = None;
    for (k, builder) in Builder::ALL.into_iter().enumerate() {
        let clusters = clusters::Options { builder, ..Default::default() };
        let options = PrepareOptions { clusters, ..PrepareOptions::default() };
        let model = Model::prepare(scene.clone(), &options, context.progress)?;
        let report = model.report();
        preparation[k] = report.clusters_s + report.optics_s;
        let grid =
            Grid::new(&model, receiver.points.clone(), [receiver.width, receiver.height], receiver.texel);
        let common = match &mut common {
            Some(common) => common,
            none => none.insert(Common::new(&grid, sizes)?),
        };
        for (set, log) in logs[k].iter_mut().enumerate() {
            *log = geometric_mean(&common.errors(&model, &grid, set)?).ln();
        }
    }
    let Some(common) = common else { return Ok(None) };
    Ok(Some(Compared {
        exact: geometric_mean(&common.exact),
        logs,
        noise: geometric_mean(&common.noise),
        triangles: scene.triangles.len(),
        preparation,
    }))
}

/// The largest surface with shadows, or a window of it, and the feature sizes; none if no surface is lit.
fn receiver(context: &Context, scene: &Arc<Scene>) -> Result<Option<(ReceiverGrid, [f64; 2])>> {
    let options = PrepareOptions::default().with_detail(Detail::Rays);
    let model = Model::prepare(scene.clone(), &options, context.progress)?;
    let surfaces = receivers::choose(&model, &model.exact(), &[])?;
    let Some([_, largest]) = surfaces.feature_sizes() else { return Ok(None) };
    let sizes = SIZES.map(|part| part * largest);
    let side = (PAIRS[usize::from(context.small)] as f64 / scene.emitters.len() as f64).sqrt();
    let maps = surfaces.maps((&model, &model.exact()), side.ceil() as usize, sizes[0]);
    Ok(maps.into_iter().next().map(|map| (map, sizes)))
}

/// What all builders are compared with.
struct Common {
    reference: Image<'static>,
    sizes: [f64; 2],
    /// By set, segments of all pairs with growing numbers a pair.
    segments: [Vec<Segments>; 2],
    /// Seconds of the exact rays; by size their FBEM, and that of the reference.
    seconds: f64,
    exact: [f64; 2],
    noise: [f64; 2],
}

impl Common {
    fn new(grid: &Grid, sizes: [f64; 2]) -> Result<Common> {
        let numbers =
            || std::iter::successors(Some(MIN_RAYS), |n| Some(4 * n)).take_while(|n| *n <= MAX_RAYS);
        let [one, two] = REFERENCES.map(|stream| grid.by_rays(REFERENCE_RAYS, stream, 1));
        let (one, two) = (one?.image, two?.image);
        let reference = mean_of(&one, &two)?;
        let [a, b] = STREAMS.map(|stream| grid.by_rays(EQUAL_TIME_RAYS, stream, REPEAT));
        let (a, b) = (a?, b?);
        let (mut exact, mut noise) = ([0.0; 2], [0.0; 2]);
        for (k, &s) in sizes.iter().enumerate() {
            exact[k] = geometric_mean(&[error(&reference, &a.image, s)?, error(&reference, &b.image, s)?]);
            // The mean of two references has half the difference between them as its standard error.
            noise[k] = 0.5 * error(&one, &two, s)?;
        }
        let segments = STREAMS.map(|stream| numbers().map(|rays| grid.segments(rays, stream)).collect());
        Ok(Common { reference, sizes, segments, seconds: a.seconds.min(b.seconds), exact, noise })
    }

    /// By size, the error at the time of the exact rays along one set of segments.
    fn errors(&self, model: &Model, grid: &Grid, set: usize) -> Result<Vec<f64>> {
        let engine = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics");
        let engine = grid.with_budget(engine);
        let error_at = |&s: &f64| -> Result<f64> {
            let mut curve: Vec<(f64, f64)> = Vec::new();
            for segments in &self.segments[set] {
                let made = grid.by_clusters_along(&engine, s, segments, REPEAT)?;
                curve.push((made.seconds, error(&self.reference, &made.image, s)?));
                if curve.len() > 1 && made.seconds > self.seconds {
                    break;
                }
            }
            Ok(at_time(&curve, self.seconds))
        };
        self.sizes.iter().map(error_at).collect()
    }
}

/// FBEM of an image.
fn error(reference: &Image, image: &Image, s: f64) -> Result<f64> {
    Ok(fbem(reference, image, &FbemOptions::default().with_size(s))?.value.max(MIN_ERROR))
}

fn mean_of(one: &Image, two: &Image) -> Result<Image<'static>> {
    let mean = |x, y| 0.5 * (one.at(x, y) + two.at(x, y));
    Image::from_fn(one.width(), one.height(), one.texel(), mean)
}

/// Errors below this visible fraction count as it: a hundredth of a step of 8-bit grey, so that logarithms exist.
const MIN_ERROR: f64 = 4e-5;

/// The error at a time, interpolated between logarithms; beyond the ends that of the nearest line.
fn at_time(curve: &[(f64, f64)], seconds: f64) -> f64 {
    let logs: Vec<(f64, f64)> = curve.iter().map(|(t, e)| (t.ln(), e.ln())).collect();
    let t = seconds.ln();
    let k = logs[1..logs.len() - 1].iter().filter(|point| point.0 < t).count();
    let ((a, e), (b, f)) = (logs[k], logs[k + 1]);
    // Errors of more segments are no larger than those of fewer; noise must not be extrapolated.
    let slope = ((f - e) / (b - a).max(1e-9)).clamp(-0.5, 0.0);
    (e + slope * (t - a)).exp()
}

fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64).exp()
}
