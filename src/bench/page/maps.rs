//! Maps: tables and plots.

use maud::{Markup, html};

use crate::Result;
use crate::bench::record::{MapRecord, Record};
use crate::bench::shown;
use crate::page::{chart, length, table};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series};

/// All maps; empty without any.
pub(super) fn section(record: &Record) -> Result<Markup> {
    let maps = &record.maps;
    if maps.is_empty() {
        return Ok(html! {});
    }
    let articles = maps.iter().map(|map| article(map, record)).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        section {
            h2 { "Maps" }
            p {
                "A map shows a whole surface, texel by texel. Both engines may compute the light at every second, fourth or eighth column \
                 and row only and interpolate linearly in between. Each ratio compares with the fastest exact map of the same error, \
                 interpolated or not; “with set-up” includes the preparation of the map, “over every texel” compares the same time with exact \
                 rays that are not interpolated, “with clusters” includes the preparation of the scene as well, which later runs read from \
                 the cache."
            }
            @for article in articles { (article) }
        }
    })
}

fn article(map: &MapRecord, record: &Record) -> Result<Markup> {
    let (unit, [mr, exact]) = (&record.unit, shown::map_rows(map, record));
    Ok(html! {
        article {
            h3 { (map.receiver) }
            p.note { (shown::map(map, unit)) }
            (plot(map, unit)?)
            h4 { "Multi-resolution, the best row of each size" }
            (table(mr.0, &mr.1))
            h4 { "Exact, rows that no other surpasses" }
            (table(exact.0, &exact.1))
        }
    })
}

/// Error against time of exact rows, interpolated and not, and of the shown MR rows.
fn plot(map: &MapRecord, unit: &str) -> Result<Markup> {
    let rays = |n: usize| if n == 1 { "1 ray".to_string() } else { format!("{n} rays") };
    let exact = |interpolated: bool| -> Vec<PlotPoint> {
        let rows = map.exact.iter().filter(|row| row.interpolated == interpolated);
        rows.map(|row| PlotPoint { x: row.seconds, y: row.rms, label: rays(row.rays) }).collect()
    };
    let mr = map.best_by_size().into_iter().map(|row| {
        let label = format!("s = {}", length(row.feature_size, unit));
        PlotPoint { x: row.seconds, y: row.rms, label }
    });
    let plot = Plot::new(
        ("time of queries and interpolation, seconds", Scale::Log),
        ("error (RMS of the visible fraction)", Scale::Log),
        vec![
            Series::new("exact", exact(false), Marks::Joined),
            Series::new("exact, interpolated", exact(true), Marks::Points),
            Series::new("multi-resolution", mr.collect(), Marks::Points),
        ],
    );
    chart(&plot, 340, "Error against time of one map, both axes logarithmic: lower left is better.")
}
