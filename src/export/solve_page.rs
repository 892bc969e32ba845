//! `solution.html`: the light of a scene on one page.
//!
//! Pictures, the irradiance in false colours with its scale, where the emitted power goes, whether the error bars are
//! right, and where the time went.

mod audit;
mod flow;
#[cfg(any(test, feature = "internals"))]
mod grids;
mod surfaces;
#[cfg(test)]
mod tests;

use super::false_colours::{Bands, hatched};
use crate::Result;
use crate::error::{own_word, worded};
use crate::image_io::Picture;
use crate::page::{bytes, count, data_url, document, figure, file_name, percent, properties, seconds};
use crate::plot::number;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::{Record, Seconds};
use crate::scene::{Photometry, Scene};
#[cfg(any(test, feature = "internals"))]
pub use grids::{PageGrid, grid_section};
use maud::{Markup, html};
#[cfg(any(test, feature = "internals"))]
pub use surfaces::{SurfaceLight, surfaces};

/// More notes than this are at the end of the page: the pictures come first.
const SHORT_NOTES: usize = 3;

/// How irradiance is shown: in W/m², the mean of the channels, or in lux.
#[derive(Clone, Copy)]
struct Shown(Option<Photometry>);

impl Shown {
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
    /// What each pixel shows.
    pub seen: Vec<Seen>,
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// No surface.
    Nothing,
    /// A surface that emits: what it receives is not to be seen.
    Emitter,
    /// A surface with this irradiance, W/m².
    Surface([f32; 3]),
}

/// The page as HTML, in lux with `photometry`. `grids` is the section on grids of points; `command` is the command line that repeats the run, if there is one.
///
/// # Errors
/// A picture has no pixels.
pub fn solve_page(
    record: &Record,
    (scene, photometry, solution): (&Scene, Option<Photometry>, &RadiosityMesh),
    (views, grids): (&[PageView], &Markup),
    command: &str,
) -> Result<String> {
    let name = file_name(&record.scene.path);
    let shown = Shown(photometry);
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
        (surfaces::section(scene, shown, solution))
        (audit::section(record)?)
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

fn headline(record: &Record, name: &str, shown: Shown) -> Markup {
    let (light, unit) = (shown.of(record.mean_irradiance), shown.unit());
    let [red, green, blue] = record.mean_irradiance.map(number);
    let (powers, unit_of_power) = record.ledger.shown(shown.0);
    html! {
        header {
            p.kicker { "Light in a scene" }
            h1 { (name) }
            p.lead {
                "All surfaces together emit " strong { (number(powers.emitted)) " " (unit_of_power) }
                " and receive " strong { (number(light)) " " (unit) } " in the mean."
            }
            div.figures {
                (figure(&format!("{} {unit}", number(light)), &format!("mean {}", shown.name())))
                @if let Some(error) = record.error_estimate {
                    (figure(&percent(error), "estimated RMS error of the elements, of the mean"))
                }
                (figure(&seconds(record.seconds.load + record.seconds.work() + record.seconds.audit), "time, all stages"))
            }
            p.note {
                @if shown.0.is_none() { "Irradiance is the mean of the channels; red" } @else { "Red" }
                ", green and blue are " (red) ", " (green) " and " (blue) " W/m² in the mean."
            }
            @if record.warnings.len() > SHORT_NOTES {
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
        @if record.warnings.len() > SHORT_NOTES {
            section {
                h2 { "Notes" }
                @for warning in &record.warnings { p.note { (worded(warning, own_word)) } }
            }
        }
    }
}

fn pictures(views: &[PageView], shown: Shown) -> Result<Markup> {
    let light = |seen: &Seen| match seen {
        Seen::Surface(e) => Some(shown.of(e.map(f64::from)) as f32),
        Seen::Nothing | Seen::Emitter => None,
    };
    let lights: Vec<Vec<Option<f32>>> =
        views.iter().map(|view| view.seen.iter().map(light).collect()).collect();
    let with_emitters = views.iter().any(|view| view.seen.contains(&Seen::Emitter));
    let bands = Bands::of(lights.iter().flatten().flatten().copied());
    let mut figures = Vec::new();
    for (view, light) in views.iter().zip(&lights) {
        let mut coloured = bands.picture(view.picture.width, light);
        for (k, colour) in
            coloured.pixels.iter_mut().enumerate().filter(|(k, _)| view.seen[*k] == Seen::Emitter)
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
        ("local pass", s.local),
        ("points", s.points),
        ("audit", s.audit),
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
