//! Rows of rays: the elements that the rays of each leaf have hit.

use super::element_rays::{LeafRays, batches};
use super::gatherer::{Buffers, FinalGather};
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::radiosity::elements::Elements;
use crate::radiosity::elements::emitter_tree::EmitterCut;
use crate::radiosity::links::Tally;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The rays of one leaf.
#[derive(Deserialize, Serialize)]
pub struct RayRow {
    /// The leaf element.
    pub leaf: u32,
    /// End of its rays among all rays.
    pub end: usize,
    /// Rays of the leaf.
    pub rays: u32,
    /// The independent halves of its rays: the first and the last ones.
    pub halves: [RowHalf; 2],
    /// Sum over the rays of the irradiance from the sky, W/m².
    pub sky: Vec3,
    /// Sum over the rays of the square of all their light that counts as direct, mean over the channels.
    pub squares: f32,
    /// The same without the light of suns.
    pub squares_beside_suns: f32,
    /// Rays that left the scene.
    pub escaped: u32,
    /// Rays that met emitters, if these are about equally bright and too many for a closed form; otherwise 0.
    pub met_emitters: u32,
    /// Irradiance from emitters and suns at the starts of the rays that left the scene, mean over the channels, sum over the rays, W/m².
    pub escaped_lit: f32,
    /// Rays that met leaves without rows: their light is known and counts as direct.
    pub outside: u32,
}

/// Half of the rays of a leaf.
#[derive(Clone, Copy, Default, Deserialize, Serialize)]
pub struct RowHalf {
    /// Sum over the rays of the irradiance from emitters, suns and sky, and from paths through leaves outside the exchange without the
    /// light of the ends of these paths, W/m².
    pub direct: Vec3,
    /// The part of `direct` by the emitters of the scene, W/m².
    pub emitted: Vec3,
    /// The part of `direct` by suns, sums over the first and over the other half of these rays, W/m².
    pub sun: [Vec3; 2],
    /// Rays that met leaves outside the exchange: paths have gone on from there.
    pub continued: u32,
}

/// The end of a path that a ray of a leaf begins and leaves outside the exchange continue.
#[derive(Clone, Copy, Deserialize, Serialize)]
pub struct PathEnd {
    /// The row of the leaf.
    pub row: u32,
    /// The ray among those of the leaf. Ends of one ray follow each other.
    pub ray: u32,
    /// The leaf where the path ends; after [`RayRows::number_rows`] its row.
    pub met: u32,
    /// Fraction of the radiosity reflected there that arrives, by channel.
    pub share: Vec3,
    /// The light of the ray that is known without its ends, mean over the channels, W/m².
    pub direct: f32,
}

/// The rays of all leaves.
#[derive(Deserialize, Serialize)]
pub struct RayRows {
    /// One row a leaf.
    pub rows: Vec<RayRow>,
    /// By ray, the leaf that it met; [`Elements::NONE`] for none.
    pub met: Vec<u32>,
    /// Ends of the paths of rays that met leaves outside the exchange, in the order of the rows.
    pub ends: Vec<PathEnd>,
    /// Leaves for which other rays were traced than planned.
    pub reduced: usize,
    /// Cost of the rays.
    pub tally: Tally,
}

impl RayRow {
    /// Sum over the rays of all light that counts as direct, W/m².
    pub fn direct(&self) -> Vec3 {
        self.halves[0].direct + self.halves[1].direct
    }

    /// Irradiance by the sky and by suns, W/m².
    pub fn sky_and_sun(&self) -> [Vec3; 2] {
        [self.sky, self.sun()].map(|light| light / self.rays as f32)
    }

    /// The half to which a ray belongs.
    pub fn half_of(&self, ray: u32) -> usize {
        usize::from(ray >= self.rays / 2)
    }

    /// Sum over the rays of the irradiance from the emitters of the scene, W/m².
    pub fn emitted(&self) -> Vec3 {
        self.halves[0].emitted + self.halves[1].emitted
    }

    /// Sum over the rays of the irradiance from suns, W/m².
    pub fn sun(&self) -> Vec3 {
        self.halves.iter().flat_map(|half| half.sun).sum()
    }

    /// Rays that met leaves outside the exchange.
    pub fn continued(&self) -> u32 {
        self.halves[0].continued + self.halves[1].continued
    }

    /// The fraction of the light reflected by the leaf that stays in the scene, for a leaf that lies both inside and outside of a room:
    /// each ray has the weight of the light at its start.
    pub fn kept_of_lit(&self) -> f32 {
        let lit = (self.emitted() + self.sun()).element_sum() / 3.0;
        if lit > 0.0 {
            (1.0 - self.escaped_lit / lit).clamp(0.0, 1.0)
        } else {
            1.0 - self.escaped as f32 / self.rays as f32
        }
    }
}

impl RayRows {
    fn new() -> RayRows {
        RayRows { rows: Vec::new(), met: Vec::new(), ends: Vec::new(), reduced: 0, tally: Tally::default() }
    }

    /// Traces the planned rays of the leaves of each list and returns the rows of each list. `instead` is called before each batch of
    /// leaves: if it returns rays, these replace the planned ones, and leaves that are not among them have no row. Any first part of the
    /// order of batches is spread over all leaves. `done` is called with the number of further leaves finished.
    pub fn trace<const N: usize>(
        gather: &FinalGather,
        planned: [&[LeafRays]; N],
        instead: impl Fn(&[LeafRays]) -> Option<Vec<LeafRays>> + Sync,
        done: impl Fn(usize) + Sync,
    ) -> [RayRows; N] {
        let batches_of = |list: usize| batches(planned[list]).into_iter().map(move |range| (list, range));
        let batches: Vec<(usize, Range<usize>)> = (0..N).flat_map(batches_of).collect();
        let order = spread_order(batches.len());
        let rows = gather.ranks.rows(order.len());
        let made: Vec<RayRows> = parallel::map_with(rows.numbers(), Buffers::default, |buffers, i| {
            let k = order[i];
            let (list, range) = &batches[k];
            let planned = &planned[*list][range.clone()];
            let fewer = instead(planned);
            let mut made = RayRows::new();
            buffers.scratch.tally = Tally::default();
            made.trace_batch(gather, fewer.as_deref().unwrap_or(planned), buffers);
            made.reduced = fewer.map_or(0, |fewer| fewer.len());
            made.tally = buffers.scratch.tally;
            done(rows.steps(planned.len()));
            made
        });
        let mut made: Vec<(usize, RayRows)> = order.into_iter().zip(rows.gather(made)).collect();
        made.sort_unstable_by_key(|(k, _)| *k);
        let mut lists =
            planned.map(|list| RayRows { rows: Vec::with_capacity(list.len()), ..RayRows::new() });
        for (k, part) in made {
            let all = &mut lists[batches[k].0];
            let (before, rows) = (all.met.len(), all.rows.len() as u32);
            all.ends.extend(part.ends.into_iter().map(|end| PathEnd { row: rows + end.row, ..end }));
            all.rows.extend(part.rows.into_iter().map(|r| RayRow { end: before + r.end, ..r }));
            all.met.extend(part.met);
            all.reduced += part.reduced;
            all.tally.add(part.tally);
        }
        lists
    }

    fn trace_batch(&mut self, gather: &FinalGather, batch: &[LeafRays], buffers: &mut Buffers) {
        let cuts = gather.cuts_of(batch, buffers);
        let random = gather.starts(batch, buffers);
        gather.trace_leaves(batch, &random, &cuts, &vec![None; batch.len()], buffers);
        let is_many = |cut: &EmitterCut| gather.emitters.is_even() && gather.emitters.faces(cut).is_none();
        let many: Vec<bool> = cuts[..batch.len()].iter().map(is_many).collect();
        let emits = |side: u32| gather.linked.elements.sides[side as usize].exitance != [0.0; 3];
        buffers.cuts = cuts;
        let seed = batch.first().map_or(0, |of| mix(!u64::from(of.leaf)));
        let paths = gather.paths_onwards(seed, buffers);
        let mut results = buffers.results.iter().zip(paths);
        for (of, many) in batch.iter().zip(many) {
            let (leaf, rays, outside) = (of.leaf, 2 * of.count, 0);
            let (mut halves, mut escaped, mut escaped_lit, mut met_emitters) =
                ([RowHalf::default(); 2], 0, 0.0, 0);
            let (mut sky, mut squares, mut squares_beside_suns) = (Vec3::ZERO, 0.0, 0.0);
            for (k, (found, path)) in results.by_ref().take(rays as usize).enumerate() {
                let onwards = path.as_ref().map_or(Vec3::ZERO, |path| path.light);
                let beside_suns = found.direct + found.sky + onwards;
                let light = beside_suns + found.sun;
                let direct = light.element_sum() / 3.0;
                for &(met, share) in path.iter().flat_map(|path| &path.ends) {
                    let row = self.rows.len() as u32;
                    self.ends.push(PathEnd { row, ray: k as u32, met, share, direct });
                }
                let (number, count) = (k % of.count as usize, of.count as usize);
                let half = &mut halves[k / count];
                half.direct += light;
                half.emitted += found.direct;
                half.sun[usize::from(number >= count / 2)] += found.sun;
                half.continued += u32::from(path.is_some());
                sky += found.sky;
                let side = found.met.side;
                met_emitters += u32::from(many && side != Elements::NONE && emits(side));
                escaped += u32::from(found.escaped);
                escaped_lit +=
                    if found.escaped { (found.direct + found.sun).element_sum() / 3.0 } else { 0.0 };
                squares += direct.powi(2);
                squares_beside_suns += (beside_suns.element_sum() / 3.0).powi(2);
                let met = match path {
                    None if found.met.side != Elements::NONE => found.met.leaf,
                    _ => Elements::NONE,
                };
                self.met.push(met);
            }
            let end = self.met.len();
            self.rows.push(RayRow {
                leaf,
                end,
                rays,
                halves,
                sky,
                squares,
                squares_beside_suns,
                escaped,
                met_emitters,
                escaped_lit,
                outside,
            });
        }
    }

    /// Adds the light that paths bring from their ends where `reflected` returns the reflected radiosity there, W/m².
    pub fn add_light_of_ends(&mut self, reflected: impl Fn(u32) -> Option<Vec3>) {
        let RayRows { rows, ends, .. } = self;
        for of_ray in ends.chunk_by_mut(|a, b| (a.row, a.ray) == (b.row, b.ray)) {
            let light = of_ray.iter().filter_map(|end| Some(end.share * reflected(end.met)?)).sum::<Vec3>();
            let (PathEnd { row, ray, direct, .. }, mean) = (of_ray[0], light.element_sum() / 3.0);
            let row = &mut rows[row as usize];
            let half = row.half_of(ray);
            row.halves[half].direct += light;
            row.squares += mean * (2.0 * direct + mean);
            row.squares_beside_suns += mean.powi(2);
            of_ray.iter_mut().for_each(|end| end.direct += mean);
        }
    }

    /// Replaces the leaves that rays have met by the numbers of their rows. Leaves without rows count as outside: the light that they
    /// reflect (by element, W/m²) becomes direct light.
    pub fn number_rows(&mut self, elements: usize, reflected: impl Fn(u32) -> Vec3) {
        let mut row_of = vec![Elements::NONE; elements];
        for (i, row) in (0..).zip(&self.rows) {
            row_of[row.leaf as usize] = i;
        }
        // The light that paths bring from leaves without rows is known.
        let is_row = |leaf: u32| row_of[leaf as usize] != Elements::NONE;
        self.add_light_of_ends(|leaf| (!is_row(leaf)).then(|| reflected(leaf)));
        let RayRows { rows, met, ends, .. } = self;
        ends.retain(|end| is_row(end.met));
        ends.iter_mut().for_each(|end| end.met = row_of[end.met as usize]);
        let mut first = 0;
        for row in rows {
            let half = (row.end - first) / 2;
            for (k, met) in met[first..row.end].iter_mut().enumerate() {
                let Some(&number) = row_of.get(*met as usize) else { continue };
                if number == Elements::NONE {
                    let light = reflected(*met);
                    row.halves[usize::from(k >= half)].direct += light;
                    let square = (light.element_sum() / 3.0).powi(2);
                    row.squares += square;
                    row.squares_beside_suns += square;
                    row.outside += 1;
                }
                *met = number;
            }
            first = row.end;
        }
    }
}

/// The numbers below `count` in an order in which any run of them is spread evenly: the k-th is the rank of the fraction of k times the
/// golden section.
fn spread_order(count: usize) -> Vec<usize> {
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_895;
    let mut places: Vec<(f64, usize)> =
        (0..count).map(|k| ((GOLDEN_SECTION * k as f64).fract(), k)).collect();
    places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut order = vec![0; count];
    for (rank, (_, k)) in places.into_iter().enumerate() {
        order[k] = rank;
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_permutations_whose_runs_are_spread() {
        for count in [0usize, 1, 2, 3, 10, 997, 1024] {
            let order = spread_order(count);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..count), "{count}");
        }
        // A tenth of a thousand: no gap is more than three times the mean one.
        let order = spread_order(1000);
        for run in order.chunks(100) {
            let mut run = run.to_vec();
            run.sort_unstable();
            assert!(run.windows(2).all(|w| w[1] - w[0] <= 30), "{run:?}");
        }
    }
}
