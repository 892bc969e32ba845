//! Progressive multi-gridding: section 6.2 of the paper.

use super::item::Item;
use super::table::{Cell, Table, count, number};
use super::{Context, Repeated, counts_of, fixed, list};
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Scale, Series};
use mrvis::internals::radiosity::{self, Options, Oracle, Record, Visibility};
use mrvis::internals::scene::generate::{self, Spec};
use mrvis::{Detail, Result};

/// The paper's seconds per iteration.
const PAPER_SECONDS: f64 = 2.0;
/// The paper's number of polygons.
const PAPER_POLYGONS: usize = 6000;
/// Elements at which an error is measured, and in tests.
const AUDITED: [usize; 2] = [400, 60];
/// Numbers of links after which solves end to measure errors, and in tests.
const ENDS: [&[usize]; 2] = [&[1, 64, 256, 1024, 4096, 16_384], &[1, 64, 1024]];
/// Numbers of links after which solves of a closed room end, for the statement that a solution is consistent at any time.
const EARLY_ENDS: [usize; 3] = [100, 1000, 10_000];
/// Part of the emitted power that a solution may create: rounding errors of 32-bit factors.
const CREATED: f64 = 1e-4;
/// Seeds of these solves and of the elements at which errors are measured; their differences tell the noise.
const SEEDS: [u64; 2] = [1, 2];

/// The measured errors of solves with two seeds that end at the same number of links.
#[derive(Clone, Copy, Debug)]
struct Audited {
    links: usize,
    /// RMS, per cent of the mean irradiance; not a number if it is unknown.
    errors: [f64; 2],
}

impl Audited {
    fn error(&self) -> f64 {
        0.5 * (self.errors[0] + self.errors[1])
    }

    /// The error in a table.
    fn cell(&self) -> Cell {
        if self.error().is_finite() { number(self.error(), 1) } else { "unknown".into() }
    }
}

/// What is judged.
struct Measured {
    polygons: usize,
    /// Seconds that a step was asked to take.
    step: f64,
    /// Of the solve in steps of limited time, by iteration: seconds, links and replaced links.
    iterations: Vec<(f64, usize, usize)>,
    /// By iteration, of solves that end at as many links.
    after: Vec<Audited>,
    /// Of solves that end at growing numbers of links.
    ends: Vec<Audited>,
    /// Of the stepped solve in the end, and of solves with as many links that are refined without limits of time, and by the light that
    /// links transport.
    own: Audited,
    other: Audited,
    by_transport: Audited,
}

/// Section 6.2: steps of a limited number of links.
pub fn multigridding(context: &Context) -> Result<Item> {
    let spec = Spec { count: Some(7000), ..Spec::new("urban-block") };
    let polygons = generate::soup(&spec)?.polygons();
    let model = context.model(generate::build(&spec)?, Detail::Optics)?;
    let small = usize::from(context.small);
    let (step, max_links) = [(0.1, 20_000), (0.05, 1000)][small];
    let audit = AUDITED[small];
    let links = Options { local_rays: Some(0), audit, ..Options::default() };
    let solve = |options: &Options| radiosity::run(&model, &[], options, context.progress).map(|o| o.record);
    let both = |options: &Options| -> Result<(Audited, Record)> {
        let [one, two] = SEEDS.map(|seed| solve(&Options { seed, ..options.clone() }));
        let (one, two) = (one?, two?);
        let error = |record: &Record| record.error_estimate.map_or(f64::NAN, |error| 100.0 * error);
        Ok((Audited { links: one.links, errors: [error(&one), error(&two)] }, one))
    };
    let end = |max_links: usize, oracle: Oracle| -> Result<Audited> {
        Ok(both(&Options { max_links, oracle, ..links.clone() })?.0)
    };
    let (own, record) = both(&Options { step_seconds: Some(step), max_links, ..links.clone() })?;
    let measured = Measured {
        polygons,
        step,
        iterations: record.iterations.iter().map(|i| (i.seconds, i.links, i.refined)).collect(),
        after: record.iterations.iter().map(|i| end(i.links, Oracle::Error)).collect::<Result<_>>()?,
        ends: ENDS[small].iter().map(|&n| end(n, Oracle::Error)).collect::<Result<_>>()?,
        own,
        other: end(own.links, Oracle::Error)?,
        by_transport: end(own.links, Oracle::Bf)?,
    };
    let mut item = Item::of(format!(
        "Scene `urban-block` of `mrvis generate` with a count of 7,000, {polygons} polygons; light along links alone (option `local_rays` \
             0). A solve in steps (options `step_seconds` {step}, `max_links` {max_links}): each refines the links above the threshold that a \
             histogram of their errors gives for the time. The record of a solve does not hold the number of links k that a step plans, so that \
             the first sentence of the claim is tested by unit tests of the histogram, not here. RMS errors, relative to the mean irradiance, \
             are those of solves that end at given numbers of links, and at those of the iterations, measured by independent paths at {audit} elements; means of two solves \
             with other random numbers, whose differences, pooled, tell the noise. In the end that of the stepped solve itself stands beside, \
             and that of links refined by the light that they transport (BF refinement of P. Hanrahan and others 1991, option `oracle`). Solves of `mrvis generate office`, a closed room, end early."
    ));
    item.tables.push(iterations(&measured));
    item.tables.push(errors(&measured));
    item.chart(plot(&measured), "Measured error of solves that end at numbers of links.");
    judge(&mut item, &measured);
    judge_early_ends(&mut item, &early_ends(context)?);
    Ok(item)
}

/// A solution that ended after few links.
struct EarlyEnd {
    links: usize,
    /// Power received less power sent, as a part of what is emitted.
    created: f64,
    /// Root mean square difference of row sums from 1, before and after normalisation.
    row_sums: [f64; 2],
}

/// Solves of the office, a closed room, that end after few links.
fn early_ends(context: &Context) -> Result<Vec<EarlyEnd>> {
    let model = context.model(generate::build(&Spec::new("office"))?, Detail::Optics)?;
    let end = |max_links: usize| -> Result<EarlyEnd> {
        let visibility = Visibility::Exact;
        let options = Options { max_links, visibility, local_rays: Some(0), audit: 0, ..Options::default() };
        let record = radiosity::run(&model, &[], &options, context.progress)?.record;
        let ledger = &record.ledger;
        Ok(EarlyEnd {
            links: record.links,
            created: ledger.created / ledger.emitted,
            row_sums: [ledger.row_sum_error_sampled, ledger.row_sum_error],
        })
    };
    EARLY_ENDS.map(end).into_iter().collect()
}

/// Errors by the number of links.
fn plot(measured: &Measured) -> Plot {
    let point = |end: &Audited| PlotPoint { x: end.links as f64, y: end.error(), label: String::new() };
    Plot {
        x_label: "links".into(),
        x_scale: Scale::Log,
        y_label: "RMS error, % of the mean irradiance".into(),
        y_scale: Scale::Log,
        series: vec![Series::new(
            "refined by error bounds",
            measured.ends.iter().filter(|end| end.error().is_finite()).map(point).collect(),
            Marks::Joined,
        )],
        ..Plot::default()
    }
}

/// The iterations of the solve in steps.
fn iterations(measured: &Measured) -> Table {
    let columns = "iteration | time, s | paper, s | links | refined | RMS error after it, %";
    let mut table = Table::new("Iterations in steps of limited time", columns);
    for (k, ((seconds, links, refined), after)) in measured.iterations.iter().zip(&measured.after).enumerate()
    {
        table.push([
            count(k + 1),
            number(*seconds, 2),
            number(PAPER_SECONDS, 0),
            count(*links),
            count(*refined),
            after.cell(),
        ]);
    }
    table
}

/// Errors by number of links and by criterion of refinement.
fn errors(measured: &Measured) -> Table {
    let noise = repeated(measured).noise();
    let title = format!("Errors; standard error {} % of each", fixed(100.0 * noise, 1));
    let mut table = Table::new(title, "links refined by | links | RMS error, %");
    let mut push = |name: &str, of: &Audited| {
        table.push([name.into(), count(of.links), of.cell()]);
    };
    measured.ends.iter().for_each(|end| push("error bounds", end));
    push("error bounds, in steps", &measured.own);
    push("error bounds", &measured.other);
    push("transported light (BF)", &measured.by_transport);
    table
}

/// All errors that are compared, by two seeds.
fn repeated(measured: &Measured) -> Repeated {
    let all = measured.ends.iter().chain([&measured.own, &measured.other, &measured.by_transport]);
    Repeated(all.map(|of| of.errors).collect())
}

fn judge(item: &mut Item, measured: &Measured) {
    let Measured { polygons, step, iterations, .. } = measured;
    item.check(
        format!("the scene has over {PAPER_POLYGONS} polygons"),
        polygons.to_string(),
        *polygons > PAPER_POLYGONS,
        || "`mrvis generate urban-block` makes fewer".into(),
    );
    let links: Vec<usize> = iterations.iter().map(|i| i.1).collect();
    let idle = iterations.windows(2).position(|i| i[1].2 > 0 && i[1].1 <= i[0].1);
    item.check_time(
        "every iteration that refines adds links to the coarsest solution, a single link",
        format!("{} links", counts_of(&links)),
        links.len() > 2 && links[0] == 1 && idle.is_none(),
        || match idle {
            Some(k) => format!("iteration {} replaces links and does not add any", k + 2),
            None => "refinement ended in the first steps, or did not start with one link".into(),
        },
    );
    judge_errors(item, measured);
    let slowest = iterations.iter().map(|i| i.0).fold(0.0, f64::max);
    item.check_time(
        format!("no iteration takes longer than the paper's 2 s, nor twice the {step} s that were asked for"),
        format!("at most {} s", fixed(slowest, 2)),
        !iterations.is_empty() && slowest <= PAPER_SECONDS.min(2.0 * step),
        || "the time of a step is estimated from those before, or other processes delayed it".into(),
    );
}

/// Whether solutions that end early are consistent.
fn judge_early_ends(item: &mut Item, ends: &[EarlyEnd]) {
    let links: Vec<usize> = ends.iter().map(|end| end.links).collect();
    let percentages = |of: &dyn Fn(&EarlyEnd) -> f64, digits| {
        list(&ends.iter().map(|end| 100.0 * of(end)).collect::<Vec<_>>(), digits)
    };
    item.check(
        "a solution of a closed room is consistent whenever it ends: received and sent power are equal, to 0.01 % of what is emitted",
        format!("{} % with {} links", percentages(&|end| end.created, 5), counts_of(&links)),
        !ends.is_empty() && ends.iter().all(|end| end.created.abs() <= CREATED),
        || {
            format!(
                "after normalisation row sums differ from 1 by {} %: one factor for each leaf does not bring all of them to 1",
                percentages(&|end| end.row_sums[1], 2)
            )
        },
    );
    item.check(
        "the form factors of a closed room sum to 1 the better the more links there are: before normalisation the root mean square \
         difference falls from end to end",
        format!("{} % with {} links", percentages(&|end| end.row_sums[0], 1), counts_of(&links)),
        ends.len() > 1
            && ends.windows(2).all(|pair| pair[0].links < pair[1].links && pair[1].row_sums[0] < pair[0].row_sums[0]),
        || "each link has few segments, and as its ends become smaller their noise adds up as much as the links' errors shrink".into(),
    );
}

/// Whether errors are known, and fall.
fn judge_errors(item: &mut Item, measured: &Measured) {
    let Measured { ends, own, other, by_transport, .. } = measured;
    let repeated = repeated(measured);
    let both = format!("standard error {} % of each", fixed(100.0 * repeated.noise(), 1));
    let certain = repeated.certain();
    let all: Vec<f64> = ends.iter().map(Audited::error).collect();
    let links: Vec<usize> = ends.iter().map(|end| end.links).collect();
    let steps: Vec<f64> = all.windows(2).map(|pair| (pair[1] / pair[0]).ln()).collect();
    let rises = steps.iter().position(|step| *step > certain);
    let falls: f64 = steps.iter().sum();
    item.check(
        "the measured error falls with the number of links: by over three standard errors from the first to the last, and nowhere does it \
         rise by as much",
        format!("{} % with {} links, {both}", list(&all, 1), counts_of(&links)),
        rises.is_none() && falls < -certain,
        || match rises {
            Some(k) => format!("it rises from {} to {} links", links[k], links[k + 1]),
            None => "no error was measured, or more links do not lower it".into(),
        },
    );
    let apart = |a: &Audited, b: &Audited| (a.error() / b.error()).ln();
    item.check_time(
        "the solve in steps of limited time errs no more than a solve with as many links without steps, to three standard errors",
        format!("{} % with {} links and {} % with {}, {both}", fixed(own.error(), 1), own.links, fixed(other.error(), 1), other.links),
        apart(own, other) <= certain,
        || format!("the ratio of the errors is {}: the order of refinement differs", fixed(apart(own, other).exp(), 2)),
    );
    item.check_time(
        "refinement by error bounds, which the paper's histogram holds, leaves a smaller error than refinement of as many links by the \
         light that they transport, by over three standard errors",
        format!(
            "{} % with {} links and {} % with {}, {both}",
            fixed(other.error(), 1),
            other.links,
            fixed(by_transport.error(), 1),
            by_transport.links
        ),
        apart(other, by_transport) < -certain,
        || format!("the ratio of the errors is {}", fixed(apart(other, by_transport).exp(), 2)),
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    fn failing(change: impl Fn(&mut Measured)) -> Vec<usize> {
        let of = |links: usize, error: f64| Audited { links, errors: [0.99 * error, 1.01 * error] };
        let mut measured = Measured {
            polygons: 7000,
            step: 0.5,
            after: vec![of(1, 200.0), of(100, 100.0), of(400, 50.0)],
            iterations: vec![(0.5, 1, 0), (0.6, 100, 30), (0.5, 400, 100)],
            ends: vec![of(1, 200.0), of(100, 100.0), of(400, 50.0)],
            own: of(400, 51.0),
            other: of(400, 50.0),
            by_transport: of(398, 80.0),
        };
        change(&mut measured);
        let mut item = Item::default();
        judge(&mut item, &measured);
        assert_eq!(
            item.checks.iter().map(|check| check.timed).collect::<Vec<_>>(),
            [false, true, false, true, true, true]
        );
        (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        assert_eq!(failing(|_| ()), [0; 0]);
        assert_eq!(failing(|m| m.polygons = 6000), [0]);
        assert_eq!(failing(|m| m.iterations[2].1 = 100), [1]);
        assert_eq!(failing(|m| m.ends[1].errors = [230.0; 2]), [2]);
        assert_eq!(failing(|m| m.ends[2].errors = [f64::NAN; 2]), [2, 3, 4]);
        assert_eq!(failing(|m| m.own.errors = [62.0; 2]), [3]);
        assert_eq!(failing(|m| m.by_transport.errors = [51.0; 2]), [4]);
        assert_eq!(failing(|m| m.iterations[1].0 = 1.1), [5]);
        // Noise does not make errors fall.
        assert_eq!(failing(|m| m.ends[0].errors = [20.0, 380.0]), [2, 4]);
    }

    #[test]
    fn ends_that_are_not_consistent_are_found() {
        let ends = |created: f64, row_sums: f64| {
            let of = |links: usize, created: f64, row_sums: f64| EarlyEnd {
                links,
                created,
                row_sums: [row_sums, 0.0],
            };
            failing_checks(|item| judge_early_ends(item, &[of(100, 0.0, 0.2), of(1000, created, row_sums)]))
        };
        assert_eq!(ends(1e-6, 0.1), [0; 0]);
        assert_eq!(ends(-2e-4, 0.1), [0]);
        assert_eq!(ends(0.0, 0.3), [1]);
    }
}
