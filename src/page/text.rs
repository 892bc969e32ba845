//! Numbers as people read them.

use crate::plot::number;

/// The last part of a path.
pub fn file_name(path: &str) -> &str {
    let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
    if name.is_empty() { "unnamed scene" } else { name }
}

/// A ratio such as `27×`; a dash if unknown.
pub fn times(value: Option<f64>) -> String {
    match value {
        Some(v) if !v.is_finite() => "–".into(),
        Some(v) if v >= 100.0 => format!("{v:.0}×"),
        Some(v) if v >= 10.0 => format!("{v:.1}×"),
        Some(v) => format!("{v:.2}×"),
        None => "–".into(),
    }
}

/// A fraction in per cent, with at least two significant digits.
pub fn percent(part: f64) -> String {
    format!("{}\u{a0}%", number(100.0 * part))
}

/// A length with its unit.
pub fn length(value: f64, unit: &str) -> String {
    format!("{}\u{a0}{unit}", number(value))
}

/// A number with its sign.
pub fn signed(v: f64) -> String {
    if v > 0.0 { format!("+{}", number(v)) } else { number(v).replace('-', "−") }
}

/// A count with digits in groups of three.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().filter_map(|g| std::str::from_utf8(g).ok()).collect();
    groups.join("\u{202f}")
}

/// A time in seconds or milliseconds.
pub fn seconds(s: f64) -> String {
    if s != 0.0 && s.abs() < 0.1 { format!("{} ms", number(1000.0 * s)) } else { format!("{} s", number(s)) }
}

/// Memory in a suitable unit.
pub fn bytes(n: u64) -> String {
    let n = n as f64;
    match n {
        n if n < 1e3 => format!("{n} B"),
        n if n < 1e6 => format!("{} kB", number(n / 1e3)),
        n if n < 1e9 => format!("{} MB", number(n / 1e6)),
        n => format!("{} GB", number(n / 1e9)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_written_for_people() {
        assert_eq!(count(1234567).replace('\u{202f}', " "), "1 234 567");
        assert_eq!((count(0), count(999)), ("0".into(), "999".into()));
        assert_eq!(
            (seconds(0.0123), seconds(2.0), seconds(0.0)),
            ("12.3 ms".into(), "2 s".into(), "0 s".into())
        );
        assert_eq!((bytes(12), bytes(45_600_000)), ("12 B".into(), "45.6 MB".into()));
        assert_eq!((signed(0.5), signed(-0.25)), ("+0.5".into(), "−0.25".into()));
    }
}
