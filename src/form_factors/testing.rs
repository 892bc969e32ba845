//! Published form factors, for tests.

use super::analytic::polygon_to_polygon;
use glam::DVec3;

fn rows(text: &'static str) -> Vec<csv::StringRecord> {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
    reader.records().map(|row| row.expect("a row")).collect()
}

/// Rows of pairs with nothing between them whose names begin with `prefix`: name, numbers of the geometry, form factor.
pub fn unobstructed(prefix: &str) -> Vec<(String, [f64; 4], f64)> {
    let mut found = rows(include_str!("../../tests/validation/viewfactors_unobstructed.csv"));
    found.retain(|row| row[0].starts_with(prefix));
    assert!(!found.is_empty(), "no row {prefix}");
    let values = |row: &csv::StringRecord| {
        let geometry = std::array::from_fn(|k| row[2 + k].parse().unwrap_or(f64::NAN));
        (row[0].to_owned(), geometry, row[6].parse().expect("a factor"))
    };
    found.iter().map(values).collect()
}

/// Value of a partly blocked pair: the first column that has one.
pub fn obstructed(id: &str, quantity: &str) -> f64 {
    let rows = rows(include_str!("../../tests/validation/viewfactors_obstructed.csv"));
    let row = rows.iter().find(|row| &row[0] == id && &row[2] == quantity).expect("the row is there");
    row[5].parse().or_else(|_| row[3].parse()).expect("a number")
}

/// A parallelogram by a corner and two edges.
pub fn quad(corner: DVec3, u: DVec3, v: DVec3) -> Vec<DVec3> {
    vec![corner, corner + u, corner + u + v, corner + v]
}

/// Form factor of two rectangles of these sides that face each other at a distance.
pub fn opposed_rectangles([a, b]: [f64; 2], gap: f64) -> f64 {
    let (x, y) = (a * DVec3::X, b * DVec3::Y);
    polygon_to_polygon(&quad(DVec3::ZERO, x, y), &quad(gap * DVec3::Z, y, x))
}
