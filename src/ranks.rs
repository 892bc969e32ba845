//! Processes that share one computation, for example over MPI: every rank reads the same scene with the same options, computes some rows of
//! the parts that take long, and receives the rows of all others. Everything else is computed redundantly on every rank.
//!
//! A row depends on its number and the seed, never on the rank that computes it, and rows are put together in the order of their numbers.
//! Sums over rows are then taken on every rank, in that order: results have the same bits for any number of ranks.

use crate::math::parallel;
use bytemuck::Pod;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The connection of a rank with all others.
pub trait Exchange: Send + Sync {
    /// Number of ranks, at least 1.
    fn count(&self) -> usize;
    /// The number of this rank, below [`Exchange::count`].
    fn own(&self) -> usize;
    /// Sends these bytes to all ranks and returns those of all ranks, by their numbers. All ranks call it equally often; it does not return
    /// if one of them is lost.
    fn all_gather(&self, own: &[u8]) -> Vec<Vec<u8>>;
}

/// The ranks of a computation: one alone, or several that are connected.
#[derive(Clone, Default)]
pub struct Ranks(Option<Arc<dyn Exchange>>);

/// Smallest number of blocks of rows per rank, if there are enough rows: the time of a rank is a sum over these blocks, whose times may
/// differ by as much as their mean, so that ranks differ by about 1/√256 = 6 % at most.
const BLOCKS: usize = 256;
/// Largest number of rows of a block. Neighbouring rows read the same memory, which long blocks read once; beyond this number the rows
/// of a block far outnumber those at its ends, and longer blocks would only spread the rows less evenly over the ranks.
const MAX_BLOCK: usize = 1024;

impl Ranks {
    /// Connected ranks.
    pub fn of(exchange: Arc<dyn Exchange>) -> Ranks {
        Ranks(Some(exchange).filter(|e| e.count() > 1))
    }

    /// The rows of this rank among `count` rows.
    pub fn rows(&self, count: usize) -> Rows<'_> {
        let (ranks, own) = self.0.as_ref().map_or((1, 0), |e| (e.count(), e.own()));
        let block = (count / (ranks * BLOCKS)).clamp(1, MAX_BLOCK);
        Rows { exchange: self.0.as_deref(), count, deal: RowBlocks { ranks, own, block } }
    }
}

/// Distribution of rows to ranks: blocks, round robin.
#[derive(Clone, Copy, Debug)]
struct RowBlocks {
    ranks: usize,
    own: usize,
    /// Rows of a block.
    block: usize,
}

impl RowBlocks {
    /// Number of rows of a rank, of `count` rows.
    fn len(self, count: usize, rank: usize) -> usize {
        let turn = self.block * self.ranks;
        count / turn * self.block + (count % turn).saturating_sub(rank * self.block).min(self.block)
    }

    /// The number of the i-th row of this rank.
    fn number(self, i: usize) -> usize {
        (i / self.block * self.ranks + self.own) * self.block + i % self.block
    }

    /// The rank of a row.
    fn rank_of(self, row: usize) -> usize {
        row / self.block % self.ranks
    }
}

/// The numbers of the rows of a rank: how they are dealt, and how many they are.
pub struct RowNumbers(RowBlocks, usize);

impl parallel::Items for RowNumbers {
    type Item = usize;

    fn number(&self) -> usize {
        self.1
    }

    fn item(&self, place: usize) -> usize {
        self.0.number(place)
    }
}

/// The part of a rank of some rows.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    exchange: Option<&'a dyn Exchange>,
    count: usize,
    deal: RowBlocks,
}

impl Rows<'_> {
    /// The numbers of the rows that this rank computes, ascending.
    pub fn numbers(&self) -> RowNumbers {
        RowNumbers(self.deal, self.deal.len(self.count, self.deal.own))
    }

    /// Approximate steps of all ranks when this rank has made `own` steps.
    pub fn steps(&self, own: usize) -> usize {
        own * self.deal.ranks
    }

    /// All rows by their numbers, from this rank's own in the order of [`Rows::numbers`].
    ///
    /// # Panics
    /// Another rank runs another program.
    pub fn gather<T: Serialize + DeserializeOwned>(&self, own: Vec<T>) -> Vec<T> {
        let Some(exchange) = self.exchange else { return own };
        let bytes = postcard::to_stdvec(&own).expect("rows have a length");
        let decode = |(rank, bytes): (usize, Vec<u8>)| -> std::vec::IntoIter<T> {
            let rows: Vec<T> = postcard::from_bytes(&bytes).expect("all ranks run the same program");
            assert_eq!(rows.len(), self.deal.len(self.count, rank), "all ranks have the same rows");
            rows.into_iter()
        };
        let others = exchange.all_gather(&bytes).into_iter().enumerate();
        // Own rows need not be decoded.
        let mut own = Some(own);
        let mut parts: Vec<std::vec::IntoIter<T>> = others
            .map(|(rank, bytes)| match own.take_if(|_| rank == self.deal.own) {
                Some(own) => own.into_iter(),
                None => decode((rank, bytes)),
            })
            .collect();
        let next = |row: usize| parts[self.deal.rank_of(row)].next().expect("as many rows as dealt");
        (0..self.count).map(next).collect()
    }

    /// The same for rows of plain numbers, which are copied without encoding: faster for large rows.
    ///
    /// # Panics
    /// Another rank runs another program.
    pub fn gather_numbers<T: Pod>(&self, own: Vec<T>) -> Vec<T> {
        let Some(exchange) = self.exchange else { return own };
        let parts = exchange.all_gather(bytemuck::cast_slice(&own));
        let mut all = vec![T::zeroed(); self.count];
        let mut rests: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        for (k, block) in all.chunks_mut(self.deal.block).enumerate() {
            let block: &mut [u8] = bytemuck::cast_slice_mut(block);
            let rest = &mut rests[k % self.deal.ranks];
            block.copy_from_slice(rest.split_off(..block.len()).expect("as many rows as dealt"));
        }
        assert!(rests.iter().all(|rest| rest.is_empty()), "all ranks have the same rows");
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factors::matrix::{Facets, Settings, compute};
    use crate::model::{Detail, testing::model};
    use crate::path_tracer;
    use crate::points::Point;
    use crate::radiosity::{Options, run};
    use crate::scene::testing::generated;
    use glam::DVec3;
    use std::sync::{Barrier, Mutex};

    /// Ranks that are threads of one process.
    struct Shared {
        barrier: Barrier,
        parts: Mutex<Vec<Vec<u8>>>,
    }

    struct Thread {
        own: usize,
        shared: Arc<Shared>,
    }

    impl Exchange for Thread {
        fn count(&self) -> usize {
            self.shared.parts.lock().expect("no panic").len()
        }

        fn own(&self) -> usize {
            self.own
        }

        fn all_gather(&self, own: &[u8]) -> Vec<Vec<u8>> {
            self.shared.parts.lock().expect("no panic")[self.own] = own.into();
            self.shared.barrier.wait();
            let all = self.shared.parts.lock().expect("no panic").clone();
            self.shared.barrier.wait();
            all
        }
    }

    /// Results of the same work on `count` ranks, each a thread.
    fn on_ranks<R: Send>(count: usize, work: impl Fn(Ranks) -> R + Sync) -> Vec<R> {
        let shared =
            Arc::new(Shared { barrier: Barrier::new(count), parts: Mutex::new(vec![Vec::new(); count]) });
        std::thread::scope(|scope| {
            let run = |own| {
                let ranks = Ranks::of(Arc::new(Thread { own, shared: shared.clone() }));
                let work = &work;
                scope.spawn(move || work(ranks))
            };
            let threads: Vec<_> = (0..count).map(run).collect();
            threads.into_iter().map(|t| t.join().expect("no panic")).collect()
        })
    }

    #[test]
    fn every_row_is_dealt_once() {
        for (count, ranks, block) in [(0, 3, 1), (1, 3, 1), (10, 3, 1), (11, 2, 4), (1000, 7, 3), (8, 2, 4)] {
            let deal = |own| RowBlocks { ranks, own, block };
            let mut all = Vec::new();
            for own in 0..ranks {
                let numbers: Vec<usize> =
                    (0..deal(own).len(count, own)).map(|i| deal(own).number(i)).collect();
                assert!(numbers.iter().all(|&row| deal(0).rank_of(row) == own));
                assert!(numbers.is_sorted());
                all.extend(numbers);
            }
            all.sort_unstable();
            assert!(all.into_iter().eq(0..count), "{count} rows, {ranks} ranks, blocks of {block}");
        }
    }

    /// Floating-point numbers keep their bits, whatever the number of ranks.
    #[test]
    fn all_ranks_have_all_rows_in_their_order() {
        let row = |k: usize| (k as u32, vec![(k as f32).sqrt(); k % 3], 1.0 / k as f64);
        for (count, ranks) in [(0, 2), (1, 2), (3, 4), (5000, 2), (5000, 3)] {
            let found = on_ranks(ranks, |ranks| {
                let rows = ranks.rows(count);
                let own: Vec<_> = parallel::map(rows.numbers(), row);
                assert!(own.len() < count.max(2));
                let numbers = rows.gather_numbers(own.iter().map(|row| [row.2, f64::from(row.0)]).collect());
                let all = rows.gather(own);
                assert!(numbers.iter().zip(&all).all(|(n, row)| n[0].to_bits() == row.2.to_bits()));
                assert_eq!(numbers.len(), count);
                all
            });
            for all in found {
                assert!(all.into_iter().eq((0..count).map(row)), "{count} rows, {ranks} ranks");
            }
        }
    }

    #[test]
    fn one_rank_has_all_rows() {
        let alone = Ranks::default();
        assert_eq!(alone.rows(5).gather(parallel::map(alone.rows(5).numbers(), |row| row)), [0, 1, 2, 3, 4]);
    }

    /// A room with clusters has the same light, of elements and at points, on any number of ranks.
    #[test]
    fn a_solution_has_the_same_bits() {
        let scene = generated("cornell");
        let model = model(&scene, Detail::Clusters);
        let options = Options { error: 0.1, local_rays: Some(100_000), ..Options::default() };
        let points: Vec<Point> = (0..100)
            .map(|k| Point { position: DVec3::new(5.0 * f64::from(k) + 20.0, 0.0, 280.0), normal: DVec3::Y })
            .collect();
        let solved = |ranks: Ranks| {
            let found = run(&model.clone().on_ranks(ranks), &points, &options, &()).expect("a solution");
            let light: Vec<[f64; 3]> = found.mesh.elements.iter().map(|e| e.irradiance).collect();
            (light, found.irradiance, found.record.error_estimate, found.record.bundles)
        };
        let alone = solved(Ranks::default());
        assert!(alone.0.len() > 1000 && alone.1.iter().flatten().any(|&e| e > 0.0));
        for count in [2, 3] {
            assert!(on_ranks(count, solved).into_iter().all(|found| found == alone), "{count} ranks");
        }
    }

    #[test]
    fn paths_and_form_factors_have_the_same_bits() {
        let scene = generated("cornell");
        let (model, facets) = (model(&scene, Detail::Rays), Facets::new(&scene));
        let points: Vec<Point> = (0..20)
            .map(|k| Point { position: DVec3::new(20.0 * f64::from(k) + 20.0, 0.0, 280.0), normal: DVec3::Y })
            .collect();
        let found = |ranks: Ranks, every: bool| {
            let model = model.clone().on_ranks(ranks);
            let settings = path_tracer::Settings { samples: 64, direct_only: false, seed: 1 };
            let light = path_tracer::irradiance(&model, &points, settings, &()).expect("light");
            let settings = Settings { rays: 128, every, ..Settings::new(facets.count()) };
            let (matrix, report) = compute(&model, &facets, &settings, &()).expect("a matrix");
            (light.values, light.standard_errors, matrix, report.rays)
        };
        for every in [true, false] {
            let alone = found(Ranks::default(), every);
            for count in [2, 5] {
                assert!(on_ranks(count, |ranks| found(ranks, every)).into_iter().all(|one| one == alone));
            }
        }
    }
}
