//! Line and bar charts as SVG, drawn with plotters: axes, grid, lines, bars, labelled points.
//!
//! Colours are CSS variables with fallbacks (`var(--plot-ink, #222)`): a chart inside a page follows the page's light
//! or dark theme, and a file by itself is correct on white.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::{Axis, Scale};
use crate::{Error, Result};

/// Colours of series, in order of use; distinguishable by colour-blind readers (scheme of M. Okabe and K. Ito).
const HUES: [(RGBColor, &str); 5] = [
    (RGBColor(0, 114, 178), "--plot-a"),
    (RGBColor(213, 94, 0), "--plot-b"),
    (RGBColor(0, 158, 115), "--plot-c"),
    (RGBColor(204, 121, 167), "--plot-d"),
    (RGBColor(230, 159, 0), "--plot-e"),
];
const INK: (RGBColor, &str) = (RGBColor(34, 34, 34), "--plot-ink");
const FAINT: (RGBColor, &str) = (RGBColor(221, 221, 222), "--plot-faint");

/// A line chart.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    /// Name and unit of the horizontal axis.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// Scale of the horizontal axis.
    pub x_scale: Scale,
    /// Scale of the vertical axis.
    pub y_scale: Scale,
    /// The vertical axis reaches at least to this value, so that charts can have the same axis; 0 for any.
    pub y_reach: f64,
    /// The series, at most five with different colours.
    pub series: Vec<Series>,
}

impl Plot {
    /// Series over axes with these labels (name and unit) and scales.
    pub fn new(x: (impl Into<String>, Scale), y: (impl Into<String>, Scale), series: Vec<Series>) -> Plot {
        Plot { x_label: x.0.into(), y_label: y.0.into(), x_scale: x.1, y_scale: y.1, y_reach: 0.0, series }
    }
}

/// A series of points.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// The points. Points that an axis cannot show (not finite, or not positive on a logarithmic axis) are omitted.
    pub points: Vec<PlotPoint>,
    /// Style of the points.
    pub marks: Marks,
}

impl Series {
    /// A series with this name.
    pub fn new(name: impl Into<String>, points: Vec<PlotPoint>, marks: Marks) -> Series {
        Series { name: name.into(), points, marks }
    }
}

/// Style of the points of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Marks {
    /// Dots.
    #[default]
    Points,
    /// Dots joined by a line in their order.
    Joined,
    /// A line in their order, without dots.
    Line,
    /// Bars from 0, beside those of the other series with bars.
    Bars,
}

/// A point of a series.
#[derive(Clone, Debug, Default)]
pub struct PlotPoint {
    /// Horizontal value.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Label beside the point; omitted if empty or without free space.
    pub label: String,
}

/// Font size of point labels, pixels.
const LABEL: i32 = 13;

/// Width of a bar and the space after it, pixels.
const BAR: i32 = 18;
/// Margins around the plotting area, pixels: left, top above the legend, right, bottom.
const MARGIN: [i32; 4] = [74, 20, 24, 52];
/// Height of a row of the legend, pixels.
const LEGEND_ROW: i32 = 20;

impl Plot {
    /// The chart as an SVG element of `width` x `height` pixels (at least 200 x 150). Without points that can be
    /// shown, only the axes are drawn.
    ///
    /// # Errors
    /// [`Error::Argument`] if plotters fails, which no input should cause.
    pub fn svg(&self, width: u32, height: u32) -> Result<String> {
        let (width, height) = (width.max(200), height.max(150));
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
            self.draw(&root).map_err(|e| Error::arguments(format!("the plot cannot be drawn: {e}")))?;
        }
        for (colour, name) in HUES.iter().chain([&INK, &FAINT]) {
            let hex = format!("#{:02X}{:02X}{:02X}", colour.0, colour.1, colour.2);
            svg = svg.replace(&format!("\"{hex}\""), &format!("\"var({name}, {hex})\""));
        }
        // plotters writes a view box; with this style a page can scale the chart.
        Ok(svg.replacen("<svg ", "<svg role=\"img\" style=\"height:auto\" ", 1))
    }

    fn draw(&self, root: &Area<'_>) -> Drawn {
        let (width, height) = root.dim_in_pixel();
        let [left, top, right, bottom] = MARGIN;
        let legend = self.legend(width as i32 - 8);
        let top = top + LEGEND_ROW * legend.last().map_or(0, |entry| entry.row + 1);
        let shown = || {
            self.series
                .iter()
                .flat_map(|s| &s.points)
                .filter(|p| self.x_scale.shows(p.x) && self.y_scale.shows(p.y))
        };
        let x = Axis::new(self.x_scale, shown().map(|p| p.x), left, width as i32 - right);
        let reach = Some(self.y_reach).filter(|reach| self.y_scale.shows(*reach));
        let y = Axis::new(self.y_scale, shown().map(|p| p.y).chain(reach), height as i32 - bottom, top);
        self.draw_frame(root, &x, &y)?;
        self.draw_legend(root, &legend)?;
        let mut boxes: Vec<[i32; 4]> = Vec::new();
        for (series, (colour, _)) in self.series.iter().zip(HUES.iter().cycle()) {
            let visible = series.points.iter().filter(|p| x.scale.shows(p.x) && y.scale.shows(p.y));
            let pixels: Vec<(i32, i32)> = visible.map(|p| (x.pixel(p.x), y.pixel(p.y))).collect();
            if series.marks == Marks::Bars {
                self.draw_bars(root, series, *colour, &pixels, y.pixel(0.0))?;
                continue;
            }
            if series.marks != Marks::Points {
                root.draw(&PathElement::new(pixels.clone(), colour.stroke_width(2)))?;
                for pair in pixels.windows(2) {
                    // Boxes along the line keep labels off the line.
                    let along = |t: i32, a: i32, b: i32| a + (b - a) * t / 24;
                    boxes.extend((0..=24).map(|t| {
                        let (u, v) = (along(t, pair[0].0, pair[1].0), along(t, pair[0].1, pair[1].1));
                        [u - 2, v - 2, u + 2, v + 2]
                    }));
                }
            }
            for &(u, v) in pixels.iter().filter(|_| series.marks != Marks::Line) {
                root.draw(&Circle::new((u, v), series.marks.radius(), colour.filled()))?;
                boxes.push([u - 5, v - 5, u + 5, v + 5]);
            }
        }
        let limits = [left, top, width as i32 - 2, height as i32 - bottom];
        self.draw_labels(root, &x, &y, limits, boxes)?;
        root.present()
    }

    /// Draws the bars of a series that end at these pixels.
    fn draw_bars(
        &self,
        root: &Area<'_>,
        series: &Series,
        colour: RGBColor,
        ends: &[(i32, i32)],
        zero: i32,
    ) -> Drawn {
        let barred = || self.series.iter().filter(|s| s.marks == Marks::Bars);
        let before = barred().take_while(|s| !std::ptr::eq(*s, series)).count() as i32;
        let shift = BAR * before - BAR * barred().count() as i32 / 2;
        for &(u, v) in ends {
            // A bar of no height is a line, so that a value of 0 differs from none.
            let corners = [(u + shift, zero.min(v) - 1), (u + shift + BAR - 2, zero.max(v))];
            root.draw(&Rectangle::new(corners, colour.filled()))?;
        }
        Ok(())
    }

    /// Writes the labels of points where there is room; `boxes` is what is drawn already.
    fn draw_labels(
        &self,
        root: &Area<'_>,
        x: &Axis,
        y: &Axis,
        limits: [i32; 4],
        mut boxes: Vec<[i32; 4]>,
    ) -> Drawn {
        // Labels of unconnected points first: they are fewer, and lines identify their unlabelled points.
        let mut order: Vec<_> = self.series.iter().zip(HUES.iter().cycle()).collect();
        order.sort_by_key(|(series, _)| series.marks != Marks::Points);
        for (series, (colour, _)) in order {
            let shown = series.points.iter().filter(|p| x.scale.shows(p.x) && y.scale.shows(p.y));
            for p in shown.filter(|p| !p.label.is_empty()) {
                let (u, v) = (x.pixel(p.x), y.pixel(p.y));
                let Some(rect) = label_place((u, v), &p.label, limits, &boxes) else { continue };
                boxes.push(rect);
                let near = (u.clamp(rect[0], rect[2]), v.clamp(rect[1], rect[3]));
                if (near.0 - u).abs().max((near.1 - v).abs()) > 12 {
                    root.draw(&PathElement::new([(u, v), near], *colour))?;
                }
                text(root, &p.label, (rect[0], (rect[1] + rect[3]) / 2), LABEL, INK.0, HPos::Left)?;
            }
        }
        Ok(())
    }

    /// Draws grid, axes, tick labels and axis names.
    fn draw_frame(&self, root: &Area<'_>, x: &Axis, y: &Axis) -> Drawn {
        let (bottom, top, left, right) = (y.from, y.to, x.from, x.to);
        let mut free = i32::MIN;
        for tick in x.ticks() {
            let u = x.pixel(tick.value);
            root.draw(&PathElement::new([(u, bottom), (u, top)], FAINT.0))?;
            let half = text_width(&tick.label, LABEL) / 2;
            if u - half > free {
                text(root, &tick.label, (u, bottom + 14), LABEL, INK.0, HPos::Center)?;
                free = u + half + 4;
            }
        }
        for tick in y.ticks() {
            let v = y.pixel(tick.value);
            root.draw(&PathElement::new([(left, v), (right, v)], FAINT.0))?;
            text(root, &tick.label, (left - 8, v), LABEL, INK.0, HPos::Right)?;
        }
        root.draw(&PathElement::new([(left, top), (left, bottom), (right, bottom)], INK.0))?;
        // The names of the axes may be as long as the picture is wide or high, centred in it.
        let (width, height) = root.dim_in_pixel();
        let (name, size) = fitted(&self.x_label, 14, width as i32 - 16);
        let half = text_width(&name, size) / 2;
        let centre = ((left + right) / 2).min(width as i32 - 8 - half).max(8 + half);
        text(root, &name, (centre, bottom + 36), size, INK.0, HPos::Center)?;
        let (name, size) = fitted(&self.y_label, 14, bottom - top + MARGIN[3]);
        let upright = ("sans-serif", size).into_font().transform(FontTransform::Rotate270).color(&INK.0);
        let upright = upright.pos(Pos::new(HPos::Center, VPos::Center));
        let half = text_width(&name, size) / 2;
        let centre = ((top + bottom) / 2).min(height as i32 - 4 - half);
        root.draw(&Text::new(name, (16, centre), upright))
    }

    /// Places of the names of the series, in rows of this width.
    fn legend(&self, width: i32) -> Vec<LegendEntry> {
        let (mut u, mut row) = (8, 0);
        let mut entries = Vec::new();
        for series in &self.series {
            let (name, size) = fitted(&series.name, LABEL, width - 33);
            let wide = 25 + text_width(&name, size);
            if u > 8 && u + wide > width {
                (u, row) = (8, row + 1);
            }
            entries.push(LegendEntry { name, size, row, left: u });
            u += wide + 22;
        }
        entries
    }

    /// Draws the names of the series above the plotting area.
    fn draw_legend(&self, root: &Area<'_>, legend: &[LegendEntry]) -> Drawn {
        for ((series, entry), (colour, _)) in self.series.iter().zip(legend).zip(HUES.iter().cycle()) {
            let (u, v) = (entry.left, 16 + LEGEND_ROW * entry.row);
            if matches!(series.marks, Marks::Joined | Marks::Line) {
                root.draw(&PathElement::new([(u, v), (u + 18, v)], colour.stroke_width(2)))?;
            }
            if series.marks == Marks::Bars {
                root.draw(&Rectangle::new([(u + 4, v - 5), (u + 14, v + 5)], colour.filled()))?;
            } else if series.marks != Marks::Line {
                root.draw(&Circle::new((u + 9, v), series.marks.radius(), colour.filled()))?;
            }
            text(root, &entry.name, (u + 25, v), entry.size, INK.0, HPos::Left)?;
        }
        Ok(())
    }
}

impl Marks {
    /// Radius of the dots, pixels.
    fn radius(self) -> i32 {
        if self == Marks::Points { 5 } else { 3 }
    }
}

/// A name in the legend.
struct LegendEntry {
    name: String,
    size: i32,
    row: i32,
    left: i32,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = std::result::Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Writes text, vertically centred at `at`.
fn text(root: &Area<'_>, what: &str, at: (i32, i32), size: i32, colour: RGBColor, horizontal: HPos) -> Drawn {
    let style = ("sans-serif", size).into_font().color(&colour).pos(Pos::new(horizontal, VPos::Center));
    root.draw(&Text::new(what.to_string(), at, style))
}

/// The text and a font size at most `size` so that it is not wider than `width` pixels: smaller down to 10 pixels, then cut.
fn fitted(what: &str, size: i32, width: i32) -> (String, i32) {
    let fits = |what: &str, size: &i32| text_width(what, *size) <= width;
    if let Some(size) = (10..=size).rev().find(|size| fits(what, size)) {
        return (what.to_owned(), size);
    }
    let mut short: Vec<char> = what.chars().collect();
    while short.len() > 1 && !fits(&format!("{}…", short.iter().collect::<String>()), &10) {
        short.pop();
    }
    (format!("{}…", short.into_iter().collect::<String>()), 10)
}

/// Approximate width of a text in pixels: the viewer chooses the font.
fn text_width(what: &str, size: i32) -> i32 {
    (what.chars().count() as i32 * size * 58 + 99) / 100
}

/// A box (left, top, right, bottom) near the point (u, v) in which the label overlaps nothing drawn so far.
fn label_place((u, v): (i32, i32), label: &str, limits: [i32; 4], boxes: &[[i32; 4]]) -> Option<[i32; 4]> {
    let (w, h) = (text_width(label, LABEL), LABEL + 2);
    let corners = [
        (u + 9, v - h / 2),
        (u + 6, v - h - 4),
        (u + 6, v + 5),
        (u - w - 9, v - h / 2),
        (u - w / 2, v - h - 8),
        (u - w / 2, v + 8),
        (u - w - 6, v - h - 4),
        (u - w - 6, v + 5),
    ];
    let overlaps = |a: &[i32; 4], b: &[i32; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    let inside =
        |a: &[i32; 4]| a[0] >= limits[0] && a[1] >= limits[1] && a[2] <= limits[2] && a[3] <= limits[3];
    // No space beside the point: try rings around it; the caller joins point and label by a line.
    let around = (2..6).flat_map(|ring| {
        (0..16).map(move |i| (16.0 * f64::from(ring), f64::from(i) * std::f64::consts::FRAC_PI_8))
    });
    let around = around.map(|(r, angle)| {
        let (du, dv) = ((r * angle.cos()) as i32, (r * angle.sin()) as i32);
        (u + du - if du < 0 { w } else { 0 }, v + dv - h / 2)
    });
    corners
        .into_iter()
        .chain(around)
        .map(|(l, t)| [l, t, l + w, t + h])
        .find(|rect| inside(rect) && !boxes.iter().any(|b| overlaps(rect, b)))
}

#[cfg(test)]
mod tests;
