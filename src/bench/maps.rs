//! Maps: shadow images of whole receivers by both engines, computed at every texel or at some and interpolated between.
//!
//! A map has many receiver points close together, so that both engines may interpolate, and what is prepared for it alone (choices and
//! caches) counts: `speedup_with_setup`. All rows of a map are compared with one reference of independent rays at every
//! texel.

mod cached;
mod compare;
mod lattice;
mod quadtree;

use super::context::{Bench, EXACT_RAYS, PlannedRow};
use super::gallery::single_rays;
use super::lights;
use super::measure::{MrRun, Queries};
use super::options::BenchOptions;
use super::receivers::{ReceiverGrid, Surfaces};
use super::record::{Build, MapRecord};
use super::reference::Reference;
use super::rounds::rounds;
use super::sample::{Extent, Sample};
use super::workload::Workload;
use crate::Result;
use crate::metrics::Image;
use crate::progress::timed;
use crate::visibility::{Exact, MultiResolution};
use cached::CachedRow;
use lattice::Lattice;
use std::time::{Duration, Instant};

/// Texels along the longer side of a map by default.
const DEFAULT_SIDE: usize = 256;
/// Largest number of texels times emitters of a map by default: with eight emitters 256 by 256 texels; limits the rows of a map to some
/// ten seconds on one core.
const DEFAULT_PAIRS: usize = 1 << 19;
/// Spacings of the texels at which light is computed: steps of 2 quarter the work.
const SPACINGS: [usize; 4] = [1, 2, 4, 8];
/// Rows of interpolated maps with so many times the segments of the others: as many a texel with every second column and row.
const MORE_SEGMENTS: usize = 4;
/// Largest number of segments of rows with more.
const MAX_SEGMENTS: usize = 256;
/// Largest mean number of exact rays a texel: rows beyond are extrapolated.
const MAX_RAYS_PER_TEXEL: usize = 64;
/// Largest number of rays from a texel in the reference, and of segments of the reference: limits its time to some seconds on two cores.
const MAX_REFERENCE_RAYS: usize = 256;
const MAX_REFERENCE_SEGMENTS: usize = 100_000_000;
/// Fewest rays from a texel in the reference: noise of at most √(¼ / 16) = 13 %, which is subtracted from the errors.
const MIN_REFERENCE_RAYS: usize = 16;
/// A further round of the rows of a map starts only if it is expected to end within this time.
const MAX_TIME: Duration = Duration::from_secs(3);

impl BenchOptions {
    /// Texels along the longer side of a map in a scene with so many emitters.
    fn map_side(&self, emitters: usize) -> usize {
        let default = || DEFAULT_SIDE.min(((DEFAULT_PAIRS / emitters.max(1)) as f64).sqrt() as usize).max(1);
        self.map.unwrap_or_else(default)
    }
}

/// One map with its reference, and the light at the texels of each spacing.
struct Map<'a> {
    grid: &'a ReceiverGrid,
    /// Lattices of all spacings that fit, in the order of [`SPACINGS`], with the queries of their texels.
    lattices: Vec<(usize, Lattice, Workload)>,
    /// Light of every texel, by two halves of the rays.
    reference: Reference,
    image: Image<'static>,
}

/// A row to be measured.
enum Planned<'a> {
    Exact { lattice: usize, rays: usize, call: Exact, setup_s: f64 },
    Mr { lattice: usize, row: PlannedRow },
    Cached(CachedRow<'a>),
}

/// Texels and error of a row.
struct Made {
    image: Image<'static>,
    rms: f64,
    bias: f64,
    aggregated: f64,
}

impl Bench<'_> {
    /// Measures maps of all receivers. `build` has the times of the preparation of the scene.
    pub fn maps(
        &self,
        surfaces: &Surfaces,
        engine: &MultiResolution,
        build: &Build,
    ) -> Result<Vec<MapRecord>> {
        let side = self.options.map_side(lights::shown(self.scene));
        if side == 0 {
            return Ok(Vec::new());
        }
        let grids = surfaces.maps((self.model, &single_rays(self.model)), side, self.sizes[0]);
        let maps = grids.iter().map(|grid| self.map(grid, engine, build));
        maps.filter_map(Result::transpose).collect()
    }

    /// `None` if no light arrives anywhere.
    fn map(&self, grid: &ReceiverGrid, engine: &MultiResolution, build: &Build) -> Result<Option<MapRecord>> {
        let Some(map) = self.prepared(grid)? else { return Ok(None) };
        self.progress.stage("choosing", 0);
        let rows = self.planned(&map, engine);
        self.progress.stage("maps", 0);
        let mut made: Vec<Result<Made>> = Vec::new();
        let measured: Vec<usize> = (0..rows.len()).filter(|&k| rows[k].is_measured()).collect();
        let timed = rounds(self.options.rounds, MAX_TIME, measured.len(), |k, first| {
            let (texels, aggregated, sections) = self.texels_of(&map, &rows[measured[k]], engine);
            if first {
                made.push(map.made(texels, aggregated));
            }
            sections
        });
        let made = made.into_iter().collect::<Result<Vec<Made>>>()?;
        let times: Vec<f64> = timed.seconds;
        let found = measured.iter().zip(made.iter().zip(&times)).map(|(&k, (made, &s))| (&rows[k], made, s));
        map.record(&rows, &found.collect::<Vec<_>>(), build).map(Some)
    }

    /// The queries of a map and its reference.
    fn prepared<'g>(&self, grid: &'g ReceiverGrid) -> Result<Option<Map<'g>>> {
        let seed = self.options.seed ^ 0x6d61_7073;
        let fits = |&spacing: &usize| spacing == 1 || spacing < grid.width.min(grid.height);
        let lattices: Vec<(usize, Lattice, Workload)> = SPACINGS
            .into_iter()
            .filter(fits)
            .map(|spacing| {
                let lattice = Lattice::new(grid, spacing);
                let workload = Workload::shown(self.model, lattice.points(grid), seed);
                (spacing, lattice, workload)
            })
            .collect();
        let workload = &lattices[0].2;
        if workload.pairs.is_empty() {
            return Ok(None);
        }
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let affordable = (MAX_REFERENCE_SEGMENTS / every.len()).clamp(MIN_REFERENCE_RAYS, MAX_REFERENCE_RAYS);
        let rays = affordable.min(self.options.reference_rays);
        let queries = Queries { scene: self.scene, workload, pairs: &every };
        let Reference { a, b, rays } = self.reference("reference maps", queries, rays);
        let [a, b] = [a, b].map(|half| workload.weighted(&half));
        let reference = Reference { a, b, rays };
        let means: Vec<f32> = (0..grid.points.len()).map(|texel| reference.mean(texel)).collect();
        let image = Image::new(grid.width, grid.height, grid.texel, means)?;
        Ok(Some(Map { grid, lattices, reference, image }))
    }

    /// Exact rows with and without interpolation, then MR rows, those by the far-field cache last.
    fn planned<'b>(&'b self, map: &Map, engine: &MultiResolution) -> Vec<Planned<'b>> {
        let mut rows = Vec::new();
        let more = MORE_SEGMENTS * self.options.rays;
        let mr_rays =
            if more <= MAX_SEGMENTS { vec![self.options.rays, more] } else { vec![self.options.rays] };
        let mut all_rays = [&EXACT_RAYS[..], &mr_rays].concat();
        all_rays.sort_unstable();
        all_rays.dedup();
        for (lattice, (spacing, _, workload)) in map.lattices.iter().enumerate() {
            let most = (MAX_RAYS_PER_TEXEL * spacing * spacing).max(self.options.rays);
            for &rays in all_rays.iter().filter(|&&rays| rays <= most) {
                let (call, setup_s) = self.embree_timed(workload, rays);
                rows.push(Planned::Exact { lattice, rays, call, setup_s });
            }
        }
        let mut sample_s = 0.0;
        let sample = timed(&mut sample_s, || {
            let how = (&mr_rays[..], Extent::MAP);
            Sample::of(self.scene, &map.lattices[0].2, how, &self.model.exact())
        });
        for (&s, rays) in self.sizes.iter().flat_map(|s| mr_rays.iter().map(move |&rays| (s, rays))) {
            let mut row = self.decide(&sample, engine, s, rays);
            row.decide_s += sample_s;
            let at_most_one_set = |spacing: usize| rays <= self.options.rays * spacing * spacing;
            for lattice in (0..map.lattices.len()).filter(|&k| at_most_one_set(map.lattices[k].0)) {
                rows.push(Planned::Mr { lattice, row });
            }
        }
        // The cache knows emitters of the scene alone.
        if !map.lattices[0].2.is_under_a_sky() {
            rows.extend(self.cached_rows(map, engine));
        }
        rows
    }

    /// Light of all texels, the part of the segments that met averaged clusters, and the times of queries and interpolation, seconds.
    fn texels_of(&self, map: &Map, row: &Planned, engine: &MultiResolution) -> (Vec<f32>, f64, Vec<f64>) {
        let interpolated = |lattice: usize, ask: &dyn Fn(Queries) -> MrRun| {
            let (_, lattice, workload) = &map.lattices[lattice];
            let every: Vec<usize> = (0..workload.pairs.len()).collect();
            let MrRun { run, cost, .. } = ask(Queries { scene: self.scene, workload, pairs: &every });
            let start = Instant::now();
            let texels = lattice.fill(&workload.weighted(&run.visible));
            let mut sections = run.sections;
            sections.push(start.elapsed().as_secs_f64());
            (texels, cost.aggregated as f64 / cost.segments.max(1) as f64, sections)
        };
        match row {
            Planned::Exact { lattice, rays, call, .. } => interpolated(*lattice, &|queries| MrRun {
                run: self.exact(queries, call, *rays, false),
                ..MrRun::default()
            }),
            Planned::Mr { lattice, row } => {
                interpolated(*lattice, &|queries| self.mr(queries, engine, row, false))
            }
            Planned::Cached(row) => self.cached_texels(map, row),
        }
    }
}

impl Planned<'_> {
    /// Whether the row is not that of exact rays.
    fn is_measured(&self) -> bool {
        match self {
            Planned::Exact { .. } | Planned::Cached(_) => true,
            Planned::Mr { row, .. } => row.pays(),
        }
    }
}

#[cfg(test)]
mod tests;
