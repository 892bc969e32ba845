//! A row of the table of all jobs.

use serde_json::{Map, Value};

/// Values by the names of their columns.
pub type Row = Map<String, Value>;

/// A value in a cell of text.
pub fn cell(value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
    }
}
