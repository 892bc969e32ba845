//! Form factors between all facets of a scene, with occlusion.
//!
//! `F(i→j)` is the fraction of the flux leaving the front of facet `i` that arrives at the front of facet `j`. A facet
//! is a polygon of the input; facets can be grouped by object or material. Three steps:
//!
//! 1. *Discovery*: every facet traces cosine-distributed rays. Facets that they hit are its partners; rays that hit
//!    nothing are its escaped share, rays that hit a back side its lost share. Up to [`Settings::MAX_ALL_PAIRS`] facets the
//!    rays only measure these shares, and all facets that face it are partners.
//! 2. *Pairs*: for two facets of which one found the other, `A F` is a closed form ([`crate::form_factors::analytic`])
//!    times the transmittance, which rays between them sample: one bundle, and more if neither all nor no rays are
//!    blocked. Pairs too small to be found with certainty also represent similar pairs that were not found. Each pair
//!    is computed once, so reciprocity `A_i F_ij = A_j F_ji` holds exactly; unoccluded large factors have no sampling
//!    error.
//! 3. *Closure* ([`Settings::enforce`]): rows without escaped rays are adjusted symmetrically to the sum 1, each entry
//!    in proportion to its variance (docs/method.md, Form factors and closure).
//!
//! Results do not depend on the number of threads or ranks. Memory is proportional to facets times rays, see [`memory_bound`].

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

pub use facets::{Facets, Labels};
pub use rows::{FormFactors, Grouping, by_groups};
pub use write::{Format, write};

use crate::error::quote;
use crate::math::parallel;
use crate::model::Model;
use crate::progress::{self, Progress};
use crate::{Error, Result};
use facets::Partner;
use rays::Traced;

/// Options of [`compute`]. [`Settings::new`] has the defaults for a number of facets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Discovery rays per facet, at least 1.
    pub rays: u32,
    /// Largest number of rays in the first bundle between two facets; at least 4.
    pub bundle: u32,
    /// Largest number of rays between two partly blocked facets; at least `bundle`.
    pub largest_bundle: u32,
    /// Whether to compute all pairs of facets that face each other, not only those found by discovery rays.
    pub every: bool,
    /// Whether to adjust rows without escaped rays to the sum 1; the default.
    pub enforce: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Settings {
    /// Largest number of facets for which all pairs are computed by default: 34 million pairs, of which [`memory_bound`] is about 1 GB.
    pub const MAX_ALL_PAIRS: usize = 8192;

    /// Defaults for a number of facets: about four million discovery rays in all (2,048 to 65,536 per facet), and
    /// bundles that grow as the number of pairs falls: about 16 million rays in first bundles (64 to 16,384 per pair),
    /// 64 million in all (256 to 1,048,576 per pair). The numbers limit the time, and errors fall with their root.
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
            every: facets <= Settings::MAX_ALL_PAIRS,
            enforce: true,
            seed: 1,
        }
    }

    /// The same with other numbers of discovery rays and of rays between two facets, where they are given.
    pub fn with_rays(self, rays: Option<u32>, largest_bundle: Option<u32>) -> Settings {
        let largest_bundle = largest_bundle.unwrap_or(self.largest_bundle);
        let bundle = self.bundle.min(largest_bundle);
        Settings { rays: rays.unwrap_or(self.rays), bundle, largest_bundle, ..self }
    }
}

/// Statistics of a computed matrix.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Number of facets.
    pub facets: usize,
    /// Number of non-zero entries.
    pub entries: usize,
    /// Number of rays traced.
    pub rays: u64,
    /// Mean of |row sum + escaped + lost − 1| over the facets, before closure.
    pub row_sum_error: f64,
    /// Largest |row sum + escaped + lost − 1| over the facets, before closure.
    pub worst_row_sum_error: f64,
    /// Smallest and largest row sum, after closure if [`Settings::enforce`] is set.
    pub row_sums: [f64; 2],
    /// Mean of |row sum + escaped + lost − 1| over the closed rows of the final matrix.
    pub closed_row_sum_error: f64,
    /// Number of closed rows: escaped and lost shares of at most [`Report::MAX_CLOSED_LOSS`].
    pub closed_rows: usize,
    /// Area-weighted mean of the escaped shares.
    pub escaped: f64,
    /// Area-weighted mean of the shares lost on back sides.
    pub lost: f64,
    /// Σ |A_i F_ij − A_j F_ji| / Σ A_i F_ij.
    pub reciprocity_residual: f64,
    /// Root mean square over rows of the standard error of a row sum before closure: discovery by chance and sampled
    /// transmittances, taken as independent.
    pub row_standard_error: f64,
    /// Conjugate-gradient steps of the closure; 0 without closure.
    pub closure_steps: usize,
    /// Suspicious facets: index, and object and reason in words. At most [`Report::MAX_BAD`] entries.
    pub bad: Vec<(usize, String)>,
    /// Number of suspicious facets.
    pub bad_facets: usize,
}

impl Report {
    /// Largest length of [`Report::bad`]: a terminal of 24 lines shows it.
    pub const MAX_BAD: usize = 20;
    /// Largest sum of escaped and lost shares of a closed row: one ray in 500 through cracks at corners. Larger shares
    /// of open rows would be scaled away by the closure.
    pub const MAX_CLOSED_LOSS: f32 = 2e-3;
    /// A facet is suspicious if its lost share exceeds this, or if row sum, escaped and lost shares differ from 1 by more than this and
    /// by more than six standard errors: far above what cracks let through ([`Report::MAX_CLOSED_LOSS`]). Affects warnings only.
    pub const MAX_LOSS: f64 = 0.05;
}

/// Upper bound of the memory in bytes for a matrix of `facets` facets: at most all pairs, and at most one new pair per
/// ray. Excludes the scene and Embree.
pub fn memory_bound(facets: usize, settings: &Settings) -> u64 {
    if settings.every {
        // Pairs with their values, and both entries of each.
        return facets as u64 * (facets as u64 * (13 + 16) / 2 + 640);
    }
    let found = facets as u64 * u64::from(settings.rays).min(facets as u64);
    // Lists of partners and their transpose, pairs with their values, and both entries of each pair.
    found * (8 + 8 + 13 + 16) + facets as u64 * 640
}

/// Computes the matrix between all facets and its statistics. Stops within about a second of the caller's wish: `progress` is asked
/// between facets, between the pairs of a facet, between the steps of the closure, and between passes over the matrix.
///
/// # Errors
/// [`Error::Argument`] if a setting is out of range, [`Error::Scene`] with too many facets, [`Error::Cancelled`] if `progress` stops.
pub fn compute(
    model: &Model,
    facets: &Facets,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(FormFactors, Report)> {
    model.check_single("the form factor matrix")?;
    model.check_clusters("the form factor matrix")?;
    if settings.rays == 0 || settings.bundle < 4 || settings.largest_bundle < settings.bundle {
        return Err(Error::arguments(
            "⟨rays⟩ must be at least 1, ⟨bundle⟩ at least 4 and ⟨largest_bundle⟩ at least ⟨bundle⟩".into(),
        ));
    }
    if facets.count() > Partner::MAX_FACETS {
        return Err(Error::Scene(format!("more than {} facets", Partner::MAX_FACETS)));
    }
    go_on(progress)?;
    progress.stage("form factors", 2 * facets.count() as u64);
    let traced = Traced::new(model);
    let pairs = pair::Pairs { traced: &traced, facets, settings, progress };
    let rows = model.ranks().rows(facets.count());
    let advance = || progress.advance(rows.steps(1) as u64);
    let found: Vec<discover::FacetRays> =
        parallel::try_map_with(rows.numbers(), discover::Buffers::default, |buffers, i| {
            go_on(progress)?;
            let found = pairs.partners(i as u32, buffers);
            advance();
            Ok(found)
        })?;
    let found = rows.gather(found);
    let partners = discover::upper(&found, progress)?;
    let shares: Vec<[f32; 2]> = found.iter().map(|f| [f.escaped, f.lost]).collect();
    drop(found);
    let upper: Vec<pair::Row> =
        parallel::try_map_with(rows.numbers(), pair::Buffers::default, |buffers, i| {
            go_on(progress)?;
            let row = if settings.every {
                pairs.every(i as u32, buffers)
            } else {
                pairs.row(i as u32, &partners[i], buffers)
            };
            advance();
            Ok(row)
        })?;
    let mut upper = rows.gather(upper);
    drop(partners);
    // Rows that were cut short are not shown.
    go_on(progress)?;
    pair::balance(&mut upper, progress)?;
    let (matrix, mut report) = rows::assemble(facets, upper, shares, settings, progress)?;
    for (facet, why) in &mut report.bad {
        let object = model.scene().triangle_object[facets.triangle(*facet)];
        *why = format!("of `{}`: {why}", quote(&model.scene().objects[object as usize].name));
    }
    Ok((matrix, report))
}

/// Nothing, or [`Error::Cancelled`] if `progress` has stopped.
fn go_on(progress: &dyn Progress) -> Result<()> {
    progress::go_on(progress, "the form factors were")
}
