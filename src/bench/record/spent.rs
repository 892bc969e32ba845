//! Where the time of a run goes.

use serde::Serialize;

/// What a run itself takes by part, seconds: most of it are references, and several runs of each row.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Choice of points, receivers and ray calls.
    pub choice_s: f64,
    /// Rows over all points.
    pub points_s: f64,
    /// Rows by class of receiver.
    pub classes_s: f64,
    /// Shadow images.
    pub images_s: f64,
    /// Maps.
    pub maps_s: f64,
}

impl Spent {
    /// Names and seconds of the parts.
    pub fn parts(&self) -> [(&'static str, f64); 5] {
        [
            ("choices", self.choice_s),
            ("rows over all points", self.points_s),
            ("classes of receivers", self.classes_s),
            ("shadow images", self.images_s),
            ("maps", self.maps_s),
        ]
    }
}
