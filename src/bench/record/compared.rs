//! Speed of rows compared with the fastest exact rays.

use super::{ExactRow, Interpolated, MrRow, interpolate_log_log};

/// Name in records of exact rays without certificates, to which a speed-up refers.
pub const PLAIN: &str = "exact";
pub const CERTIFIED: &str = "certified";

/// Range of speed-ups that count as equal speed: repeated runs of a row differ by 5 %.
pub const EQUAL_SPEED_RANGE: [f64; 2] = [0.95, 1.05];

/// Route of rows that plain exact rays answer.
pub const EMBREE: &str = "embree";

/// The speed-up of a row by this route. A row of plain exact rays is compared with itself: its speed-up is 1, whatever the noise of its
/// time.
pub fn speedup(route: &str, found: Option<f64>) -> Option<f64> {
    if route == EMBREE { found.map(|_| 1.0) } else { found }
}

/// Time (seconds) and error of rows, for [`interpolate_log_log`].
pub fn curve<'a>(rows: impl IntoIterator<Item = &'a ExactRow>) -> Vec<(f64, f64)> {
    rows.into_iter().map(|row| (row.seconds, row.rms)).collect()
}

/// `a / b` if finite.
pub fn ratio(a: f64, b: f64) -> Option<f64> {
    let ratio = a / b;
    ratio.is_finite().then_some(ratio)
}

impl MrRow {
    /// Computes the speed-ups from the times: over the fastest exact rays, with or without certificates.
    pub fn compare(&mut self, exact: &[ExactRow], certified: &[ExactRow]) {
        let as_many = exact.iter().chain(certified).filter(|row| row.rays == self.rays && row.seconds > 0.0);
        let as_many = as_many.map(|row| row.seconds).min_by(f64::total_cmp).unwrap_or(0.0);
        self.speedup_per_segment = speedup(&self.route, ratio(as_many, self.seconds)).unwrap_or(0.0);
        let plain = interpolate_log_log(&curve(exact), self.rms);
        let fastest = interpolate_log_log(&curve(exact.iter().chain(certified)), self.rms);
        let over = |time: Option<Interpolated>| time.and_then(|t| ratio(t.seconds, self.seconds));
        self.speedup_over_plain_exact = over(plain);
        self.speedup_at_same_rms = speedup(&self.route, over(fastest));
        self.extrapolated = fastest.is_some_and(|t| t.extrapolated);
        let gained = fastest.zip(plain).is_some_and(|(fastest, plain)| fastest.seconds < plain.seconds);
        self.compared_with = if gained { CERTIFIED } else { PLAIN }.into();
    }

    /// How much faster certificates make exact rays at the error of this row; 1 if they do not.
    pub fn certificates_gain(&self) -> f64 {
        let gain = self.speedup_over_plain_exact.zip(self.speedup_at_same_rms);
        gain.and_then(|(plain, fastest)| ratio(plain, fastest)).unwrap_or(1.0)
    }

    /// The engine of the row, in words.
    pub fn route_in_words(&self) -> &'static str {
        match self.route.as_str() {
            "cut" => "distance cut",
            "bundle" => "walks of bundles",
            "certified" => "exact rays with certificates",
            _ => "exact rays",
        }
    }

    /// The engine of the row, in one word.
    pub fn route_in_a_word(&self) -> &'static str {
        match self.route.as_str() {
            "cut" => "cut",
            "bundle" => "walks",
            "certified" => "certified",
            _ => "exact",
        }
    }

    /// The reference of the speed-up, in words.
    pub fn compared_in_words(&self) -> &'static str {
        match self.compared_with == CERTIFIED {
            true => "exact rays (Embree) with certificates",
            false => "exact rays (Embree)",
        }
    }
}
