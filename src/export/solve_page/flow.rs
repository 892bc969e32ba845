//! The energy ledger as a flow: the emitted power at the top divides into what materials absorb and what escapes.

use super::LightUnit;
use crate::page::percent;
use crate::plot::number;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{Ledger, Powers};
use crate::scene::Scene;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// Number of materials with a stream of their own, those that absorb most: with more, labels would overlap. The others share one
/// stream.
const MAX_MATERIALS: usize = 4;
/// Colours of streams: classes of the style sheet.
const COLOURS: [&str; 7] =
    ["stream-a", "stream-b", "stream-c", "stream-d", "stream-e", "stream-rest", "stream-error"];
/// Width and height of the drawing, and gap between the ends of streams, its own units.
const SIZE: [f64; 2] = [1000.0, 240.0];
const GAP: f64 = 14.0;

/// A part of the emitted power, as a stream of the diagram.
#[derive(Clone, Debug, PartialEq)]
struct Flow {
    name: String,
    power: f64,
    colour: &'static str,
}

/// Diagram and numbers.
pub(super) fn section(ledger: &Ledger, shown: LightUnit, scene: &Scene, solution: &RadiosityMesh) -> Markup {
    let (powers, unit) = ledger.shown(shown.0);
    if powers.emitted <= 0.0 {
        return html! { p { "No surface emits light." } };
    }
    let streams = streams(&powers, shown, scene, solution);
    html! {
        p { "Of " strong { (number(powers.emitted)) " " (unit) } " that are emitted:" }
        (PreEscaped(drawing(&streams)))
        div.streams {
            @for stream in &streams {
                div {
                    span class=(format!("swatch {}", stream.colour)) {}
                    span.name { (stream.name) }
                    span.power { (number(stream.power)) " " (unit) ", " (percent(stream.power / powers.emitted)) }
                }
            }
        }
        p.note {
            "The difference of what is received and what is sent, " (number(powers.created)) " " (unit)
            ", is an error of the solution. "
            @if let Some(sums) = ledger.row_sums.and_then(sums) {
                "The form factors of an element from which no light leaves the scene should sum to 1, and sum to " (sums) "."
            }
        }
    }
}

/// Smallest and largest sum of form factors; none if both are as they should be.
fn sums(sums: [f64; 2]) -> Option<String> {
    match sums.map(number) {
        [low, high] if low != high => Some(format!("{low} to {high}")),
        [one, _] => (one != "1").then_some(one),
    }
}

/// Absorption by material, the largest first, then what escapes and what is lost by error.
fn streams(powers: &Powers<f64>, shown: LightUnit, scene: &Scene, solution: &RadiosityMesh) -> Vec<Flow> {
    let mut absorbed = vec![0.0; scene.materials.len()];
    for e in &solution.elements {
        let part = shown.of([0, 1, 2].map(|c| (1.0 - f64::from(e.albedo[c])) * e.irradiance[c]));
        if let Some(absorbed) = absorbed.get_mut(e.material as usize) {
            *absorbed += e.area * part;
        }
    }
    let all = absorbed.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut order: Vec<usize> = (0..absorbed.len()).filter(|&m| absorbed[m] > 0.0).collect();
    order.sort_by(|&a, &b| absorbed[b].total_cmp(&absorbed[a]));
    let power = |share: f64| share / all * powers.absorbed;
    let mut streams = Vec::new();
    let mut add = |name: String, power: f64, colour: &'static str| {
        if power > 0.0 {
            streams.push(Flow { name, power, colour });
        }
    };
    for (&m, colour) in order.iter().zip(COLOURS).take(MAX_MATERIALS) {
        add(format!("absorbed by {}", scene.materials[m].name), power(absorbed[m]), colour);
    }
    let others = &order[order.len().min(MAX_MATERIALS)..];
    let name = match others {
        [one] => format!("absorbed by {}", scene.materials[*one].name),
        _ => format!("absorbed by {} other materials", others.len()),
    };
    add(name, power(others.iter().map(|&m| absorbed[m]).sum()), COLOURS[4]);
    add("escaped from the scene".into(), powers.escaped, COLOURS[5]);
    add("lost by error".into(), -powers.created, COLOURS[6]);
    streams
}

/// Streams from one bar at the top to bars with gaps at the bottom, as wide as their power.
fn drawing(streams: &[Flow]) -> String {
    let [width, height] = SIZE;
    let all: f64 = streams.iter().map(|s| s.power).sum();
    let gaps = GAP * streams.len().saturating_sub(1) as f64;
    let (scale, bar) = ((width - gaps) / all, 12.0);
    let (mut top, mut bottom) = (0.5 * gaps, 0.0);
    let mut svg = format!(
        "<svg class=\"flow\" viewBox=\"0 0 {width} {height}\" preserveAspectRatio=\"none\" role=\"img\" \
         aria-label=\"flow of power\"><rect x=\"{top:.1}\" width=\"{:.1}\" height=\"{bar}\" class=\"stream-all\"/>",
        width - gaps
    );
    for Flow { power, colour, .. } in streams {
        let wide = power * scale;
        let (a, b, m, end) = (bar, height - bar, 0.5 * height, bottom + wide);
        // Writing to a string cannot fail.
        let _ = write!(
            svg,
            "<path d=\"M{top:.1} {a}C{top:.1} {m} {bottom:.1} {m} {bottom:.1} {b}H{end:.1}C{end:.1} {m} {right:.1} {m} {right:.1} {a}Z\" \
             class=\"{colour}\" fill-opacity=\".45\"/><rect x=\"{bottom:.1}\" y=\"{b}\" width=\"{wide:.1}\" height=\"{bar}\" class=\"{colour}\"/>",
            right = top + wide
        );
        top += wide;
        bottom += wide + GAP;
    }
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_told_if_they_are_wrong() {
        assert_eq!(sums([0.99999, 1.00001]), None);
        assert_eq!(sums([0.98, 1.0]), Some("0.98 to 1".into()));
        assert_eq!(sums([1.02, 1.02]), Some("1.02".into()));
    }

    #[test]
    fn streams_are_as_wide_as_their_power() {
        let stream = |power| Flow { name: String::new(), power, colour: "red" };
        let svg = drawing(&[stream(3.0), stream(1.0)]);
        let widths: Vec<f64> =
            svg.split("width=\"").skip(1).filter_map(|w| w.split('"').next()?.parse().ok()).collect();
        assert_eq!(widths, [986.0, 739.5, 246.5]);
    }
}
