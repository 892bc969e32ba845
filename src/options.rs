//! Options: structures of which one table states the default and the range of each field.

use crate::error::quote;
use crate::{Error, Result};
use std::fmt::{Display, LowerExp};
use std::ops::{Bound, RangeBounds};

/// Defines options from a table: `pub name: type = default;`, for numbers with a range: `= default, in 1..=9;`, `= default, above 0.0;` or
/// `= default, above 0.0, at most 1.0;`, which may end with what the number is and its unit: `, "a pressure in hPa";`.
///
/// The structure implements [`Default`], and if there are ranges, it has a method `check_ranges`. The documentation of a field with a range
/// states it and the default.
macro_rules! options {
    ($(#[$of_all:meta])* pub struct $name:ident {
        $($(#[$of_field:meta])* $visible:vis $field:ident: $kind:ty = $default:expr
            $(, in $range:expr $(, $what:literal)?)?
            $(, above $low:literal $(, at most $high:literal)? $(, $what_above:literal)?)?;)+
    }) => {
        $(#[$of_all])*
        pub struct $name {
            $(
                $(#[$of_field])*
                $(#[doc = concat!("\n\nIn `", stringify!($range), "`, default `", stringify!($default), "`.")])?
                $(#[doc = concat!(
                    "\n\nAbove `", stringify!($low), $("`, at most `", stringify!($high),)? "`, default `", stringify!($default), "`."
                )])?
                $visible $field: $kind,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default,)+ }
            }
        }

        options!(@check $name
            $($($field in $range, concat!($($what)?);)? $($field in $crate::options::above($low, None$(.or(Some($high)))?), concat!($($what_above)?);)?)+
        );
    };
    (@check $name:ident) => {};
    (@check $name:ident $($field:ident in $range:expr, $what:expr;)+) => {
        impl $name {
            /// Checks each number by itself.
            ///
            /// # Errors
            /// [`Error::Argument`](crate::Error::Argument) that names the option and its range.
            #[doc(hidden)]
            pub fn check_ranges(&self) -> $crate::Result<()> {
                $($crate::options::check(stringify!($field), &self.$field, &$range, $what)?;)+
                Ok(())
            }
        }
    };
}

/// The range above `low` and at most `high`.
pub const fn above<T: Copy>(low: T, high: Option<T>) -> (Bound<T>, Bound<T>) {
    match high {
        Some(high) => (Bound::Excluded(low), Bound::Included(high)),
        None => (Bound::Excluded(low), Bound::Unbounded),
    }
}

/// Checks an option: that all its numbers are in the range and finite. `what` they are, with their unit; may be empty.
pub fn check<V: Values>(
    name: &str,
    values: &V,
    range: &impl RangeBounds<V::Number>,
    what: &str,
) -> Result<()> {
    // NaN is in no range.
    let allowed = |number: V::Number| range.contains(&number) && number.to_string() != "inf";
    let Some(wrong) = values.first_not(&allowed) else { return Ok(()) };
    Err(Error::argument(
        name,
        wrong,
        problem(range.start_bound().map(figure), range.end_bound().map(figure), what),
    ))
}

/// What is wrong with a number outside of a range.
fn problem(low: Bound<String>, high: Bound<String>, what: &str) -> String {
    let from = match &low {
        Bound::Included(low) => format!("at least {low}"),
        Bound::Excluded(low) => format!("above {low}"),
        Bound::Unbounded => String::new(),
    };
    let words = match (&low, &high) {
        (Bound::Included(low), Bound::Included(high)) => format!("in {low}..{high}"),
        (_, Bound::Included(high)) => format!("{from}, at most {high}"),
        (_, Bound::Excluded(high)) => format!("{from}, below {high}"),
        (_, Bound::Unbounded) => from,
    };
    match what {
        "" if words.starts_with("in ") => format!("must lie {words}"),
        "" => format!("must be a number {words}"),
        what => format!("must be {what}, {words}"),
    }
}

/// A number for a message, with an exponent if that is clearly shorter.
fn figure(number: &(impl Display + LowerExp)) -> String {
    let [plain, exponent] = [number.to_string(), format!("{number:e}")];
    if exponent.len() + 2 < plain.len() { exponent } else { plain }
}

/// An option with any count of numbers.
pub trait Values {
    /// Their type.
    type Number: Copy + PartialOrd + Display + LowerExp;
    /// The first number that is not allowed, for a message.
    fn first_not(&self, allowed: &impl Fn(Self::Number) -> bool) -> Option<String>;
}

macro_rules! numbers {
    ($($kind:ty: $shown:expr;)+) => {
        $(impl Values for $kind {
            type Number = $kind;
            fn first_not(&self, allowed: &impl Fn($kind) -> bool) -> Option<String> {
                (!allowed(*self)).then(|| $shown(self))
            }
        })+
    };
}

// Whole numbers as they were given.
numbers! { f32: figure; f64: figure; u32: u32::to_string; usize: usize::to_string; }

impl<T: Values> Values for Option<T> {
    type Number = T::Number;
    fn first_not(&self, allowed: &impl Fn(T::Number) -> bool) -> Option<String> {
        self.as_ref()?.first_not(allowed)
    }
}

impl<T: Values> Values for Vec<(String, T)> {
    type Number = T::Number;
    fn first_not(&self, allowed: &impl Fn(T::Number) -> bool) -> Option<String> {
        let wrong = |(name, value): &(String, T)| Some((quote(name), value.first_not(allowed)?));
        self.iter().find_map(wrong).map(|(name, wrong)| format!("{wrong} of `{name}`"))
    }
}

#[cfg(test)]
mod tests {
    options! {
        /// A table.
        #[derive(Debug)]
        pub struct Table {
            /// A count.
            pub count: Option<usize> = None, in 1..=4;
            /// A size.
            pub size: f32 = 1.0, above 0.0, "a length in m";
            /// Parts by name.
            pub parts: Vec<(String, f64)> = Vec::new(), above 0.0, at most 1e6;
            /// A part.
            pub part: f64 = 0.5, in 0.0..1.0, "a part";
            /// Without a range.
            pub name: String = "a".into();
        }
    }

    #[test]
    fn messages_state_option_value_and_range() {
        let wrong = |change: &dyn Fn(&mut Table)| {
            let mut table = Table::default();
            change(&mut table);
            table.check_ranges().map_err(|error| error.to_string()).err()
        };
        assert_eq!(wrong(&|table| table.name.push('b')), None);
        for (change, want) in [
            (&(|t: &mut Table| t.count = Some(5)) as &dyn Fn(&mut Table), "`count` 5: must lie in 1..4"),
            (&|t| t.size = 0.0, "`size` 0: must be a length in m, above 0"),
            (&|t| t.size = f32::INFINITY, "`size` inf: must be a length in m, above 0"),
            (
                &|t| t.parts = vec![("a".into(), 1e6), ("b".into(), 2e6)],
                "`parts` 2e6 of `b`: must be a number above 0, at most 1e6",
            ),
            (&|t| t.part = 1.0, "`part` 1: must be a part, at least 0, below 1"),
            (&|t| t.part = f64::NAN, "`part` NaN: must be a part, at least 0, below 1"),
        ] {
            assert_eq!(wrong(change).as_deref(), Some(want));
        }
    }
}
