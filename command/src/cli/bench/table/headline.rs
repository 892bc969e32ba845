//! The result of a benchmark in one sentence.

use super::times;
use mrvis::internals::bench::record::{NO_FASTER, Record};
use mrvis::internals::plot::number;

/// The result in one sentence.
pub(super) fn of(record: &Record) -> String {
    let unit = &record.unit;
    let Some((row, speed)) = record.best().and_then(|row| Some((row, row.speedup_at_same_rms?))) else {
        return "no multi-resolution row could be compared with exact at the same error".into();
    };
    let about = if row.extrapolated { "about " } else { "" };
    let speed = match speed {
        v if v >= NO_FASTER[1] => format!("{about}{} times faster than", number(v)),
        v if v > NO_FASTER[0] => "no faster than".into(),
        v => format!("{about}{} times slower than", number(1.0 / v)),
    };
    let gain = row.certificates_gain();
    let extrapolated =
        if row.extrapolated { " (more exact rays than were measured, extrapolated)" } else { "" };
    let certificates = match gain > NO_FASTER[1] {
        true => format!("; certificates alone make exact rays {} times faster", number(gain)),
        false => String::new(),
    };
    let features = record.faster_at_same_fbem().map_or(String::new(), |(row, speed)| {
        let s = number(row.feature_size);
        format!("; at the same feature error (FBEM) s = {s} {unit} is {} times faster", number(speed))
    });
    format!(
        "best: s = {} {unit} with {} segments is {speed} {} at the same RMS error of {} %{extrapolated} (per segment {}); {} % of \
         its segments met averaged clusters{features}{certificates}",
        number(row.feature_size),
        row.rays,
        row.compared_in_words(),
        number(100.0 * row.rms),
        times(Some(row.speedup_per_segment), false),
        number(100.0 * row.aggregated_fraction)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use mrvis::internals::bench::record::{ExactRow, MrRow};

    #[test]
    fn losses_are_said_plainly() {
        let row = |speed| MrRow {
            speedup_at_same_rms: Some(speed),
            rms: 0.01,
            feature_size: 0.1,
            ..MrRow::default()
        };
        let said = |rows: &[MrRow]| of(&Record { mr: rows.into(), unit: "m".into(), ..Record::default() });
        assert!(said(&[row(2.0)]).contains("2 times faster"));
        assert!(said(&[row(0.5)]).contains("2 times slower"));
        assert!(said(&[row(1.03)]).contains("no faster than exact rays"));
        assert!(said(&[]).contains("no multi-resolution row"));
        let features = MrRow { feature_size: 0.4, speedup_at_same_fbem: Some(9.29), ..row(0.97) };
        let both = said(&[row(1.03), features]);
        assert!(
            both.contains("no faster") && both.contains("(FBEM) s = 0.4 m is 9.29 times faster"),
            "{both}"
        );
    }

    #[test]
    fn what_certificates_gain_is_not_the_gain_of_averaging() {
        let exact = ExactRow { rays: 16, seconds: 2.0, rms: 0.01, ..ExactRow::default() };
        let certified = ExactRow { seconds: 1.0, ..exact.clone() };
        let mut row = MrRow { rays: 16, seconds: 1.0, rms: 0.01, ..MrRow::default() };
        row.compare(&[exact], &[certified]);
        let text = of(&Record { mr: vec![row], unit: "m".into(), ..Record::default() });
        assert!(text.contains("no faster than exact rays (Embree) with certificates"), "{text}");
        assert!(text.contains("certificates alone make exact rays 2 times faster"), "{text}");
    }
}
