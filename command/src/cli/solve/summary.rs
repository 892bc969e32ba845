//! The record of a solution as text.

use super::super::args::grouped;
use super::super::values::{ENGINES, name_of};
use super::{Luminous, Reported, grids};
use mrvis::internals::bench::side_by_side::{ComparedRecord, SideBySide};
use mrvis::internals::plot::number;
use mrvis::internals::radiosity::{Ledger, Record};
use std::fmt::Write as _;

/// The record as text.
pub fn summary(reported: &Reported) -> String {
    let Reported { compared: ComparedRecord { record: r, versus }, photometric, at_points, grids, .. } =
        reported;
    let s = &r.seconds;
    let [elements, links, rays] =
        [(r.elements, "element"), (r.links, "link"), (r.exact_rays as usize, "exact ray")]
            .map(|(count, noun)| format!("{} {noun}{}", grouped(count), if count == 1 { "" } else { "s" }));
    let mut text = format!("{elements}, {links}, {rays}\n");
    // Writing to a string cannot fail.
    if r.scene.up_from.starts_with("guessed") {
        let _ = writeln!(text, "{} up ({}; --up y or --up z sets it)", r.scene.up, r.scene.up_from);
    }
    for line in &r.scene.sky {
        let _ = writeln!(text, "{line}");
    }
    if r.unlit.sides > 0 {
        let ([sides, of], area) = ([r.unlit.sides, r.unlit.of].map(grouped), 100.0 * r.unlit.area);
        let _ = writeln!(text, "{sides} of {of} sides, {area:.1} % of the surface, are reached by no light");
    }
    let _ = writeln!(
        text,
        "reading {:.2} s, Embree {:.2} s, clusters {:.2} s, optics {:.2} s, elements {:.2} s, links {:.2} s, local pass {:.2} s, points {:.2} s",
        s.load, s.embree, s.hierarchy, s.characterise, s.elements, s.solve, s.local, s.points
    );
    energy(&mut text, r, photometric);
    text += &grids::lines(at_points.as_ref(), grids, r);
    if let Some(v) = versus {
        text += &side_by_side(r, v);
    }
    if let Some(a) = &r.audit {
        let _ = writeln!(
            text,
            "error bars, checked by independent paths at {} elements: on {:.0} % of the area light lies within one error bar, on {:.0} % within two",
            a.elements,
            100.0 * a.within_one,
            100.0 * a.within_two
        );
    }
    for warning in &r.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// Powers, and the mean irradiance of lit surfaces.
fn energy(text: &mut String, r: &Record, photometric: &Option<Luminous>) {
    let l = &r.ledger;
    let photometry = photometric.as_ref().map(|l| l.photometry);
    let (powers, unit) = l.shown(photometry);
    // Direct light at points needs no light of elements.
    let has_elements = !powers.absorbed.is_nan();
    if has_elements {
        // Sums err by the rounding of 64 bits.
        let shown = |p: f64| number(if p.abs() <= Ledger::ROUNDING * powers.emitted { 0.0 } else { p });
        let [emitted, absorbed, escaped, wrong] =
            [powers.emitted, powers.absorbed, powers.escaped, powers.created.abs()]
                .map(|p| format!("{} {unit}", shown(p)));
        let error = format!("{} by error {wrong}", if powers.created < 0.0 { "lost" } else { "created" });
        let of = if photometry.is_none() { " (mean of the channels)" } else { "" };
        let _ = writeln!(text, "emitted {emitted}, absorbed {absorbed}, escaped {escaped}, {error}{of}");
        if !r.scene.sky.is_empty() {
            let part = |power: f64| number(100.0 * power / l.emitted.max(f64::MIN_POSITIVE));
            let [sky, sun] = [l.sky, l.sun].map(part);
            let _ = writeln!(text, "of this {sky} % come from the sky, {sun} % from the sun");
        }
        let [red, green, blue] = r.mean_irradiance.map(number);
        let estimate = match r.error_estimate {
            Some(estimate) => {
                format!(
                    "; estimated error of elements {} % of that{}{}",
                    number(100.0 * estimate),
                    upper(r),
                    unchecked(r)
                )
            }
            None => "; error unknown".into(),
        };
        let estimate = if r.options.elements { estimate } else { String::new() };
        let is_radiometric = photometry.is_none_or(|of| !of.holds_lumens());
        if is_radiometric {
            let _ = writeln!(
                text,
                "mean irradiance of lit surfaces {red}, {green}, {blue} W/m\u{b2} (red, green, blue){estimate}"
            );
        }
        if let Some(l) = photometric {
            let estimate = if is_radiometric { "" } else { &estimate };
            let mean = number(l.mean_illuminance_lx);
            let _ = writeln!(text, "mean illuminance of lit surfaces {mean} lx{estimate}");
        }
    }
}

/// Times and results of both engines.
fn side_by_side(r: &Record, v: &SideBySide) -> String {
    let name = |engine| name_of(ENGINES, engine);
    let mut text = format!(
        "{:<9}{:>11}{:>11}{:>11}{:>11}{:>11}{:>12}\n",
        "", "set-up s", "light s", "points s", "all s", "links", "exact rays"
    );
    for (engine, s, links, rays) in [
        (r.options.engine, &r.seconds, r.links, r.bundles.exact_rays),
        (v.engine, &v.seconds, v.links, v.bundles.exact_rays),
    ] {
        let (solve, points) = (s.elements + s.solve + s.local, s.points);
        let (name, setup, all) = (name(engine), s.embree + s.hierarchy + s.characterise, s.work());
        let [links, rays] = [links, rays as usize].map(grouped);
        let _ = writeln!(
            text,
            "{name:<9}{setup:>11.2}{solve:>11.2}{points:>11.2}{all:>11.2}{links:>11}{rays:>12}"
        );
    }
    let (own, other) = (name(r.options.engine), name(v.engine));
    let _ = writeln!(
        text,
        "{other} took {:.2} times as long as {own}; at the points {own} differs from it by {} % (RMS), {} % in the mean",
        v.speedup,
        number(100.0 * v.difference.rms),
        number(100.0 * v.difference.bias)
    );
    text
}

/// What is said of an estimate that no independent paths have checked, as after a time limit.
fn unchecked(record: &Record) -> &'static str {
    match record.audit {
        Some(_) => "",
        None => " (by the error bars, which independent paths have not checked)",
    }
}

/// The upper end of the estimate's interval, if it has one.
fn upper(record: &Record) -> String {
    record.error_estimate_upper.map_or_else(String::new, |upper| {
        format!(" (at most {} % with 95 % probability)", number(100.0 * upper))
    })
}
