//! Rows of maps by the far-field cache: probes at the corners of cells that have nothing close to them, and segments at the texels between
//! other corners.

use super::quadtree::{MapNode, Quadtree};
use super::{MAX_SEGMENTS, Map, PlannedMap, SEGMENT_FACTOR};
use crate::bench::context::Bench;
use crate::bench::receivers::ReceiverGrid;
use crate::bench::record::MapMrRow;
use crate::progress::timed;
use crate::visibility::{Cost, FarField, FarFieldBuffers, MultiResolution, Probe};
use std::ops::Range;
use std::time::Instant;

/// Largest distance between probes, texels: larger cells save less than a hundredth of the probes.
const MAX_SPACING: usize = 32;
/// Smallest distance between probes, and texels a probe in the mean, with which a row is planned: with fewer its preparation takes as long
/// as what it saves.
const MIN_SPACING: usize = 4;
const MIN_TEXELS_PER_PROBE: usize = 8;
/// Probes per parallel task: few enough to balance the load of the threads. Does not change results.
const PROBES_PER_TASK: usize = 64;

/// A row by the cache.
pub(super) struct CachedRow<'a> {
    pub s: f64,
    /// Segments from a texel; from probes as many times as they are texels apart, up to sixteen.
    pub rays: usize,
    /// Largest distance between probes, texels.
    pub spacing: usize,
    /// Time to find and fill the probes, seconds.
    pub setup_s: f64,
    cache: Cache<'a>,
}

impl CachedRow<'_> {
    /// The row before its measurement.
    pub fn row(&self) -> MapMrRow {
        let CachedRow { s, rays, spacing, setup_s, .. } = *self;
        MapMrRow {
            feature_size: s,
            rays,
            spacing,
            interpolated: true,
            route: "cache".into(),
            setup_s,
            ..MapMrRow::default()
        }
    }
}

struct Cache<'a> {
    field: FarField<'a>,
    tree: Quadtree,
    probes: Values,
}

/// Visible fractions by emitter and node, and their cost.
struct Values {
    visible: Vec<Vec<f32>>,
    cost: Cost,
}

impl Bench<'_> {
    /// A row for each feature size that is larger than a few texels, and two numbers of segments, where probes are much fewer than texels.
    pub(super) fn cached_rows<'b>(&'b self, map: &Map, engine: &MultiResolution) -> Vec<PlannedMap<'b>> {
        let rays = [self.options.rays, SEGMENT_FACTOR * self.options.rays]
            .into_iter()
            .filter(|&n| n <= MAX_SEGMENTS);
        let row = |(s, rays): (f64, usize)| {
            let steps = (s / map.grid.texel).max(1.0) as usize;
            let spacing = (1 << steps.ilog2()).min(MAX_SPACING);
            if spacing < MIN_SPACING {
                return None;
            }
            let mut first_s = 0.0;
            timed(&mut first_s, || self.cache(map.grid, engine, spacing, rays))?;
            // The smaller time of two, as of rows.
            let mut again_s = 0.0;
            let cache = timed(&mut again_s, || self.cache(map.grid, engine, spacing, rays))?;
            Some(PlannedMap::Cached(CachedRow { s, rays, spacing, setup_s: first_s.min(again_s), cache }))
        };
        rays.flat_map(|rays| self.sizes.iter().map(move |&s| (s, rays))).filter_map(row).collect()
    }

    /// The cache of a map with at most `spacing` texels between probes; none if its probes would be too many.
    fn cache<'b>(
        &'b self,
        grid: &ReceiverGrid,
        engine: &MultiResolution,
        spacing: usize,
        rays: usize,
    ) -> Option<Cache<'b>> {
        let seed = self.options.seed as u32;
        let field = FarField::new(engine, self.scene, self.model.samplers(), rays, seed)?;
        let tree = Quadtree::new([grid.width, grid.height], spacing, |texels, side| {
            let parts = self.timer.parts(texels.len(), PROBES_PER_TASK, |range| {
                let clear =
                    |&[x, y]: &[usize; 2]| field.is_clear(&grid.probe(x, y), side as f32 * grid.texel as f32);
                texels[range].iter().map(clear).collect::<Vec<bool>>()
            });
            parts.concat()
        });
        if tree.nodes().len() * MIN_TEXELS_PER_PROBE > grid.points.len() {
            return None;
        }
        let probes = self.seen(grid, &field, tree.probes());
        Some(Cache { field, tree, probes })
    }

    /// Visible fraction of each emitter from the nodes.
    fn seen(&self, grid: &ReceiverGrid, field: &FarField, nodes: &[MapNode]) -> Values {
        let mut cost = Cost::default();
        let mut visible = Vec::new();
        for emitter in 0..self.scene.emitters.len() {
            let look = |range: Range<usize>| {
                let (mut scratch, mut cost) = (FarFieldBuffers::default(), Cost::default());
                let value = |node: &MapNode| {
                    let probe = grid.probe(node.at[0], node.at[1]);
                    let answer = field.visible(&probe, emitter, node.sets(), &mut scratch);
                    cost.add(answer.cost);
                    answer.transmittance
                };
                let values: Vec<f32> = nodes[range].iter().map(value).collect();
                (values, cost)
            };
            let parts = self.timer.parts(nodes.len(), PROBES_PER_TASK, look);
            parts.iter().for_each(|part| cost.add(part.1));
            visible.push(parts.into_iter().flat_map(|part| part.0).collect());
        }
        Values { visible, cost }
    }

    /// Light of all texels, the fraction of the segments that met averaged clusters, and the time, seconds.
    pub(super) fn cached_texels(&self, map: &Map, row: &CachedRow) -> (Vec<f32>, f64, Vec<f64>) {
        let (grid, workload) = (map.grid, &map.lattices[0].2);
        let Cache { field, tree, probes } = &row.cache;
        let start = Instant::now();
        let mut rest = self.seen(grid, field, tree.others());
        let fill = |(probes, rest): (&Vec<f32>, &Vec<f32>)| tree.texels(&[&probes[..], &rest[..]].concat());
        let images: Vec<Vec<f32>> = probes.visible.iter().zip(&rest.visible).map(fill).collect();
        let of_pair = workload.pairs.iter().map(|pair| images[pair.emitter as usize][pair.point as usize]);
        let texels = workload.weighted(&of_pair.collect::<Vec<f32>>());
        let sections = vec![start.elapsed().as_secs_f64()];
        rest.cost.add(probes.cost);
        (texels, rest.cost.aggregated as f64 / rest.cost.segments.max(1) as f64, sections)
    }
}

impl ReceiverGrid {
    fn probe(&self, x: usize, y: usize) -> Probe {
        let point = &self.points[y * self.width + x];
        Probe::new(point.position, point.normal, point.magnitude)
    }
}
