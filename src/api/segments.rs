//! Batches of segments in the caller's arrays, and the output arrays of their answers.

use crate::visibility::Method;
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Largest coordinate, scene units: squares of differences stay finite in f32.
pub(super) const MAX_COORDINATE: f32 = 1e12;
/// Largest number of segments of a bundle: limits its packets to 34 MB (65,536 of 516 bytes).
const MAX_BUNDLE: u64 = 1 << 20;

/// Positions in arrays of the caller: x, y, z of each one after the other at a fixed stride, or in three arrays. Borrowed. Numbers are
/// f32; those of meshes may be f64.
#[derive(Clone, Copy, Debug)]
pub struct Strided<'a, T = f32> {
    /// The arrays of x, y and z; of interleaved positions the same array from the first, second and third number on.
    axes: [&'a [T]; 3],
    stride: usize,
    count: usize,
}

impl<'a, T: Copy> Strided<'a, T> {
    /// `count` positions, of which each begins `stride` numbers after the one before. A stride of 0 stands for 3: packed.
    ///
    /// # Errors
    /// [`Error::Argument`] if the stride is 1 or 2, or `data` is too short.
    pub fn new(data: &'a [T], stride: usize, count: usize) -> Result<Strided<'a, T>> {
        let stride = if stride == 0 { 3 } else { stride };
        if stride < 3 {
            return Err(Error::argument("stride", stride, "must be 0 (packed) or at least 3 numbers"));
        }
        check_length("data", data.len(), stride, 3, count)?;
        Ok(Strided::interleaved(data, stride, count))
    }

    /// `count` positions with x, y and z in arrays of their own, each number `stride` numbers after the one before. A stride of 0 stands
    /// for 1: packed.
    ///
    /// # Errors
    /// [`Error::Argument`] if an array is too short.
    pub fn of_axes(
        x: &'a [T],
        y: &'a [T],
        z: &'a [T],
        stride: usize,
        count: usize,
    ) -> Result<Strided<'a, T>> {
        let stride = stride.max(1);
        for (name, axis) in [("x", x), ("y", y), ("z", z)] {
            check_length(name, axis.len(), stride, 1, count)?;
        }
        Ok(Strided { axes: [x, y, z], stride, count })
    }

    /// The same position, `count` times.
    pub fn repeated(position: &'a [T; 3], count: usize) -> Strided<'a, T> {
        Strided::interleaved(position, 0, count)
    }

    /// The same position, `count` times, with its numbers in arrays of one entry.
    #[doc(hidden)]
    pub fn repeated_axes(x: &'a [T], y: &'a [T], z: &'a [T], count: usize) -> Strided<'a, T> {
        Strided { axes: [x, y, z], stride: 0, count }
    }

    fn interleaved(data: &'a [T], stride: usize, count: usize) -> Strided<'a, T> {
        Strided { axes: [0, 1, 2].map(|axis| data.get(axis..).unwrap_or_default()), stride, count }
    }

    /// Number of positions.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// The numbers of position `i`.
    pub(super) fn numbers(&self, i: usize) -> [T; 3] {
        self.axes.map(|axis| axis[i * self.stride])
    }
}

/// Checks that an array holds `count` entries of `size` numbers, of which each begins `stride` numbers after the one before.
fn check_length(name: &str, length: usize, stride: usize, size: usize, count: usize) -> Result<()> {
    let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
    if needed.is_none_or(|needed| needed > length) {
        let problem = format!("too few for {count} positions with a stride of {stride}");
        return Err(Error::argument(name, format!("of {length} numbers"), problem));
    }
    Ok(())
}

impl Strided<'_> {
    fn at(&self, i: usize) -> Vec3 {
        Vec3::from_array(self.numbers(i))
    }
}

impl<'a, T: Copy> From<&'a [[T; 3]]> for Strided<'a, T> {
    fn from(positions: &'a [[T; 3]]) -> Strided<'a, T> {
        Strided::interleaved(positions.as_flattened(), 3, positions.len())
    }
}

/// A value that all entries of an array have, or one for each.
#[derive(Clone, Copy, Debug)]
pub(super) enum PerEntry<'a, T> {
    All(T),
    Each(&'a [T]),
}

impl<T: Copy> PerEntry<'_, T> {
    pub fn of(&self, entry: usize) -> T {
        match self {
            PerEntry::All(value) => *value,
            PerEntry::Each(values) => values[entry],
        }
    }
}

impl PerEntry<'_, f32> {
    /// Checks the sizes of `bundles` bundles.
    fn check(&self, name: &str, bundles: usize, in_range: impl Fn(f32) -> bool, must: &str) -> Result<()> {
        let sizes = match self {
            PerEntry::All(size) => std::slice::from_ref(size),
            PerEntry::Each(sizes) if sizes.len() == bundles => sizes,
            PerEntry::Each(sizes) => {
                let count = sizes.len();
                let problem = format!("there are {bundles} bundles");
                return Err(Error::argument(name, format!("of {count} entries"), problem));
            }
        };
        let Some(k) = sizes.iter().position(|&size| !(size.is_finite() && in_range(size))) else {
            return Ok(());
        };
        let name = match self {
            PerEntry::All(_) => name.trim_end_matches('s').into(),
            PerEntry::Each(_) => format!("{name}[{k}]"),
        };
        Err(Error::argument(name, sizes[k], format!("must be {must}")))
    }
}

/// A batch of queries: segments from receivers to emitters, in bundles that share their ends.
///
/// Positions are f32, as engines trace them, and relative to a point in f64 ([`Segments::relative_to`]): scenes far from zero keep
/// their precision and nothing is copied. A batch whose `relative_to` is [`Scene::origin`](crate::Scene::origin) is traced bit by
/// bit as given; by default positions are in the coordinates of the file.
///
/// Surfaces at the ends are not known: 6.4e-6 of the scene's largest coordinate is left out at both ends, or of the largest coordinate
/// of the end and of the face at it, where those of the end are below a sixteenth of the scene's. Ends on surfaces of which segments
/// leave at less than 4° should be given 2e-6 of that coordinate above them.
///
/// Segments of a bundle should begin at one place and end at one emitter, those that end close together one after the other;
/// bundles whose receivers are neighbours should follow each other: that is faster, and answers do not depend on it but for rounding.
#[derive(Clone, Copy, Debug)]
#[must_use = "segments are asked by `Visibility::answer_into`"]
pub struct Segments<'a> {
    pub(super) origins: Strided<'a>,
    pub(super) targets: Strided<'a>,
    pub(super) bundles: &'a [u64],
    pub(super) feature_sizes: Option<PerEntry<'a, f32>>,
    pub(super) emitter_sizes: PerEntry<'a, f32>,
    relative_to: [f64; 3],
}

impl<'a> Segments<'a> {
    /// Segment `i` runs from `origins[i]`, the receiver, to `targets[i]`, the emitter; scene units. Bundle `k` holds the segments
    /// `bundles[k]..bundles[k + 1]`: ascending offsets, one more than bundles, the first 0, the last the number of segments. At most
    /// 1,048,576 segments a bundle.
    pub fn new(
        origins: impl Into<Strided<'a>>,
        targets: impl Into<Strided<'a>>,
        bundles: &'a [u64],
    ) -> Segments<'a> {
        Segments {
            origins: origins.into(),
            targets: targets.into(),
            bundles,
            feature_sizes: None,
            emitter_sizes: PerEntry::All(0.0),
            relative_to: [0.0; 3],
        }
    }

    /// One feature size for all bundles, scene units, above 0; see [`Query::feature_size`](crate::Query::feature_size).
    pub fn feature_size(mut self, size: f32) -> Segments<'a> {
        self.feature_sizes = Some(PerEntry::All(size));
        self
    }

    /// A feature size for each bundle, scene units, above 0.
    pub fn feature_sizes(mut self, sizes: &'a [f32]) -> Segments<'a> {
        self.feature_sizes = Some(PerEntry::Each(sizes));
        self
    }

    /// The smallest width of all emitters as seen from their receivers, scene units, at least 0 (default: points). Smaller than true
    /// is safe: less is averaged.
    pub fn emitter_size(mut self, size: f32) -> Segments<'a> {
        self.emitter_sizes = PerEntry::All(size);
        self
    }

    /// The same, one for each bundle.
    pub fn emitter_sizes(mut self, sizes: &'a [f32]) -> Segments<'a> {
        self.emitter_sizes = PerEntry::Each(sizes);
        self
    }

    /// The point, in the coordinates of the file, that positions are relative to; default zero. f64, scene units.
    pub fn relative_to(mut self, point: [f64; 3]) -> Segments<'a> {
        self.relative_to = point;
        self
    }

    /// Number of bundles.
    pub(super) fn bundle_count(&self) -> usize {
        self.bundles.len().saturating_sub(1)
    }

    pub(super) fn of_bundle(&self, bundle: usize) -> Range<usize> {
        self.bundles[bundle] as usize..self.bundles[bundle + 1] as usize
    }

    /// Offset from the positions of segments to positions relative to the scene's origin.
    pub(super) fn shift(&self, origin: DVec3) -> DVec3 {
        DVec3::from_array(self.relative_to) - origin
    }

    /// The ends of a segment relative to the scene's origin.
    pub(super) fn ends(&self, segment: usize, shift: DVec3) -> (Vec3, Vec3) {
        let moved = |p: Vec3| if shift == DVec3::ZERO { p } else { (p.as_dvec3() + shift).as_vec3() };
        (moved(self.origins.at(segment)), moved(self.targets.at(segment)))
    }

    /// Checks all preconditions of the engines.
    pub(super) fn check(&self, shift: DVec3, parallel: bool) -> Result<()> {
        let (segments, bundles) = (self.origins.len(), self.bundle_count());
        if self.targets.len() != segments {
            return Err(Error::arguments(format!(
                "⟨targets⟩ has {} positions for {segments} ⟨origins⟩",
                self.targets.len()
            )));
        }
        match (self.bundles.first(), self.bundles.last()) {
            (Some(0), Some(&last)) if last == segments as u64 => {}
            _ => {
                let problem =
                    format!("the first offset must be 0 and the last {segments}, the number of segments");
                return Err(Error::argument("bundles", "", problem));
            }
        }
        if let Some(k) = self.bundles.windows(2).position(|w| w[1] < w[0] || w[1] - w[0] > MAX_BUNDLE) {
            let [from, to] = [self.bundles[k], self.bundles[k + 1]];
            let problem = format!("offsets must ascend, by {MAX_BUNDLE} segments at most");
            return Err(Error::argument(
                format!("bundles[{}]", k + 1),
                format!("{to} after {from}"),
                problem,
            ));
        }
        if let Some(sizes) = &self.feature_sizes {
            sizes.check("feature_sizes", bundles, |s| s > 0.0, "a finite number above 0")?;
        }
        self.emitter_sizes.check("emitter_sizes", bundles, |s| s >= 0.0, "a finite number not below 0")?;
        if !shift.is_finite() {
            return Err(Error::argument("relative_to", format!("{:?}", self.relative_to), "must be finite"));
        }
        let lies = |p: Vec3| p.is_finite() && p.abs().max_element() <= MAX_COORDINATE;
        let bad = |i: usize| {
            let (from, to) = self.ends(i, shift);
            !lies(from) || !lies(to) || from == to
        };
        let first = match parallel {
            true => (0..segments).into_par_iter().with_min_len(1 << 12).find_first(|&i| bad(i)),
            false => (0..segments).find(|&i| bad(i)),
        };
        let Some(i) = first else { return Ok(()) };
        let (from, to) = (self.origins.at(i), self.targets.at(i));
        let (moved, other) = self.ends(i, shift);
        if lies(moved) && lies(other) {
            let problem = format!("the segment from {from} has no length");
            return Err(Error::argument(format!("targets[{i}]"), to, problem));
        }
        let name = if lies(moved) { "targets" } else { "origins" };
        let value = if name == "targets" { to } else { from };
        let problem = format!("must be finite, at most {MAX_COORDINATE:e} from the scene's origin");
        Err(Error::argument(format!("{name}[{i}]"), value, problem))
    }
}

/// Arrays of the caller that the answers to a batch are written into, one entry a bundle. Written only if there is no error.
#[derive(Debug)]
#[must_use = "answers are written by `Visibility::answer_into`"]
pub struct Answers<'a> {
    pub(super) transmittance: &'a mut [f32],
    pub(super) intervals: Option<(&'a mut [f32], &'a mut [f32])>,
    pub(super) methods: Option<&'a mut [Method]>,
    /// The same as numbers.
    pub(super) method_codes: Option<&'a mut [u8]>,
    pub(super) segments: Option<&'a mut [f32]>,
}

impl<'a> Answers<'a> {
    /// Mean transmittance of the segments of each bundle, in `[0, 1]`; 1 for a bundle without segments.
    pub fn new(transmittance: &'a mut [f32]) -> Answers<'a> {
        Answers { transmittance, intervals: None, methods: None, method_codes: None, segments: None }
    }

    /// Also the ends of the stated 95 % interval of each bundle; see [`Answer`](crate::Answer).
    pub fn intervals(mut self, lo: &'a mut [f32], hi: &'a mut [f32]) -> Answers<'a> {
        self.intervals = Some((lo, hi));
        self
    }

    /// Also how the answer to each bundle was found.
    pub fn methods(mut self, methods: &'a mut [Method]) -> Answers<'a> {
        self.methods = Some(methods);
        self
    }

    /// The same as numbers: `Method as u8`.
    #[doc(hidden)]
    pub fn method_codes(mut self, codes: &'a mut [u8]) -> Answers<'a> {
        self.method_codes = Some(codes);
        self
    }

    /// Also the transmittance of each segment, one entry a segment. Cluster engines then ask every sixteen segments by themselves, so
    /// that bundles of more have wider intervals.
    pub fn segments(mut self, transmittance: &'a mut [f32]) -> Answers<'a> {
        self.segments = Some(transmittance);
        self
    }

    pub(super) fn check(&self, bundles: usize, segments: usize) -> Result<()> {
        let (lo, hi) =
            self.intervals.as_ref().map_or((None, None), |(lo, hi)| (Some(lo.len()), Some(hi.len())));
        for (name, have, want) in [
            ("transmittance", Some(self.transmittance.len()), bundles),
            ("lo", lo, bundles),
            ("hi", hi, bundles),
            ("methods", self.methods.as_ref().map(|m| m.len()), bundles),
            ("methods", self.method_codes.as_ref().map(|m| m.len()), bundles),
            ("segments", self.segments.as_ref().map(|s| s.len()), segments),
        ] {
            if have.is_some_and(|have| have != want) {
                let have = format!("of {} entries", have.unwrap_or(0));
                return Err(Error::argument(name, have, format!("must have {want}")));
            }
        }
        Ok(())
    }
}
