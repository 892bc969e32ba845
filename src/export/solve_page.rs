//! `solution.html`: the light of a scene on one page.
//!
//! Pictures, the irradiance in false colours with its scale, where the emitted power goes, whether the error bars are
//! right, and where the time went.

mod flow;
#[cfg(test)]
mod tests;

use super::false_colours::{Bands, hatched};
use crate::Result;
use crate::error::{own_word, worded};
use crate::image_io::Picture;
use crate::page::{
    TableCell, bytes, chart, count, data_url, document, figure, file_name, percent, properties, seconds,
    table,
};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{Record, Seconds};
use crate::scene::{Photometry, Scene};
use maud::{Markup, html};
use serde::Serialize;
use std::collections::HashMap;

/// More notes than this are at the end of the page: the pictures come first.
const MAX_NOTES_AT_TOP: usize = 3;

/// Unit of irradiance on the page: W/m² (mean of the channels), or lux with a photometry.
#[derive(Clone, Copy)]
struct LightUnit(Option<Photometry>);

impl LightUnit {
    fn unit(self) -> &'static str {
        if self.0.is_some() { "lx" } else { "W/m²" }
    }

    fn name(self) -> &'static str {
        if self.0.is_some() { "illuminance" } else { "irradiance" }
    }

    fn legend(self) -> &'static str {
        match self.0 {
            Some(_) => "Illuminance in lx:",
            None => "Irradiance in W/m², mean of the channels:",
        }
    }

    fn of(self, light: [f64; 3]) -> f64 {
        self.0.map_or_else(|| light.iter().sum::<f64>() / 3.0, |photometry| photometry.of(light))
    }
}

/// A picture of the page.
#[derive(Clone, Debug)]
pub struct PageView {
    /// Name of the camera.
    pub name: String,
    /// The tone-mapped picture.
    pub picture: Picture,
    /// Content of each pixel.
    pub seen: Vec<PixelContent>,
}

/// Content of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelContent {
    /// No surface.
    Nothing,
    /// A surface that emits: its irradiance is not shown.
    Emitter,
    /// A surface with this irradiance, W/m².
    Surface([f32; 3]),
}

/// The page as HTML, in lux with `photometry`. `grids` is the section on grids of points; `command` is the command line that repeats the
/// run, if there is one.
///
/// # Errors
/// A picture has no pixels.
pub fn solve_page(
    record: &Record,
    scene: &Scene,
    photometry: Option<Photometry>,
    solution: &RadiosityMesh,
    views: &[PageView],
    grids: &Markup,
    command: &str,
) -> Result<String> {
    let name = file_name(&record.scene.path);
    let shown = LightUnit(photometry);
    let body = html! {
        (headline(record, name, shown))
        section {
            h2 { "Pictures" }
            (pictures(views, shown)?)
        }
        (grids)
        section {
            h2 { "Where the light goes" }
            (flow::section(&record.ledger, shown, scene, solution))
        }
        (surface_section(scene, shown, solution))
        (error_bars(record)?)
        section {
            h2 { "Where the time goes" }
            (stages(&record.seconds))
        }
        section {
            h2 { "Scene and solution" }
            div.columns { (scene_properties(record)) (solution_properties(record)) }
        }
        (notes(record))
        footer {
            h2 { "To repeat this" }
            p {
                "mrvis " (record.mrvis) " · Embree " (record.embree) " · " (record.threads) " "
                (if record.threads == 1 { "thread" } else { "threads" }) " · seed " (record.options.seed)
                " · lengths in " (record.unit)
            }
            @if !command.is_empty() { pre { (command) } }
        }
    };
    Ok(document(&format!("mrvis solve: {name}"), &body))
}

fn headline(record: &Record, name: &str, shown: LightUnit) -> Markup {
    let (light, unit) = (shown.of(record.mean_irradiance), shown.unit());
    let [red, green, blue] = record.mean_irradiance.map(number);
    let (powers, unit_of_power) = record.ledger.shown(shown.0);
    html! {
        header {
            p.kicker { "Light in a scene" }
            h1 { (name) }
            p.lead {
                "All sources together emit " strong { (number(powers.emitted)) " " (unit_of_power) }
                "; surfaces receive " strong { (number(light)) " " (unit) } " in the mean."
            }
            div.figures {
                (figure(&format!("{} {unit}", number(light)), &format!("mean {}", shown.name())))
                @if let Some(error) = record.error_estimate {
                    (figure(&percent(error), "estimated RMS error of the elements, relative to the mean"))
                }
                (figure(&seconds(record.seconds.load + record.seconds.work() + record.seconds.audit), "time, all stages"))
            }
            p.note {
                @if shown.0.is_none() { "Irradiance is the mean of the channels; red" } @else { "Red" }
                ", green and blue are " (red) ", " (green) " and " (blue) " W/m² in the mean."
            }
            @if record.warnings.len() > MAX_NOTES_AT_TOP {
                p.warning { (record.warnings.len()) " notes are at the end of this page." }
            } @else {
                @for warning in &record.warnings { p.warning { (worded(warning, own_word)) } }
            }
        }
    }
}

/// All notes, if they are too many for the head of the page.
fn notes(record: &Record) -> Markup {
    html! {
        @if record.warnings.len() > MAX_NOTES_AT_TOP {
            section {
                h2 { "Notes" }
                @for warning in &record.warnings { p.note { (worded(warning, own_word)) } }
            }
        }
    }
}

fn pictures(views: &[PageView], shown: LightUnit) -> Result<Markup> {
    let light = |seen: &PixelContent| match seen {
        PixelContent::Surface(e) => Some(shown.of(e.map(f64::from)) as f32),
        PixelContent::Nothing | PixelContent::Emitter => None,
    };
    let lights: Vec<Vec<Option<f32>>> =
        views.iter().map(|view| view.seen.iter().map(light).collect()).collect();
    let with_emitters = views.iter().any(|view| view.seen.contains(&PixelContent::Emitter));
    let bands = Bands::of(lights.iter().flatten().flatten().copied());
    let mut figures = Vec::new();
    for (view, light) in views.iter().zip(&lights) {
        let mut coloured = bands.picture(view.picture.width, light);
        for (k, colour) in
            coloured.pixels.iter_mut().enumerate().filter(|(k, _)| view.seen[*k] == PixelContent::Emitter)
        {
            *colour = hatched([k % view.picture.width, k / view.picture.width]);
        }
        figures.push(html! {
            div.views {
                figure {
                    div.frame { img src=(data_url(&view.picture)?) alt=(format!("picture of {}", view.name)); }
                    figcaption { b { (view.name) } " tone-mapped" }
                }
                figure {
                    div.frame { img src=(data_url(&coloured)?) alt=(format!("{} of {}", shown.name(), view.name)); }
                    figcaption { b { (shown.name()) } " of the surfaces that are seen" }
                }
            }
        });
    }
    Ok(html! {
        @if views.is_empty() { p { "The scene has no surface to show." } }
        @for figure in figures { (figure) }
        @if !views.is_empty() { (bands.legend(shown.legend(), with_emitters)) }
    })
}

/// All stages that took time, the slowest first, as bars.
fn stages(s: &Seconds) -> Markup {
    let mut stages = vec![
        ("reading the scene", s.load),
        ("Embree's tree", s.embree),
        ("clusters", s.hierarchy),
        ("measuring clusters", s.characterise),
        ("elements", s.elements),
        ("links and light", s.solve),
        ("light by rays", s.local),
        ("points", s.points),
        ("check of the errors", s.audit),
    ];
    let all: f64 = stages.iter().map(|stage| stage.1).sum::<f64>().max(f64::MIN_POSITIVE);
    stages.retain(|stage| stage.1 > 0.005 * all);
    stages.sort_by(|a, b| b.1.total_cmp(&a.1));
    let longest = stages.first().map_or(1.0, |stage| stage.1);
    html! {
        div.stages {
            @for (name, time) in &stages {
                div.stage {
                    div { (name) }
                    div.track { span style=(format!("width:{:.1}%", 100.0 * time / longest)) {} }
                    div.time { (seconds(*time)) ", " (percent((time / all * 100.0).round() / 100.0)) }
                }
            }
        }
        p.note { "All stages took " (seconds(all)) "; those of less than half a per cent are not shown." }
    }
}

fn scene_properties(record: &Record) -> Markup {
    let scene = &record.scene;
    properties(
        "Scene",
        &[
            ("triangles", count(scene.triangles as u64)),
            ("objects", count(scene.objects as u64)),
            ("emitters", count(scene.emitters as u64)),
            ("sides without light", count(record.unlit.sides as u64)),
        ],
    )
}

fn solution_properties(record: &Record) -> Markup {
    properties(
        "Solution",
        &[
            ("elements", count(record.elements as u64)),
            ("links", count(record.links as u64)),
            ("exact rays", count(record.exact_rays)),
            ("memory of elements and links", bytes(record.bytes as u64)),
        ],
    )
}

/// Fraction of normally distributed errors within 1/4, 2/4, … 12/4 standard deviations: erf(k/4 / √2).
const NORMAL: [f64; 12] =
    [0.1974, 0.3829, 0.5467, 0.6827, 0.7887, 0.8664, 0.9199, 0.9545, 0.9756, 0.9876, 0.9940, 0.9973];

/// Verdict on the fraction of the errors within one error bar; deviations up to twice its standard deviation count as chance.
fn verdict(elements: usize, within_one: f64) -> &'static str {
    let chance = 2.0 * (NORMAL[3] * (1.0 - NORMAL[3]) / elements as f64).sqrt();
    match within_one - NORMAL[3] {
        more if more > chance => "the bars are cautious, and most errors are smaller than they say",
        less if less < -chance => "the bars are too narrow, and errors are larger than they say",
        _ => "the bars say how large errors are",
    }
}

/// Plot and words; empty without an audit.
fn error_bars(record: &Record) -> Result<Markup> {
    let Some(audit) = record.audit.as_ref().filter(|audit| audit.elements > 0) else { return Ok(html! {}) };
    let series = |name: &str, parts: &[f64; 12], marks| {
        Series::new(
            name,
            parts
                .iter()
                .enumerate()
                .map(|(k, &y)| PlotPoint { x: 0.25 * (k + 1) as f64, y, label: String::new() })
                .collect(),
            marks,
        )
    };
    let plot = Plot::new(
        ("error, in error bars", Scale::Linear),
        ("part of the elements", Scale::Linear),
        vec![
            series("normal distribution", &NORMAL, Marks::Line),
            series("elements of the audit", &audit.within_quarters, Marks::Points),
        ],
    );
    let chart = chart(
        &plot,
        320,
        "Fraction of the audited elements whose error is at most this multiple of the error bar. Points above the line: the \
        bars are wider than the errors; below: too narrow.",
    )?;
    Ok(html! {
        section {
            h2 { "Are the error bars right?" }
            p {
                "The light of " (audit.elements) " elements, drawn by area, light and error bars, was computed again by independent paths of \
                 exact rays. " (percent(audit.within_one)) " of their errors lie within one error bar and "
                (percent(audit.within_two)) " within two (68 and 95 % for a normal distribution): " (verdict(audit.elements, audit.within_one)) ". The error of the \
                 whole solution above comes from the same paths."
            }
            (chart)
        }
    })
}

/// Number of surfaces that are listed, the largest: two screens.
const MAX_SURFACES: usize = 50;

/// Light of the elements on one side of the faces of an object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SurfaceLight {
    /// The object.
    pub name: String,
    /// `front` or `back`: sheets have both.
    pub side: &'static str,
    /// Area of the elements, scene units squared.
    pub area: f64,
    /// lx, or W/m² (mean of the channels).
    pub unit: &'static str,
    /// Mean over the area.
    pub mean: f64,
    /// Light of the darkest element.
    pub minimum: f64,
    /// Light of the brightest element.
    pub maximum: f64,
}

/// The light of the fronts of all objects, and of the backs that light reaches; the 50 of the largest area, in descending order.
pub fn surfaces(
    scene: &Scene,
    photometry: Option<Photometry>,
    solution: &RadiosityMesh,
) -> Vec<SurfaceLight> {
    let shown = LightUnit(photometry);
    let mut sides: HashMap<(u32, bool), [f64; 4]> = HashMap::new();
    for e in &solution.elements {
        let light = shown.of(e.irradiance);
        let [area, power, minimum, maximum] =
            sides.entry((e.object, e.front)).or_insert([0.0, 0.0, f64::INFINITY, 0.0]);
        *area += e.area;
        *power += e.area * light;
        *minimum = minimum.min(light);
        *maximum = maximum.max(light);
    }
    let is_listed = |((_, front), [area, .., maximum]): &((u32, bool), [f64; 4])| {
        *area > 0.0 && (*front || *maximum > 0.0)
    };
    let mut sides: Vec<_> = sides.into_iter().filter(is_listed).collect();
    sides.sort_by(|(a, [s, ..]), (b, [t, ..])| t.total_cmp(s).then((a.0, !a.1).cmp(&(b.0, !b.1))));
    let of = |((object, front), [area, power, minimum, maximum]): ((u32, bool), [f64; 4])| {
        let name = scene.objects.get(object as usize).map_or_else(String::new, |o| o.name.clone());
        let side = if front { "front" } else { "back" };
        SurfaceLight { name, side, area, unit: shown.unit(), mean: power / area, minimum, maximum }
    };
    sides.into_iter().take(MAX_SURFACES).map(of).collect()
}

/// The table.
fn surface_section(scene: &Scene, shown: LightUnit, solution: &RadiosityMesh) -> Markup {
    let surfaces = surfaces(scene, shown.0, solution);
    let (name, area) = (format!("mean {}", shown.unit()), format!("area {}²", scene.unit));
    let columns = format!("object | side | {area} | {name} | minimum | maximum");
    let row = |s: &SurfaceLight| {
        [
            TableCell::words(&s.name),
            TableCell::words(s.side),
            number(s.area).into(),
            number(s.mean).into(),
            number(s.minimum).into(),
            number(s.maximum).into(),
        ]
    };
    let rows: Vec<_> = surfaces.iter().map(row).collect();
    html! {
        section {
            h2 { "Light by surface" }
            (table(&columns, &rows))
            p.note {
                (capital(shown.name())) " of the elements of each object, the mean weighted by their area"
                @if rows.len() == MAX_SURFACES { "; the " (count(MAX_SURFACES as u64)) " largest surfaces" }
                "."
            }
        }
    }
}

fn capital(text: &str) -> String {
    text.chars().take(1).flat_map(char::to_uppercase).chain(text.chars().skip(1)).collect()
}
