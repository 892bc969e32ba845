//! Importance and feature sizes by surface: section 6 of the paper.

use super::item::{Item, Panel, Table, number};
use super::office_light::{ANGLE, SIZE, VIEW, bright};
use super::view::{irradiance, seen};
use super::{Context, MIN_STANDARD_ERRORS, by_links, changed, fixed};
use glam::DVec3;
use mrvis::internals::points::Point;
use mrvis::internals::radiosity::{self, Options};
use mrvis::internals::scene::Object;
use mrvis::internals::scene::generate::{self, DESKS, Spec};
use mrvis::metrics::Image;
use mrvis::{Detail, Engine, Result};

/// Feature size of the viewed objects, metres.
const VIEWED_FEATURE_SIZE: f32 = 0.05;
/// Feature size of all other objects, metres.
const OTHER_FEATURE_SIZE: f32 = 2.0;
/// Columns and rows of points on the desk.
const POINTS: [i32; 2] = [32, 16];
/// Number of solves of each case, from whose spread the noise is estimated, and the number in tests.
const SEEDS: [u64; 2] = [8, 2];
/// Number of solves with the large size everywhere, whose noise is not needed.
const COARSE_SEEDS: u64 = 2;
/// Errors count as equal if they differ by at most this fraction of the goal and two standard errors. Chosen here; the paper states none.
const EQUALITY_MARGIN: f64 = 0.1;
/// Name of that case.
const COARSE_CASE: &str = "2 m everywhere";
/// Viewed objects: the first desk and the objects on it.
const OBJECTS: [&str; 7] = ["desk", "screen", "keyboard", "cup", "pencils", "books", "sheets"];

/// Numbers of solves of one case, by seed.
#[derive(Clone, Debug, Default)]
struct Solve {
    name: &'static str,
    /// RMS error on the desk top, per cent.
    error: Vec<f64>,
    /// That of the picture where it shows the desk and the things on it, per cent.
    picture: Vec<f64>,
    links: Vec<f64>,
    /// Exact rays, thousands.
    rays: Vec<f64>,
    seconds: Vec<f64>,
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean difference of the values of the same seeds, and its standard error.
fn difference_of(a: &[f64], b: &[f64]) -> [f64; 2] {
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    let (n, mean) = (differences.len() as f64, mean(&differences));
    let square = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>();
    [mean, (square / (n * (n - 1.0).max(1.0))).sqrt()]
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

/// Section 6: feature sizes and errors by importance. The camera looks at the desks.
pub fn importance(context: &Context) -> Result<Item> {
    let model = context.model(generate::build(&Spec::new("office"))?, Detail::Optics)?;
    let points = desk();
    let small = usize::from(context.small);
    let error = [Options::default().error, 0.05][small];
    let base = by_links(error);
    let reference = changed(&base, |options| options.error *= [0.25, 0.5][small]);
    let mr = |rest: f32| {
        changed(&base, |options| {
            options.engine = Engine::MultiResolution;
            options.feature_size = Some(rest);
        })
    };
    let names = OBJECTS.map(String::from).to_vec();
    let sizes = names.iter().map(|name| (name.clone(), VIEWED_FEATURE_SIZE)).collect();
    let cases = [
        ("0.05 m everywhere", mr(VIEWED_FEATURE_SIZE)),
        (COARSE_CASE, mr(OTHER_FEATURE_SIZE)),
        (
            "0.05 m on the desk, 2 m elsewhere",
            changed(&mr(OTHER_FEATURE_SIZE), |options| options.feature_sizes = sizes),
        ),
        ("importance of the desk", changed(&mr(VIEWED_FEATURE_SIZE), |options| options.importance = names)),
    ];
    let truth = radiosity::run(&model, &points, &reference, context.progress)?;
    let truth = (truth.irradiance, seen(&truth.mesh, at_desk(), ANGLE, SIZE)?);
    let objects = &model.scene().parts().objects;
    let looked: Vec<bool> = truth.1.objects.iter().map(|o| is_viewed(objects, *o)).collect();
    let (mut found, mut pictures) = (Vec::new(), Vec::new());
    for (name, options) in cases {
        let mut solve = Solve { name, ..Solve::default() };
        for seed in 1..=if name == COARSE_CASE { COARSE_SEEDS } else { SEEDS[small] } {
            let options = changed(&options, |options| options.seed = seed);
            let outcome = radiosity::run(&model, &points, &options, context.progress)?;
            let picture = irradiance(&outcome.mesh, at_desk(), ANGLE, SIZE)?;
            solve.error.push(100.0 * difference(&truth.0, &outcome.irradiance));
            solve.picture.push(100.0 * picture_difference(&truth.1.image, &picture, &looked));
            solve.links.push(outcome.record.links as f64);
            solve.rays.push(outcome.record.bundles.exact_rays as f64 / 1e3);
            solve.seconds.push(outcome.record.seconds.work());
            if seed == 1 {
                pictures.push((name, [picture, irradiance(&outcome.mesh, VIEW, ANGLE, SIZE)?]));
            }
        }
        found.push(solve);
    }
    let goal = 100.0 * base.error;
    let mut item = Item::of(format!(
        "The office of Figure 7; one looks at the first desk and the things on it. Feature sizes by surface (option `feature_sizes`), and \
             importance (option `importance`: errors elsewhere count by their effect on these objects, and feature sizes grow up to 7 times \
             there). The goal of all solves is an RMS error of {} %; errors on the desk top, at {} points, and in the picture, where it shows \
             these objects, are relative to an exact solve with a goal of {} %. Numbers are means of {} solves with other random numbers \
             ({COARSE_SEEDS} with the large size everywhere); solves with the same random numbers are compared, and the scatter of their \
             differences tells the noise.",
        fixed(goal, 0),
        POINTS[0] * POINTS[1],
        fixed(100.0 * reference.error, 1),
        SEEDS[small]
    ));
    let (mut desk, mut room) = (vec![("reference", truth.1.image)], Vec::new());
    for (name, [first, second]) in pictures {
        desk.push((name, first));
        room.push((name, second));
    }
    show(&mut item, "The desk", &desk);
    show(&mut item, "The room", &room);
    item.tables.push(table(&found));
    judge(&mut item, goal, &found);
    Ok(item)
}

/// Whether an object is one of [`OBJECTS`].
fn is_viewed(objects: &[Object], object: Option<u32>) -> bool {
    object.is_some_and(|o| OBJECTS.contains(&objects[o as usize].name.as_str()))
}

fn show(item: &mut Item, title: &str, images: &[(&str, Image)]) {
    let white = images.first().map_or(1.0, |(_, image)| bright(image));
    let panels = images.iter().map(|(name, image)| Panel::scaled(image, white, *name));
    item.row(format!("{title}: irradiance, black 0, white {white:.0} W/m² and more"), panels.collect());
}

fn table(found: &[Solve]) -> Table {
    let columns = "solve | RMS error on the desk top, % | RMS error of the picture, % | links | exact rays, thousands | time, s";
    let mut table = Table::new("Irradiance on the desk", columns);
    for solve in found {
        let Solve { name, error, picture, links, rays, seconds } = solve;
        let numbers = [(error, 2), (picture, 2), (links, 0), (rays, 0), (seconds, 2)]
            .map(|(values, digits)| number(mean(values), digits));
        table.push([(*name).into()].into_iter().chain(numbers));
    }
    table
}

/// Checks of the solves: the small size everywhere, the large one everywhere, sizes by surface, importance.
fn judge(item: &mut Item, goal: f64, found: &[Solve]) {
    let [fine, coarse, named, looked] = [0, 1, 2, 3].map(|k| &found[k]);
    let percentage = |values: &[f64]| fixed(mean(values), 2);
    let at_most = fixed(goal, 0);
    item.check(
        "with the small size everywhere the goal is met on the desk top, with the large one it is missed: shadows are lost",
        format!("{} % and {} % of at most {at_most} %", percentage(&fine.error), percentage(&coarse.error)),
        mean(&fine.error) <= goal && mean(&coarse.error) > goal,
        || match mean(&fine.error) <= goal {
            true => "the large size keeps the shadows on the desk top".into(),
            false => "the goal holds for the mean over all surfaces, and shadows on the desk top are finer than elsewhere".into(),
        },
    );
    for (name, solve) in [("sizes by surface", named), ("importance", looked)] {
        item.check(
            format!("with {name} the goal is met on the desk top"),
            format!("{} % of at most {at_most} %", percentage(&solve.error)),
            mean(&solve.error) <= goal,
            || coarser(solve, fine),
        );
        let why = || coarser(solve, fine);
        let statement = format!("with {name} the quality on the desk top");
        judge_same(item, &statement, goal, &solve.error, &fine.error, why);
        let statement = format!("with {name} the quality of the picture of the desk and the things on it");
        judge_same(item, &statement, goal, &solve.picture, &fine.picture, why);
        judge_saved(item, name, solve, fine);
    }
}

/// How much fewer links a solve has.
fn coarser(solve: &Solve, fine: &Solve) -> String {
    format!(
        "light comes along {} links, and along {} with the small size everywhere",
        fixed(mean(&solve.links), 0),
        fixed(mean(&fine.links), 0)
    )
}

/// Whether errors are those with the small size everywhere, and why they may not be.
fn judge_same(
    item: &mut Item,
    statement: &str,
    goal: f64,
    errors: &[f64],
    fine: &[f64],
    why: impl FnOnce() -> String,
) {
    let margin = EQUALITY_MARGIN * goal;
    let [worse, error] = difference_of(errors, fine);
    item.check(
        format!(
            "{statement} is that with the small size everywhere: the RMS error with two standard errors is larger by at most a tenth of the \
             goal (our margin), {} %",
            fixed(margin, 1)
        ),
        format!("{} % and {} %, difference {} ± {} %", fixed(mean(errors), 2), fixed(mean(fine), 2), fixed(worse, 2), fixed(error, 2)),
        worse + 2.0 * error <= margin,
        || match worse > margin {
            true => format!(
                "the error is larger by {} percentage points, {} % of it: {}",
                fixed(worse, 2),
                fixed(100.0 * worse / mean(fine), 0),
                why()
            ),
            false => format!("the noise of {} solves does not tell such a difference from a larger one", errors.len()),
        },
    );
}

/// Whether links and rays are saved.
fn judge_saved(item: &mut Item, name: &str, solve: &Solve, fine: &Solve) {
    let saved = |all: &[f64], of: &[f64]| {
        let [saving, error] = difference_of(all, of);
        let part = |v: f64| fixed(100.0 * v / mean(all), 1);
        (
            format!("{} % ± {} %", part(saving), part(error)),
            saving > MIN_STANDARD_ERRORS * error && saving > 0.0,
        )
    };
    let (links, rays) = (saved(&fine.links, &solve.links), saved(&fine.rays, &solve.rays));
    item.check(
        format!(
            "with {name} work is saved elsewhere: fewer links and exact rays, by over three standard errors"
        ),
        format!("{} of the links, {} of the rays", links.0, rays.0),
        links.1 && rays.1,
        || "links elsewhere are refined as much, or clusters are averaged no more often".into(),
    );
}

/// RMS difference of pictures relative to the mean of the reference, over some pixels.
fn picture_difference(reference: &Image, other: &Image, pixels: &[bool]) -> f64 {
    let chosen = || reference.data().iter().zip(other.data()).zip(pixels).filter(|(_, chosen)| **chosen);
    let square: f64 = chosen().map(|((a, b), _)| f64::from(a - b).powi(2)).sum();
    let sum: f64 = chosen().map(|((a, _), _)| f64::from(*a)).sum();
    (square * chosen().count() as f64).sqrt() / sum
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
    use super::super::item::failing_checks;
    use super::*;

    fn failing(change: impl Fn(&mut [Solve; 4])) -> Vec<usize> {
        let of = |name, error: f64, links: f64| Solve {
            name,
            error: vec![error, error + 0.02],
            picture: vec![4.0 * error, 4.0 * error + 0.04],
            links: vec![links, links + 1.0],
            rays: vec![links, links + 2.0],
            seconds: vec![1.0; 2],
        };
        let mut found = [
            of("fine", 1.0, 1000.0),
            of("coarse", 6.0, 900.0),
            of("named", 1.0, 950.0),
            of("looked", 1.01, 100.0),
        ];
        change(&mut found);
        failing_checks(|item| judge(item, 2.0, &found))
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|f| f[1].error = vec![1.9; 2]), [0]);
        assert_eq!(failing(|f| f[2].error = vec![1.3; 2]), [2]);
        // Noise does not make errors equal.
        assert_eq!(failing(|f| f[2].error = vec![0.7, 1.3]), [2]);
        assert_eq!(failing(|f| f[2].picture = vec![4.3; 2]), [3]);
        assert_eq!(failing(|f| f[2].links = vec![999.5, 1000.0]), [4]);
        assert_eq!(failing(|f| f[3].error = vec![2.4; 2]), [5, 6]);
        assert_eq!(failing(|f| f[3].picture = vec![6.0; 2]), [7]);
        assert_eq!(failing(|f| f[3].rays = vec![1001.0; 2]), [8]);
    }

    #[test]
    fn only_some_pixels_count() {
        let image = |values: [f32; 4]| Image::new(2, 2, 1.0, values.to_vec()).expect("an image");
        let (one, other) = (image([1.0, 1.0, 2.0, 5.0]), image([2.0, 0.0, 2.0, 9.0]));
        let found = picture_difference(&one, &other, &[true, true, true, false]);
        // √(2 / 3) of a mean of 4 / 3.
        assert!((found - (2.0f64 / 3.0).sqrt() / (4.0 / 3.0)).abs() < 1e-12, "{found}");
    }
}
