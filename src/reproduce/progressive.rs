//! Progressive multi-gridding: section 6.2 of the paper.

use super::item::Item;
use super::table::{Cell, Table, count, number};
use super::{Context, fixed, list};
use crate::Result;
use crate::model::{Model, PrepareOptions};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};
use crate::radiosity::{self, Options, Oracle, Record};
use crate::scene::generate::{self, Spec};

/// The paper's seconds per iteration.
const PAPER_SECONDS: f64 = 2.0;
/// The paper's number of polygons.
const PAPER_POLYGONS: usize = 6000;
/// Elements at which an error is measured.
const AUDITED: usize = 400;
/// Factor by which a solve may miss a number of links: one link is replaced by up to sixteen, or by over a hundred if its ends are one.
const MISSED: f64 = 2.0;

/// The measured error of a solve.
#[derive(Clone, Copy, Debug)]
struct Audited {
    links: usize,
    /// RMS, per cent of the mean irradiance; none if it is unknown.
    error: Option<f64>,
}

/// What is judged.
struct Measured {
    polygons: usize,
    /// Seconds that a step was asked to take.
    step: f64,
    /// By iteration: seconds, links and replaced links.
    iterations: Vec<(f64, usize, usize)>,
    /// By iteration, of another solve that ends at as many links.
    others: Vec<Audited>,
    /// Of the stepped solve in the end.
    own: Audited,
    /// Of a solve whose links are refined by the light that they transport.
    by_transport: Audited,
}

/// Section 6.2: steps of a limited number of links.
pub fn multigridding(context: &Context) -> Result<Item> {
    let spec = Spec { count: Some(7000), ..Spec::new("urban-block") };
    let polygons = generate::soup(&spec)?.polygons();
    let model = Model::prepare(generate::build(&spec)?, &PrepareOptions::default(), context.progress)?;
    let (step, max_links) = if context.small { (0.05, 4000) } else { (0.1, 20_000) };
    let links = Options { local_rays: Some(0), audit: AUDITED, ..Options::default() };
    let solve = |options: &Options| radiosity::run(&model, &[], options, context.progress).map(|o| o.record);
    let steps = Options { step_seconds: Some(step), max_links, ..links.clone() };
    let record = solve(&steps)?;
    let others = record
        .iterations
        .iter()
        .map(|iteration| Ok(audited(&solve(&Options { max_links: iteration.links, ..links.clone() })?)));
    let others = others.collect::<Result<Vec<_>>>()?;
    let transport = Options { oracle: Oracle::Bf, max_links: record.links, ..links.clone() };
    let measured = Measured {
        polygons,
        step,
        iterations: record.iterations.iter().map(|i| (i.seconds, i.links, i.refined)).collect(),
        others,
        own: audited(&record),
        by_transport: audited(&solve(&transport)?),
    };
    let mut item = Item {
        here: format!(
            "Scene `urban-block` of `mrvis generate` with a count of 7,000, {polygons} polygons; light along links alone (options \
             `step_seconds` {step}, `max_links` {max_links}, `local_rays` 0). Each step refines the links above the threshold that a \
             histogram of their errors gives for the time; the RMS error after a step, relative to the mean irradiance, is that of \
             another solve that ends at as many links, measured by independent paths at {AUDITED} elements; in the end that of the stepped \
             solve itself stands beside, and that of links refined by the light that they transport (BF refinement of P. Hanrahan and others \
             1991, option `oracle`)."
        ),
        ..Item::default()
    };
    item.tables.push(iterations(&measured));
    item.tables.push(criteria(&measured));
    item.chart(plot(&measured), "Measured error after the iterations, with their numbers.");
    judge(&mut item, &measured);
    Ok(item)
}

fn audited(record: &Record) -> Audited {
    Audited { links: record.links, error: record.error_estimate.map(|error| 100.0 * error) }
}

/// Errors by the time of the iterations.
fn plot(measured: &Measured) -> Plot {
    let (mut points, mut seconds) = (Vec::new(), 0.0);
    for (k, (iteration, other)) in measured.iterations.iter().zip(&measured.others).enumerate() {
        seconds += iteration.0;
        points.extend(other.error.map(|y| PlotPoint { x: seconds, y, label: (k + 1).to_string() }));
    }
    Plot {
        x_label: "seconds".into(),
        y_label: "RMS error, % of the mean irradiance".into(),
        y_scale: Scale::Log,
        series: vec![Series { name: "after iteration".into(), points, marks: Marks::Joined }],
        ..Plot::default()
    }
}

fn shown(error: Option<f64>) -> Cell {
    error.map_or("unknown".into(), |error| number(error, 1))
}

/// The iterations with the errors after them.
fn iterations(measured: &Measured) -> Table {
    let columns = ["iteration", "time, s", "paper, s", "links", "refined", "RMS error, %", "its links"];
    let mut table = Table::new("Iterations", &columns);
    for (k, ((seconds, links, refined), other)) in
        measured.iterations.iter().zip(&measured.others).enumerate()
    {
        table.push([
            count(k + 1),
            number(*seconds, 2),
            number(PAPER_SECONDS, 0),
            count(*links),
            count(*refined),
            shown(other.error),
            count(other.links),
        ]);
    }
    table
}

/// Errors by criterion of refinement.
fn criteria(measured: &Measured) -> Table {
    let mut table = Table::new("In the end", &["links refined by", "links", "RMS error, %"]);
    let mut push = |name: &str, of: &Audited| table.push([name.into(), count(of.links), shown(of.error)]);
    push("error bounds, in steps", &measured.own);
    if let Some(last) = measured.others.last() {
        push("error bounds", last);
    }
    push("transported light (BF)", &measured.by_transport);
    table
}

/// Standard error of a root mean square of independent errors, as a part of it: 1/√(2n).
fn relative_error() -> f64 {
    1.0 / (2.0 * AUDITED as f64).sqrt()
}

fn judge(item: &mut Item, measured: &Measured) {
    let Measured { polygons, step, iterations, .. } = measured;
    item.check(
        format!("the scene has over {PAPER_POLYGONS} polygons"),
        polygons.to_string(),
        *polygons > PAPER_POLYGONS,
    );
    let links: Vec<usize> = iterations.iter().map(|i| i.1).collect();
    item.check(
        "every iteration that refines adds links to the coarsest solution, a single link",
        format!("{} links", links.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
        links.len() > 2 && links[0] == 1 && iterations.windows(2).all(|i| i[1].2 == 0 || i[1].1 > i[0].1),
    );
    judge_errors(item, measured);
    let slowest = iterations.iter().map(|i| i.0).fold(0.0, f64::max);
    item.check_time(
        format!("no iteration takes longer than the paper's 2 s, nor twice the {step} s that were asked for"),
        format!("at most {} s", fixed(slowest, 2)),
        !iterations.is_empty() && slowest <= PAPER_SECONDS.min(2.0 * step),
    );
}

/// Whether errors are known, and fall.
fn judge_errors(item: &mut Item, measured: &Measured) {
    let Measured { iterations, others, own, by_transport, .. } = measured;
    let factor = |(other, i): (&Audited, &(f64, usize, usize))| (other.links as f64 / i.1 as f64).ln().abs();
    let missed = others.iter().zip(iterations).map(factor).fold(0.0, f64::max).exp();
    let errors: Vec<f64> = others.iter().filter_map(|other| other.error).collect();
    item.check(
        format!(
            "an error is measured for every iteration, by a solve with as many links to a factor of {MISSED}"
        ),
        format!(
            "{} of {} iterations; the numbers of links differ by factors of at most {missed:.2}",
            errors.len(),
            iterations.len()
        ),
        errors.len() == iterations.len() && missed <= MISSED,
    );
    let noise = relative_error();
    let last = errors.last().copied().unwrap_or(f64::NAN);
    let both = format!("standard error {} % of each", fixed(100.0 * noise, 1));
    let own = own.error.unwrap_or(f64::NAN);
    // Of two errors with independent noise.
    let apart = 3.0 * noise * (own * own + last * last).sqrt();
    item.check(
        "the error of the stepped solve itself is that of the other solve in the end, to three standard errors",
        format!("{} % and {} %, {both}", fixed(own, 1), fixed(last, 1)),
        (own - last).abs() <= apart,
    );
    item.check(
        "the measured error falls: from iteration to iteration, to three standard errors of it, and from the first to the last",
        format!("{} %, {both}", list(&errors, 1)),
        errors.len() > 1
            && errors.windows(2).all(|e| e[1] < e[0] * (1.0 + 3.0 * noise))
            && last < errors[0] * (1.0 - 3.0 * noise),
    );
    let bf = by_transport.error.unwrap_or(f64::NAN);
    let check = item.check(
        "refinement by error bounds, which the paper's histogram holds, leaves a smaller error than refinement of as many links by the \
         light that they transport",
        format!("{} % with {} links and {} % with {}, {both}", fixed(own, 1), measured.own.links, fixed(bf, 1), by_transport.links),
        own < bf,
    );
    check.if_not(|| format!("the ratio of the errors is {}", fixed(own / bf, 2)));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failing(change: impl Fn(&mut Measured)) -> Vec<usize> {
        let of = |links: usize, error: f64| Audited { links, error: Some(error) };
        let mut measured = Measured {
            polygons: 7000,
            step: 0.5,
            iterations: vec![(0.5, 1, 0), (0.6, 100, 30), (0.5, 400, 100)],
            others: vec![of(1, 200.0), of(99, 100.0), of(400, 50.0)],
            own: of(400, 51.0),
            by_transport: of(398, 80.0),
        };
        change(&mut measured);
        let mut item = Item::default();
        judge(&mut item, &measured);
        assert!(item.checks[6].timed);
        (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|m| m.polygons = 6000), [0]);
        assert_eq!(failing(|m| m.iterations[2].1 = 100), [1, 2]);
        assert_eq!(failing(|m| m.others[1].error = None), [2]);
        assert_eq!(failing(|m| m.others[1].links = 49), [2]);
        assert_eq!(failing(|m| m.own.error = Some(62.0)), [3]);
        assert_eq!(failing(|m| m.others[1].error = Some(230.0)), [4]);
        assert_eq!(failing(|m| m.by_transport.error = Some(40.0)), [5]);
        assert_eq!(failing(|m| m.iterations[1].0 = 1.1), [6]);
        assert_eq!(failing(|m| m.own.error = None), [3, 5]);
    }
}
