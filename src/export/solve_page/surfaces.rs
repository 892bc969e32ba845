//! The light of each object: mean, smallest and largest.

use super::Shown;
use crate::page::{Cell, count, table};
use crate::plot::number;
use crate::radiosity::mesh::RadiosityMesh;
use crate::scene::{Photometry, Scene};
use maud::{Markup, html};
use serde::Serialize;
use std::collections::HashMap;

/// Number of surfaces that are listed, the largest.
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
    /// Of the darkest element.
    pub minimum: f64,
    /// Of the brightest element.
    pub maximum: f64,
}

/// The light of the fronts of all objects, and of the backs that light reaches; the 50 of the largest area, in descending order.
pub fn surfaces(
    scene: &Scene,
    photometry: Option<Photometry>,
    solution: &RadiosityMesh,
) -> Vec<SurfaceLight> {
    let shown = Shown(photometry);
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
pub(super) fn section(scene: &Scene, shown: Shown, solution: &RadiosityMesh) -> Markup {
    let surfaces = surfaces(scene, shown.0, solution);
    let (name, area) = (format!("mean {}", shown.unit()), format!("area {}²", scene.unit));
    let columns = format!("object | side | {area} | {name} | minimum | maximum");
    let row = |s: &SurfaceLight| {
        [
            Cell::words(&s.name),
            Cell::words(s.side),
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
