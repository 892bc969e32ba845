//! Light on grids of points: pictures and their numbers.

use crate::Result;
use crate::image_io::Picture;
use crate::page::{Cell, data_url, table};
use crate::plot::number;
use maud::{Markup, html};

/// A grid of the page.
pub struct PageGrid<'a> {
    /// The object, group or material.
    pub name: &'a str,
    /// Number of points along its sides.
    pub counts: [usize; 2],
    /// Height above the surface, scene units.
    pub height: f64,
    /// Unit of the light.
    pub unit: &'a str,
    /// Smallest, mean and largest light.
    pub light: [f64; 3],
    /// Minimum divided by mean.
    pub uniformity: Option<f64>,
    /// The light in false colours.
    pub picture: &'a Picture,
}

/// The section of the page; empty without grids. `unit`: of lengths.
///
/// # Errors
/// A picture has no pixels.
pub fn grid_section(grids: &[PageGrid], unit: &str) -> Result<Markup> {
    let Some(first) = grids.first() else { return Ok(Markup::default()) };
    let [height, mean] = [format!("height {unit}"), format!("mean {}", first.unit)];
    let columns = format!("surface | points | {height} | minimum | {mean} | maximum | uniformity U0");
    let row = |grid: &PageGrid| {
        let [minimum, mean, maximum] = grid.light.map(|light| Cell::from(number(light)));
        let points = format!("{} × {}", grid.counts[0], grid.counts[1]);
        let uniformity = grid.uniformity.map_or_else(String::new, |u| format!("{u:.2}"));
        let height = number(grid.height).into();
        [Cell::words(grid.name), points.into(), height, minimum, mean, maximum, uniformity.into()]
    };
    let rows: Vec<_> = grids.iter().map(row).collect();
    let urls = grids.iter().map(|grid| Ok((grid, data_url(grid.picture)?))).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        section {
            h2 { "Grids of points" }
            (table(&columns, &rows))
            p.note { "Uniformity U0 is the minimum divided by the mean (EN 12464). Isolines are at the limits of the colours." }
            div.views {
                @for (grid, url) in &urls {
                    figure {
                        div.frame { img src=(url) alt=(format!("light on the grid of {}", grid.name)); }
                        figcaption { b { (grid.name) } " in " (grid.unit) ", " (number(grid.height)) " " (unit) " above the surface" }
                    }
                }
            }
        }
    })
}
