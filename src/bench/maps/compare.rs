//! Rows of a map: errors, and speed-ups over the fastest exact row with the same error.

use super::{Made, Map, Planned};
use crate::Result;
use crate::bench::context::PlannedRow;
use crate::bench::record::{Build, MapExactRow, MapMrRow, MapRecord, interpolate_log_log, ratio, speedup};
use crate::metrics::Image;
use crate::metrics::fbem::fbem_at;

impl Map<'_> {
    /// Image and errors of the light of all texels.
    pub(super) fn made(&self, texels: Vec<f32>, aggregated: f64) -> Result<Made> {
        let (rms, bias) = self.reference.errors(&texels);
        let image = Image::new(self.grid.width, self.grid.height, self.grid.texel, texels)?;
        Ok(Made { image, rms, bias, aggregated })
    }

    /// The record from all rows, and those that were measured with their times.
    pub(super) fn record(
        &self,
        rows: &[Planned],
        measured: &[(&Planned, &Made, f64)],
        build: &Build,
    ) -> Result<MapRecord> {
        let exact: Vec<(usize, MapExactRow, &Made)> = measured
            .iter()
            .filter_map(|&(row, made, seconds)| {
                let Planned::Exact { lattice, rays, setup_s, .. } = *row else { return None };
                let spacing = self.lattices[lattice].0;
                let (interpolated, rms, bias) = (spacing > 1, made.rms, made.bias);
                let row = MapExactRow { rays, spacing, interpolated, seconds, setup_s, rms, bias };
                Some((lattice, row, made))
            })
            .collect();
        let mut mr = Vec::new();
        let mut found = measured.iter().filter(|(row, ..)| !matches!(row, Planned::Exact { .. }));
        for planned in rows {
            let (row, as_exact) = match planned {
                Planned::Exact { .. } => continue,
                Planned::Mr { lattice, row } => {
                    let same = exact.iter().find(|e| e.0 == *lattice && e.1.rays == row.rays);
                    (self.planned_row(*lattice, row), same)
                }
                Planned::Cached(row) => (row.row(), None),
            };
            let (made, seconds) = if planned.is_measured() {
                let (_, made, seconds) = found.next().expect("a run of every row that is measured");
                (*made, *seconds)
            } else {
                let (_, same, made) = as_exact.expect("exact rows have the number of rays of MR");
                (*made, same.seconds)
            };
            let row = MapMrRow {
                seconds,
                rms: made.rms,
                bias: made.bias,
                fbem: fbem_at(&self.image, &made.image, row.feature_size)?.value,
                aggregated_fraction: made.aggregated,
                ..row
            };
            mr.push(self.compared(row, &exact, build)?);
        }
        Ok(MapRecord {
            receiver: self.grid.name.clone(),
            width: self.grid.width,
            height: self.grid.height,
            texel: self.grid.texel,
            reference_rays: self.reference.rays,
            reference_rms: self.reference.standard_error(),
            exact: exact.into_iter().map(|(_, row, _)| row).collect(),
            mr,
        })
    }

    /// What is known of a row before it is measured.
    fn planned_row(&self, lattice: usize, row: &PlannedRow) -> MapMrRow {
        let spacing = self.lattices[lattice].0;
        MapMrRow {
            feature_size: row.s,
            rays: row.rays,
            spacing,
            interpolated: spacing > 1,
            route: row.route_name().into(),
            setup_s: row.decide_s,
            ..MapMrRow::default()
        }
    }

    /// The row with its speed-ups.
    fn compared(
        &self,
        row: MapMrRow,
        exact: &[(usize, MapExactRow, &Made)],
        build: &Build,
    ) -> Result<MapMrRow> {
        // Over exact rows whose texels are at most so far apart.
        let over = |spacing: usize, time: &dyn Fn(&MapExactRow) -> f64, seconds: f64| {
            let rows = exact.iter().filter(|(_, e, _)| e.spacing <= spacing);
            let curve: Vec<(f64, f64)> = rows.map(|(_, e, _)| (time(e), e.rms)).collect();
            let same = interpolate_log_log(&curve, row.rms)?;
            Some((ratio(same.seconds, seconds)?, same.extrapolated))
        };
        let mut by_features = Vec::new();
        for (_, e, made) in exact {
            by_features.push((e.seconds, fbem_at(&self.image, &made.image, row.feature_size)?.value));
        }
        let queries = over(usize::MAX, &|e| e.seconds, row.seconds);
        let with_setup = |spacing| over(spacing, &|e| e.seconds, row.seconds + row.setup_s);
        let prepared = row.seconds + row.setup_s + build.embree_s + build.mr_preparation();
        let with_preparation = over(usize::MAX, &|e| e.seconds + build.embree_s, prepared);
        let same_features = interpolate_log_log(&by_features, row.fbem);
        Ok(MapMrRow {
            speedup_at_same_rms: speedup(&row.route, queries.map(|found| found.0)),
            extrapolated: queries.is_some_and(|found| found.1),
            speedup_with_setup: with_setup(usize::MAX).map(|found| found.0),
            speedup_over_texels: with_setup(1).map(|found| found.0),
            texels_extrapolated: with_setup(1).is_some_and(|found| found.1),
            speedup_with_preparation: with_preparation.map(|found| found.0),
            speedup_at_same_fbem: speedup(
                &row.route,
                same_features.and_then(|same| ratio(same.seconds, row.seconds)),
            ),
            ..row
        })
    }
}
