//! Visibility of a source from points of surfaces.

use crate::arguments::{set_keywords, whole};
use crate::arrays::{Floats, Rows, output, points_f64, single};
use crate::errors::{input, translated};
use crate::visibility::{PyVisibility, costs, methods, unlocked};
use crate::work::{Watch, long};
use mrvis::{Answer, Engine, Error, ErrorCategory, Model, Progress};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::sync::Arc;

/// Points of surfaces that look at a source.
pub struct SourceAsk<'py> {
    py: Python<'py>,
    points: Rows<'py, f64>,
    normals: Normals<'py>,
    source: usize,
    feature_size: Option<Floats<'py>>,
    rays: usize,
    seed: u32,
    engine: Engine,
}

/// One normal for all points, or one each.
pub enum Normals<'py> {
    All([f64; 3]),
    Each(Rows<'py, f64>),
}

impl<'py> Normals<'py> {
    pub fn new(given: &Bound<'py, PyAny>, points: usize) -> PyResult<Normals<'py>> {
        if let Some(one) = single(given) {
            return Ok(Normals::All(one));
        }
        let rows = points_f64("normals", given)?;
        if rows.len() != points {
            let what =
                format!("`normals` has {} rows for {points} `points`: give one each, or one", rows.len());
            return Err(input(given.py(), what));
        }
        Ok(Normals::Each(rows))
    }

    pub fn of(&self, point: usize) -> [f64; 3] {
        match self {
            Normals::All(normal) => *normal,
            Normals::Each(rows) => rows.row(point),
        }
    }
}

impl<'py> SourceAsk<'py> {
    pub fn new(
        points: &Bound<'py, PyAny>,
        normals: &Bound<'py, PyAny>,
        source: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<SourceAsk<'py>> {
        let points = points_f64("points", points)?;
        let mut ask = SourceAsk {
            py: normals.py(),
            normals: Normals::new(normals, points.len())?,
            points,
            source: source.map_or(Ok(0), |source| whole("source", source))?,
            feature_size: None,
            rays: 64,
            seed: 1,
            engine: Engine::Automatic,
        };
        let mut seed = 1u64;
        set_keywords! {
            ask, "source_visibility", options, feature_size, rays, seed => seed, engine
        }
        // The crate has seeds of 32 bits here; those below 2³² stay as they are.
        ask.seed = (seed ^ (seed >> 32)) as u32;
        if let Some(sizes) = &ask.feature_size {
            sizes.check(ask.py, "feature_size", ask.points.len(), "`points`")?;
        }
        Ok(ask)
    }

    /// Asks the model on its threads, without the GIL.
    pub fn answer(
        self,
        model: &Model,
        out: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PyVisibility> {
        let (py, count) = (self.py, self.points.len());
        let mut clear = output(py, "out", out, count)?;
        let queries: Vec<([f64; 3], [f64; 3], Option<f32>)> = (0..count)
            .map(|i| {
                let size = match &self.feature_size {
                    None => None,
                    Some(Floats::All(size)) => Some(*size),
                    Some(Floats::Each(sizes)) => sizes.as_slice()?.get(i).copied(),
                };
                Ok((self.points.row(i), self.normals.of(i), size))
            })
            .collect::<PyResult<_>>()?;
        let SourceAsk { source, rays, seed, engine, .. } = self;
        let visibility = model.visibility().with_engine(engine);
        let one = move |&(point, normal, size): &([f64; 3], [f64; 3], Option<f32>)| {
            let query = visibility.from_point(point, normal).to_source(source).rays(rays).seed(seed);
            size.map_or(query, |size| query.feature_size(size)).answer()
        };
        let model = model.clone();
        let work = move |watch: Arc<Watch>| {
            watch.stage("visibility", count as u64);
            model.on_threads(|| {
                let answers = queries.par_iter().enumerate().map(|(i, query)| {
                    if watch.stopped() {
                        return Err((i, Error::Cancelled("stopped before all points were answered".into())));
                    }
                    watch.advance(1);
                    one(query).map_err(|error| (i, error))
                });
                // The error of the first point that has one, on any number of threads.
                let answers: Vec<Result<Answer, (usize, Error)>> = answers.collect();
                answers.into_iter().collect::<Result<Vec<Answer>, _>>()
            })
        };
        let answers = long(py, progress, work)?.map_err(|(i, error)| match error.category() {
            ErrorCategory::Input => input(py, format!("`points`[{i}]: {}", translated(py, &error).value(py))),
            _ => translated(py, &error),
        })?;
        for (out, answer) in clear.as_slice_mut()?.iter_mut().zip(&answers) {
            *out = answer.transmittance;
        }
        let array =
            |of: fn(&Answer) -> f32| Some(PyArray1::from_vec(py, answers.iter().map(of).collect()).unbind());
        Ok(PyVisibility {
            transmittance: unlocked(&clear),
            lo: array(|answer| answer.lo),
            hi: array(|answer| answer.hi),
            method: Some(methods(py, answers.iter().map(|answer| answer.method).collect())),
            segments: None,
            cost: costs(py, answers.iter().map(|answer| &answer.cost))?,
        })
    }
}
