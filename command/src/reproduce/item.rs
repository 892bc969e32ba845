//! Item of the paper: the claim, pictures, charts and tables made here, and a verdict of checks.

use super::fixed;
use mrvis::internals::image_io::{Picture, grey};
use mrvis::internals::plot::Plot;
use mrvis::internals::raster::BitImage;
use mrvis::metrics::Image;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

/// A figure, table or section of the paper, reproduced.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Item {
    /// Name on the command line.
    pub name: &'static str,
    /// Heading.
    pub title: &'static str,
    /// What the paper states.
    pub claim: &'static str,
    /// What was built and measured here, and how it differs from the paper.
    pub here: String,
    /// What this run leaves out.
    pub warnings: Vec<String>,
    /// Rows of pictures.
    pub pictures: Vec<PictureRow>,
    /// Rows of charts.
    pub charts: Vec<ChartRow>,
    /// Tables.
    pub tables: Vec<Table>,
    /// The verdict: it holds if all checks hold.
    pub checks: Vec<Check>,
    /// Whether all checks hold.
    pub holds: bool,
    /// Whether the checks are goals of this program; otherwise they are what the paper states or what follows from it.
    pub of_program: bool,
    /// Seconds that the item took.
    pub seconds: f64,
}

/// A statement that is computed from numbers, and can fail.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// The statement.
    pub statement: String,
    /// The numbers that decide.
    pub measured: String,
    /// Whether the statement holds.
    pub holds: bool,
    /// Why it does not hold; none if it holds.
    pub reason: Option<String>,
    /// Whether the numbers are times or depend on them, and vary from run to run.
    pub timed: bool,
}

/// Pictures with one colour scale.
#[derive(Clone, Debug, Serialize)]
pub struct PictureRow {
    /// Heading with the colour scale.
    pub title: String,
    /// The pictures.
    pub panels: Vec<Panel>,
}

/// A picture with its caption.
#[derive(Clone, Debug, Serialize)]
pub struct Panel {
    /// The picture.
    #[serde(skip)]
    pub picture: Picture,
    /// Caption.
    pub caption: String,
}

/// Charts that belong together.
#[derive(Clone, Debug, Serialize)]
pub struct ChartRow {
    /// Heading, may be empty.
    pub title: String,
    /// The charts.
    pub charts: Vec<Chart>,
}

/// A chart with its caption.
#[derive(Clone, Debug)]
pub struct Chart {
    /// The chart.
    pub plot: Plot,
    /// Caption.
    pub caption: String,
}

/// The series of a chart as numbers.
#[derive(Serialize)]
struct Points<'a> {
    name: &'a str,
    points: Vec<[f64; 2]>,
}

impl Serialize for Chart {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let series = self.plot.series.iter();
        let series: Vec<Points> = series
            .map(|s| Points { name: &s.name, points: s.points.iter().map(|p| [p.x, p.y]).collect() })
            .collect();
        let mut map = serializer.serialize_map(Some(4))?;
        map.serialize_entry("caption", &self.caption)?;
        map.serialize_entry("x", &self.plot.x_label)?;
        map.serialize_entry("y", &self.plot.y_label)?;
        map.serialize_entry("series", &series)?;
        map.end()
    }
}

/// Name of the colour scale of visible fractions.
pub const VISIBLE: &str = "visible fraction of the light: black 0, white 1";
/// Name of the colour scale of features.
pub const FEATURES: &str = "features: black";

impl Item {
    /// An item without results. `here`: what was built and measured.
    pub fn of(here: impl Into<String>) -> Item {
        Item { here: here.into(), ..Item::default() }
    }

    /// Adds a check of numbers, with the reason that is given if it does not hold.
    pub fn check(
        &mut self,
        statement: impl Into<String>,
        measured: impl Into<String>,
        holds: bool,
        reason: impl FnOnce() -> String,
    ) {
        let (statement, measured) = (statement.into(), measured.into());
        let reason = (!holds).then(reason);
        self.checks.push(Check { statement, measured, holds, reason, timed: false });
    }

    /// Adds a check of numbers that depend on measured times.
    pub fn check_time(
        &mut self,
        statement: impl Into<String>,
        measured: impl Into<String>,
        holds: bool,
        reason: impl FnOnce() -> String,
    ) {
        self.check(statement, measured, holds, reason);
        if let Some(check) = self.checks.last_mut() {
            check.timed = true;
        }
    }

    /// Adds a row of pictures.
    pub fn row(&mut self, title: impl Into<String>, panels: Vec<Panel>) {
        self.pictures.push(PictureRow { title: title.into(), panels });
    }

    /// Adds a chart.
    pub fn chart(&mut self, plot: Plot, caption: impl Into<String>) {
        let charts = vec![Chart { plot, caption: caption.into() }];
        self.charts.push(ChartRow { title: String::new(), charts });
    }

    /// Number of checks that do not hold.
    pub fn missed(&self) -> usize {
        self.checks.iter().filter(|check| !check.holds).count()
    }

    /// The verdict in one word.
    pub fn verdict(&self) -> &'static str {
        match (self.holds, self.of_program) {
            (true, _) => "holds",
            (false, false) => "not confirmed",
            (false, true) => "goal missed",
        }
    }
}

impl Check {
    /// The statement that does not hold, with the numbers and the reason.
    pub fn failure(&self) -> String {
        let mut text = format!("not so: {}", self.statement);
        if !self.measured.is_empty() {
            text += &format!(" ({})", self.measured);
        }
        if let Some(reason) = &self.reason {
            text += &format!(": {reason}");
        }
        text
    }
}

impl Panel {
    /// An image of visible fractions.
    pub fn visible(image: &Image, caption: impl Into<String>) -> Panel {
        Panel { picture: grey(image, 1.0), caption: caption.into() }
    }

    /// An image of values up to `white`.
    pub fn scaled(image: &Image, white: f32, caption: impl Into<String>) -> Panel {
        Panel { picture: grey(image, white), caption: caption.into() }
    }

    /// A binary image: object pixels are black.
    pub fn binary(image: &BitImage, caption: impl Into<String>) -> Panel {
        let (width, height) = (image.width(), image.height());
        let pixel = |i: usize| if image.get(i % width, i / width) { [0; 3] } else { [255; 3] };
        let pixels = (0..width * height).map(pixel).collect();
        Panel { picture: Picture { width, height, pixels }, caption: caption.into() }
    }
}

/// Indices of the checks that fail of an item that is judged so.
#[cfg(test)]
pub fn failing_checks(judge: impl Fn(&mut Item)) -> Vec<usize> {
    let mut item = Item::default();
    judge(&mut item);
    (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
}

/// A table.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// The columns.
    pub columns: Vec<Column>,
    /// The rows.
    pub rows: Vec<Vec<Cell>>,
}

/// A column of a table.
#[derive(Clone, Debug, Serialize)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Unit of its numbers; empty for words and counts.
    pub unit: String,
}

/// A cell of a table.
#[derive(Clone, Debug)]
pub enum Cell {
    /// Words.
    Words(String),
    /// A number, and digits after its point on the page.
    Number(f64, usize),
}

impl Table {
    /// An empty table. Names of columns stand between vertical bars, and may end in a comma and a unit.
    pub fn new(title: impl Into<String>, columns: &str) -> Table {
        let column = |label: &str| {
            let (name, unit) = label.rsplit_once(", ").unwrap_or((label, ""));
            Column { name: name.into(), unit: unit.into() }
        };
        let columns = columns.split(" | ").map(column).collect();
        Table { title: title.into(), columns, rows: Vec::new() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        self.rows.push(row.into_iter().collect());
    }
}

impl Column {
    /// Name and unit.
    pub fn label(&self) -> String {
        match self.unit.as_str() {
            "" => self.name.clone(),
            unit => format!("{}, {unit}", self.name),
        }
    }
}

impl Cell {
    /// Text of the cell on the page.
    pub fn text(&self) -> String {
        match self {
            Cell::Words(words) => words.clone(),
            Cell::Number(value, digits) => fixed(*value, *digits),
        }
    }
}

/// A cell with a number, shown with this number of digits after the point.
pub fn number(value: f64, digits: usize) -> Cell {
    Cell::Number(value, digits)
}

/// A cell with a count.
pub fn count(n: usize) -> Cell {
    Cell::Number(n as f64, 0)
}

impl From<String> for Cell {
    fn from(words: String) -> Cell {
        Cell::Words(words)
    }
}

impl From<&str> for Cell {
    fn from(words: &str) -> Cell {
        Cell::Words(words.into())
    }
}

impl Serialize for Cell {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Cell::Words(words) => serializer.serialize_str(words),
            Cell::Number(value, _) => serializer.serialize_f64(*value),
        }
    }
}
