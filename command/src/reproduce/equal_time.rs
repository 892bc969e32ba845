//! Errors of clusters by several builders at the time of exact rays, in one scene.

use super::Context;
use super::shadow::{Grid, Segments};
use super::shaft::part_between;
use mrvis::Builder;
use mrvis::Result;
use mrvis::Scene;
use mrvis::internals::bench::receivers::{self, ReceiverGrid};
use mrvis::internals::clusters;
use mrvis::internals::visibility::{LeafMode, MultiResolution};
use mrvis::internals::{BuilderParts, ModelParts, PrepareParts, SceneParts};
use mrvis::metrics::{FbemOptions, Image, fbem};
use mrvis::{Detail, Model, PrepareOptions};
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
/// Rays a pair of each of two references, and in tests.
const REFERENCE_RAYS: [usize; 2] = [1024, 256];
/// Repetitions of each measurement, of which the shortest time of each run of texels counts: other processes interrupt some.
const REPEAT: usize = 2;
/// Segments of the repeated measurements, whose differences tell the error.
const STREAMS: [u64; 2] = [0, 2];
/// Those of the references.
const REFERENCES: [u64; 2] = [1, 3];

/// Errors of the builders in one scene: FBEM without the noise of the reference, geometric means over feature sizes.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    /// Of exact rays.
    pub exact: f64,
    /// Logarithms by builder and measurement, at the time of the exact rays.
    pub logs: [[f64; 2]; 4],
    /// By builder, part of the segments that are handed over to exact rays.
    pub handed_over: [f64; 4],
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

    /// Half the difference between the two measurements in the logarithm of the ratio of two builders: an estimate of the standard
    /// error of their mean with one degree of freedom.
    pub fn half_difference(&self, builder: usize, other: usize) -> f64 {
        let ratio = |set: usize| self.logs[builder][set] - self.logs[other][set];
        0.5 * (ratio(0) - ratio(1))
    }
}

/// `None` if the scene has no emitter or no receiver.
pub fn compare(context: &Context, scene: Arc<Scene>) -> Result<Option<Compared>> {
    if scene.parts().emitters.is_empty() {
        return Ok(None);
    }
    let Some((receiver, sizes)) = receiver(context, &scene)? else { return Ok(None) };
    let scene = part_between(&scene, std::slice::from_ref(&receiver));
    let rays = PrepareOptions::default().with_detail(Detail::Rays);
    let rays = Model::prepare(scene.clone(), &rays, context.progress)?;
    let truth = Truth::new(&grid_of(&rays, &receiver), sizes, REFERENCE_RAYS[usize::from(context.small)])?;
    let (mut logs, mut preparation, mut handed_over) = ([[0.0; 2]; 4], [0.0; 4], [0.0; 4]);
    let mut exact = Vec::new();
    // All of a measurement is repeated: preparation, decisions about exact rays, segments and times.
    for (set, stream) in STREAMS.into_iter().enumerate() {
        let measurement = Measurement::new(&grid_of(&rays, &receiver), &truth, stream)?;
        exact.extend(measurement.exact);
        for (k, builder) in Builder::ALL.into_iter().enumerate() {
            let clusters = clusters::Options { builder, ..Default::default() };
            let options = PrepareOptions::default().with_clusters(clusters);
            let model = Model::prepare(scene.clone(), &options, context.progress)?;
            let report = model.report();
            preparation[k] += 0.5 * (report.clusters_s + report.optics_s);
            let grid = grid_of(&model, &receiver);
            let engine = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics");
            let engine = grid.with_budget(engine, stream);
            logs[k][set] = geometric_mean(&measurement.errors(&engine, &grid, &truth)?).ln();
            handed_over[k] += 0.5 * measurement.handed_over(&engine, &grid, &truth);
        }
    }
    Ok(Some(Compared {
        exact: geometric_mean(&exact),
        logs,
        handed_over,
        noise: geometric_mean(&truth.noise),
        triangles: scene.parts().triangles.len(),
        preparation,
    }))
}

fn grid_of<'a>(model: &'a Model, receiver: &ReceiverGrid) -> Grid<'a> {
    Grid::new(model, receiver.points.clone(), [receiver.width, receiver.height], receiver.texel)
}

/// The largest surface with shadows, or a window of it, and the feature sizes; none if no surface is lit.
fn receiver(context: &Context, scene: &Arc<Scene>) -> Result<Option<(ReceiverGrid, [f64; 2])>> {
    let options = PrepareOptions::default().with_detail(Detail::Rays);
    let model = Model::prepare(scene.clone(), &options, context.progress)?;
    let surfaces = receivers::choose(&model, &model.exact(), &[])?;
    let Some([_, largest]) = surfaces.feature_sizes() else { return Ok(None) };
    let sizes = SIZES.map(|part| part * largest);
    let side = (PAIRS[usize::from(context.small)] as f64 / scene.parts().emitters.len() as f64).sqrt();
    let maps = surfaces.maps((&model, &model.exact()), side.ceil() as usize, sizes[0]);
    Ok(maps.into_iter().next().map(|map| (map, sizes)))
}

/// What all builders are compared with.
struct Truth {
    reference: Image<'static>,
    sizes: [f64; 2],
    /// By size, FBEM of the reference by its noise.
    noise: [f64; 2],
}

impl Truth {
    fn new(grid: &Grid, sizes: [f64; 2], rays: usize) -> Result<Truth> {
        let [one, two] = REFERENCES.map(|stream| grid.by_rays(rays, stream, 1));
        let (one, two) = (one?.image, two?.image);
        let mut noise = [0.0; 2];
        for (noise, s) in noise.iter_mut().zip(sizes) {
            // The mean of two references has half the difference between them as its standard error.
            *noise = (0.5 * fbem_of(&one, &two, s)?).max(MIN_ERROR);
        }
        Ok(Truth { reference: mean_of(&one, &two)?, sizes, noise })
    }

    /// FBEM of an image at a size, without the noise of the reference, whose squares add up; no less than half of that noise.
    fn error(&self, image: &Image, k: usize) -> Result<f64> {
        let (found, noise) = (fbem_of(&self.reference, image, self.sizes[k])?, self.noise[k]);
        Ok((found * found - noise * noise).max(0.25 * noise * noise).sqrt())
    }
}

/// Segments and times of one measurement.
struct Measurement {
    /// Of all pairs, with growing numbers a pair.
    segments: Vec<Segments>,
    /// Seconds of the exact rays; by size their error.
    seconds: f64,
    exact: [f64; 2],
}

impl Measurement {
    fn new(grid: &Grid, truth: &Truth, stream: u64) -> Result<Measurement> {
        let numbers = std::iter::successors(Some(MIN_RAYS), |n| Some(4 * n)).take_while(|n| *n <= MAX_RAYS);
        let exact = grid.by_rays(EQUAL_TIME_RAYS, stream, REPEAT)?;
        Ok(Measurement {
            segments: numbers.map(|rays| grid.segments(rays, stream)).collect(),
            seconds: exact.seconds,
            exact: [truth.error(&exact.image, 0)?, truth.error(&exact.image, 1)?],
        })
    }

    /// Part of the segments that are handed over to exact rays, mean over sizes; [`MIN_RAYS`] a pair.
    fn handed_over(&self, engine: &MultiResolution, grid: &Grid, truth: &Truth) -> f64 {
        let parts = truth.sizes.map(|s| grid.handed_over(engine, s, &self.segments[0]));
        0.5 * (parts[0] + parts[1])
    }

    /// By size, the error at the time of the exact rays.
    fn errors(&self, engine: &MultiResolution, grid: &Grid, truth: &Truth) -> Result<Vec<f64>> {
        let error_at = |k: usize| -> Result<f64> {
            let mut curve: Vec<(f64, f64)> = Vec::new();
            for segments in &self.segments {
                let made = grid.by_clusters_along(engine, truth.sizes[k], segments, REPEAT)?;
                curve.push((made.seconds, truth.error(&made.image, k)?));
                if curve.len() > 1 && made.seconds > self.seconds {
                    break;
                }
            }
            Ok(at_time(&curve, self.seconds))
        };
        (0..truth.sizes.len()).map(error_at).collect()
    }
}

/// FBEM of an image.
fn fbem_of(reference: &Image, image: &Image, s: f64) -> Result<f64> {
    Ok(fbem(reference, image, &FbemOptions::default().with_size(s))?.value)
}

fn mean_of(one: &Image, two: &Image) -> Result<Image<'static>> {
    let mean = |x, y| 0.5 * (one.at(x, y) + two.at(x, y));
    Image::from_fn(one.width(), one.height(), one.texel(), mean)
}

/// A noise below this visible fraction counts as it: a hundredth of a step of 8-bit grey, so that logarithms exist.
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
