//! Light inside clusters: Figure 10 of the paper.

use super::blocks::Blocks;
use super::item::{Item, Panel};
use super::table::{Table, count, number};
use super::view::irradiance;
use super::{Context, fixed, list};
use crate::Result;
use crate::clusters::{self, FAN_OUT};
use crate::model::{Model, PrepareOptions};
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{self, Inside, Options, Record, RowSums};
use crate::scene::Scene;
use glam::DVec3;

/// Books in a row.
const BOOKS: u32 = 14;
/// Size of the smallest book, metres.
const BOOK: DVec3 = DVec3::new(0.03, 0.18, 0.26);
/// Columns and rows of the pictures.
const SIZE: [usize; 2] = [360, 270];
/// The camera, and what it looks at.
const VIEW: [DVec3; 2] = [DVec3::new(0.45, -0.55, 0.55), DVec3::new(-0.02, 0.0, 0.13)];
/// Its vertical angle of view.
const ANGLE: f64 = 0.75;
/// Largest error that links are refined to, relative to the mean irradiance.
const COARSE: f64 = 64.0;
/// By what it is multiplied until links are refined.
const FINER: f64 = 0.5;
/// How often at most.
const TRIES: i32 = 11;
/// Solves with coarse links whose mean is taken.
const SEEDS: u64 = 32;

/// Books that stand side by side and lean on nothing, lit from above.
fn scene() -> Result<Scene> {
    let mut blocks = Blocks::with_reflectance("books", 0.0);
    let mut x = -0.5 * f64::from(BOOKS) * 1.3 * BOOK.x;
    for k in 0..BOOKS {
        let size = BOOK * (1.0 + 0.1 * DVec3::new(f64::from(k % 5), f64::from(k % 3), f64::from(k * 7 % 4)));
        let low = DVec3::new(x, -0.5 * size.y, 0.0);
        blocks.cuboid(low, low + size);
        x += size.x + 0.004;
    }
    blocks.rectangle(DVec3::new(0.0, 0.0, 1.6), 0.4 * DVec3::Y, 0.4 * DVec3::X, true);
    blocks.scene()
}

/// What the books receive by one method, and its ledger: means over solves.
#[derive(Clone, Copy, Debug, Default)]
struct Received {
    /// Links, the largest number.
    links: usize,
    /// Links that were replaced by links between parts, the largest number.
    replaced: usize,
    /// Power, W, and its standard error.
    power: f64,
    error: f64,
    /// Deviation of the irradiance relative to its mean.
    deviation: f64,
    /// Emitted, absorbed, escaped and created power of the ledger, W.
    ledger: [f64; 4],
}

/// The light on the books by one method.
struct Lit {
    mesh: RadiosityMesh,
    record: Record,
}

impl Lit {
    fn new(model: &Model, options: &Options) -> Result<Lit> {
        let outcome = radiosity::run(model, &[], options, &())?;
        Ok(Lit { mesh: outcome.mesh, record: outcome.record })
    }

    /// The coarsest links beyond that of the root with itself, which are those from the light to the cluster.
    fn coarsest(model: &Model, options: &Options) -> Result<Lit> {
        let at = |k: i32| Lit::new(model, &Options { error: COARSE * FINER.powi(k), ..options.clone() });
        let mut lit = at(0)?;
        for k in 1..TRIES {
            if lit.record.links > 1 {
                break;
            }
            lit = at(k)?;
        }
        Ok(lit)
    }

    /// Means over `count` solves with the same error and other random numbers: one link has few segments.
    fn mean_received(&self, model: &Model, count: u64) -> Result<Received> {
        let mut all = vec![self.received()];
        for seed in 1..count {
            let options = Options { seed: seed + 1, ..self.record.options.clone() };
            all.push(Lit::new(model, &options)?.received());
        }
        let n = all.len() as f64;
        let mean = |of: &dyn Fn(&Received) -> f64| all.iter().map(of).sum::<f64>() / n;
        let power = mean(&|r| r.power);
        let square = all.iter().map(|r| (r.power - power).powi(2)).sum::<f64>();
        Ok(Received {
            links: all.iter().map(|r| r.links).max().unwrap_or(0),
            replaced: all.iter().map(|r| r.replaced).max().unwrap_or(0),
            power,
            error: (square / (n * (n - 1.0).max(1.0))).sqrt(),
            deviation: mean(&|r| r.deviation),
            ledger: std::array::from_fn(|k| mean(&|r| r.ledger[k])),
        })
    }

    /// What the books receive in this solve.
    fn received(&self) -> Received {
        // The first objects are the books; the light comes last.
        let books = self.mesh.elements.iter().filter(|e| e.object < BOOKS);
        let (mut area, mut power, mut square) = (0.0, 0.0, 0.0);
        for e in books {
            let irradiance = e.irradiance.iter().sum::<f64>() / 3.0;
            area += e.area;
            power += e.area * irradiance;
            square += e.area * irradiance * irradiance;
        }
        let mean = power / area;
        let ledger = &self.record.ledger;
        Received {
            links: self.record.links,
            replaced: self.record.iterations.iter().map(|iteration| iteration.refined).sum(),
            power,
            error: 0.0,
            deviation: (square / area - mean * mean).max(0.0).sqrt() / mean,
            ledger: [ledger.emitted, ledger.absorbed, ledger.escaped, ledger.created],
        }
    }
}

/// Figure 10: links from the light to clusters with three models of the light inside them, and the light by rays.
pub fn figure_10(context: &Context) -> Result<Item> {
    // The covers of the books shall be in clusters, large as they are in this scene.
    let clusters = clusters::Options { large_surface: f32::INFINITY, ..Default::default() };
    let options = PrepareOptions { clusters, ..PrepareOptions::default() };
    let model = Model::prepare(scene()?, &options, context.progress)?;
    let links = |inside| Options {
        inside,
        local_rays: Some(0),
        audit: 0,
        row_sums: RowSums::Sampled,
        ..Options::default()
    };
    let rays = Options { audit: 0, error: if context.small { 0.1 } else { 0.02 }, ..Options::default() };
    let cases = [
        ("without visibility or orientation", links(Inside::Isotropic)),
        ("without visibility", links(Inside::Oriented)),
        ("with visibility", links(Inside::Visible)),
        ("reference: rays", rays),
    ];
    let light = |(k, (_, options)): (usize, &(&str, Options))| match k {
        3 => Lit::new(&model, options),
        _ => Lit::coarsest(&model, options),
    };
    let lit = cases.iter().enumerate().map(light).collect::<Result<Vec<_>>>()?;
    let seeds = |k: usize| if k == 3 { 1 } else { SEEDS };
    let received = lit.iter().enumerate().map(|(k, lit)| lit.mean_received(&model, seeds(k)));
    let received = received.collect::<Result<Vec<_>>>()?;
    let mut item = Item {
        here: format!(
            "{BOOKS} black books side by side under a light of 0.4 m, with the coarsest links that refinement makes, and no local pass; by \
             values `isotropic`, `oriented` and `visible` of option `inside` of a solve. mrvis lets the segments of a link end on the surfaces \
             of the cluster instead of using an item buffer. Numbers are means over {SEEDS} solves with other random numbers. The books absorb \
             all light, so that what they receive beyond the light of the rays is created. A link carries the same power in both directions, \
             so that the ledger counts what the books receive in excess as power that did not leave the scene."
        ),
        ..Item::default()
    };
    let images =
        lit.iter().map(|lit| irradiance(&lit.mesh, VIEW, ANGLE, SIZE)).collect::<Result<Vec<_>>>()?;
    let white = images[3].data().iter().fold(0.0f32, |white, v| white.max(*v));
    let panels = images.iter().zip(&cases).map(|(image, (name, _))| Panel::scaled(image, white, *name));
    item.row(format!("Irradiance: black 0, white {white:.0} W/m² and more"), panels.collect());
    item.tables.push(ledger(&received, &cases.map(|(name, _)| name)));
    judge(&mut item, &received);
    Ok(item)
}

/// The power on the books and the ledger's numbers.
fn ledger(received: &[Received], names: &[&str]) -> Table {
    let columns = [
        "light in the cluster",
        "links",
        "replaced",
        "books receive, W",
        "more than by rays, W",
        "deviation / mean",
        "emitted, W",
        "absorbed, W",
        "escaped, W",
        "created, W",
    ];
    let mut table = Table::new("The books, and the ledger of the scene", &columns);
    let truth = received.last().map_or(0.0, |r| r.power);
    for (r, name) in received.iter().zip(names) {
        let numbers = [r.power, r.power - truth, r.deviation].into_iter().chain(r.ledger);
        table.push(
            [(*name).into(), count(r.links), count(r.replaced)]
                .into_iter()
                .chain(numbers.map(|v| number(v, 3))),
        );
    }
    table
}

/// Standard errors within which numbers count as equal.
const CERTAIN: f64 = 3.0;
/// Largest standard error of a power, as a part of the power by rays, for which equality within [`CERTAIN`] says anything.
const PRECISE: f64 = 0.05;
/// Part of the emitted power to which the ledger must balance: sums of 32-bit factors.
const BALANCED: f64 = 1e-4;

/// Checks of the numbers of the four cases.
fn judge(item: &mut Item, received: &[Received]) {
    let [isotropic, oriented, visible, truth] = [0, 1, 2, 3].map(|k| &received[k]);
    let polygons = 6 * BOOKS as usize;
    let replaced = [isotropic, oriented, visible].map(|r| r.replaced);
    item.check(
        format!(
            "the same number of links is replaced in all three cases, so few that links end at clusters: at most {FAN_OUT} ends for each, \
             fewer than there are polygons"
        ),
        format!("{} replaced, {polygons} polygons", replaced.map(|n| n.to_string()).join(", ")),
        replaced.iter().all(|&n| n == replaced[0] && n > 0 && n * FAN_OUT < polygons),
    );
    let of = |r: &Received| format!("{} ± {} W", fixed(r.power, 3), fixed(r.error, 3));
    let by_rays = format!("{} W by rays", fixed(truth.power, 3));
    for (name, case) in [("", oriented), (" or orientation", isotropic)] {
        let check = item.check(
            format!(
                "without visibility{name} energy is created: the books receive more than rays bring, by over three standard errors"
            ),
            format!("{}, {by_rays}", of(case)),
            case.power - truth.power > CERTAIN * case.error,
        );
        check.if_not(|| {
            format!("the excess is {} standard errors", fixed((case.power - truth.power) / case.error, 1))
        });
    }
    let created = oriented.power - truth.power;
    let check = item.check(
        "with visibility energy is preserved: the books receive what rays bring, to three standard errors of at most 5 %, which are less \
         than what is created without",
        format!("{}, {by_rays}", of(visible)),
        (visible.power - truth.power).abs() <= CERTAIN * visible.error
            && visible.error <= PRECISE * truth.power
            && CERTAIN * visible.error < created,
    );
    check.if_not(|| {
        format!(
            "the difference is {} standard errors",
            fixed((visible.power - truth.power) / visible.error, 1)
        )
    });
    let ledgers = received.iter().map(|r| r.ledger);
    let gaps: Vec<f64> =
        ledgers.map(|[out, absorbed, escaped, created]| out + created - absorbed - escaped).collect();
    item.check(
        "the ledger balances in all cases: emitted and created power is absorbed or escapes, to 0.01 % of what is emitted",
        format!("differences {} W", list(&gaps, 5)),
        gaps.iter().zip(received).all(|(gap, r)| gap.abs() <= BALANCED * r.ledger[0]),
    );
    item.check(
        "with visibility the ledger creates less than what the books receive in excess without",
        format!("{} W and {} W", fixed(visible.ledger[3], 4), fixed(created, 3)),
        visible.ledger[3].abs() < created,
    );
    item.check(
        "illumination is more uniform without visibility than with it, whose modulation is nearer to that by rays",
        format!(
            "deviation / mean {} without visibility and orientation, {} without visibility, {} with it; {} by rays",
            fixed(isotropic.deviation, 2),
            fixed(oriented.deviation, 2),
            fixed(visible.deviation, 2),
            fixed(truth.deviation, 2)
        ),
        isotropic.deviation < oriented.deviation
            && oriented.deviation < visible.deviation
            && (visible.deviation - truth.deviation).abs() < (oriented.deviation - truth.deviation).abs(),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers like those of the paper's picture.
    fn like_the_paper() -> [Received; 4] {
        let of = |power: f64, deviation: f64| Received {
            links: 40,
            replaced: 1,
            power,
            error: 0.01,
            deviation,
            ledger: [50.0, power, 50.0 - power, 0.0],
        };
        [of(1.1, 1.0), of(1.2, 2.0), of(0.98, 3.0), Received { error: 0.0, ..of(1.0, 3.1) }]
    }

    fn failing(change: impl Fn(&mut [Received; 4])) -> Vec<usize> {
        let mut received = like_the_paper();
        change(&mut received);
        let mut item = Item::default();
        judge(&mut item, &received);
        (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|r| r[0].replaced = 2), [0]);
        assert_eq!(failing(|r| r[..3].iter_mut().for_each(|r| r.replaced = 6)), [0]);
        assert_eq!(failing(|r| r[..3].iter_mut().for_each(|r| r.replaced = 0)), [0]);
        assert_eq!(failing(|r| r[1].error = 0.1), [1]);
        assert_eq!(failing(|r| r[0].error = 0.1), [2]);
        assert_eq!(failing(|r| r[2].power = 0.9), [3]);
        assert_eq!(failing(|r| r[2].error = 0.06), [3]);
        assert_eq!(failing(|r| r[3].ledger[2] -= 0.1), [4]);
        assert_eq!(failing(|r| r[2].ledger = [50.0, 1.2, 49.1, 0.3]), [5]);
        assert_eq!(failing(|r| r[0].deviation = 2.1), [6]);
    }
}
