//! Grids of measuring points over surfaces, `--grid`.

use super::super::args::{distinct, plain};
use super::AtPoints;
use maud::{Markup, html};
use mrvis::internals::error::quote;
use mrvis::internals::export::GridLight;
use mrvis::internals::image_io::Picture;
use mrvis::internals::page::{TableCell, data_url, table};
use mrvis::internals::plot::number;
use mrvis::internals::points::Point;
use mrvis::internals::radiosity::Record;
use mrvis::internals::scene::{MeasuringGrid, Photometry};
use mrvis::{Result, Scene};
use serde::Serialize;

/// A grid as it is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct GridArg {
    surface: String,
    spacing: f64,
    height: f64,
}

impl std::str::FromStr for GridArg {
    type Err = String;

    /// From `SURFACE:SPACING[:HEIGHT]`; names may contain colons.
    fn from_str(text: &str) -> Result<GridArg, String> {
        let last = |text: &str| -> Option<(String, f64)> {
            let (rest, number) = text.rsplit_once(':')?;
            Some((rest.to_owned(), number.trim().parse().ok().filter(|n: &f64| n.is_finite())?))
        };
        let Some((rest, number)) = last(text) else {
            return Err("write SURFACE:SPACING or SURFACE:SPACING:HEIGHT, such as floor:0.5:0.75".into());
        };
        let (surface, spacing, height) = match last(&rest) {
            Some((surface, spacing)) => (surface, spacing, number),
            None => (rest, number, 0.0),
        };
        if spacing <= 0.0 {
            return Err("the spacing must be above 0".into());
        }
        if height < 0.0 {
            return Err("the height must be at least 0: points lie above the lit side of the surface".into());
        }
        Ok(GridArg { surface, spacing, height })
    }
}

/// The grids of a command, with the points of all.
#[derive(Default)]
pub struct Grids(Vec<(GridArg, MeasuringGrid)>);

/// A grid and its light, for the JSON.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredGrid {
    /// The object, group or material.
    pub name: String,
    /// Largest distance of neighbouring points as asked for, scene units.
    pub spacing: f64,
    /// Height above the surface, scene units.
    pub height: f64,
    pub columns: usize,
    pub rows: usize,
    /// Direction that the points face.
    pub normal: [f64; 3],
    #[serde(flatten)]
    pub light: AtPoints,
}

impl Grids {
    /// The grids over surfaces of a scene.
    ///
    /// # Errors
    /// A surface is unknown or not plane, or a grid has no points or too many.
    pub fn of(asked: &[GridArg], scene: &Scene) -> Result<Grids> {
        let grid = |asked: &GridArg| {
            let GridArg { surface, spacing, height } = asked;
            let grid = scene.measuring_grid(surface, *spacing, *height)?;
            Ok((asked.clone(), grid))
        };
        asked.iter().map(grid).collect::<Result<_>>().map(Grids)
    }

    /// The points of all grids.
    pub fn points(&self) -> impl Iterator<Item = Point> {
        let points = |grid: &MeasuringGrid| {
            let normal = grid.normal;
            grid.points.clone().into_iter().map(move |position| Point { position, normal })
        };
        self.0.iter().flat_map(move |(_, grid)| points(grid))
    }

    /// Names of their pictures.
    pub fn pictures(&self) -> Vec<String> {
        let names = self.0.iter().map(|(asked, _)| format!("grid-{}", plain(&asked.surface)));
        distinct(names).into_iter().map(|name| name + ".png").collect()
    }

    /// Each grid with its light and its picture. `irradiance`: of all their points, W/m².
    pub fn measured(
        &self,
        mut irradiance: &[[f64; 3]],
        photometry: Option<Photometry>,
    ) -> Vec<(MeasuredGrid, Picture)> {
        let mut measured = Vec::new();
        for (asked, grid) in &self.0 {
            let (own, rest) = irradiance.split_at(grid.points.len());
            irradiance = rest;
            let Some(light) = AtPoints::of(own, photometry) else { continue };
            let [columns, rows] = grid.counts;
            let mut values = vec![None; columns * rows];
            for (&cell, e) in grid.cells.iter().zip(own) {
                values[cell] = Some(AtPoints::value(*e, photometry) as f32);
            }
            let picture = GridLight { counts: grid.counts, steps: grid.steps, values }.picture(light.unit);
            let GridArg { surface: name, spacing, height } = asked.clone();
            let normal = grid.normal.to_array();
            measured.push((MeasuredGrid { name, spacing, height, columns, rows, normal, light }, picture));
        }
        measured
    }
}

/// The section of the page about grids with these pictures, empty without grids; `unit`: of lengths.
///
/// # Errors
/// A picture has no pixels.
pub fn section(grids: &[MeasuredGrid], pictures: &[Picture], unit: &str) -> Result<Markup> {
    let Some(first) = grids.first() else { return Ok(Markup::default()) };
    let [height, mean] = [format!("height {unit}"), format!("mean {}", first.light.unit)];
    let columns = format!("surface | points | {height} | minimum | {mean} | maximum | uniformity U0");
    let row = |MeasuredGrid { name, height, columns, rows, light, .. }: &MeasuredGrid| {
        let [minimum, mean, maximum] =
            [light.minimum, light.mean, light.maximum].map(|light| TableCell::from(number(light)));
        let uniformity = light.uniformity.map_or_else(String::new, |u| format!("{u:.2}"));
        let [points, height] = [format!("{columns} × {rows}"), number(*height)];
        [TableCell::words(name), points.into(), height.into(), minimum, mean, maximum, uniformity.into()]
    };
    let rows: Vec<_> = grids.iter().map(row).collect();
    let urls = pictures.iter().map(data_url).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        section {
            h2 { "Grids of points" }
            (table(&columns, &rows))
            p.note {
                "Uniformity U0 is the minimum divided by the mean (EN 12464). Isolines are at the limits of the colours."
                @for MeasuredGrid { name, light, .. } in grids.iter().filter(|grid| grid.light.dark > 0) {
                    " " (light.dark_in_words()) " on " (name) " (below or inside of things?)."
                }
            }
            div.views {
                @for (MeasuredGrid { name, height, light, .. }, url) in grids.iter().zip(&urls) {
                    figure {
                        div.frame { img src=(url) alt=(format!("light on the grid of {name}")); }
                        figcaption {
                            b { (name) } " in " (light.unit)
                            @if *height > 0.0 { ", " (number(*height)) " " (unit) " above the surface" }
                        }
                    }
                }
            }
        }
    })
}

/// The lines of the summary about the points of a file and about grids.
pub fn lines(points: Option<&AtPoints>, grids: &[MeasuredGrid], record: &Record) -> String {
    let grid = |grid: &MeasuredGrid| {
        let MeasuredGrid { name, height, columns, rows, light, .. } = grid;
        let above = match *height {
            0.0 => String::new(),
            height => format!(", {} {} above it", number(height), record.unit),
        };
        format!("grid `{}` of {columns} x {rows}{above}: {}", quote(name), light.words())
    };
    let error = record.points_error.map(|error| {
        let [rms, upper] = [error.rms, error.rms_upper].map(|e| number(100.0 * e));
        let found = match error.rms > error.detection_limit {
            true => format!("{rms} % of their mean"),
            false => {
                format!("below {rms} % of their mean: the paths that check it have this noise themselves")
            }
        };
        format!("estimated error at all points {found} (at most {upper} % with 95 % probability)")
    });
    let lines = points.map(AtPoints::words).into_iter().chain(grids.iter().map(grid));
    lines.chain(error).map(|line| line + "\n").collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_lists_grids_and_shows_their_pictures() {
        let picture = || Picture { width: 1, height: 1, pixels: vec![[7; 3]] };
        let light = AtPoints {
            count: 32,
            unit: "lx",
            minimum: 120.0,
            mean: 300.0,
            maximum: 456.0,
            dark: 2,
            uniformity: Some(0.4),
        };
        let desk = MeasuredGrid {
            name: "desk <a>".into(),
            spacing: 0.5,
            height: 0.75,
            columns: 8,
            rows: 4,
            normal: [0.0, 0.0, 1.0],
            light,
        };
        let dark = MeasuredGrid { name: "dark".into(), height: 0.0, ..desk.clone() };
        let page = section(&[desk, dark], &[picture(), picture()], "m").expect("a section").into_string();
        assert_eq!(page.matches("data:image/png;base64,").count(), 2);
        let parts = ["desk &lt;a&gt;", "8 × 4", "height m", "120", "mean lx", "456", "0.40", "0.75 m above"];
        for part in parts {
            assert!(page.contains(part), "lacks {part}");
        }
        assert!(section(&[], &[], "m").expect("nothing").into_string().is_empty());
    }

    #[test]
    fn surface_spacing_and_height_are_read_from_the_end() {
        let grid = |surface: &str, spacing, height| GridArg { surface: surface.into(), spacing, height };
        for (text, want) in [
            ("floor:0.5", grid("floor", 0.5, 0.0)),
            ("floor:0.5:0.75", grid("floor", 0.5, 0.75)),
            ("a:b:1", grid("a:b", 1.0, 0.0)),
            ("a: b:1:2", grid("a: b", 1.0, 2.0)),
        ] {
            assert_eq!(text.parse(), Ok(want), "{text}");
        }
        for (text, words) in [
            ("floor", "SURFACE:SPACING"),
            ("floor:x", "SURFACE:SPACING"),
            ("floor:0", "above 0"),
            ("floor:-1:0", "above 0"),
            ("floor:1:-1", "height"),
            ("floor:1:nan", "SURFACE:SPACING"),
        ] {
            let error = text.parse::<GridArg>().expect_err(text);
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
