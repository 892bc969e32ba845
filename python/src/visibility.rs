//! Visibility in batches, from and into arrays.

use crate::arguments::{arguments, is_whole, set_keywords, whole, word};
use crate::arrays::{Floats, Numbers, Points, Rows, numbers, output, points, single};
use crate::errors::{Raise, input};
use crate::work::{borrowing, short};
use mrvis::{Answers, Cost, Engine, Method, Model, Segments, Strided};
use numpy::{PyArray1, PyReadwriteArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;

const ENGINES: [(&str, Engine); 4] = [
    ("auto", Engine::Automatic),
    ("exact", Engine::Exact),
    ("mr", Engine::MultiResolution),
    ("average", Engine::Average),
];
arguments!(Engine: |name, given| word(name, given, &ENGINES););

/// Largest batch that is answered on the calling thread, without checks for signals: 0.05 s at one microsecond a segment. A separate thread
/// takes 50 µs more.
const MAX_SEGMENTS_WITHOUT_THREAD: usize = 50_000;

/// Answers to a batch: arrays with one entry a bundle or point.
#[pyclass(frozen, module = "mrvis", name = "Visibility")]
pub struct PyVisibility {
    /// Mean transmittance in [0, 1], shape (K,), float32; `out` if that was given.
    #[pyo3(get)]
    pub transmittance: Py<PyArray1<f32>>,
    /// Lower ends of the 95 % intervals, shape (K,), float32.
    #[pyo3(get)]
    pub lo: Option<Py<PyArray1<f32>>>,
    /// Upper ends of the 95 % intervals, shape (K,), float32.
    #[pyo3(get)]
    pub hi: Option<Py<PyArray1<f32>>>,
    /// How each answer was found, shape (K,), uint8: values of `mrvis.Method`.
    #[pyo3(get)]
    pub method: Option<Py<PyArray1<u8>>>,
    /// Transmittance of each segment, shape (N,), float32.
    #[pyo3(get)]
    pub segments: Option<Py<PyArray1<f32>>>,
    /// What it took: numbers of segments and nodes.
    #[pyo3(get)]
    pub cost: Py<PyDict>,
}

#[pymethods]
impl PyVisibility {
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.transmittance.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let count = self.__len__(py)?;
        let mean = self.transmittance.bind(py).call_method0("mean");
        let mean = if count == 0 { 1.0 } else { mean?.extract::<f64>()? };
        Ok(format!("<mrvis.Visibility: {count} answers, mean transmittance {mean:.4}>"))
    }
}

/// The entries of [`PyVisibility::cost`], added up.
pub fn costs<'a>(py: Python<'_>, all: impl Iterator<Item = &'a Cost>) -> PyResult<Py<PyDict>> {
    let names = ["segments", "nodes", "exact_rays", "handed_over", "aggregated", "certified"];
    let mut sums = [0; 6];
    for c in all {
        let parts = [c.segments, c.nodes, c.exact_rays, c.handed_over, c.aggregated, c.certified];
        sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
    }
    let entries = PyDict::new(py);
    for (name, sum) in names.into_iter().zip(sums) {
        entries.set_item(name, sum)?;
    }
    Ok(entries.unbind())
}

pub fn methods(py: Python<'_>, methods: Vec<Method>) -> Py<PyArray1<u8>> {
    PyArray1::from_vec(py, methods.into_iter().map(|method| method as u8).collect()).unbind()
}

/// One position for all segments, or one each.
enum Ends<'py> {
    All([f32; 3]),
    Each(Rows<'py, f32>),
    /// Relative to the origin of the scene.
    Moved(Vec<[f32; 3]>),
}

impl Ends<'_> {
    fn count(&self) -> Option<usize> {
        match self {
            Ends::All(_) => None,
            Ends::Each(rows) => Some(rows.len()),
            Ends::Moved(rows) => Some(rows.len()),
        }
    }

    fn strided(&self, count: usize) -> mrvis::Result<Strided<'_>> {
        Ok(match self {
            Ends::All(position) => Strided::repeated(position, count),
            Ends::Each(rows) => rows.strided()?,
            Ends::Moved(rows) => rows[..].into(),
        })
    }
}

/// Division of a batch into bundles.
enum Bundles<'py> {
    Size(u64),
    Offsets(Numbers<'py, u64>),
}

impl Bundles<'_> {
    /// Offsets of the bundles of a batch with `segments` segments.
    fn offsets(&self, py: Python<'_>, segments: usize) -> PyResult<Cow<'_, [u64]>> {
        let segments = segments as u64;
        match self {
            Bundles::Offsets(offsets) => Ok(Cow::Borrowed(offsets.slice())),
            Bundles::Size(size) if *size > 0 && segments.is_multiple_of(*size) => {
                Ok(Cow::Owned((0..=segments / size).map(|k| k * size).collect()))
            }
            Bundles::Size(size) => {
                let must = format!("must be at least 1 and divide the number of segments, {segments}");
                Err(input(py, format!("`bundles` {size}: {must}; or give offsets")))
            }
        }
    }
}

/// A batch of segments from the arguments of Python.
pub struct SegmentBatch<'py> {
    py: Python<'py>,
    origins: Source<'py>,
    targets: Source<'py>,
    bundles: Bundles<'py>,
    feature_size: Option<Floats<'py>>,
    emitter_size: Option<Floats<'py>>,
    engine: Engine,
    relative_to: [f64; 3],
    intervals: bool,
    methods: bool,
    segments: bool,
}

/// Positions as given.
enum Source<'py> {
    One([f64; 3]),
    Many(Points<'py>),
}

impl<'py> Source<'py> {
    fn new(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Source<'py>> {
        match single(given) {
            Some(one) => Ok(Source::One(one)),
            None => points(name, given).map(Source::Many),
        }
    }

    fn is_f64(&self) -> bool {
        matches!(self, Source::Many(Points::F64(_)))
    }

    /// Single precision as it is; with `move_by`, positions plus that, rounded once.
    fn ends(self, move_by: Option<[f64; 3]>) -> Ends<'py> {
        let moved = |p: [f64; 3]| {
            let by = move_by.unwrap_or_default();
            std::array::from_fn(|k| (p[k] + by[k]) as f32)
        };
        match (self, move_by) {
            (Source::One(p), _) => Ends::All(moved(p)),
            (Source::Many(Points::F32(rows)), None) => Ends::Each(rows),
            (Source::Many(Points::F32(rows)), Some(_)) => {
                Ends::Moved((0..rows.len()).map(|i| moved(rows.row(i).map(f64::from))).collect())
            }
            (Source::Many(Points::F64(rows)), _) => {
                Ends::Moved((0..rows.len()).map(|i| moved(rows.row(i))).collect())
            }
        }
    }
}

impl<'py> SegmentBatch<'py> {
    pub fn new(
        origins: &Bound<'py, PyAny>,
        targets: &Bound<'py, PyAny>,
        bundles: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<SegmentBatch<'py>> {
        let bundles = match bundles {
            None => Bundles::Size(1),
            Some(size) if is_whole(size) => Bundles::Size(whole("bundles", size)?),
            Some(offsets) => Bundles::Offsets(numbers("bundles", offsets)?.0),
        };
        let mut ask = SegmentBatch {
            py: origins.py(),
            origins: Source::new("origins", origins)?,
            targets: Source::new("targets", targets)?,
            bundles,
            feature_size: None,
            emitter_size: None,
            engine: Engine::Automatic,
            relative_to: [0.0; 3],
            intervals: false,
            methods: false,
            segments: false,
        };
        set_keywords! {
            ask, "visibility", options, feature_size, emitter_size, engine, relative_to, intervals, methods,
            segments
        }
        Ok(ask)
    }

    /// Asks the model, without the GIL.
    pub fn answer(
        self,
        model: &Model,
        out: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PyVisibility> {
        let py = self.py;
        // Positions in double precision are rounded once, relative to the origin of the scene, as the crate would.
        let origin = model.scene().origin();
        let is_moved = self.origins.is_f64() || self.targets.is_f64();
        let move_by = is_moved.then(|| std::array::from_fn(|k| self.relative_to[k] - origin[k]));
        let relative_to = if is_moved { origin } else { self.relative_to };
        let (origins, targets) = (self.origins.ends(move_by), self.targets.ends(move_by));
        let count = origins.count().or(targets.count()).unwrap_or(1);
        let offsets = self.bundles.offsets(py, count)?;
        let (from, to) = (origins.strided(count).raise(py)?, targets.strided(count).raise(py)?);
        let entries = offsets.len().saturating_sub(1);
        for (name, sizes) in [("feature_size", &self.feature_size), ("emitter_size", &self.emitter_size)] {
            sizes.as_ref().map_or(Ok(()), |sizes| sizes.check(py, name, entries, "bundles"))?;
        }
        let mut segments = Segments::new(from, to, &offsets).relative_to(relative_to);
        segments = match &self.feature_size {
            None => segments,
            Some(Floats::All(size)) => segments.feature_size(*size),
            Some(Floats::Each(sizes)) => segments.feature_sizes(sizes.as_slice()?),
        };
        segments = match &self.emitter_size {
            None => segments,
            Some(Floats::All(size)) => segments.emitter_size(*size),
            Some(Floats::Each(sizes)) => segments.emitter_sizes(sizes.as_slice()?),
        };
        let mut clear = output(py, "out", out, entries)?;
        let room = |wanted: bool, count: usize| if wanted { vec![0.0f32; count] } else { Vec::new() };
        let (mut lo, mut hi) = (room(self.intervals, entries), room(self.intervals, entries));
        let mut each = room(self.segments, count);
        let mut how = vec![Method::Clear; if self.methods { entries } else { 0 }];
        let mut answers = Answers::new(clear.as_slice_mut()?);
        if self.intervals {
            answers = answers.intervals(&mut lo, &mut hi);
        }
        if self.methods {
            answers = answers.methods(&mut how);
        }
        if self.segments {
            answers = answers.segments(&mut each);
        }
        let mut ask =
            |model: &Model| model.visibility().with_engine(self.engine).answer_into(&segments, &mut answers);
        let cost = match progress {
            None if count <= MAX_SEGMENTS_WITHOUT_THREAD => short(py, || ask(model)),
            progress => borrowing(py, progress, |watch| ask(&model.with_progress(watch))),
        }?;
        let array = |wanted: bool, values: Vec<f32>| wanted.then(|| PyArray1::from_vec(py, values).unbind());
        Ok(PyVisibility {
            transmittance: unlocked(&clear),
            lo: array(self.intervals, lo),
            hi: array(self.intervals, hi),
            method: self.methods.then(|| methods(py, how)),
            segments: array(self.segments, each),
            cost: costs(py, std::iter::once(&cost))?,
        })
    }
}

/// The array, no longer borrowed.
pub fn unlocked(array: &PyReadwriteArray1<'_, f32>) -> Py<PyArray1<f32>> {
    (***array).clone().unbind()
}
