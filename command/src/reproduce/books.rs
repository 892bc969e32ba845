//! Light inside clusters: Figure 10 of the paper.

use super::blocks::Blocks;
use super::item::{Item, Panel, Table, count, number};
use super::view::irradiance;
use super::{Context, MIN_STANDARD_ERRORS, by_links, by_rays, changed, counts_of, fixed};
use glam::DVec3;
use mrvis::internals::clusters;
use mrvis::internals::math::parallel;
use mrvis::internals::math::triangle_area;
use mrvis::internals::radiosity::{self, Inside, Options, Outcome, RowNormalisation};
use mrvis::metrics::Image;
use mrvis::{Model, PrepareOptions, Result, Scene};

/// Books in a row.
const BOOKS: u32 = 14;
/// Their polygons, the first of the scene.
const POLYGONS: usize = 6 * BOOKS as usize;
/// Size of the smallest book, metres.
const BOOK: DVec3 = DVec3::new(0.03, 0.18, 0.26);
/// Columns and rows of the pictures.
const SIZE: [usize; 2] = [360, 270];
/// The camera, and what it looks at.
const VIEW: [DVec3; 2] = [DVec3::new(0.45, -0.55, 0.55), DVec3::new(-0.02, 0.0, 0.13)];
/// Its vertical angle of view.
const ANGLE: f64 = 0.75;
/// Largest error that links are refined to, relative to the mean irradiance: no link is refined with it.
const MAX_LINK_ERROR: f64 = 64.0;
/// Factor between successive errors, until links are refined: the error found is known to this factor.
const ERROR_FACTOR: f64 = 0.5;
/// Largest number of these steps, at whose end the error is 64 / 2¹¹ = 0.03 of the mean irradiance.
const MAX_STEPS: i32 = 11;
/// Number of solves by links between two checks of the standard error, and in tests; their mean picture is shown.
const BATCH: [usize; 2] = [32, 8];
/// Largest number of solves by links, and that in tests: limits the time if the standard error stays above [`TARGET_STANDARD_ERROR`].
const SOLVES: [usize; 2] = [1024, 8];
/// Standard error of the mean power at which solves end, as a fraction of the power by rays: well below [`EQUALITY_MARGIN`].
const TARGET_STANDARD_ERROR: f64 = 0.01;
/// Number of solves by rays, and that in tests.
const RAY_SOLVES: [usize; 2] = [8, 2];

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

/// Light that the books receive by one method: means over solves.
#[derive(Clone, Copy, Debug, Default)]
struct Received {
    solves: usize,
    /// Links, the largest number.
    links: usize,
    /// Links that end at the light, the largest number.
    of_light: usize,
    /// Polygons of the books that receive light in some solve.
    lit: usize,
    /// Power, W, and its standard error.
    power: f64,
    error: f64,
    /// Deviation of the mean irradiance of the polygons relative to its mean.
    deviation: f64,
    /// Emitted, absorbed and escaped power of the ledger, W.
    ledger: [f64; 3],
}

/// Solves by one method with different random numbers.
#[derive(Default)]
struct Solves {
    /// Sum of their pictures, of the first [`BATCH`].
    picture: Vec<f64>,
    pictures: usize,
    /// Power of each polygon of the books, summed over solves.
    polygons: Vec<f64>,
    /// Power of all books by solve.
    powers: Vec<f64>,
    links: usize,
    of_light: usize,
    ledger: [f64; 3],
}

impl Solves {
    /// Adds solves in the order of their seeds until the standard error of the power is at most `max_error`, or there are `max`.
    fn new(model: &Model, options: &Options, batch: usize, max: usize, max_error: f64) -> Result<Solves> {
        let mut all = Solves::default();
        while all.powers.len() < max && (all.powers.len() < 2 || all.power()[1] > max_error) {
            let first = all.powers.len() as u64 + 1;
            let seeds: Vec<u64> = (first..first + batch as u64).collect();
            let made = parallel::map(&seeds, |&seed| {
                radiosity::run(model, &[], &changed(options, |options| options.seed = seed), &())
            });
            for outcome in made {
                let outcome = outcome?;
                all.add(model.scene(), &outcome)?;
            }
        }
        Ok(all)
    }

    fn add(&mut self, scene: &Scene, outcome: &Outcome) -> Result<()> {
        let (mesh, record) = (&outcome.mesh, &outcome.record);
        if self.powers.len() < BATCH[0] {
            let picture = irradiance(mesh, VIEW, ANGLE, SIZE)?;
            self.picture.resize(picture.data().len(), 0.0);
            self.picture.iter_mut().zip(picture.data()).for_each(|(sum, v)| *sum += f64::from(*v));
            self.pictures += 1;
        }
        // The first objects are the books; the light comes last.
        self.polygons.resize(POLYGONS, 0.0);
        let mut power = 0.0;
        for e in &mesh.elements {
            if e.object < BOOKS {
                let received = e.area * e.irradiance.iter().sum::<f64>() / 3.0;
                self.polygons[scene.parts().triangle_polygon[e.triangle as usize] as usize] += received;
                power += received;
            } else {
                self.of_light = self.of_light.max(e.links as usize);
            }
        }
        self.powers.push(power);
        self.links = self.links.max(record.links);
        let ledger = &record.ledger;
        for (sum, power) in self.ledger.iter_mut().zip([ledger.emitted, ledger.absorbed, ledger.escaped]) {
            *sum += power;
        }
        Ok(())
    }

    /// Mean power of the books and its standard error.
    fn power(&self) -> [f64; 2] {
        let n = self.powers.len() as f64;
        let mean = self.powers.iter().sum::<f64>() / n;
        let square = self.powers.iter().map(|power| (power - mean).powi(2)).sum::<f64>();
        [mean, (square / (n * (n - 1.0).max(1.0))).sqrt()]
    }

    /// The mean picture.
    fn picture(&self) -> Result<Image<'static>> {
        let values: Vec<f32> =
            self.picture.iter().map(|sum| (sum / self.pictures.max(1) as f64) as f32).collect();
        Image::new(SIZE[0], SIZE[1], 1.0, values)
    }

    fn received(&self, areas: &[f64]) -> Received {
        let n = self.powers.len() as f64;
        let [power, error] = self.power();
        let area: f64 = areas.iter().sum();
        let mean = power / area;
        let deviation = |(power, area): (&f64, &f64)| area * (power / n / area - mean).powi(2);
        let square: f64 = self.polygons.iter().zip(areas).map(deviation).sum();
        Received {
            solves: self.powers.len(),
            links: self.links,
            of_light: self.of_light,
            lit: self.polygons.iter().filter(|power| **power > 0.0).count(),
            power,
            error,
            deviation: (square / area).sqrt() / mean,
            ledger: self.ledger.map(|sum| sum / n),
        }
    }
}

/// Areas of the polygons of the books.
fn areas(scene: &Scene) -> Vec<f64> {
    let mut areas = vec![0.0; POLYGONS];
    for t in 0..scene.parts().triangles.len() {
        if scene.parts().triangle_object[t] < BOOKS {
            let [a, b, c] = scene.corners(t as u32);
            areas[scene.parts().triangle_polygon[t] as usize] += triangle_area(a, b, c);
        }
    }
    areas
}

/// The largest error to which links beyond that of the root with itself are refined: those from the light to the cluster.
fn coarsest(model: &Model, options: &Options) -> Result<f64> {
    for k in 0..MAX_STEPS {
        let error = MAX_LINK_ERROR * ERROR_FACTOR.powi(k);
        if radiosity::run(model, &[], &changed(options, |options| options.error = error), &())?.record.links
            > 1
        {
            return Ok(error);
        }
    }
    Ok(MAX_LINK_ERROR * ERROR_FACTOR.powi(MAX_STEPS))
}

/// Figure 10: links from the light to clusters with three models of the light inside them, and the light by rays.
pub fn figure_10(context: &Context) -> Result<Item> {
    // The covers of the books shall be in clusters, large as they are in this scene.
    let clusters = clusters::Options { large_surface: f32::INFINITY, ..Default::default() };
    let options = PrepareOptions::default().with_clusters(clusters);
    let model = Model::prepare_watched(scene()?, &options, context.progress)?;
    let links = |inside, error| {
        changed(&by_links(error), |options| {
            options.inside = inside;
            options.row_sums = RowNormalisation::Sampled;
        })
    };
    let rays = by_rays(if context.small { 0.1 } else { 0.02 });
    let small = usize::from(context.small);
    let by_rays = Solves::new(&model, &rays, RAY_SOLVES[small], RAY_SOLVES[small], 0.0)?;
    let max_error = TARGET_STANDARD_ERROR * by_rays.power()[0];
    // The same error in all cases.
    let error = coarsest(&model, &links(Inside::Visible, MAX_LINK_ERROR))?;
    let solves = |inside: Inside, max_error: f64| {
        Solves::new(&model, &links(inside, error), BATCH[small], SOLVES[small], max_error)
    };
    let isotropic = solves(Inside::Isotropic, max_error)?;
    let oriented = solves(Inside::Oriented, max_error)?;
    // A quarter of the margin of equality.
    let margin = EQUALITY_MARGIN * (oriented.power()[0] - by_rays.power()[0]).abs();
    let all = [isotropic, oriented, solves(Inside::Visible, 0.25 * margin)?, by_rays];
    let areas = areas(model.scene());
    let received = all.each_ref().map(|solves| solves.received(&areas));
    let mut item = Item::of(format!(
        "{BOOKS} black books side by side under a light of 0.4 m, with the coarsest links that refinement makes, to an error of {error} of \
             the mean irradiance in all cases, and no local pass; by values `isotropic`, `oriented` and `visible` of option `inside` of a solve. \
             mrvis lets the segments of a link end on the surfaces of the cluster instead of using an item buffer. Numbers and pictures are means \
             over solves with different random numbers, repeated until the standard error of the power is at most {} % of the power by rays (with \
             visibility, a quarter of the margin of equality) or {} solves are made. The books absorb all light. The ledger of a solution cannot show what is created inside a cluster: a link carries the \
             same power in both directions, and what the books receive in excess counts as power that did not leave the scene. So the power on \
             the books is compared with that by rays.",
        100.0 * TARGET_STANDARD_ERROR,
        SOLVES[small]
    ));
    let images = all.iter().map(Solves::picture).collect::<Result<Vec<_>>>()?;
    let white = images[3].data().iter().fold(0.0f32, |white, v| white.max(*v));
    let names =
        ["without visibility or orientation", "without visibility", "with visibility", "reference: rays"];
    let panels = images.iter().zip(names).map(|(image, name)| Panel::scaled(image, white, name));
    item.row(
        format!("Irradiance, means over up to {} solves: black 0, white {white:.0} W/m² and more", BATCH[0]),
        panels.collect(),
    );
    item.tables.push(table(&received, &names));
    judge(&mut item, &received);
    Ok(item)
}

/// The power on the books and the ledger's numbers.
fn table(received: &[Received], names: &[&str]) -> Table {
    let columns = "light in the cluster | solves | links | of the light | books receive, W | standard error, W | more than by rays, W | \
         deviation / mean | emitted, W | absorbed, W | escaped, W";
    let mut table = Table::new("The books, and the ledger of the scene", columns);
    let truth = received.last().map_or(0.0, |r| r.power);
    for (r, name) in received.iter().zip(names) {
        let numbers = [r.power, r.error, r.power - truth, r.deviation].into_iter().chain(r.ledger);
        let counts = [r.solves, r.links, r.of_light].map(count);
        table.push([(*name).into()].into_iter().chain(counts).chain(numbers.map(|v| number(v, 3))));
    }
    table
}

/// Powers count as equal up to this fraction of the power created without visibility. Chosen here; the paper states none.
const EQUALITY_MARGIN: f64 = 0.1;

/// Checks of the numbers of the four cases.
fn judge(item: &mut Item, received: &[Received; 4]) {
    let [isotropic, oriented, visible, truth] = received;
    let links = [isotropic, oriented, visible].map(|r| r.of_light);
    let lit = [isotropic, oriented, visible].map(|r| r.lit);
    item.check(
        "few links bring light to the books in all three cases: fewer end at the light than polygons of the books receive light, so that \
         their other ends are clusters",
        format!("{} links, {} polygons", counts_of(&links), counts_of(&lit)),
        links.iter().zip(&lit).all(|(n, lit)| *n > 0 && n < lit),
        || "links from the light are refined to the polygons, or carry no light".into(),
    );
    let of = |r: &Received| format!("{} ± {} W", fixed(r.power, 3), fixed(r.error, 3));
    let by_rays = format!("{} by rays", of(truth));
    let excess = |r: &Received| [r.power - truth.power, r.error.hypot(truth.error)];
    for (name, case) in [("", oriented), (" or orientation", isotropic)] {
        let [more, error] = excess(case);
        item.check(
            format!(
                "without visibility{name} energy is created: the books receive more than rays bring, by over three standard errors"
            ),
            format!("{}, {by_rays}", of(case)),
            more > MIN_STANDARD_ERRORS * error,
            || format!("the excess is {} standard errors after {} solves", fixed(more / error, 1), case.solves),
        );
    }
    judge_preserved(item, [oriented, visible].map(excess), &format!("{}, {by_rays}", of(visible)));
    item.check(
        "illumination is more uniform without visibility than with it, whose modulation is nearer to that by rays",
        format!(
            "deviation / mean of the polygons {} without visibility and orientation, {} without visibility, {} with it; {} by rays",
            fixed(isotropic.deviation, 2),
            fixed(oriented.deviation, 2),
            fixed(visible.deviation, 2),
            fixed(truth.deviation, 2)
        ),
        isotropic.deviation < oriented.deviation
            && oriented.deviation < visible.deviation
            && (visible.deviation - truth.deviation).abs() < (oriented.deviation - truth.deviation).abs(),
        || "what polygons of one link receive differs by the noise of its segments more than by their visibility".into(),
    );
}

/// Whether the power with visibility is that by rays; what is received in excess without and with visibility, with standard errors.
fn judge_preserved(item: &mut Item, [[created, _], [more, error]]: [[f64; 2]; 2], measured: &str) {
    let margin = EQUALITY_MARGIN * created;
    item.check(
        format!(
            "with visibility energy is preserved: with two standard errors the power on the books differs from that by rays by at most a tenth \
             of what is created without (our margin), {} W",
            fixed(margin, 3)
        ),
        measured,
        more.abs() + 2.0 * error <= margin,
        || {
            format!(
                "the difference is {} ± {} W, {} % of what is created without: {}",
                fixed(more, 3),
                fixed(error, 3),
                fixed(100.0 * more / created, 0),
                match more.abs() - 2.0 * error > margin {
                    true => "segments of coarse links miss a part of the light that rays find",
                    false => "the solves do not tell whether it is smaller than the margin",
                }
            )
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    /// Numbers like those of the paper's picture.
    fn like_the_paper() -> [Received; 4] {
        let of = |power: f64, deviation: f64| Received {
            solves: 100,
            links: 40,
            of_light: 15,
            lit: 40,
            power,
            error: 0.002,
            deviation,
            ledger: [50.0, power, 50.0 - power],
        };
        [of(1.1, 1.0), of(1.2, 2.0), of(0.99, 3.0), of(1.0, 3.1)]
    }

    fn failing(change: impl Fn(&mut [Received; 4])) -> Vec<usize> {
        let mut received = like_the_paper();
        change(&mut received);
        failing_checks(|item| judge(item, &received))
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|r| r[0].of_light = 40), [0]);
        assert_eq!(failing(|r| r[2].lit = 15), [0]);
        assert_eq!(failing(|r| r[1].error = 0.1), [1]);
        assert_eq!(failing(|r| r[0].error = 0.1), [2]);
        assert_eq!(failing(|r| r[2].power = 0.97), [3]);
        assert_eq!(failing(|r| r[2].error = 0.02), [3]);
        assert_eq!(failing(|r| r[3].error = 0.02), [3]);
        assert_eq!(failing(|r| r[0].deviation = 2.1), [4]);
    }
}
