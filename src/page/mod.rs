//! Pages: what the pages of `bench` and `solve` share.
//!
//! A page is one file without references to other files or to the network: pictures are inline PNG and SVG. It fits
//! into any width from 320 pixels: wide tables become lists of names and values, and every chart is drawn twice, for
//! wide and for narrow windows; the style sheet shows one of them.

use crate::image_io::Picture;
use crate::plot::{Plot, number};
use crate::{Result, error::is_obeyed};
use base64::Engine;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// Width of a chart in wide and in narrow windows, pixels: the text column of a wide page, and that of a telephone.
const CHART_WIDTHS: [u32; 2] = [860, 360];
/// Height of a narrow chart: enough for its legend and six tick marks.
const NARROW_CHART_HEIGHT: u32 = 340;

/// An HTML document with this title and body.
pub fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { (body) } }
        }
    };
    page.into_string().replace(|c| is_obeyed(c) && !matches!(c, '\n' | '\r' | '\t'), "")
}

/// A short table of names and values under a heading.
pub fn properties(title: &str, rows: &[(&str, String)]) -> Markup {
    html! {
        div.properties {
            h3 { (title) }
            dl { @for (name, value) in rows { div { dt { (name) } dd { (value) } } } }
        }
    }
}

/// A large figure with its meaning.
pub fn figure(value: &str, what: &str) -> Markup {
    html! { div.figure { div.value { (value) } div.what { (what) } } }
}

/// A cell of a [`table`].
#[derive(Clone, Debug)]
pub struct TableCell {
    text: String,
    class: Option<&'static str>,
}

impl TableCell {
    /// The cell, marked as a loss if `loss`.
    pub fn loss(self, loss: bool) -> TableCell {
        TableCell { class: if loss { Some("loss") } else { self.class }, ..self }
    }

    /// A speed-up, a loss if it is below 1, marked if it is an estimate.
    pub fn speedup(value: Option<f64>, is_estimate: bool) -> TableCell {
        let about = if is_estimate { "~" } else { "" };
        TableCell::from(format!("{about}{}", times(value))).loss(value.is_some_and(|v| v < 1.0))
    }

    /// A cell of words, aligned left; it may be long.
    pub fn words(text: impl Into<String>) -> TableCell {
        TableCell { text: text.into(), class: Some("text") }
    }
}

impl<T: ToString> From<T> for TableCell {
    fn from(value: T) -> TableCell {
        TableCell { text: value.to_string(), class: None }
    }
}

/// A table. The headings of its columns stand between vertical bars. In windows too narrow for its columns each row is a list of headings
/// and values.
pub fn table(columns: &str, rows: &[impl AsRef<[TableCell]>]) -> Markup {
    let rows: Vec<&[TableCell]> = rows.iter().map(AsRef::as_ref).collect();
    let count = columns.split(" | ").count();
    debug_assert!(rows.iter().all(|row| row.len() == count), "a heading for each column");
    // More columns than this do not fit into a tablet.
    let class = if count > 6 { "rows many" } else { "rows" };
    html! {
        table class=(class) {
            thead {
                tr {
                    @for (k, name) in columns.split(" | ").enumerate() {
                        th scope="col" class=[rows.first().and_then(|row| row[k].class.filter(|c| *c == "text"))] { (name) }
                    }
                }
            }
            tbody {
                @for row in &rows {
                    tr { @for (cell, name) in row.iter().zip(columns.split(" | ")) { td class=[cell.class] data-name=(name) { (cell.text) } } }
                }
            }
        }
    }
}

/// Text of a page for a terminal: with spaces that break lines, and digits in groups as in other texts.
pub fn text_of(text: &str) -> String {
    text.replace('\u{a0}', " ").replace('\u{202f}', ",")
}

/// A table as lines of text. A heading with a comma takes two lines.
pub fn text_table(columns: &str, rows: &[Vec<TableCell>]) -> String {
    let headings: Vec<[&str; 2]> = (columns.split(" | "))
        .map(|name| name.split_once(", ").map_or(["", name], |(first, second)| [first, second]))
        .collect();
    let heading = |line: usize| headings.iter().map(|heading| heading[line].to_owned()).collect();
    let mut lines: Vec<Vec<String>> = vec![heading(0), heading(1)];
    lines.retain(|line| line.iter().any(|name| !name.is_empty()));
    lines.extend(rows.iter().map(|row| row.iter().map(|cell| text_of(&cell.text)).collect()));
    let is_words =
        |k: usize| rows.first().is_some_and(|row: &Vec<TableCell>| k > 0 && row[k].class == Some("text"));
    let width = |k: usize| lines.iter().map(|line| line[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..headings.len()).map(width).collect();
    let line = |line: &Vec<String>| {
        let cells =
            line.iter().zip(&widths).enumerate().map(|(k, (cell, &width))| match k == 0 || is_words(k) {
                true => format!("{cell:<width$}"),
                false => format!("{cell:>width$}"),
            });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    lines.iter().map(line).collect()
}

/// A chart with its caption; `height` in wide windows, pixels.
///
/// # Errors
/// The chart cannot be drawn.
pub fn chart(plot: &Plot, height: u32, caption: &str) -> Result<Markup> {
    let [wide, narrow] = [(CHART_WIDTHS[0], height), (CHART_WIDTHS[1], NARROW_CHART_HEIGHT)]
        .map(|(width, height)| plot.svg(width, height));
    let (wide, narrow) = (wide?, narrow?);
    Ok(html! {
        figure.plot {
            div.wide { (PreEscaped(wide)) }
            div.narrow { (PreEscaped(narrow)) }
            figcaption { (caption) }
        }
    })
}

/// A chart of the width of a narrow window with its caption, to stand beside others.
///
/// # Errors
/// The chart cannot be drawn.
pub fn small_chart(plot: &Plot, caption: &str) -> Result<Markup> {
    let svg = plot.svg(CHART_WIDTHS[1], NARROW_CHART_HEIGHT)?;
    Ok(html! { figure.plot { (PreEscaped(svg)) figcaption { (caption) } } })
}

/// A picture as the address of inline PNG.
///
/// # Errors
/// The picture has no pixels.
pub fn data_url(picture: &Picture) -> Result<String> {
    Ok(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(picture.png()?)))
}

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
