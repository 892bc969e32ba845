//! Shadow images on a plane, by rays and by clusters.

use super::plain::{Descent, PlainTree, Visits};
use glam::{DVec3, Vec3};
use mrvis::internals::bench::{ReceiverPoint, Workload};
use mrvis::internals::math::parallel;
use mrvis::internals::ray::{LANES, Occluder, Packet};
use mrvis::internals::visibility::{Bundle, Exact, MultiResolution, Workspace};
use mrvis::metrics::{FeatureOptions, Features, Image, Morphology};
use mrvis::{Model, Result};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// A grid of square texels on a plane, in coordinates of the file.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    pub centre: DVec3,
    /// Unit vectors of the plane: along rows, and from the last row to the first.
    pub right: DVec3,
    pub up: DVec3,
    pub columns: usize,
    pub rows: usize,
    /// Side of a texel.
    pub texel: f64,
}

/// An image with the time of its queries.
#[derive(Clone, Debug)]
pub struct Rendered {
    pub image: Image<'static>,
    /// Seconds of the queries, summed over threads; of each run of texels the shortest of the repetitions.
    pub seconds: f64,
}

impl Wall {
    /// The texels as receivers of a model.
    pub fn grid(self, model: &Model) -> Grid<'_> {
        let (scene, normal) = (model.scene(), self.right.cross(self.up));
        let at = |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * self.texel;
        // A thousandth of a texel above the surface, so that it does not block.
        let centre = self.centre - scene.parts().origin + 1e-3 * self.texel * normal;
        let point = |x, y| ReceiverPoint {
            position: (centre + at(x, self.columns) * self.right - at(y, self.rows) * self.up).as_vec3(),
            normal: normal.as_vec3(),
            magnitude: model.magnitude(),
        };
        let places = (0..self.rows).flat_map(|y| (0..self.columns).map(move |x| (x, y)));
        Grid::new(model, places.map(|(x, y)| point(x, y)).collect(), [self.columns, self.rows], self.texel)
    }
}

/// Texels and the emitters that they face.
pub struct Grid<'a> {
    model: &'a Model,
    workload: Workload,
    /// Emitter by emitter: neighbouring segments share the upper part of a traversal.
    pairs: Vec<usize>,
    size: [usize; 2],
    texel: f64,
}

impl<'a> Grid<'a> {
    /// Texels row by row from the top left: columns, rows and side.
    pub fn new(model: &'a Model, points: Vec<ReceiverPoint>, size: [usize; 2], texel: f64) -> Grid<'a> {
        let workload = Workload::new(model, points, 1);
        let mut pairs: Vec<usize> = (0..workload.pairs.len()).collect();
        pairs.sort_by_key(|&pair| workload.pairs[pair].emitter);
        Grid { model, workload, pairs, size, texel }
    }

    fn image(&self, values: Vec<f32>) -> Result<Image<'static>> {
        Image::new(self.size[0], self.size[1], self.texel, values)
    }

    /// The visible fraction of some points (coordinates of the file), from each texel.
    pub fn sees(&self, targets: &[DVec3]) -> Result<Image<'static>> {
        let (exact, rule) = (self.model.exact(), self.model.end_rule());
        let origin = self.model.scene().parts().origin;
        let targets: Vec<Vec3> = targets.iter().map(|&t| (t - origin).as_vec3()).collect();
        let visible = |point: &ReceiverPoint| {
            let mut packets = vec![Packet::EMPTY; targets.len().div_ceil(LANES)];
            for (k, &target) in targets.iter().enumerate() {
                packets[k / LANES].set_unknown(k % LANES, point.position, target, [rule; 2]);
            }
            1.0 - blocked(&exact, &packets) as f32 / targets.len() as f32
        };
        self.image(parallel::map(&self.workload.points, visible))
    }

    /// The fraction of the unoccluded light of all emitters by exact rays; `stream` selects an independent sample set.
    pub fn by_rays(&self, rays: usize, stream: u64, repeat: usize) -> Result<Rendered> {
        let exact = self.model.exact();
        self.rendered(repeat, |run| {
            let (pairs, mut packets) = (&self.pairs[run], Vec::new());
            let bundles: Vec<Vec<Packet>> = pairs
                .iter()
                .map(|&pair| {
                    packets.clear();
                    self.workload.pack(self.model.scene(), &[pair], rays, stream, &mut packets);
                    packets.clone()
                })
                .collect();
            let start = Instant::now();
            let visible = |packets: &Vec<Packet>| 1.0 - blocked(&exact, packets) as f32 / rays as f32;
            (bundles.iter().map(visible).collect(), start.elapsed().as_secs_f64())
        })
    }

    /// The same by plain descents of a tree; `descent` for a width of the emitter.
    pub fn by_plain_tree(
        &self,
        tree: &PlainTree,
        descent: impl Fn(f32) -> Descent + Sync,
        rays: usize,
        repeat: usize,
    ) -> Result<(Rendered, Visits)> {
        let all = Mutex::new(Visits::default());
        let rendered = self.rendered(repeat, |run| {
            let (mut packets, mut found, mut visits) = (Vec::new(), Vec::new(), Visits::default());
            let mut seconds = 0.0;
            for &pair in &self.pairs[run] {
                packets.clear();
                self.workload.pack(self.model.scene(), &[pair], rays, 0, &mut packets);
                let descent = descent(self.workload.pairs[pair].emitter_size);
                let start = Instant::now();
                let mut sum = 0.0;
                for packet in &packets {
                    for lane in packet.lanes() {
                        let [from, to] = [0.0, 1.0].map(|t| packet.point(lane, t));
                        sum += tree.transmittance(from, to, descent, &mut visits);
                    }
                }
                seconds += start.elapsed().as_secs_f64();
                found.push(sum / rays as f32);
            }
            all.lock().unwrap_or_else(PoisonError::into_inner).add(visits);
            (found, seconds)
        })?;
        let all = all.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok((rendered, all.of_one(repeat.max(1) as u64)))
    }

    /// The same by clusters at a feature size.
    pub fn by_clusters(
        &self,
        engine: &MultiResolution,
        s: f64,
        rays: usize,
        repeat: usize,
    ) -> Result<Rendered> {
        self.rendered(1, |run| {
            let (pairs, mut packets) = (&self.pairs[run], Vec::new());
            for &pair in pairs {
                self.workload.add_bundle(self.model.scene(), pair, rays, 0, &mut packets);
            }
            let of_pairs = packets.chunks(rays.div_ceil(LANES)).zip(pairs);
            let bundles: Vec<Bundle> = of_pairs.map(|(packets, &pair)| self.bundle(pair, packets)).collect();
            let mut workspace = Workspace::default();
            // Memory of the workspace is not part of the time.
            engine.answers(&bundles, s as f32, &mut workspace, |_| ());
            let timed = |_| {
                let mut found = Vec::with_capacity(bundles.len());
                let start = Instant::now();
                engine.answers(&bundles, s as f32, &mut workspace, |a| found.push(a.transmittance));
                (found, start.elapsed().as_secs_f64())
            };
            let shorter = |a: (Vec<f32>, f64), b: (Vec<f32>, f64)| if b.1 < a.1 { b } else { a };
            (0..repeat.max(1)).map(timed).reduce(shorter).unwrap_or_default()
        })
    }

    fn bundle<'s>(&'s self, pair: usize, packets: &'s [Packet]) -> Bundle<'s> {
        Bundle {
            packets,
            emitter_size: self.workload.pairs[pair].emitter_size,
            emitter: self.workload.hull_of_surface(pair),
        }
    }

    /// An image of the answers for all pairs of texels and emitters, by runs of them, each timed `repeat` times.
    fn rendered(
        &self,
        repeat: usize,
        run: impl Fn(Range<usize>) -> (Vec<f32>, f64) + Sync,
    ) -> Result<Rendered> {
        let n = self.pairs.len();
        let ranges: Vec<Range<usize>> =
            (0..n).step_by(TEXELS_PER_RUN).map(|first| first..(first + TEXELS_PER_RUN).min(n)).collect();
        let mut shortest = vec![f64::INFINITY; ranges.len()];
        let mut values = vec![0.0; n];
        for _ in 0..repeat.max(1) {
            let runs: Vec<(Vec<f32>, f64)> = parallel::map(&ranges, |range| run(range.clone()));
            for ((range, (found, seconds)), shortest) in ranges.iter().zip(runs).zip(&mut shortest) {
                *shortest = shortest.min(seconds);
                self.pairs[range.clone()].iter().zip(found).for_each(|(&pair, value)| values[pair] = value);
            }
        }
        Ok(Rendered { image: self.image(self.workload.weighted(&values))?, seconds: shortest.iter().sum() })
    }
}

/// Number of blocked segments of packets.
fn blocked(exact: &Exact, packets: &[Packet]) -> u32 {
    let mut blocked = vec![0; packets.len()];
    exact.occluded(packets, &mut blocked);
    blocked.iter().map(|b| b.count_ones()).sum()
}

/// Neighbouring texels that share the upper part of a traversal, as in `bench`.
const TEXELS_PER_RUN: usize = 64;

/// Features as the paper defines them: shadows, sized by erosions with eight neighbours.
pub fn paper_features() -> FeatureOptions {
    let mut options = FeatureOptions::default();
    (options.features, options.morphology) = (Features::Shadow, Morphology::Paper8);
    options
}

/// Mean of an image.
pub fn mean(image: &Image) -> f64 {
    image.data().iter().map(|&v| f64::from(v)).sum::<f64>() / image.data().len() as f64
}

/// Part of an image: columns and rows from the first to before the last.
pub fn crop(image: &Image, [left, top, right, bottom]: [usize; 4]) -> Result<Image<'static>> {
    Image::from_fn(right - left, bottom - top, image.texel(), |x, y| image.at(left + x, top + y))
}

/// The means over square cells of `side` texels: the best solution on a mesh of such elements.
pub fn meshed(image: &Image, side: usize) -> Result<Image<'static>> {
    let cells = |n: usize| n.div_ceil(side);
    let mut sums = vec![(0.0f64, 0.0f64); cells(image.width()) * cells(image.height())];
    let cell = |x: usize, y: usize| y / side * cells(image.width()) + x / side;
    for y in 0..image.height() {
        for x in 0..image.width() {
            let (sum, count) = &mut sums[cell(x, y)];
            (*sum, *count) = (*sum + f64::from(image.at(x, y)), *count + 1.0);
        }
    }
    let value = |x, y| {
        let (sum, count) = sums[cell(x, y)];
        (sum / count) as f32
    };
    Image::from_fn(image.width(), image.height(), image.texel(), value)
}
