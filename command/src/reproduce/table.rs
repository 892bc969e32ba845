//! Tables of an item: words and numbers, which are rounded on the page and not in the record.

use super::fixed;
use serde::{Serialize, Serializer};

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
    /// What the page shows.
    pub fn text(&self) -> String {
        match self {
            Cell::Words(words) => words.clone(),
            Cell::Number(value, digits) => fixed(*value, *digits),
        }
    }
}

/// A cell with a number, of which the page shows so many digits after the point.
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
