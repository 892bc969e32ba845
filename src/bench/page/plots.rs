//! Plots of the page.

use maud::Markup;

use crate::Result;
use crate::bench::record::{ExactRow, Record};
use crate::metrics::{Fbem, Image};
use crate::page::{chart, length};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};

/// Error against time of each row, both axes logarithmic.
pub(super) fn error_against_time(record: &Record) -> Result<Markup> {
    let rays = |n: usize| if n == 1 { "1 ray".to_string() } else { format!("{n} rays") };
    let points = |rows: &[ExactRow]| -> Vec<PlotPoint> {
        rows.iter().map(|row| PlotPoint { x: row.seconds, y: row.rms, label: rays(row.rays) }).collect()
    };
    let mut series = vec![Series::new("exact", points(&record.exact), Marks::Joined)];
    if !record.certified.is_empty() {
        let points = points(&record.certified);
        series.push(Series::new("exact with certificates", points, Marks::Joined));
    }
    for row in record.shown_rows() {
        let name = format!("multi-res., {} segments", row.rays);
        let label = format!("s = {}", length(row.feature_size, &record.unit));
        let point = PlotPoint { x: row.seconds, y: row.rms, label };
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series::new(name, vec![point], Marks::Points)),
        }
    }
    let plot = Plot::new(
        ("time of the queries, seconds", Scale::Log),
        ("error (RMS of the visible fraction)", Scale::Log),
        series,
    );
    chart(
        &plot,
        460,
        "Both axes are logarithmic. The lines show exact visibility with increasing numbers of rays from each point to \
         each emitter. A multi-resolution point below and to the left of both lines is faster at the same error: time of \
         the faster line at the height of the point, divided by the time of the point, is the speed-up at the same error.",
    )
}

/// Spectrum (FBEM over feature size) of the exact image of 16 rays, and FBEM of each MR image at its own size.
pub(super) fn spectrum(exact: &[Fbem], mr: &[Fbem], unit: &str) -> Result<Markup> {
    let point = |row: &Fbem| PlotPoint { x: row.size, y: row.value, label: String::new() };
    let series =
        |name: &str, rows: &[Fbem], marks| Series::new(name, rows.iter().map(point).collect(), marks);
    let plot = Plot::new(
        (format!("feature size s, {unit}"), Scale::Linear),
        ("feature-based error FBEM(s)", Scale::Linear),
        vec![
            series("exact, 16 rays", exact, Marks::Joined),
            series("multi-resolution, each image at its own s", mr, Marks::Points),
        ],
    );
    chart(
        &plot,
        340,
        "Feature-based error by feature size: at s = 0 the RMS error, further right the error of features larger than s \
         and of averages.",
    )
}

/// Visible fraction along a row of texels: reference, exact with 16 rays, multi-resolution.
pub(super) fn cross_section(images: [&Image; 3], row: usize, unit: &str) -> Result<Markup> {
    let series =
        images.iter().zip(["reference", "exact, 16 rays", "multi-resolution"]).map(|(image, name)| {
            let at = |x: usize| PlotPoint {
                x: (x as f64 + 0.5) * image.texel(),
                y: f64::from(image.at(x, row)),
                label: String::new(),
            };
            Series::new(name, (0..image.width()).map(at).collect(), Marks::Line)
        });
    let plot = Plot::new(
        (format!("place along row {row} of the texels, {unit}"), Scale::Linear),
        ("visible fraction", Scale::Linear),
        series.collect(),
    );
    chart(&plot, 240, "Cross-section through the largest difference.")
}
