//! An axis of a chart: range, mapping to pixels, tick marks.

use crate::error::number;

/// Scale of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Linear; the axis begins at 0 unless a value is negative.
    #[default]
    Linear,
    /// Logarithmic; only positive values can be shown.
    Log,
}

impl Scale {
    /// Whether an axis of this scale can show the value.
    pub fn shows(self, v: f64) -> bool {
        v.abs() < 1e200 && (self == Scale::Linear || v > 1e-200)
    }

    fn place(self, v: f64) -> f64 {
        if self == Scale::Log { v.log10() } else { v }
    }
}

/// An axis between two pixels; `to` may be the smaller.
pub(super) struct Axis {
    pub(super) scale: Scale,
    low: f64,
    high: f64,
    pub(super) from: i32,
    pub(super) to: i32,
}

/// A tick mark.
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

impl Axis {
    /// An axis that contains all `values` (which its scale can show) with a margin of 6 %.
    pub(super) fn new(scale: Scale, values: impl Iterator<Item = f64>, from: i32, to: i32) -> Axis {
        let places = values.map(|v| scale.place(v));
        let (mut low, mut high) = places.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if scale == Scale::Linear {
            low = low.min(0.0);
        }
        if high - low < 1e-9 * high.abs().max(low.abs()) || high == low {
            let room = if scale == Scale::Log || high == 0.0 { 0.5 } else { 0.5 * high.abs() };
            (low, high) = (low - room, high + room);
        }
        let room = 0.06 * (high - low);
        high += room;
        if scale == Scale::Log || low < 0.0 {
            low -= room;
        }
        Axis { scale, low, high, from, to }
    }

    /// Pixel coordinate of a value.
    pub(super) fn pixel(&self, v: f64) -> i32 {
        let t = (self.scale.place(v) - self.low) / (self.high - self.low);
        (f64::from(self.from) + t * f64::from(self.to - self.from)).round() as i32
    }

    /// Round values inside the axis, far enough apart for their labels.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        let values = match self.scale {
            Scale::Linear => self.even_ticks(),
            Scale::Log => self.log_ticks(),
        };
        values.into_iter().map(|value| Tick { value, label: number(value) }).collect()
    }

    fn even_ticks(&self) -> Vec<f64> {
        let wish = (self.high - self.low) / 6.0;
        let power = 10f64.powf(wish.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= wish).unwrap_or(wish);
        let first = (self.low / step - 1e-9).ceil();
        let value = |i: i32| (first + f64::from(i)) * step;
        (0..20).map(value).take_while(|v| *v <= self.high).collect()
    }

    /// Powers of ten; with intermediate values on short axes, every second or third power on long ones.
    fn log_ticks(&self) -> Vec<f64> {
        let decades = self.high - self.low;
        let mantissas: &[f64] = match decades {
            d if d < 0.7 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
            d if d < 2.6 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let every = (decades / 8.0).ceil().max(1.0) as i32;
        let powers = (self.low.floor() as i32..=self.high.ceil() as i32).filter(|p| p % every == 0);
        let values = powers.flat_map(|p| mantissas.iter().map(move |m| m * 10f64.powi(p)));
        values.filter(|v| (self.low..=self.high).contains(&v.log10())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_inside_and_not_too_many() {
        for (low, high) in [(1.0, 1.1), (1.0, 3.0), (1e-6, 1.0), (1e-100, 1e100), (0.2, 30.0)] {
            for scale in [Scale::Linear, Scale::Log] {
                let axis = Axis::new(scale, [low, high].into_iter(), 0, 500);
                let ticks = axis.ticks();
                assert!((1..=12).contains(&ticks.len()), "{scale:?} {low} {high}: {}", ticks.len());
                assert!(ticks.iter().all(|t| (0..=500).contains(&axis.pixel(t.value))));
            }
        }
    }
}
