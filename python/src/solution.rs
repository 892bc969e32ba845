//! Solutions: irradiance, elements, pictures.

use crate::arguments::{not_pickled, set_keywords, value, whole};
use crate::arrays::{points_f64, rows_out};
use crate::errors::{input, notes};
use crate::source::Normals;
use crate::work::long;
use mrvis::{Camera, Element, ImageOptions, Solution, SolveOptions, SurfacePoint};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use std::collections::BTreeMap;

/// Limits of [`ImageOptions::size`].
const MAX_SIDE: usize = 16_384;
const MAX_PIXELS: usize = 1 << 25;

pub fn solve_options(options: Option<&Bound<'_, PyDict>>) -> PyResult<SolveOptions> {
    let mut all = SolveOptions::default();
    set_keywords! {
        all, "solve", options, error, engine, feature_size, feature_sizes as by_name, importance, min_area,
        direct_only, max_seconds, max_links, target_error, audit, light_rays, gather_rays, seed
    }
    Ok(all)
}

/// Numbers by name.
pub fn by_name<T: for<'py> FromPyObjectOwned<'py>>(
    name: &str,
    given: &Bound<'_, PyAny>,
) -> PyResult<Vec<(String, T)>> {
    Ok(value::<BTreeMap<String, T>>(name, given)?.into_iter().collect())
}

/// The light in a model. Immutable; several threads may ask at once.
#[pyclass(frozen, module = "mrvis", name = "Solution")]
pub struct PySolution {
    pub solution: Solution,
    /// The model that was solved.
    #[pyo3(get)]
    pub model: Py<PyAny>,
}

/// A class of `mrvis._types`.
pub fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyType>> {
    Ok(py.import("mrvis._types")?.getattr(name)?.cast_into()?)
}

/// A camera as a `mrvis.Camera`.
pub fn camera_out<'py>(py: Python<'py>, camera: &Camera) -> PyResult<Bound<'py, PyAny>> {
    let tuple = |v: [f64; 3]| (v[0], v[1], v[2]);
    class(py, "Camera")?.call1((tuple(camera.eye), tuple(camera.target), tuple(camera.up), camera.angle))
}

/// Points of surfaces from positions and normals, checked.
pub fn surface_points(points: &Bound<'_, PyAny>, normals: &Bound<'_, PyAny>) -> PyResult<Vec<SurfacePoint>> {
    let positions = points_f64("points", points)?;
    let normals = Normals::new(normals, positions.len())?;
    let surface = |i| {
        let (position, normal) = (positions.row(i), normals.of(i));
        let length: f64 = normal.iter().map(|n| n * n).sum();
        if !position.iter().chain([&length]).all(|v| v.is_finite()) || length == 0.0 {
            let what = format!("`points`[{i}] {position:?} with `normals`[{i}] {normal:?}");
            let cure = "give a finite position and a normal longer than 0";
            return Err(input(points.py(), format!("{what}: {cure}")));
        }
        Ok(SurfacePoint { position, normal })
    };
    (0..positions.len()).map(surface).collect()
}

/// Name of an array of `mrvis.Elements`, and its entries.
type Column<T> = (&'static str, fn(&Element) -> T);

/// Columns and rows of an image, of as many pixels as the crate allows.
fn sides(given: &Bound<'_, PyAny>) -> PyResult<[usize; 2]> {
    let numbers = given.extract::<[Bound<'_, PyAny>; 2]>();
    let [columns, rows] = numbers.map_err(|_| input(given.py(), "`size`: must be (columns, rows)"))?;
    let [columns, rows] = [whole("size", &columns)?, whole("size", &rows)?];
    if [columns, rows].iter().any(|n| !(1..=MAX_SIDE).contains(n)) || columns * rows > MAX_PIXELS {
        let must = format!("each must lie in 1..{MAX_SIDE}, with at most {MAX_PIXELS} pixels");
        return Err(input(given.py(), format!("`size` ({columns}, {rows}): {must}")));
    }
    Ok([columns, rows])
}

/// A `mrvis.Camera`.
#[derive(FromPyObject)]
struct GivenCamera {
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    angle: f64,
}

#[pymethods]
impl PySolution {
    /// Irradiance at N points of surfaces, shape (N, 3), float64, W/m², linear RGB: direct light by rays to the emitters, reflected light
    /// by rays that gather the radiosity of surfaces.
    ///
    /// points: (N, 3) scene units; normals: (N, 3), or (3,) for all, of any length above 0; both are copied. progress: as for `Model`.
    #[pyo3(signature = (points, normals, *, progress=None))]
    fn irradiance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        normals: &Bound<'py, PyAny>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let surface = surface_points(points, normals)?;
        let solution = self.solution.clone();
        let found = long(py, progress, move |watch| solution.with_progress(watch).irradiance(&surface))?;
        rows_out(py, found)
    }

    /// The elements, constant pieces of lit sides of surfaces, as `Elements`: new arrays at each call.
    fn elements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (all, fields) = (self.solution.elements(), PyDict::new(py));
        fields.set_item("vertices", rows_out(py, self.solution.vertices().collect())?)?;
        let corners: Vec<u32> = all.iter().flat_map(|element| element.corners).collect();
        fields.set_item("corners", PyArray1::from_vec(py, corners).reshape([all.len(), 4])?)?;
        let colours: [Column<[f64; 3]>; 4] = [
            ("radiosity", |element| element.radiosity),
            ("irradiance", |element| element.irradiance),
            ("error", |element| element.error),
            ("exitance", |element| element.exitance),
        ];
        for (name, of) in colours {
            fields.set_item(name, rows_out(py, all.iter().map(of).collect())?)?;
        }
        fields.set_item("albedo", rows_out(py, all.iter().map(|element| element.albedo).collect())?)?;
        let area = all.iter().map(|element| element.area).collect();
        fields.set_item("area", PyArray1::from_vec(py, area))?;
        let numbers: [Column<u32>; 3] = [
            ("triangle", |element| element.triangle),
            ("object", |element| element.object),
            ("material", |element| element.material),
        ];
        for (name, of) in numbers {
            fields.set_item(name, PyArray1::from_vec(py, all.iter().map(of).collect()))?;
        }
        let front = all.iter().map(|element| element.front).collect();
        fields.set_item("front", PyArray1::from_vec(py, front))?;
        class(py, "Elements")?.call((), Some(&fields))
    }

    /// The record of the solution as a dict, the content of `solution.json`: options, times, energy, error estimate, warnings.
    fn json<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.solution.json(),))
    }

    /// A camera that shows much of the scene.
    #[pyo3(signature = (*, progress=None))]
    fn automatic_camera<'py>(
        &self,
        py: Python<'py>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let solution = self.solution.clone();
        camera_out(py, &long(py, progress, move |watch| solution.with_progress(watch).automatic_camera())?)
    }

    /// The radiance that a camera sees, shape (rows, columns, 3), float32, W/(m² sr), linear RGB, from the top; black where it sees no lit
    /// side.
    ///
    /// camera: a `Camera`; default: the automatic one. size: columns and rows, 1 to 16,384, default (800, 600). gather: whether the
    /// irradiance of each pixel is gathered instead of interpolated, slower and sharper (default False). look_inside: whether surfaces
    /// are transparent from sides that no light can reach, as the outside of a closed room (default False). out: a C-contiguous float32
    /// array of that shape to write into. progress: as for `Model`.
    #[pyo3(signature = (camera=None, size=None, *, gather=false, look_inside=false, out=None, progress=None))]
    fn image<'py>(
        this: &Bound<'py, Self>,
        camera: Option<&Bound<'py, PyAny>>,
        size: Option<&Bound<'py, PyAny>>,
        gather: bool,
        look_inside: bool,
        out: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let py = this.py();
        let camera: Option<GivenCamera> = camera.map(|camera| value("camera", camera)).transpose()?;
        let [columns, rows] = size.map_or(Ok([800, 600]), sides)?;
        let mut options = ImageOptions::default();
        (options.size, options.gather, options.look_inside) = ([columns, rows], gather, look_inside);
        let out = match out {
            None => None,
            Some(out) => match out.cast::<PyArray3<f32>>() {
                Ok(array) if array.is_c_contiguous() && *array.shape() == [rows, columns, 3] => {
                    let locked = array.try_readwrite();
                    Some(locked.map_err(|error| input(py, format!("`out`: {error}")))?)
                }
                _ => {
                    let must =
                        format!("must be a C-contiguous float32 array of shape ({rows}, {columns}, 3)");
                    return Err(input(py, format!("`out`: {must}")));
                }
            },
        };
        let solution = this.get().solution.clone();
        let radiance = long(py, progress, move |watch| {
            let solution = solution.with_progress(watch);
            let camera = match camera {
                Some(GivenCamera { eye, target, up, angle }) => Camera { eye, target, up, angle },
                None => solution.automatic_camera()?,
            };
            let mut radiance = vec![0.0f32; 3 * columns * rows];
            solution.image(&camera, &options, &mut radiance)?;
            Ok(radiance)
        })?;
        match out {
            None => PyArray1::from_vec(py, radiance).reshape([rows, columns, 3]),
            Some(mut out) => {
                out.as_slice_mut()?.copy_from_slice(&radiance);
                Ok((**out).clone())
            }
        }
    }

    /// The irradiance of all surfaces in one image of about `texels` texels (1 to 2**26, default 2**20), as a `Lightmap`.
    #[pyo3(signature = (texels=None, *, progress=None))]
    fn lightmap<'py>(
        &self,
        py: Python<'py>,
        texels: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let texels = texels.map_or(Ok(1 << 20), |texels| whole("texels", texels))?;
        let solution = self.solution.clone();
        let map = long(py, progress, move |watch| solution.with_progress(watch).lightmap(texels))?;
        let fields = PyDict::new(py);
        let irradiance = PyArray1::from_vec(py, map.irradiance.into_flattened());
        fields.set_item("irradiance", irradiance.reshape([map.height, map.width, 3])?)?;
        fields.set_item("positions", rows_out(py, map.positions)?)?;
        let texcoords = PyArray1::from_vec(py, map.texcoords.into_flattened().into_flattened());
        fields.set_item("texcoords", texcoords.reshape([map.triangles.len(), 3, 2])?)?;
        fields.set_item("triangles", rows_out(py, map.triangles)?)?;
        fields.set_item("note", map.note)?;
        class(py, "Lightmap")?.call((), Some(&fields))
    }

    /// One HTML page that shows the solution: pictures, energy, error bars and times. It refers to no other file.
    #[pyo3(signature = (*, progress=None))]
    fn page(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<String> {
        let solution = self.solution.clone();
        long(py, progress, move |watch| solution.with_progress(watch).page())
    }

    /// Mean irradiance of all surfaces, shape (3,), float64, W/m², linear RGB.
    #[getter]
    fn mean_irradiance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solution.report().mean_irradiance)
    }

    /// Estimated RMS error of the irradiance of the elements, relative to its mean; None if it is unknown.
    #[getter]
    fn error_estimate(&self) -> Option<f64> {
        self.solution.report().error_estimate
    }

    /// What a user should know, one sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        notes(self.solution.notes())
    }

    /// Whether progress stopped it before the error was reached.
    #[getter]
    fn interrupted(&self) -> bool {
        self.solution.report().interrupted
    }

    fn __repr__(&self) -> String {
        let elements = self.solution.elements().len();
        let error =
            self.solution.report().error_estimate.map_or("unknown".into(), |e| format!("{:.2} %", 100.0 * e));
        format!("<mrvis.Solution: {elements} elements, estimated error {error}>")
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Solution", "store its arrays, or solve in the other process")
    }
}
