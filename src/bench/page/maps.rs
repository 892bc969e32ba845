//! Maps: tables and plots.

use maud::{Markup, html};

use crate::Result;
use crate::bench::record::{MapExactRow, MapMrRow, MapRecord};
use crate::page::{Cell, chart, length, seconds, signed, table};
use crate::plot::{Marks, Plot, PlotPoint, Scale, Series, number};

/// All maps; empty without any.
pub(super) fn section(maps: &[MapRecord], unit: &str) -> Result<Markup> {
    if maps.is_empty() {
        return Ok(html! {});
    }
    let articles = maps.iter().map(|map| article(map, unit)).collect::<Result<Vec<_>>>()?;
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

fn article(map: &MapRecord, unit: &str) -> Result<Markup> {
    let exact: Vec<_> = map.best_exact().into_iter().map(exact_row).collect();
    let mr: Vec<_> = map.best_by_size().into_iter().map(|row| mr_row(row, unit)).collect();
    let columns = "s | segments | every | time | set-up | RMS | bias | FBEM | speed-up, same RMS | with set-up | over every texel | with clusters \
         | same FBEM";
    Ok(html! {
        article {
            h3 { (map.receiver) }
            p.note {
                (map.width) " × " (map.height) " texels of " (length(map.texel, unit)) "; reference of "
                (map.reference_rays) " rays a texel, whose noise of " (number(map.reference_rms)) " is subtracted."
            }
            (plot(map, unit)?)
            h4 { "Multi-resolution, the best row of each size" }
            (table(columns, &mr))
            h4 { "Exact, rows that no other surpasses" }
            (table("rays | every | time | set-up | RMS | bias", &exact))
        }
    })
}

/// Spacing of the columns and rows at which light is computed.
fn every(spacing: usize) -> Cell {
    if spacing == 1 { "texel".into() } else { format!("{spacing} texels").into() }
}

fn exact_row(row: &MapExactRow) -> [Cell; 6] {
    measured(row.rays, row.spacing, [row.seconds, row.setup_s], [row.rms, row.bias])
}

/// Segments, spacing, times and errors: columns of both tables.
fn measured(rays: usize, spacing: usize, [time, setup]: [f64; 2], [rms, bias]: [f64; 2]) -> [Cell; 6] {
    [
        rays.into(),
        every(spacing),
        seconds(time).into(),
        seconds(setup).into(),
        number(rms).into(),
        signed(bias).into(),
    ]
}

fn mr_row(row: &MapMrRow, unit: &str) -> [Cell; 13] {
    let speed = |v: Option<f64>| Cell::speedup(v, row.extrapolated);
    let [rays, spacing, time, setup, rms, bias] =
        measured(row.rays, row.spacing, [row.seconds, row.setup_s], [row.rms, row.bias]);
    [
        length(row.feature_size, unit).into(),
        rays,
        spacing,
        time,
        setup,
        rms,
        bias,
        number(row.fbem).into(),
        speed(row.speedup_at_same_rms),
        speed(row.speedup_with_setup),
        Cell::speedup(row.speedup_over_texels, row.texels_extrapolated),
        speed(row.speedup_with_preparation),
        Cell::speedup(row.speedup_at_same_fbem, false),
    ]
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
