//! The command line that repeats a run.

use crate::bench::record::Record;
use crate::cli::args::shell_word;
use std::fmt::Write as _;

/// `mrvis bench` with the options of a run.
pub fn command_line(record: &Record) -> String {
    let mut sizes: Vec<f64> = record.mr.iter().map(|row| row.feature_size).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    let mut text = format!("mrvis bench {}", shell_word(&record.scene.path));
    let work = &record.workload;
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        " --points {} --rays {} --reference-rays {}",
        work.points, work.rays, work.reference_rays
    );
    for size in sizes {
        let _ = write!(text, " --feature-size {size}");
    }
    for receiver in &record.receivers {
        let _ = write!(text, " --receiver {}", shell_word(&receiver.name));
    }
    let _ = write!(
        text,
        " --seed {} --threads {} --unit {}",
        record.seed,
        record.threads,
        shell_word(&record.unit)
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::record::{MrRow, ReceiverErrors};

    #[test]
    fn runs_are_repeated_with_their_options() {
        let row = |feature_size| MrRow { feature_size, ..Default::default() };
        let receivers = vec![ReceiverErrors { name: "it's".into(), ..Default::default() }];
        let mut record = Record { mr: vec![row(0.5), row(0.25), row(0.5)], receivers, ..Default::default() };
        (record.scene.path, record.unit, record.threads) = ("a b.obj".into(), "m".into(), 1);
        assert_eq!(
            command_line(&record),
            "mrvis bench 'a b.obj' --points 0 --rays 0 --reference-rays 0 --feature-size 0.25 --feature-size 0.5 \
             --receiver 'it'\\''s' --seed 0 --threads 1 --unit m"
        );
    }
}
