//! Scenes from files, bytes, arrays and generators.

use crate::arguments::{is_whole, not_pickled, set_keywords, value, vector, whole};
use crate::arrays::{Numbers, Points, numbers, points};
use crate::errors::{Raise, input, notes};
use crate::solution::{by_name, camera_out};
use crate::work::{Watch, long, short};
use mrvis::{LoadOptions, MeshArrays, Positions, Scene, SceneBuilder, Strength, UpAxis};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An immutable scene of triangles, checked and repaired. Lengths are in scene units, metres unless `unit` says otherwise.
#[pyclass(frozen, module = "mrvis", name = "Scene")]
pub struct PyScene {
    pub scene: Arc<Scene>,
    source: String,
}

fn load_options(function: &str, options: Option<&Bound<'_, PyDict>>) -> PyResult<LoadOptions> {
    let mut all = LoadOptions::default();
    set_keywords! {
        all, function, options, unit, emitters as emitters, two_sided_emission, sides as sides, up as up,
        threads
    }
    Ok(all)
}

fn emitters(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<(String, Strength)>> {
    Ok(by_name(name, given)?.into_iter().map(|(name, watts)| (name, Strength::Watts(watts))).collect())
}

fn sides(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Option<u8>> {
    match whole(name, given)? {
        sides @ (1 | 2) => Ok(Some(sides)),
        other => Err(input(given.py(), format!("`sides` {other}: must be 1 (closed solids) or 2 (sheets)"))),
    }
}

fn up(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Option<UpAxis>> {
    match value::<String>(name, given)?.as_str() {
        "y" => Ok(Some(UpAxis::Y)),
        "z" => Ok(Some(UpAxis::Z)),
        text => Err(input(given.py(), format!("`up` {text}: must be y or z"))),
    }
}

#[pymethods]
impl PyScene {
    /// Reads a file by its extension: OBJ, glTF, GLB, PLY, or a height field in ESRI ASCII, GeoTIFF, PNG or NPZ.
    ///
    /// unit: name of the length unit, "m" (default), "cm", "mm", "km", "in" or "ft". emitters: power in W per channel of objects, groups
    /// or materials that become emitters, as a dict of names. two_sided_emission: whether emissive faces emit from both sides (default
    /// False). sides: 1 if all faces bound solids, 2 if all are sheets; default: by connectivity. up: "y" or "z", the upward axis for
    /// skies and cameras; default: that of the format, else guessed. threads: 0 (default) for one a core.
    ///
    /// Raises IoError, or InputError that names file and line.
    #[staticmethod]
    #[pyo3(signature = (path, **options))]
    fn load(py: Python<'_>, path: PathBuf, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyScene> {
        let options = load_options("load", options)?;
        let source = path.display().to_string();
        let scene = long(py, None, move |_| Scene::load_with(&path, &options))?;
        Ok(PyScene { scene: Arc::new(scene), source })
    }

    /// Reads the bytes of a file, borrowed; `format` is "obj", "gltf", "glb" or "ply". Files that it names are looked for in `folder`;
    /// without one it may name none. Options are those of `load`.
    #[staticmethod]
    #[pyo3(signature = (data, format, folder=None, **options))]
    fn from_bytes(
        py: Python<'_>,
        data: PyBackedBytes,
        format: &str,
        folder: Option<PathBuf>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyScene> {
        let options = load_options("from_bytes", options)?;
        let (source, format) = (format!("{format} in memory"), format.to_owned());
        let read = move |_: Arc<Watch>| Scene::from_memory(&data, &format, folder.as_deref(), &options);
        let scene = long(py, None, read)?;
        Ok(PyScene { scene: Arc::new(scene), source })
    }

    /// Generates a scene by name: "cube-groups", "forest", "cubes", "brick-wall", "louvres", "bookshelf", "desk-room", "urban-block" or
    /// "cornell". Metres, but "cornell" is in millimetres. Every one has an emitter.
    #[staticmethod]
    fn generate(py: Python<'_>, name: String) -> PyResult<PyScene> {
        let source = name.to_owned();
        let scene = long(py, None, move |_| Scene::generate(&name))?;
        Ok(PyScene { scene: Arc::new(scene), source })
    }

    /// The same scene without instances: each placed mesh becomes triangles of the scene's own, which `Model.solve` and
    /// `Model.form_factors` need.
    ///
    /// max_triangles: InputError beyond this number; default 2³¹.
    #[pyo3(signature = (max_triangles=None))]
    fn flattened(&self, py: Python<'_>, max_triangles: Option<&Bound<'_, PyAny>>) -> PyResult<PyScene> {
        let most = max_triangles.map_or(Ok(u64::MAX), |most| whole("max_triangles", most))?;
        let placed = self.scene.clone();
        let scene = long(py, None, move |_| placed.flattened(most))?;
        Ok(PyScene { scene: Arc::new(scene), source: self.source.clone() })
    }

    /// The same scene below a sky and a sun, instead of those that it has.
    ///
    /// The texts are those of the command's options: sky "uniform:E", "overcast:E", "cie:N,E", "clear:TURBIDITY", "perez:DNI,DHI", or the
    /// name of a map (.exr, .hdr) or of a description (.toml); sun "AZIMUTH,ELEVATION:E" or "X,Y,Z:E"; place "LATITUDE,LONGITUDE"; time
    /// as 2026-06-21T12:00+02:00. Below a sky of a description with `photometric = true`, which is in lux, all other light of the scene
    /// must be in lumens and lux. InputError if the texts are wrong or do not fit together.
    #[pyo3(signature = (sky=None, *, sun=None, place=None, time=None))]
    fn with_sky(
        &self,
        py: Python<'_>,
        sky: Option<String>,
        sun: Option<String>,
        place: Option<String>,
        time: Option<String>,
    ) -> PyResult<PyScene> {
        let dark = self.scene.clone();
        let scene = long(py, None, move |_| {
            let [sky, sun, place, time] = [&sky, &sun, &place, &time].map(|text| text.as_deref());
            let mut lit = mrvis::Scene::clone(&dark);
            lit.set_sky(&mrvis::SkyOptions::of_texts(sky, sun, place, time)?)?;
            Ok(lit)
        })?;
        Ok(PyScene { scene: Arc::new(scene), source: self.source.clone() })
    }

    /// Name of the length unit.
    #[getter]
    fn unit(&self) -> &str {
        self.scene.unit()
    }

    /// The point that coordinates are stored relative to, shape (3,), float64, scene units.
    #[getter]
    fn origin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.scene.origin())
    }

    /// Smallest and largest corner of the box around everything, shape (2, 3), float64, scene units.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        crate::arrays::rows_out(py, self.scene.bounds().to_vec())
    }

    /// Number of triangles stored.
    #[getter]
    fn triangle_count(&self) -> usize {
        self.scene.triangle_count()
    }

    /// Number of triangles seen: those of shared meshes once for each instance.
    #[getter]
    fn visible_triangle_count(&self) -> u64 {
        self.scene.visible_triangle_count()
    }

    /// Names of objects.
    #[getter]
    fn object_names(&self) -> Vec<&str> {
        self.scene.object_names().collect()
    }

    /// Names of materials.
    #[getter]
    fn material_names(&self) -> Vec<&str> {
        self.scene.material_names().collect()
    }

    /// Names of emitters; the position is the number of the source.
    #[getter]
    fn emitter_names(&self) -> Vec<&str> {
        self.scene.emitter_names().collect()
    }

    /// The perspective cameras of the file as (name, `Camera`), for `Solution.image`; names need not be unique.
    #[getter]
    fn cameras<'py>(&self, py: Python<'py>) -> PyResult<Vec<(&str, Bound<'py, PyAny>)>> {
        self.scene.cameras().map(|(name, camera)| Ok((name, camera_out(py, &camera)?))).collect()
    }

    /// Repairs made while reading, one sentence each.
    #[getter]
    fn repairs(&self) -> Vec<String> {
        notes(&self.scene.parts().repairs.messages)
    }

    fn __repr__(&self) -> String {
        let (triangles, emitters) = (self.scene.triangle_count(), self.scene.emitter_names().len());
        format!("<mrvis.Scene {:?}: {triangles} triangles, {emitters} emitters>", self.source)
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Scene", "load or build the scene in the other process")
    }
}

/// Builds a scene from arrays: materials, then objects and shared meshes that use them, then instances of shared meshes.
#[pyclass(frozen, module = "mrvis", name = "SceneBuilder")]
#[derive(Default)]
pub struct PySceneBuilder {
    builder: Mutex<SceneBuilder>,
}

/// A mesh from the arguments of Python.
struct Mesh<'py> {
    positions: Points<'py>,
    indices: Numbers<'py, u32>,
    sizes: Option<Numbers<'py, u32>>,
    material: Result<u32, Numbers<'py, u32>>,
}

impl<'py> Mesh<'py> {
    fn new(
        positions: &Bound<'py, PyAny>,
        indices: &Bound<'py, PyAny>,
        sizes: Option<&Bound<'py, PyAny>>,
        material: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Mesh<'py>> {
        let py = positions.py();
        let positions = points("positions", positions)?;
        let (indices, shape) = numbers("indices", indices)?;
        let sizes = match sizes {
            Some(sizes) => Some(numbers("polygon_sizes", sizes)?.0),
            None => match *shape {
                [_] | [_, 3] => None,
                [polygons, corners] => Some(Numbers::Owned(vec![corners as u32; polygons])),
                _ => {
                    let what = format!("`indices` has shape {shape:?}: must be (M, 3), (M, corners) or flat");
                    return Err(input(py, what));
                }
            },
        };
        let material = match material {
            None => Ok(0),
            Some(material) if is_whole(material) => Ok(whole("material", material)?),
            Some(material) => Err(numbers("material", material)?.0),
        };
        Ok(Mesh { positions, indices, sizes, material })
    }

    fn arrays<'a>(&'a self, name: &'a str) -> mrvis::Result<MeshArrays<'a>> {
        let positions = match &self.positions {
            Points::F32(rows) => Positions::F32(rows.strided()?),
            Points::F64(rows) => Positions::F64(rows.strided()?),
        };
        let mut mesh = MeshArrays::new(name, positions, self.indices.slice());
        if let Some(sizes) = &self.sizes {
            mesh = mesh.polygon_sizes(sizes.slice());
        }
        Ok(match &self.material {
            Ok(material) => mesh.material(*material),
            Err(materials) => mesh.face_materials(materials.slice()),
        })
    }
}

impl PySceneBuilder {
    fn lock(&self) -> MutexGuard<'_, SceneBuilder> {
        self.builder.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PySceneBuilder {
    #[new]
    fn new() -> PySceneBuilder {
        PySceneBuilder::default()
    }

    /// Adds a material with a unique name and returns its number: diffuse reflectance of both sides in [0, 1], and the radiance that the
    /// front emits, W/(m² sr), default none; both linear RGB.
    #[pyo3(signature = (name, reflectance, emission=None))]
    fn add_material(
        &self,
        py: Python<'_>,
        name: &str,
        reflectance: &Bound<'_, PyAny>,
        emission: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<u32> {
        let reflectance = vector("reflectance", reflectance)?.map(|v| v as f32);
        let emission =
            emission.map_or(Ok([0.0; 3]), |emission| vector("emission", emission))?.map(|v| v as f32);
        let added = self.lock().add_material(name, reflectance, emission);
        added.raise(py)
    }

    /// Adds a mesh as an object of the scene, with a name that is unique among objects and instances. Everything is checked, then copied
    /// once.
    ///
    /// positions: (V, 3), scene units; float32 and float64 are borrowed for the copy. indices: whole numbers below V: (M, 3) triangles,
    /// (M, C) polygons of C corners, or flat; counterclockwise from the front; uint32 is borrowed, other integers are checked and copied.
    /// polygon_sizes: (M,) numbers of corners for flat indices of polygons. material: a number, or (M,) numbers, one a polygon; default 0.
    #[pyo3(signature = (name, positions, indices, *, polygon_sizes=None, material=None))]
    fn add_object<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        positions: &Bound<'py, PyAny>,
        indices: &Bound<'py, PyAny>,
        polygon_sizes: Option<&Bound<'py, PyAny>>,
        material: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<()> {
        let mesh = Mesh::new(positions, indices, polygon_sizes, material)?;
        let arrays = mesh.arrays(name).raise(py)?;
        short(py, || self.lock().add_object(&arrays))
    }

    /// Adds a mesh that instances share and returns its number; arguments are those of `add_object`. It is not seen until an instance
    /// places it, and its materials do not emit.
    #[pyo3(signature = (name, positions, indices, *, polygon_sizes=None, material=None))]
    fn add_shared_mesh<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        positions: &Bound<'py, PyAny>,
        indices: &Bound<'py, PyAny>,
        polygon_sizes: Option<&Bound<'py, PyAny>>,
        material: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<u32> {
        let mesh = Mesh::new(positions, indices, polygon_sizes, material)?;
        let arrays = mesh.arrays(name).raise(py)?;
        short(py, || self.lock().add_shared_mesh(&arrays))
    }

    /// Places a shared mesh: rotation, reflection, uniform scale and translation as a matrix of shape (3, 4) or (4, 4), which maps column
    /// vectors of the mesh to the scene, at most 1e12 from its origin. The name is unique among objects and instances.
    fn add_instance(
        &self,
        py: Python<'_>,
        mesh: &Bound<'_, PyAny>,
        name: &str,
        transform: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (mesh, transform) = (whole("mesh", mesh)?, affine("transform", transform)?);
        let added = self.lock().add_instance(mesh, name, transform);
        added.raise(py)
    }

    /// Makes the scene, checked and repaired as a file is (`Scene.repairs` says what). Options are those of `Scene.load`. The builder is
    /// empty afterwards, also after an error.
    #[pyo3(signature = (**options))]
    fn finish(&self, py: Python<'_>, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyScene> {
        let options = load_options("finish", options)?;
        let builder = std::mem::take(&mut *self.lock());
        let scene = long(py, None, move |_| builder.finish(&options))?;
        Ok(PyScene { scene: Arc::new(scene), source: "arrays".into() })
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("SceneBuilder", "build the scene in the other process")
    }
}

/// The matrix of an instance.
pub fn affine(name: &str, given: &Bound<'_, PyAny>) -> PyResult<[[f64; 4]; 3]> {
    let py = given.py();
    let arguments = (given, "float64");
    let made = py.import("numpy").and_then(|numpy| numpy.call_method1("asarray", arguments));
    let matrix = made.ok().and_then(|made| made.extract::<PyReadonlyArray2<'_, f64>>().ok());
    let matrix =
        matrix.ok_or_else(|| input(py, format!("`{name}`: must be a matrix of shape (3, 4) or (4, 4)")))?;
    let m = matrix.as_array();
    match m.dim() {
        (3, 4) => {}
        (4, 4) if [0.0, 0.0, 0.0, 1.0] == [m[[3, 0]], m[[3, 1]], m[[3, 2]], m[[3, 3]]] => {}
        (4, 4) => return Err(input(py, format!("`{name}`: its last row must be 0, 0, 0, 1"))),
        (rows, columns) => {
            return Err(input(
                py,
                format!("`{name}` has shape ({rows}, {columns}): must be (3, 4) or (4, 4)"),
            ));
        }
    }
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| m[[row, column]])))
}
