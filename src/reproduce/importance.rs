//! Importance and feature sizes by surface: section 6 of the paper.

use super::item::{Item, Panel};
use super::office_light::{ANGLE, SIZE, VIEW, bright};
use super::table::{Table, number};
use super::view::irradiance;
use super::{Context, fixed};
use crate::Result;
use crate::metrics::Image;
use crate::model::{Model, PrepareOptions};
use crate::points::Point;
use crate::radiosity::{self, Options, Visibility};
use crate::scene::generate::{self, DESKS, Spec};
use glam::DVec3;

/// Feature size where one looks, metres.
const LOOKED: f32 = 0.05;
/// Feature size elsewhere, metres.
const ELSEWHERE: f32 = 2.0;
/// Columns and rows of points on the desk.
const POINTS: [i32; 2] = [32, 16];
/// Seeds of each solve, whose differences tell the noise.
const SEEDS: [u64; 2] = [1, 2];
/// Standard errors within which numbers count as equal.
const CERTAIN: f64 = 3.0;

/// Numbers of a solve by seed.
#[derive(Clone, Copy, Debug)]
struct Solve {
    name: &'static str,
    /// RMS error on the desk, per cent.
    error: [f64; 2],
    links: [f64; 2],
    /// Exact rays, thousands.
    rays: [f64; 2],
    seconds: [f64; 2],
}

fn mean(values: [f64; 2]) -> f64 {
    0.5 * (values[0] + values[1])
}

/// Standard error of the difference of the means of two pairs of values, from the differences within pairs that have the same noise.
fn difference_error(pairs: &[[f64; 2]]) -> f64 {
    // Half the squared difference of a pair is the variance of a value; the means of two pairs have half of it each.
    (pairs.iter().map(|[a, b]| 0.5 * (a - b).powi(2)).sum::<f64>() / pairs.len() as f64).sqrt()
}

/// Points on the first desk.
fn desk() -> Vec<Point> {
    let ([x, y], [columns, rows]) = (DESKS[0], POINTS);
    let point = |k: i32| {
        let [u, v] = [k % columns, k / columns].map(|i| f64::from(i) + 0.5);
        let at =
            DVec3::new(x - 0.78 + 1.56 * u / f64::from(columns), y - 0.38 + 0.76 * v / f64::from(rows), 0.74);
        Point { position: at, normal: DVec3::Z }
    };
    (0..columns * rows).map(point).collect()
}

/// The camera before the first desk, and what it looks at.
fn at_desk() -> [DVec3; 2] {
    let [x, y] = DESKS[0];
    [DVec3::new(x + 0.7, y - 1.3, 1.6), DVec3::new(x, y, 0.74)]
}

/// Section 6: feature sizes and errors by importance. One looks at the desks.
pub fn importance(context: &Context) -> Result<Item> {
    let model =
        Model::prepare(generate::build(&Spec::new("office"))?, &PrepareOptions::default(), context.progress)?;
    let points = desk();
    let base = Options { local_rays: Some(0), audit: 0, ..Options::default() };
    let reference = Options { error: if context.small { 0.01 } else { 0.005 }, ..base.clone() };
    let mr = |rest: f32| Options { visibility: Visibility::Mr, feature_size: Some(rest), ..base.clone() };
    let truth = radiosity::run(&model, &points, &reference, context.progress)?.irradiance;
    let cases = [
        ("0.05 m everywhere", mr(LOOKED)),
        ("2 m everywhere", mr(ELSEWHERE)),
        (
            "0.05 m on the desk, 2 m elsewhere",
            Options { feature_sizes: vec![("desk".into(), LOOKED)], ..mr(ELSEWHERE) },
        ),
        ("importance of the desk", Options { importance: vec!["desk".into()], ..mr(LOOKED) }),
    ];
    let (mut found, mut pictures) = (Vec::new(), Vec::new());
    for (name, options) in cases {
        let [mut error, mut links, mut rays, mut seconds] = [[0.0; 2]; 4];
        for (k, seed) in SEEDS.into_iter().enumerate() {
            let options = Options { seed, ..options.clone() };
            let outcome = radiosity::run(&model, &points, &options, context.progress)?;
            error[k] = 100.0 * difference(&truth, &outcome.irradiance);
            links[k] = outcome.record.links as f64;
            rays[k] = outcome.record.bundles.exact_rays as f64 / 1e3;
            seconds[k] = outcome.record.seconds.work();
            if k == 0 {
                let seen = [at_desk(), VIEW].map(|ends| irradiance(&outcome.mesh, ends, ANGLE, SIZE));
                pictures.push((name, seen));
            }
        }
        found.push(Solve { name, error, links, rays, seconds });
    }
    let goal = 100.0 * base.error;
    let mut item = Item {
        here: format!(
            "The office of Figure 7; one looks at the first desk. Feature sizes by surface (option `feature_sizes`), and importance (option \
             `importance`: errors elsewhere count by their effect on the desk, and feature sizes grow up to 7 times there). The goal of all \
             solves is an RMS error of {} %; errors on the desk are relative to an exact solve with a goal of {} %. Numbers are means of two \
             solves with other random numbers, whose differences, pooled over solves, tell the noise.",
            fixed(goal, 0),
            fixed(100.0 * reference.error, 1)
        ),
        ..Item::default()
    };
    let [mut desk, mut room] = [Vec::new(), Vec::new()];
    for (name, [first, second]) in pictures {
        desk.push((name, first?));
        room.push((name, second?));
    }
    show(&mut item, "The desk", &desk);
    show(&mut item, "The room", &room);
    item.tables.push(table(&found));
    judge(&mut item, goal, &found);
    Ok(item)
}

fn show(item: &mut Item, title: &str, images: &[(&str, Image)]) {
    let white = images.first().map_or(1.0, |(_, image)| bright(image));
    let panels = images.iter().map(|(name, image)| Panel::scaled(image, white, *name));
    item.row(format!("{title}: irradiance, black 0, white {white:.0} W/m² and more"), panels.collect());
}

fn table(found: &[Solve]) -> Table {
    let columns = ["solve", "RMS error on the desk, %", "links", "exact rays, thousands", "time, s"];
    let mut table = Table::new("Irradiance on the desk", &columns);
    for solve in found {
        let numbers = [(solve.error, 2), (solve.links, 0), (solve.rays, 0), (solve.seconds, 2)]
            .map(|(v, d)| number(mean(v), d));
        table.push([solve.name.into()].into_iter().chain(numbers));
    }
    table
}

/// Checks of the solves: the small size everywhere, the large one everywhere, sizes by surface, importance.
fn judge(item: &mut Item, goal: f64, found: &[Solve]) {
    let [fine, coarse, named, looked] = [0, 1, 2, 3].map(|k| &found[k]);
    item.check(
        "with the small size everywhere the goal is met on the desk, with the large one it is missed: shadows are lost",
        format!("{} % and {} % of at most {} %", fixed(mean(fine.error), 2), fixed(mean(coarse.error), 2), fixed(goal, 0)),
        mean(fine.error) <= goal && mean(coarse.error) > goal,
    );
    let noise = difference_error(&[fine.error, named.error, looked.error]);
    for (name, solve) in [("sizes by surface", named), ("importance", looked)] {
        item.check(
            format!("with {name} the goal is met on the desk"),
            format!("{} % of at most {} %", fixed(mean(solve.error), 2), fixed(goal, 0)),
            mean(solve.error) <= goal,
        );
        let worse = mean(solve.error) - mean(fine.error);
        let check = item.check(
            format!("with {name} the image quality on the desk is that with the small size everywhere, to three standard errors"),
            format!(
                "{} % and {} %, standard error of the difference {} %",
                fixed(mean(solve.error), 2),
                fixed(mean(fine.error), 2),
                fixed(noise, 2)
            ),
            worse <= CERTAIN * noise,
        );
        check.if_not(|| {
            format!(
                "the error is larger by {} percentage points, {} standard errors",
                fixed(worse, 2),
                fixed(worse / noise, 1)
            )
        });
        let saved = |all: [f64; 2], of: [f64; 2]| {
            let saving = mean(all) - mean(of);
            let noise = difference_error(&[all, of]);
            let text = format!(
                "{} % ± {} %",
                fixed(100.0 * saving / mean(all), 1),
                fixed(100.0 * noise / mean(all), 1)
            );
            (text, saving > CERTAIN * noise && saving > 0.0)
        };
        let (links, rays) = (saved(fine.links, solve.links), saved(fine.rays, solve.rays));
        item.check(
            format!("with {name} work is saved elsewhere: fewer links and exact rays, by over three standard errors"),
            format!("{} of the links, {} of the rays", links.0, rays.0),
            links.1 && rays.1,
        );
    }
}

/// RMS difference relative to the mean of the reference.
fn difference(reference: &[[f64; 3]], other: &[[f64; 3]]) -> f64 {
    let mean = |v: &[f64; 3]| v.iter().sum::<f64>() / 3.0;
    let square: f64 = reference.iter().zip(other).map(|(a, b)| (mean(a) - mean(b)).powi(2)).sum();
    let sum: f64 = reference.iter().map(mean).sum();
    (square * reference.len() as f64).sqrt() / sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failing(change: impl Fn(&mut [Solve; 4])) -> Vec<usize> {
        let of = |name, error: f64, links: f64| Solve {
            name,
            error: [error, error + 0.02],
            links: [links, links + 1.0],
            rays: [links, links + 2.0],
            seconds: [1.0; 2],
        };
        let mut found = [
            of("fine", 1.0, 1000.0),
            of("coarse", 6.0, 900.0),
            of("named", 1.0, 950.0),
            of("looked", 1.01, 100.0),
        ];
        change(&mut found);
        let mut item = Item::default();
        judge(&mut item, 2.0, &found);
        (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|f| f[1].error = [1.9; 2]), [0]);
        assert_eq!(failing(|f| f[2].error = [1.1; 2]), [2]);
        assert_eq!(failing(|f| f[2].links = [999.5, 1000.0]), [3]);
        assert_eq!(failing(|f| f[3].error = [2.4; 2]), [4, 5]);
        assert_eq!(failing(|f| f[3].rays = [1001.0; 2]), [6]);
    }
}
