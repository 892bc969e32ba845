//! Form factors between all facets of a scene, with what stands between them.
//!
//! `F(i→j)` is the share of what facet `i` sends out from its front that arrives at the front of facet `j`. A facet is a
//! polygon of the input; groups of facets can be summed to objects or materials. Three steps:
//!
//! 1. *Discovery*: every facet sends out rays spread by the cosine. What they meet are its partners; what meets nothing is
//!    its escaped share, what meets a back side its lost share. Up to [`Settings::EVERY`] facets the rays are for these
//!    shares alone, and the partners are all facets that face it.
//! 2. *Pairs*: for two facets of which one found the other `A F` is a closed form (see `form_factor`) times the
//!    transmittance, which rays between them sample: a bundle at first, more where that is neither all clear nor all
//!    blocked. What is so small that it was found by chance also stands for what was not found. A pair is computed once, so
//!    that reciprocity `A_i F_ij = A_j F_ji` holds by construction, and large factors between facets that see all of each
//!    other have no sampling error at all.
//! 3. *Closure*, unless unwanted: rows that nothing escapes from are adjusted to the sum 1, symmetrically, each entry by
//!    as much as it is uncertain.
//!
//! Everything is the same on any number of threads. Memory is proportional to facets times rays, see [`memory_bound`].

mod closure;
mod discover;
mod every;
mod facets;
mod pair;
mod rays;
mod rows;
#[cfg(test)]
mod tests;
mod write;

pub use facets::Facets;
pub use rows::{Grouping, Matrix};
pub use write::{Format, write};

use crate::model::Model;
use crate::{Error, Result};
use rayon::prelude::*;
use rays::Traced;

/// How much is computed. [`Settings::new`] has the defaults for a number of facets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Rays of discovery a facet, at least 1.
    pub rays: u32,
    /// Rays between two facets to begin with, at most; at least 4.
    pub bundle: u32,
    /// Rays between two facets that are partly blocked, at most; not below `bundle`.
    pub largest_bundle: u32,
    /// Try every pair of facets that face each other, rather than those that rays find.
    pub every: bool,
    /// Adjust rows that nothing escapes from to the sum 1; the default.
    pub enforce: bool,
    /// Seed of everything random.
    pub seed: u64,
}

impl Settings {
    /// Up to so many facets every pair is tried: it costs less than to find most of them by rays.
    pub const EVERY: usize = 8192;

    /// Few facets get many rays: about four million of discovery in all (1,024 to 65,536 a facet) and bundles that make
    /// up for what there are few of.
    pub fn new(facets: usize) -> Settings {
        let n = facets.max(1) as u64;
        let rays = ((1 << 22) / n).clamp(2048, 1 << 16).next_power_of_two().min(1 << 16) as u32;
        let pairs = (n * n / 2).max(1);
        let bundle = ((1 << 24) / pairs).clamp(64, 1 << 14).next_power_of_two() as u32;
        let largest = ((1 << 26) / pairs).clamp(256, 1 << 20).next_power_of_two() as u32;
        Settings {
            rays,
            bundle,
            largest_bundle: largest,
            every: facets <= Settings::EVERY,
            enforce: true,
            seed: 1,
        }
    }
}

/// What was computed, and how good it is.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Number of facets.
    pub facets: usize,
    /// Entries that are not zero.
    pub entries: usize,
    /// Rays traced.
    pub rays: u64,
    /// Mean of |row sum + escaped + lost − 1| over the facets, before closure.
    pub row_sum_error: f64,
    /// Largest of them.
    pub worst_row_sum_error: f64,
    /// Smallest and largest row sum, after closure if that was asked for.
    pub row_sums: [f64; 2],
    /// Mean of |row sum + escaped + lost − 1| over the closed rows, as in the matrix that is given out.
    pub closed_row_sum_error: f64,
    /// Number of rows that nothing escapes from, but for stray rays ([`Report::STRAY`]).
    pub closed_rows: usize,
    /// Area-weighted mean of the escaped share.
    pub escaped: f64,
    /// Area-weighted mean of the share lost on back sides.
    pub lost: f64,
    /// Σ |A_i F_ij − A_j F_ji| / Σ A_i F_ij.
    pub reciprocity_residual: f64,
    /// Root mean square over rows of the standard error of a row's sum before closure: what was found by chance, and
    /// sampled transmittances, as if all were independent.
    pub row_standard_error: f64,
    /// Steps of the closure, 0 without.
    pub closure_steps: usize,
    /// Facets that look wrong: index, and why. At most [`Report::MAX_BAD`].
    pub bad: Vec<(usize, String)>,
    /// How many there are.
    pub bad_facets: usize,
}

impl Report {
    /// Length of the list of bad facets.
    pub const MAX_BAD: usize = 20;
    /// Escaped and lost shares up to this are stray rays through corners.
    pub const STRAY: f32 = 2e-3;
    /// A facet whose row sum, escaped and lost shares are off by more, or that loses more on back sides, is bad; sums
    /// only if they are off by more than six standard errors too.
    pub const BAD: f64 = 0.05;
}

/// The most memory that a matrix of so many facets takes while it is made, in bytes: there are no more pairs than every
/// facet with every other, and every ray finds at most one new. The scene and Embree come on top.
pub fn memory_bound(facets: usize, settings: &Settings) -> u64 {
    if settings.every {
        // Pairs with their values, and both entries of each.
        return facets as u64 * (facets as u64 * (13 + 16) / 2 + 640);
    }
    let found = facets as u64 * u64::from(settings.rays).min(facets as u64);
    // Lists of partners and their transpose, pairs with their values, and both entries of each pair.
    found * (8 + 8 + 13 + 16) + facets as u64 * 640
}

/// The matrix of all facets. `done` is called with steps out of `2 × facets`, from any thread.
///
/// # Errors
/// A setting is out of range.
pub fn compute(
    model: &Model,
    facets: &Facets,
    settings: &Settings,
    done: &(dyn Fn(u64) + Sync),
) -> Result<(Matrix, Report)> {
    if settings.rays == 0 || settings.bundle < 4 || settings.largest_bundle < settings.bundle {
        return Err(Error::Argument("rays must be at least 1, bundles at least 4 and not shrink".into()));
    }
    if facets.len() > discover::Partner::FACETS {
        return Err(Error::Scene(format!("more than {} facets", discover::Partner::FACETS)));
    }
    let traced = Traced::new(model, facets);
    let found: Vec<discover::Found> = (0..facets.len() as u32)
        .into_par_iter()
        .map_init(discover::Buffers::default, |buffers, i| {
            let found = discover::partners(&traced, facets, settings, i, buffers);
            done(1);
            found
        })
        .collect();
    let partners = discover::upper(&found);
    let shares: Vec<[f32; 2]> = found.iter().map(|f| [f.escaped, f.lost]).collect();
    drop(found);
    let pairs = pair::Pairs { traced: &traced, facets, settings, ends: model.end_rule() };
    let mut upper: Vec<pair::Row> = partners
        .par_iter()
        .enumerate()
        .map_init(pair::Buffers::default, |buffers, (i, partners)| {
            let row = if settings.every {
                pairs.every(i as u32, buffers)
            } else {
                pairs.row(i as u32, partners, buffers)
            };
            done(1);
            row
        })
        .collect();
    drop(partners);
    pair::balance(&mut upper);
    Ok(rows::assemble(facets, upper, shares, settings))
}
