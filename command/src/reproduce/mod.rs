//! The figures and tables of Sillion and Drettakis 1995, *Feature-based control of visibility error* ([SD95]), made again
//! with this engine: each with the paper's claim and a verdict computed from numbers.
//!
//! An entry of [`ENTRIES`] is a function that makes an [`Item`]. What only the reproduction needs is here, or is reached
//! through options of other rooms: the paper's extinction, sizes by erosions, light in clusters without visibility.

mod blocks;
mod books;
mod cubes;
mod erosion;
mod feature_sizes;
mod feature_verdict;
mod groups;
mod importance;
mod item;
mod office;
mod office_light;
mod office_verdict;
mod page;
mod plain;
mod shadow;
mod table_1;
#[cfg(test)]
mod tests;
mod umbra;
mod view;

pub use item::Item;
pub use page::page;

use groups::Groups;
use mrvis::{Detail, Error, Model, PrepareOptions, Progress, Result, Scene, SolveOptions};
use serde::Serialize;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Instant;

/// `options` with other values of some fields.
fn changed(options: &SolveOptions, change: impl FnOnce(&mut SolveOptions)) -> SolveOptions {
    let mut options = options.clone();
    change(&mut options);
    options
}

/// A solution by rays, without an audit.
fn by_rays(error: f64) -> SolveOptions {
    changed(&SolveOptions::default(), |options| (options.error, options.audit) = (error, 0))
}

/// A solution by links alone, without an audit.
fn by_links(error: f64) -> SolveOptions {
    changed(&by_rays(error), |options| options.local_rays = Some(0))
}

/// Data that all items share.
pub struct Context<'a> {
    /// Whether small versions of the items are made, for tests.
    pub small: bool,
    /// Receives the name of the item that is made.
    pub progress: &'a dyn Progress,
    groups: OnceLock<Groups>,
    making: Mutex<()>,
}

impl<'a> Context<'a> {
    /// A context without images.
    pub fn new(small: bool, progress: &'a dyn Progress) -> Context<'a> {
        Context { small, progress, groups: OnceLock::new(), making: Mutex::new(()) }
    }

    /// A scene prepared up to this detail.
    fn model(&self, scene: Scene, detail: Detail) -> Result<Model> {
        let mut options = PrepareOptions::default();
        options.detail = detail;
        Model::prepare_watched(scene, &options, self.progress)
    }

    /// The images of the four groups, made once.
    fn groups(&self) -> Result<&Groups> {
        let _one_at_a_time = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(groups) = self.groups.get() {
            return Ok(groups);
        }
        let made = Groups::new(self)?;
        Ok(self.groups.get_or_init(|| made))
    }
}

/// An item that can be made.
pub struct Entry {
    /// Names on the command line; the first is its own.
    pub names: &'static [&'static str],
    title: &'static str,
    claim: &'static str,
    /// Whether it judges this program by goals of its own: an item that fails is a fault of the program then, and a finding on the paper
    /// otherwise.
    of_program: bool,
    make: fn(&Context) -> Result<Item>,
}

/// All items, in the order of the paper.
pub const ENTRIES: &[Entry] = &[
    Entry {
        names: &["fig1"],
        title: "Figure 1: four groups of cubes, one error",
        claim: "The approximate images of four groups of cubes of different sizes, made with the same coarse mesh, have similar L2 \
                errors, although the illumination features that they miss have very different sizes (section 2.1).",
        of_program: false,
        make: groups::figure_1,
    },
    Entry {
        names: &["table1"],
        title: "Table 1: the feature-based error metric",
        claim: "FBEM values are equivalent for small feature sizes and decrease at different rates: faster for groups of smaller \
                objects. For a feature size of 30 only the group of the largest cubes needs more work (section 2.3).",
        of_program: false,
        make: table_1::table_1,
    },
    Entry {
        names: &["fig2"],
        title: "Figure 2: erosion and expansion",
        claim: "Erosion turns points of an object with a neighbour outside white; expansion adds points with a neighbour in the \
                object. An object of diameter 2d disappears after d erosions (section 2.4).",
        of_program: false,
        make: erosion::figure_2,
    },
    Entry {
        names: &["fig3"],
        title: "Figure 3: n erosions, then n expansions",
        claim: "Only regions of diameter larger than 2n survive the sequence, slightly modified in shape (section 2.4).",
        of_program: false,
        make: erosion::figure_3,
    },
    Entry {
        names: &["fig4"],
        title: "Figure 4: feature masks",
        claim: "Masks for feature sizes of 12, 18 and 24 isolate the features of the four groups by size (section 2.4).",
        of_program: false,
        make: erosion::figure_4,
    },
    Entry {
        names: &["fig5"],
        title: "Figure 5: umbra against the position of the blocker",
        claim: "A blocker larger than the emitter always has an umbra; that of a smaller one may disappear for some positions \
                (section 3.2).",
        of_program: false,
        make: umbra::figure_5,
    },
    Entry {
        names: &["fig6"],
        title: "Figure 6: the fictitious blocker",
        claim: "The maximum feature size of a cluster on the receiver is the umbra of a fictitious blocker of size BSIZE at its \
                centre (section 3.2).",
        of_program: false,
        make: umbra::figure_6,
    },
    Entry {
        names: &["fig7"],
        title: "Figure 7: surface visibility with three builders",
        claim: "In a scene of 5,380 polygons the new hierarchy of uniform grids is faster than the k-d tree of Sillion 94 for surface \
                visibility; the quality of the shadows is comparable (section 4.2). The comparison with Goldsmith and Salmon's \
                construction is not reported.",
        of_program: false,
        make: office::figure_7,
    },
    Entry {
        names: &["fig8"],
        title: "Figure 8: average visibility with three builders",
        claim: "With average visibility by extinction the differences become more pronounced: shadows are completely missing from \
                under the desks with the k-d tree, whose clusters are not suited to the extinction model; the new hierarchy, \
                although slower than the k-d tree, represents all shadows, and average visibility is four times faster than surface \
                visibility with it (section 4.2).",
        of_program: false,
        make: office::figure_8,
    },
    Entry {
        names: &["fig9"],
        title: "Figure 9: four feature sizes",
        claim: "As the desired feature size grows from 2 to 2.8, 3.5 and 5, the time drops (1984, 1648, 1459, 1356 s); L2 norms \
                increase for all clusters, later for larger objects; FBEM values for the feature size are always of similar magnitude, \
                although very different levels of averaging are used (section 5).",
        of_program: false,
        make: feature_sizes::figure_9,
    },
    Entry {
        names: &["fig10"],
        title: "Figure 10: light inside a cluster of books",
        claim: "Ignoring visibility inside a cluster that a link ends at results in the creation of energy, since all books are fully \
                illuminated, with relatively uniform illumination. With the visibility energy is preserved and its distribution \
                modulated (section 6.1).",
        of_program: false,
        make: books::figure_10,
    },
    Entry {
        names: &["importance"],
        title: "Section 6: importance and feature sizes",
        claim: "A plausible replacement for a global and local pass uses importance to assign different feature sizes of interest to \
                different surfaces in the scene.",
        of_program: true,
        make: importance::importance,
    },
];

/// All items that were made.
#[derive(Debug, Default, Serialize)]
pub struct Report {
    /// Version of this program.
    pub mrvis: String,
    /// Threads.
    pub threads: usize,
    /// Number of items whose verdict holds.
    pub hold: usize,
    /// The items.
    pub items: Vec<Item>,
    /// Seconds of all items.
    pub seconds: f64,
}

impl Report {
    /// How many verdicts hold, and what the others are, as a sentence without a full stop.
    pub fn summary(&self) -> String {
        let failed = |of_program: bool| {
            self.items.iter().filter(|item| !item.holds && item.of_program == of_program).count()
        };
        let mut text = format!("{} of {} verdicts hold", self.hold, self.items.len());
        let others = [
            (failed(false), "not confirmed, findings on the paper"),
            (failed(true), "goals of mrvis missed"),
        ];
        for (count, what) in others.into_iter().filter(|(count, _)| *count > 0) {
            text += &format!("; {what}: {count}");
        }
        text
    }
}

/// The entries with these names; all of them without names.
///
/// # Errors
/// [`Error::Argument`] if there is no such item.
pub fn chosen(names: &[String]) -> Result<Vec<&'static Entry>> {
    let known = |name: &str| ENTRIES.iter().any(|entry| entry.names.contains(&name));
    if let Some(unknown) = names.iter().find(|name| !known(name)) {
        let all: Vec<&str> = ENTRIES.iter().flat_map(|entry| entry.names).copied().collect();
        return Err(Error::arguments(format!("there is no item `{unknown}`; there are {}", all.join(", "))));
    }
    let wanted = |entry: &&Entry| names.is_empty() || names.iter().any(|n| entry.names.contains(&n.as_str()));
    Ok(ENTRIES.iter().filter(wanted).collect())
}

/// Makes these items.
///
/// # Errors
/// An item cannot be made.
pub fn run(entries: &[&Entry], context: &Context) -> Result<Report> {
    let start = Instant::now();
    let mut report = Report {
        mrvis: env!("CARGO_PKG_VERSION").into(),
        threads: rayon::current_num_threads(),
        ..Report::default()
    };
    for entry in entries {
        report.items.push(entry.item(context)?);
    }
    report.hold = report.items.iter().filter(|item| item.holds).count();
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}

impl Entry {
    fn item(&self, context: &Context) -> Result<Item> {
        context.progress.stage(self.title, 0);
        let start = Instant::now();
        let mut item = (self.make)(context)?;
        (item.name, item.title, item.claim) = (self.names[0], self.title, self.claim);
        item.of_program = self.of_program;
        item.holds = !item.checks.is_empty() && item.checks.iter().all(|check| check.holds);
        item.seconds = start.elapsed().as_secs_f64();
        Ok(item)
    }
}

/// Smallest ratio of a significant difference to its standard error: noise alone exceeds it in 0.3 % of cases.
const MIN_STANDARD_ERRORS: f64 = 3.0;

/// Pairs of repeated measurements of one quantity.
#[derive(Clone, Debug)]
struct Repeated(Vec<[f64; 2]>);

impl Repeated {
    fn mean(&self, k: usize) -> f64 {
        0.5 * (self.0[k][0] + self.0[k][1])
    }

    /// Standard error of a mean, as a fraction of it: half the difference of the two, pooled over pairs.
    fn noise(&self) -> f64 {
        let square: f64 = self.0.iter().map(|[a, b]| ((a - b) / (a + b)).powi(2)).sum();
        (square / self.0.len() as f64).sqrt()
    }

    /// Smallest significant difference of the logarithms of two means.
    fn certain(&self) -> f64 {
        MIN_STANDARD_ERRORS * 2.0f64.sqrt() * self.noise()
    }
}

/// A number with this number of digits after the point.
fn fixed(value: f64, digits: usize) -> String {
    format!("{value:.digits$}")
}

/// Several numbers with this number of digits after the point.
fn list(values: &[f64], digits: usize) -> String {
    values.iter().map(|v| fixed(*v, digits)).collect::<Vec<_>>().join(", ")
}

/// Whole numbers with commas between them.
fn counts_of<N: ToString>(numbers: &[N]) -> String {
    numbers.iter().map(N::to_string).collect::<Vec<_>>().join(", ")
}
