//! Light inside clusters: Figure 10 of the paper.

use super::blocks::Blocks;
use super::item::{Item, Panel, Table};
use super::view::irradiance;
use super::{Context, fixed};
use crate::Result;
use crate::clusters;
use crate::model::{Model, PrepareOptions};
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{self, Inside, Options, Record, RowSums};
use crate::scene::Scene;
use glam::DVec3;

/// Books in a row, and their least thickness, metres.
const BOOKS: u32 = 14;
const BOOK: DVec3 = DVec3::new(0.03, 0.18, 0.26);
/// Columns and rows of the pictures; the camera, what it looks at, and its angle of view.
const SIZE: [usize; 2] = [360, 270];
const VIEW: [DVec3; 2] = [DVec3::new(0.45, -0.55, 0.55), DVec3::new(-0.02, 0.0, 0.13)];
const ANGLE: f64 = 0.75;
/// Largest error that links are refined to, relative to the mean irradiance, and how often it is halved at most.
const COARSE: f64 = 64.0;
const HALVINGS: i32 = 10;
/// Solves with coarse links whose mean is taken.
const SEEDS: u64 = 16;

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

/// What the books receive by one method.
struct Received {
    /// Power, W, and its standard error.
    power: f64,
    error: f64,
    /// Deviation of the irradiance relative to its mean.
    deviation: f64,
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

    /// The coarsest links beyond that of the root with itself: from the light to the cluster.
    fn coarsest(model: &Model, options: &Options) -> Result<Lit> {
        let at = |k: i32| Lit::new(model, &Options { error: COARSE * 0.5f64.powi(k), ..options.clone() });
        let mut lit = at(0)?;
        for k in 1..HALVINGS {
            if lit.record.links > 1 {
                break;
            }
            lit = at(k)?;
        }
        Ok(lit)
    }

    /// The mean over solves with the same error and other random numbers: one link has few segments.
    fn mean_received(&self, model: &Model) -> Result<Received> {
        let mut all = vec![self.received()];
        for seed in 1..SEEDS {
            let options = Options { seed: seed + 1, ..self.record.options.clone() };
            all.push(Lit::new(model, &options)?.received());
        }
        let n = all.len() as f64;
        let mean = |k: usize| all.iter().map(|of_one| of_one[k]).sum::<f64>() / n;
        let square = all.iter().map(|[power, _]| (power - mean(0)).powi(2)).sum::<f64>();
        Ok(Received { power: mean(0), error: (square / (n * (n - 1.0))).sqrt(), deviation: mean(1) })
    }

    /// Power that the books receive, W, and the deviation of their irradiance relative to its mean.
    fn received(&self) -> [f64; 2] {
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
        [power, (square / area - mean * mean).max(0.0).sqrt() / mean]
    }
}

/// Figure 10: the same link with three models of the light inside the cluster, and the light by rays.
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
    let mut item = Item {
        here: format!(
            "{BOOKS} black books side by side under a light of 0.4 m, with the coarsest links from the light that refinement makes, and no \
             local pass; by values `isotropic`, `oriented` and `visible` of option `inside` of a solve. mrvis lets the segments of a link \
             end on the surfaces of the cluster instead of using an item buffer. Numbers are means over {SEEDS} solves with other random \
             numbers. The books absorb all light, so that what they receive beyond the light of the rays is created."
        ),
        ..Item::default()
    };
    let images =
        lit.iter().map(|lit| irradiance(&lit.mesh, VIEW, ANGLE, SIZE)).collect::<Result<Vec<_>>>()?;
    let white = images[3].data().iter().fold(0.0f32, |white, v| white.max(*v));
    let panels = images.iter().zip(&cases).map(|(image, (name, _))| Panel::scaled(image, white, *name));
    item.row(format!("Irradiance: black 0, white {white:.0} W/m² and more"), panels.collect());
    let columns = [
        "light in the cluster",
        "links",
        "emitted, W",
        "absorbed by books, W",
        "left the scene, W",
        "more than by rays, W",
        "deviation / mean",
    ];
    let mut received = Vec::new();
    for (k, case) in lit.iter().enumerate() {
        received.push(match k {
            3 => {
                let [power, deviation] = case.received();
                Received { power, error: 0.0, deviation }
            }
            _ => case.mean_received(&model)?,
        });
    }
    let mut table = Table::new("The ledger", &columns);
    let truth = received[3].power;
    for ((case, (name, _)), Received { power, deviation, .. }) in lit.iter().zip(&cases).zip(&received) {
        let emitted = case.record.ledger.emitted;
        let numbers = [emitted, *power, emitted - power, power - truth, *deviation].map(|v| fixed(v, 3));
        table.push([(*name).into(), case.record.links.to_string()].into_iter().chain(numbers));
    }
    item.tables.push(table);
    judge(&mut item, lit[1].record.links, &received);
    Ok(item)
}

/// Standard errors within which numbers count as equal.
const CERTAIN: f64 = 3.0;

/// Checks of the numbers of links, and of power and deviation of the four cases.
fn judge(item: &mut Item, links: usize, received: &[Received]) {
    let [isotropic, oriented, visible, truth] = [0, 1, 2, 3].map(|k| &received[k]);
    let polygons = 6 * BOOKS as usize;
    item.check(
        "links end at clusters: fewer than one a polygon",
        format!("{links} links to {polygons} polygons"),
        links < polygons,
    );
    let of = |r: &Received| format!("{} ± {} W", fixed(r.power, 3), fixed(r.error, 3));
    item.check(
        "without visibility energy is created: the books receive more than rays bring, by over three standard errors",
        format!("{}, {} W by rays", of(oriented), fixed(truth.power, 3)),
        oriented.power - truth.power > CERTAIN * oriented.error,
    );
    item.check(
        "with visibility energy is preserved: the books receive what rays bring, to three standard errors, which are less than what is \
         created without",
        format!("{}, {} W by rays", of(visible), fixed(truth.power, 3)),
        (visible.power - truth.power).abs() <= CERTAIN * visible.error
            && CERTAIN * visible.error < oriented.power - truth.power,
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
