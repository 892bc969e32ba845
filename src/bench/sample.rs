//! Sample of a workload for decisions: runs of neighbouring bundles.

use super::measure::clear_fraction;
use super::workload::Workload;
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::{
    Bundle, Exact, MultiResolution, ReferenceHalves, Route, RouteSample, Work, Workspace,
};
use glam::Vec3;

/// Segments of runs of neighbouring pairs, evenly spread over a workload, for each number of segments of the rows.
pub struct Sample {
    sets: Vec<Set>,
    runs: Vec<Run>,
    /// Visible fraction of each bundle, by [`Extent::reference_rays`] rays of their own for each half.
    reference: ReferenceHalves,
    /// More bundles, to which walks are fitted.
    mean: Option<Box<Sample>>,
}

/// Size of a sample.
#[derive(Clone, Copy)]
pub struct Extent {
    /// Largest number of runs, and of bundles of a run.
    runs: usize,
    run: usize,
    /// Rays of each half of a separate estimate of the visible fraction of a bundle; 0 for none.
    reference_rays: usize,
}

impl Extent {
    /// For points: 256 bundles, so that mean squares have an error of a tenth, and as many rays as the largest row has, so that a half
    /// has no more noise. Bundles of a run share their traversal as those of rows do; there are many runs because errors within a run are
    /// similar.
    pub const POINTS: Extent = Extent { runs: 32, run: 8, reference_rays: 256 };
    /// For the mean of walks, which is compared with exact rays along the same segments: among leaves, runs of neighbours differ by 0.04
    /// to 0.08, so that the mean of 1,024 runs has an error of 0.001 to 0.0025.
    const MEAN: Extent = Extent { runs: 1024, run: 2, reference_rays: 0 };
    /// For a map, which is interpolated between as few as a thousand bundles of sixteen segments: about as many rays as those.
    pub const MAP: Extent = Extent { runs: 16, run: 4, reference_rays: 64 };
}

/// Segments of the bundles of [`Extent::MEAN`].
const MEAN_SEGMENTS: usize = 64;
/// Sample sets of [`Extent::reference_rays`]: others use 0 to 9.
const REFERENCE_STREAMS: [u64; 2] = [10, 11];

/// All bundles with one number of segments, in order.
struct Set {
    rays: usize,
    packets: Vec<Packet>,
}

/// Neighbouring pairs of one emitter.
struct Run {
    /// [`Workload::hull`] of each pair.
    hulls: Vec<Vec<Vec3>>,
    /// Emitter size of each pair.
    sizes: Vec<f32>,
}

impl Sample {
    /// Samples with these numbers of segments per pair, and with one packet per pair. `exact` traces the reference.
    pub fn of(scene: &Scene, workload: &Workload, rays: &[usize], extent: Extent, exact: &Exact) -> Sample {
        let mut sample =
            Sample { sets: Vec::new(), runs: Vec::new(), reference: ReferenceHalves::default(), mean: None };
        let pairs = workload.pairs.len();
        let length = (extent.run * workload.sources()).min(pairs);
        let runs = extent.runs.min(pairs / length.max(1));
        let mut chosen = Vec::new();
        for k in 0..runs {
            let first = (pairs - length) * k / (runs - 1).max(1);
            // A run has one emitter, as the bundles of a query do.
            let emitter = workload.pairs[first].emitter;
            let same = (first..first + length).filter(|&pair| workload.pairs[pair].emitter == emitter);
            let first_of_run = chosen.len();
            chosen.extend(same.take(extent.run));
            let sizes =
                chosen[first_of_run..].iter().map(|&pair| workload.pairs[pair].emitter_size).collect();
            let hulls = chosen[first_of_run..].iter().map(|&pair| workload.hull(pair).to_vec()).collect();
            sample.runs.push(Run { hulls, sizes });
        }
        for rays in numbers(rays) {
            let mut packets = Vec::new();
            for &pair in &chosen {
                workload.add_bundle(scene, pair, rays, 0, &mut packets);
            }
            sample.sets.push(Set { rays, packets });
        }
        if extent.reference_rays == 0 {
            return sample;
        }
        let (mut packets, mut blocked) = (Vec::new(), Vec::new());
        for (half, stream) in sample.reference.iter_mut().zip(REFERENCE_STREAMS) {
            for &pair in &chosen {
                packets.clear();
                workload.pack(scene, &[pair], extent.reference_rays, stream, &mut packets);
                blocked.clear();
                blocked.resize(packets.len(), 0);
                exact.occluded(&packets, &mut blocked);
                half.push(clear_fraction(&blocked, 0, extent.reference_rays));
            }
        }
        sample
    }

    /// Adds the bundles to which walks are fitted. Without, they are fitted to the bundles of this sample.
    #[must_use]
    pub fn with_mean(mut self, scene: &Scene, workload: &Workload, exact: &Exact) -> Sample {
        self.mean = Some(Box::new(Sample::of(scene, workload, &[MEAN_SEGMENTS], Extent::MEAN, exact)));
        self
    }

    /// Upper bound of the memory of a sample of points with these numbers of segments, bytes.
    pub fn bytes(rays: &[usize]) -> usize {
        let packets: usize = numbers(rays).iter().map(|n| n.div_ceil(LANES)).sum();
        let bundles = |extent: Extent| extent.runs * extent.run;
        let mean = (LANES + MEAN_SEGMENTS) / LANES * bundles(Extent::MEAN);
        (bundles(Extent::POINTS) * packets + mean) * size_of::<Packet>()
    }

    /// The bundles with `rays` segments, run by run; with one packet if the sample has no such number.
    pub fn bundles(&self, rays: usize) -> Vec<Vec<Bundle<'_>>> {
        let set = self.sets.iter().find(|set| set.rays == rays).unwrap_or(&self.sets[0]);
        let mut packets = set.packets.chunks(set.rays.div_ceil(LANES));
        let mut runs = Vec::with_capacity(self.runs.len());
        for run in &self.runs {
            let with_size = run.hulls.iter().zip(&run.sizes);
            runs.push(
                with_size
                    .map(|(emitter, &emitter_size)| Bundle {
                        packets: packets.next().expect("a bundle a pair"),
                        emitter_size,
                        emitter,
                    })
                    .collect(),
            );
        }
        runs
    }

    /// How bundles like these are answered.
    pub fn route(&self, engine: &MultiResolution, s: f32, rays: usize) -> Route {
        let sample = RouteSample { runs: self.bundles(rays), reference: &self.reference };
        let mean = self.mean.as_deref().unwrap_or(self);
        let mean = mean.bundles(mean.sets.last().map_or(rays, |set| set.rays));
        engine.route(&sample, &mean, s, &mut Workspace::default())
    }

    /// Whether certificates may make exact rays faster: their search is not given up for most bundles, as it is under a dome.
    pub fn certifies(&self, engine: &MultiResolution, rays: usize) -> bool {
        let (mut workspace, mut work) = (Workspace::default(), Work::default());
        for run in &self.bundles(rays) {
            work.add(engine.certified_work(run, &mut workspace));
        }
        !work.is_mostly_abandoned()
    }
}

/// Numbers of segments of a sample, ascending.
fn numbers(rays: &[usize]) -> Vec<usize> {
    let mut numbers = [&[LANES], rays].concat();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::workload::surface_points;

    #[test]
    fn every_number_has_its_bundles_and_memory_is_as_stated() {
        let scene = crate::scene::testing::generated("desk-room");
        let model = crate::model::testing::model(&scene, crate::model::Detail::Rays);
        let points = surface_points(&model, 3000, 1).expect("points");
        let workload = Workload::new(&model, points, 1);
        let sample = Sample::of(&scene, &workload, &[64, 256], Extent::POINTS, &model.exact());
        let ends = |bundle: &Bundle| -> Vec<[u32; 3]> {
            let of = |p: &Packet, l: usize| p.point(l, 1.0).to_array().map(f32::to_bits);
            bundle.packets.iter().flat_map(|p| p.lanes().map(|l| of(p, l))).collect()
        };
        let [one, few, many] = [1, 64, 256].map(|rays| sample.bundles(rays).concat());
        assert!(many.len() > 100 && many.len() == few.len() && one.len() == few.len());
        for ((one, few), many) in one.iter().zip(&few).zip(&many) {
            assert_eq!((one.packets.len(), few.packets.len(), many.packets.len()), (1, 4, 16));
            assert_eq!(few.emitter_size, many.emitter_size);
            let [one, few, many] = [one, few, many].map(ends);
            assert!(one.iter().all(|end| few.contains(end)) && few.iter().all(|end| many.contains(end)));
        }
        let packets: usize = sample.sets.iter().map(|set| set.packets.len()).sum();
        assert!(packets * size_of::<Packet>() <= Sample::bytes(&[64, 256]));
    }
}
