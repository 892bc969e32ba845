//! Rows of rays: what the rays of each leaf have met.

use super::gatherer::{Buffers, FinalGather, PathVertex};
use crate::math::sampling::{mix, point_on};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::Tally;
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// Elements that one task traces for.
const CHUNK: usize = 64;

/// The rays of one leaf.
pub struct RayRow {
    /// The leaf element.
    pub leaf: u32,
    /// End of its rays among all rays.
    pub end: usize,
    /// Sum over the rays of the irradiance from emitters, W/m².
    pub direct: Vec3,
    /// Sum over the rays of the square of its mean over the channels.
    pub squares: f32,
    /// Rays that left the scene.
    pub gone: u32,
}

/// The rays of all leaves.
pub struct RayRows {
    /// One row a leaf.
    pub rows: Vec<RayRow>,
    /// By ray, the leaf that it met; [`Elements::NONE`] for none.
    pub met: Vec<u32>,
    /// Cost of the rays.
    pub tally: Tally,
}

impl RayRows {
    fn new() -> RayRows {
        RayRows { rows: Vec::new(), met: Vec::new(), tally: Tally::default() }
    }

    /// A row with the leaves that its rays met.
    pub fn of(&self, i: usize) -> (&RayRow, &[u32]) {
        let from = if i > 0 { self.rows[i - 1].end } else { 0 };
        (&self.rows[i], &self.met[from..self.rows[i].end])
    }

    /// Traces `count` rays of each leaf; `done` learns of how many leaves more they are traced.
    pub fn trace(
        gather: &FinalGather,
        leaves: &[u32],
        count: impl Fn(u32) -> u32 + Sync,
        done: impl Fn(usize) + Sync,
    ) -> RayRows {
        let made: Vec<RayRows> = leaves
            .par_chunks(CHUNK)
            .map_init(Buffers::default, |buffers, leaves| {
                let mut made = RayRows::new();
                buffers.scratch.tally = Tally::default();
                for &leaf in leaves {
                    made.trace_leaf(gather, leaf, count(leaf), buffers);
                }
                made.tally = buffers.scratch.tally;
                done(leaves.len());
                made
            })
            .collect();
        let mut all = RayRows { rows: Vec::with_capacity(leaves.len()), ..RayRows::new() };
        all.met.reserve_exact(made.iter().map(|m| m.met.len()).sum());
        for part in made {
            let before = all.met.len();
            all.rows.extend(part.rows.into_iter().map(|r| RayRow { end: before + r.end, ..r }));
            all.met.extend(part.met);
            all.tally.add(part.tally);
        }
        all
    }

    fn trace_leaf(&mut self, gather: &FinalGather, leaf: u32, count: u32, buffers: &mut Buffers) {
        let linked = gather.linked;
        let element = &linked.elements.elements[leaf as usize];
        let Shape::Surface { side, corners } = element.shape else { return };
        let seed = mix(linked.settings.seed ^ mix(element.ids[0])) as u32;
        buffers.vertices.clear();
        buffers.vertices.extend((0..count).map(|k| {
            let [u, v, ..] = sample_4d(k, 1, seed);
            PathVertex { at: point_on(&corners, u, v), side, leaf, share: Vec3::ONE }
        }));
        let mut cut = std::mem::take(&mut buffers.cut);
        gather.cut_of(leaf, &mut cut);
        gather.trace(&linked.engine, &cut, |k| sample_4d(k as u32, 0, seed), buffers);
        buffers.cut = cut;
        let (mut direct, mut squares, mut gone) = (Vec3::ZERO, 0.0, 0);
        for found in &buffers.results {
            direct += found.direct;
            gone += u32::from(found.gone);
            squares += (found.direct.element_sum() / 3.0).powi(2);
            let nothing = found.met.side == Elements::NONE;
            self.met.push(if nothing { Elements::NONE } else { found.met.leaf });
        }
        self.rows.push(RayRow { leaf, end: self.met.len(), direct, squares, gone });
    }
}
