//! What an item of the paper consists of: the claim, pictures, charts and tables made here, and a verdict of checks.

use crate::image_io::{Picture, grey};
use crate::metrics::Image;
use crate::plot::Plot;
use crate::raster::BitImage;
use serde::Serialize;

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
    /// Rows of pictures.
    pub pictures: Vec<PictureRow>,
    /// Charts.
    #[serde(skip)]
    pub charts: Vec<Chart>,
    /// Tables.
    pub tables: Vec<Table>,
    /// The verdict: it holds if all checks hold.
    pub checks: Vec<Check>,
    /// Whether all checks hold.
    pub holds: bool,
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
    /// Whether the numbers are times, which vary from run to run.
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

/// A chart with its caption.
#[derive(Clone, Debug)]
pub struct Chart {
    /// The chart.
    pub plot: Plot,
    /// Caption.
    pub caption: String,
}

/// A table.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// The rows.
    pub rows: Vec<Vec<String>>,
}

/// Names of the colour scales.
pub const VISIBLE: &str = "visible fraction of the light: black 0, white 1";
/// Black and white pictures of features.
pub const FEATURES: &str = "features: black";

impl Item {
    /// Adds a check of numbers.
    pub fn check(&mut self, statement: impl Into<String>, measured: impl Into<String>, holds: bool) {
        let (statement, measured) = (statement.into(), measured.into());
        self.checks.push(Check { statement, measured, holds, timed: false });
    }

    /// Adds a check of times.
    pub fn check_time(&mut self, statement: impl Into<String>, measured: impl Into<String>, holds: bool) {
        self.check(statement, measured, holds);
        self.checks.iter_mut().last().into_iter().for_each(|check| check.timed = true);
    }

    /// Adds a row of pictures.
    pub fn row(&mut self, title: impl Into<String>, panels: Vec<Panel>) {
        self.pictures.push(PictureRow { title: title.into(), panels });
    }
}

impl Table {
    /// An empty table.
    pub fn new(title: impl Into<String>, columns: &[&str]) -> Table {
        let columns = columns.iter().map(|&name| name.into()).collect();
        Table { title: title.into(), columns, rows: Vec::new() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: impl IntoIterator<Item = String>) {
        self.rows.push(row.into_iter().collect());
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
