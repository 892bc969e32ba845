//! Maps: shadow images of whole receivers by both engines, computed at every texel or at some and interpolated between.
//!
//! A map has many receiver points close together, so that both engines may interpolate, and what is prepared for it alone (choices and
//! caches) counts: `speedup_with_setup`. All rows of a map are compared with one reference of independent rays at every texel.

mod cached;
mod quadtree;

use super::context::{Bench, EXACT_RAYS, PlannedRow};
use super::exact_reference::ExactReference;
use super::gallery::single_rays;
use super::lights;
use super::measure::{MrRun, Queries, rounds};
use super::options::BenchOptions;
use super::receivers::{ReceiverGrid, Surfaces};
use super::record::{Build, MapRecord};
use super::sample::{Extent, Sample};
use super::workload::Workload;
use crate::Result;
use crate::bench::record::{MapExactRow, MapMrRow, interpolate_log_log, ratio, speedup};
use crate::metrics::Image;
use crate::metrics::fbem::fbem_at;
use crate::progress::timed;
use crate::visibility::{Exact, MultiResolution};
use cached::CachedRow;
use quadtree::Lattice;
use std::time::{Duration, Instant};

/// Texels along the longer side of a map by default: with six emitters, 256 by 256 texels of [`MAX_REFERENCE_RAYS`] have
/// [`MAX_REFERENCE_SEGMENTS`]; 512 by 512 would with one only.
const DEFAULT_SIDE: usize = 256;
/// Largest number of texels times emitters of a map by default: with eight emitters 256 by 256 texels; limits the rows of a map to some
/// ten seconds on one core.
const DEFAULT_PAIRS: usize = 1 << 19;
/// Spacings of the texels at which light is computed: steps of 2 quarter the work.
const SPACINGS: [usize; 4] = [1, 2, 4, 8];
/// Factor on the number of segments in some rows of interpolated maps: with every second column and row, as many segments per texel.
const SEGMENT_FACTOR: usize = 4;
/// Largest number of segments of rows with more.
const MAX_SEGMENTS: usize = 256;
/// Largest mean number of exact rays a texel: rows beyond are extrapolated.
const MAX_RAYS_PER_TEXEL: usize = 64;
/// Largest number of rays from a texel in the reference: noise of at most √(¼ / 256) = 3 %, which is subtracted from the errors.
const MAX_REFERENCE_RAYS: usize = 256;
/// Largest number of segments of the reference: limits its time to some seconds on two cores.
const MAX_REFERENCE_SEGMENTS: usize = 100_000_000;
/// Fewest rays from a texel in the reference: noise of at most √(¼ / 16) = 13 %, which is subtracted from the errors.
const MIN_REFERENCE_RAYS: usize = 16;
/// A further round of the rows of a map starts only if it is expected to end within this time: limits the duration of a benchmark.
const MAX_TIME: Duration = Duration::from_secs(3);

impl BenchOptions {
    /// Texels along the longer side of a map in a scene with this number of emitters.
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
    reference: ExactReference,
    image: Image<'static>,
}

/// A row to be measured.
enum PlannedMap<'a> {
    Exact { lattice: usize, rays: usize, call: Exact, setup_s: f64 },
    Mr { lattice: usize, row: PlannedRow },
    Cached(CachedRow<'a>),
}

/// Texels and error of a row.
struct MapResult {
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
        let grids = surfaces.maps(self.model, &single_rays(self.model), side, self.sizes[0]);
        let maps = grids.iter().map(|grid| self.map(grid, engine, build));
        maps.filter_map(Result::transpose).collect()
    }

    /// `None` if no light arrives anywhere.
    fn map(&self, grid: &ReceiverGrid, engine: &MultiResolution, build: &Build) -> Result<Option<MapRecord>> {
        let Some(map) = self.prepared(grid)? else { return Ok(None) };
        self.progress.stage("choosing", 0);
        let rows = self.planned(&map, engine);
        self.progress.stage("maps", 0);
        let mut made: Vec<Result<MapResult>> = Vec::new();
        let measured: Vec<usize> = (0..rows.len()).filter(|&k| rows[k].is_measured()).collect();
        let timed = rounds(self.options.rounds, MAX_TIME, measured.len(), |k, first| {
            let (texels, aggregated, sections) = self.texels_of(&map, &rows[measured[k]], engine);
            if first {
                made.push(map.made(texels, aggregated));
            }
            sections
        });
        let made = made.into_iter().collect::<Result<Vec<MapResult>>>()?;
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
        let ExactReference { a, b, rays } = self.reference("reference maps", queries, rays);
        let [a, b] = [a, b].map(|half| workload.weighted(&half));
        let reference = ExactReference { a, b, rays };
        let means: Vec<f32> = (0..grid.points.len()).map(|texel| reference.mean(texel)).collect();
        let image = Image::new(grid.width, grid.height, grid.texel, means)?;
        Ok(Some(Map { grid, lattices, reference, image }))
    }

    /// Exact rows with and without interpolation, then MR rows, those by the far-field cache last.
    fn planned<'b>(&'b self, map: &Map, engine: &MultiResolution) -> Vec<PlannedMap<'b>> {
        let mut rows = Vec::new();
        let more = SEGMENT_FACTOR * self.options.rays;
        let mr_rays =
            if more <= MAX_SEGMENTS { vec![self.options.rays, more] } else { vec![self.options.rays] };
        let mut all_rays = [&EXACT_RAYS[..], &mr_rays].concat();
        all_rays.sort_unstable();
        all_rays.dedup();
        for (lattice, (spacing, _, workload)) in map.lattices.iter().enumerate() {
            let most = (MAX_RAYS_PER_TEXEL * spacing * spacing).max(self.options.rays);
            for &rays in all_rays.iter().filter(|&&rays| rays <= most) {
                let (call, setup_s) = self.embree_timed(workload, rays);
                rows.push(PlannedMap::Exact { lattice, rays, call, setup_s });
            }
        }
        let mut sample_s = 0.0;
        let sample = timed(&mut sample_s, || {
            Sample::of(self.scene, &map.lattices[0].2, &mr_rays, Extent::MAP, &self.model.exact())
        });
        for (&s, rays) in self.sizes.iter().flat_map(|s| mr_rays.iter().map(move |&rays| (s, rays))) {
            let mut row = self.decide(&sample, engine, s, rays);
            row.decide_s += sample_s;
            let at_most_one_set = |spacing: usize| rays <= self.options.rays * spacing * spacing;
            for lattice in (0..map.lattices.len()).filter(|&k| at_most_one_set(map.lattices[k].0)) {
                rows.push(PlannedMap::Mr { lattice, row });
            }
        }
        // The cache supports emitters of the scene only.
        if !map.lattices[0].2.is_under_a_sky() {
            rows.extend(self.cached_rows(map, engine));
        }
        rows
    }

    /// Light of all texels, the fraction of the segments that met averaged clusters, and the times of queries and interpolation, seconds.
    fn texels_of(&self, map: &Map, row: &PlannedMap, engine: &MultiResolution) -> (Vec<f32>, f64, Vec<f64>) {
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
            PlannedMap::Exact { lattice, rays, call, .. } => interpolated(*lattice, &|queries| MrRun {
                run: self.exact(queries, call, *rays, false),
                ..MrRun::default()
            }),
            PlannedMap::Mr { lattice, row } => {
                interpolated(*lattice, &|queries| self.mr(queries, engine, row, false))
            }
            PlannedMap::Cached(row) => self.cached_texels(map, row),
        }
    }
}

impl PlannedMap<'_> {
    /// Whether the row is not that of exact rays.
    fn is_measured(&self) -> bool {
        match self {
            PlannedMap::Exact { .. } | PlannedMap::Cached(_) => true,
            PlannedMap::Mr { row, .. } => row.pays(),
        }
    }
}

impl Map<'_> {
    /// Image and errors of the light of all texels.
    pub(super) fn made(&self, texels: Vec<f32>, aggregated: f64) -> Result<MapResult> {
        let (rms, bias) = self.reference.errors(&texels);
        let image = Image::new(self.grid.width, self.grid.height, self.grid.texel, texels)?;
        Ok(MapResult { image, rms, bias, aggregated })
    }

    /// The record from all rows, and those that were measured with their times.
    pub(super) fn record(
        &self,
        rows: &[PlannedMap],
        measured: &[(&PlannedMap, &MapResult, f64)],
        build: &Build,
    ) -> Result<MapRecord> {
        let exact: Vec<(usize, MapExactRow, &MapResult)> = measured
            .iter()
            .filter_map(|&(row, made, seconds)| {
                let PlannedMap::Exact { lattice, rays, setup_s, .. } = *row else { return None };
                let spacing = self.lattices[lattice].0;
                let (interpolated, rms, bias) = (spacing > 1, made.rms, made.bias);
                let row = MapExactRow { rays, spacing, interpolated, seconds, setup_s, rms, bias };
                Some((lattice, row, made))
            })
            .collect();
        let mut mr = Vec::new();
        let mut found = measured.iter().filter(|(row, ..)| !matches!(row, PlannedMap::Exact { .. }));
        for planned in rows {
            let (row, as_exact) = match planned {
                PlannedMap::Exact { .. } => continue,
                PlannedMap::Mr { lattice, row } => {
                    let same = exact.iter().find(|e| e.0 == *lattice && e.1.rays == row.rays);
                    (self.planned_row(*lattice, row), same)
                }
                PlannedMap::Cached(row) => (row.row(), None),
            };
            let (made, seconds) = if planned.is_measured() {
                let (_, made, seconds) = found.next().expect("a run of every row that is measured");
                (*made, *seconds)
            } else {
                let (_, same, made) = as_exact.expect("exact rows have the number of rays of MR");
                (*made, same.seconds)
            };
            let row = MapMrRow {
                seconds,
                rms: made.rms,
                bias: made.bias,
                fbem: fbem_at(&self.image, &made.image, row.feature_size)?.value,
                aggregated_fraction: made.aggregated,
                ..row
            };
            mr.push(self.compared(row, &exact, build)?);
        }
        Ok(MapRecord {
            receiver: self.grid.name.clone(),
            width: self.grid.width,
            height: self.grid.height,
            texel: self.grid.texel,
            reference_rays: self.reference.rays,
            reference_rms: self.reference.standard_error(),
            exact: exact.into_iter().map(|(_, row, _)| row).collect(),
            mr,
        })
    }

    /// A row before its measurement.
    fn planned_row(&self, lattice: usize, row: &PlannedRow) -> MapMrRow {
        let spacing = self.lattices[lattice].0;
        MapMrRow {
            feature_size: row.s,
            rays: row.rays,
            spacing,
            interpolated: spacing > 1,
            route: row.route_name().into(),
            setup_s: row.decide_s,
            ..MapMrRow::default()
        }
    }

    /// The row with its speed-ups.
    fn compared(
        &self,
        row: MapMrRow,
        exact: &[(usize, MapExactRow, &MapResult)],
        build: &Build,
    ) -> Result<MapMrRow> {
        // Over exact rows with at most this spacing of texels.
        let over = |spacing: usize, time: &dyn Fn(&MapExactRow) -> f64, seconds: f64| {
            let rows = exact.iter().filter(|(_, e, _)| e.spacing <= spacing);
            let curve: Vec<(f64, f64)> = rows.map(|(_, e, _)| (time(e), e.rms)).collect();
            let same = interpolate_log_log(&curve, row.rms)?;
            Some((ratio(same.seconds, seconds)?, same.extrapolated))
        };
        let mut by_features = Vec::new();
        for (_, e, made) in exact {
            by_features.push((e.seconds, fbem_at(&self.image, &made.image, row.feature_size)?.value));
        }
        let queries = over(usize::MAX, &|e| e.seconds, row.seconds);
        let with_setup = |spacing| over(spacing, &|e| e.seconds, row.seconds + row.setup_s);
        let prepared = row.seconds + row.setup_s + build.embree_s + build.mr_preparation();
        let with_preparation = over(usize::MAX, &|e| e.seconds + build.embree_s, prepared);
        let same_features = interpolate_log_log(&by_features, row.fbem);
        Ok(MapMrRow {
            speedup_at_same_rms: speedup(&row.route, queries.map(|found| found.0)),
            extrapolated: queries.is_some_and(|found| found.1),
            speedup_with_setup: with_setup(usize::MAX).map(|found| found.0),
            speedup_over_texels: with_setup(1).map(|found| found.0).filter(|_| !row.is_exact()),
            texels_extrapolated: with_setup(1).is_some_and(|found| found.1),
            speedup_with_preparation: with_preparation.map(|found| found.0),
            speedup_at_same_fbem: speedup(
                &row.route,
                same_features.and_then(|same| ratio(same.seconds, row.seconds)),
            ),
            ..row
        })
    }
}

#[cfg(test)]
mod tests;
