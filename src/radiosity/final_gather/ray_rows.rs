//! Rows of rays: what the rays of each leaf have met.

use super::element_rays::{LeafRays, ROW, batches};
use super::gatherer::{Buffers, FinalGather};
use crate::radiosity::elements::Elements;
use crate::radiosity::links::Tally;
use glam::Vec3;
use rayon::prelude::*;

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

    /// Traces `count` rays of each leaf; `done` is called with the number of further leaves finished.
    pub fn trace(
        gather: &FinalGather,
        leaves: &[u32],
        count: impl Fn(u32) -> u32 + Sync,
        done: impl Fn(usize) + Sync,
    ) -> RayRows {
        let rays: Vec<LeafRays> = leaves.iter().map(|&leaf| LeafRays { leaf, count: count(leaf) }).collect();
        let made: Vec<RayRows> = batches(&rays)
            .into_par_iter()
            .map_init(Buffers::default, |buffers, batch| {
                let batch = &rays[batch];
                let mut made = RayRows::new();
                buffers.scratch.tally = Tally::default();
                made.trace_batch(gather, batch, buffers);
                made.tally = buffers.scratch.tally;
                done(batch.len());
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

    fn trace_batch(&mut self, gather: &FinalGather, batch: &[LeafRays], buffers: &mut Buffers) {
        let cuts = gather.cuts_of(batch, buffers);
        gather.trace_leaves(batch, ROW, &cuts, &vec![None; batch.len()], buffers);
        buffers.cuts = cuts;
        let mut results = buffers.results.iter();
        for of in batch {
            let (mut direct, mut squares, mut gone) = (Vec3::ZERO, 0.0, 0);
            for found in results.by_ref().take(of.count as usize) {
                direct += found.direct;
                gone += u32::from(found.gone);
                squares += (found.direct.element_sum() / 3.0).powi(2);
                let nothing = found.met.side == Elements::NONE;
                self.met.push(if nothing { Elements::NONE } else { found.met.leaf });
            }
            self.rows.push(RayRow { leaf: of.leaf, end: self.met.len(), direct, squares, gone });
        }
    }
}
