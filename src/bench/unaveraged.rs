//! Scenes in which nothing is averaged: all rows with as many segments are equal, and one stands for all.

use super::gallery::Imaged;
use super::record::{ClassRecord, MapRecord, MrRow, Record};
use crate::page::length;

/// One sentence for rows, classes, images and maps that average nothing; `None` if any averages.
///
/// That a row averages nothing has one of two reasons: the umbra criterion opens every cluster (certain if the largest size was walked to
/// the end), or exact rays are expected to be faster.
pub(super) fn sentence(
    rows: &[MrRow],
    classes: &[ClassRecord],
    images: &Imaged,
    maps: &[MapRecord],
    unit: &str,
) -> Option<String> {
    let averaged = images.averaged
        || average(rows)
        || classes.iter().any(|class| average(&class.mr))
        || maps.iter().flat_map(|map| &map.mr).any(|row| row.aggregated_fraction > 0.0);
    if averaged || rows.is_empty() {
        return None;
    }
    let size = |pick: fn(f64, f64) -> f64| {
        length(rows.iter().map(|row| row.feature_size).reduce(pick).unwrap_or_default(), unit)
    };
    let range = match [size(f64::min), size(f64::max)] {
        [low, high] if low == high => format!("of {low}"),
        [low, high] => format!("from {low} to {high}"),
    };
    let largest = rows.iter().map(|row| row.feature_size).fold(0.0, f64::max);
    let opened = images.all_opened
        || rows
            .iter()
            .any(|row| row.feature_size == largest && row.route != "certified" && row.handed_over == 0.0);
    Some(match opened {
        true => format!(
            "Nothing may be averaged in this scene at feature sizes up to {}: the shadows of every cluster could be as large. All answers are \
             exact, and multi-resolution visibility is no faster.",
            size(f64::max)
        ),
        false => format!(
            "Nothing is averaged in this scene at feature sizes {}: exact rays are expected to be faster than clusters. All answers are \
             exact, and multi-resolution visibility is no faster.",
            range
        ),
    })
}

fn average(rows: &[MrRow]) -> bool {
    rows.iter().any(|row| row.aggregated_fraction > 0.0)
}

impl ClassRecord {
    /// Keeps one MR row, that of the largest size with `rays` segments, if none averages anything.
    pub(super) fn keep_one_if_unaveraged(&mut self, rays: usize) {
        if !average(&self.mr) {
            keep_one_row(&mut self.mr, rays);
        }
    }
}

fn keep_one_row(rows: &mut Vec<MrRow>, rays: usize) {
    let only = rows.iter().rposition(|row| row.rays == rays).map(|k| rows.swap_remove(k));
    *rows = only.into_iter().collect();
}

impl Record {
    /// A speed-up as text and page show it. Where nothing is averaged none is shown, except the 1 of the row with which others are
    /// compared.
    pub(super) fn gain(&self, speedup: Option<f64>) -> Option<f64> {
        speedup.filter(|speedup| self.nothing_averaged.is_none() || *speedup == 1.0)
    }

    /// The MR rows that table and page show: all, or if nothing is averaged one for all.
    pub fn shown_rows(&self) -> &[MrRow] {
        let of_workload = |row: &MrRow| row.rays == self.workload.rays;
        match self.nothing_averaged.as_ref().and_then(|_| self.mr.iter().rposition(of_workload)) {
            Some(only) => &self.mr[only..=only],
            None => &self.mr,
        }
    }
}

/// Keeps the row, the errors, the images and the rows of maps of the largest size with `rays` segments.
pub(super) fn keep_one(rows: &mut Vec<MrRow>, images: &mut Imaged, maps: &mut [MapRecord], rays: usize) {
    keep_one_row(rows, rays);
    let largest = rows.first().map_or(0.0, |row: &MrRow| row.feature_size);
    maps.iter_mut().for_each(|map| map.mr.retain(|row| row.feature_size == largest));
    for receiver in &mut images.errors {
        receiver.fbem.drain(..receiver.fbem.len().saturating_sub(1));
    }
    for receiver in &mut images.shown {
        receiver.mr.drain(..receiver.mr.len().saturating_sub(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::record::{MapMrRow, Workload};

    fn rows() -> Vec<MrRow> {
        let row = |(rays, feature_size)| MrRow { rays, feature_size, handed_over: 1.0, ..MrRow::default() };
        [(16, 0.1), (16, 0.4), (64, 0.1), (64, 0.4)].map(row).into()
    }

    #[test]
    fn only_what_averages_nothing_is_said_to() {
        let (mut rows, mut images) = (rows(), Imaged::default());
        let slower = sentence(&rows, &[], &images, &[], "m").expect("a sentence");
        assert!(slower.contains("expected to be faster") && slower.contains("0.1"), "{slower}");
        images.all_opened = true;
        assert!(sentence(&rows, &[], &images, &[], "m").is_some_and(|s| s.contains("may be averaged")));
        // A whole walk at a small size says nothing about larger ones.
        images.all_opened = false;
        rows[2].handed_over = 0.0;
        assert_eq!(sentence(&rows, &[], &images, &[], "m"), Some(slower));
        rows[3].handed_over = 0.0;
        assert!(sentence(&rows, &[], &images, &[], "m").is_some_and(|s| s.contains("may be averaged")));
        images.averaged = true;
        assert_eq!(sentence(&rows, &[], &images, &[], "m"), None);
        images.averaged = false;
        rows[1].aggregated_fraction = 1e-6;
        assert_eq!(sentence(&rows, &[], &images, &[], "m"), None);
        assert_eq!(sentence(&[], &[], &images, &[], "m"), None);
        rows[1].aggregated_fraction = 0.0;
        assert!(sentence(&rows, &[], &images, &[MapRecord::default()], "m").is_some());
        let averaged = MapMrRow { aggregated_fraction: 0.01, ..MapMrRow::default() };
        let map = MapRecord { mr: vec![averaged], ..MapRecord::default() };
        assert_eq!(sentence(&rows, &[], &images, &[map], "m"), None);
        let mut class = ClassRecord { mr: rows.clone(), ..ClassRecord::default() };
        assert!(sentence(&rows, std::slice::from_ref(&class), &images, &[], "m").is_some());
        class.mr[3].aggregated_fraction = 0.01;
        assert_eq!(sentence(&rows, &[class], &images, &[], "m"), None);
    }

    #[test]
    fn one_row_stands_for_all() {
        let workload = Workload { rays: 16, ..Workload::default() };
        let mut record = Record { mr: rows(), workload, ..Record::default() };
        assert_eq!(record.shown_rows().len(), 4);
        record.nothing_averaged = Some("Nothing.".into());
        assert!(matches!(record.shown_rows(), [MrRow { rays: 16, feature_size: 0.4, .. }]));
        keep_one(&mut record.mr, &mut Imaged::default(), &mut [], 16);
        assert!(matches!(record.mr[..], [MrRow { rays: 16, feature_size: 0.4, .. }]));
        assert_eq!(record.shown_rows().len(), 1);
    }

    #[test]
    fn only_a_class_that_averages_nothing_has_one_row() {
        let mut class = ClassRecord { mr: rows(), ..ClassRecord::default() };
        class.mr[0].aggregated_fraction = 0.5;
        class.keep_one_if_unaveraged(16);
        assert_eq!(class.mr.len(), 4);
        class.mr[0].aggregated_fraction = 0.0;
        class.keep_one_if_unaveraged(16);
        assert!(matches!(class.mr[..], [MrRow { rays: 16, feature_size: 0.4, .. }]));
    }
}
