//! One version of the map: points, key frames, the maps that it consists of.

use crate::arrays::{matrices, points, rows};
use crate::errors::raise;
use crate::interrupt::on_thread;
use crate::trajectory::Trajectory;
use crate::walk::Route;
use cairn::atlas::{KeyFrameId, MapId};
use cairn::geometry::{Se3, Vec3};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// One version of the map; it never changes.
///
/// It may consist of several maps, each in a frame of its own, until a place that they share is recognised. Where a method
/// takes `map` and none is given, it is the largest one.
#[pyclass(frozen, module = "cairn")]
pub struct Map {
    inner: cairn::Map,
    routes: BTreeMap<String, cairn::guide::Route>,
}

/// Reads a saved map to look at; `Slam(..., map=path)` goes on in it.
///
/// Raises:
///     MapError: When it cannot be read, is no map, or is damaged.
#[pyfunction]
pub fn load_map(py: Python<'_>, path: PathBuf) -> PyResult<Map> {
    on_thread(py, move || {
        let file = cairn::Slam::load_map(&path).map_err(raise)?;
        let routes =
            cairn::routes_of(&file).filter_map(|(name, _, route)| Some((name.to_owned(), route.ok()?)));
        Ok(Map { routes: routes.collect(), inner: cairn::Map::of_file(&file) })
    })
}

impl Map {
    /// Of a running engine.
    pub fn new(inner: cairn::Map) -> Self {
        Self { inner, routes: BTreeMap::new() }
    }

    /// The map of that name, or the largest; None in an empty map.
    fn named(&self, map: Option<usize>) -> PyResult<Option<MapId>> {
        let Some(name) = map else { return Ok(self.inner.largest()) };
        let id = KeyFrameId::from_index(name).map(MapId);
        match id.filter(|id| self.inner.maps().any(|m| m == *id)) {
            Some(id) => Ok(Some(id)),
            None => Err(PyKeyError::new_err(format!("there is no map {name}; there are {:?}", self.maps()))),
        }
    }
}

#[pymethods]
impl Map {
    fn __repr__(&self) -> String {
        let s = self.inner.snapshot();
        format!(
            "Map(version {}, {} key frames, {} landmarks)",
            s.version(),
            s.key_frame_count(),
            s.landmark_count()
        )
    }

    /// Grows with every commit.
    #[getter]
    fn version(&self) -> u64 {
        self.inner.snapshot().version()
    }

    /// Names of the maps, oldest first: each the number of its first key frame.
    #[getter]
    fn maps(&self) -> Vec<usize> {
        self.inner.maps().map(|m| m.root().index()).collect()
    }

    /// Number of key frames of all maps.
    #[getter]
    fn key_frame_count(&self) -> usize {
        self.inner.snapshot().key_frame_count()
    }

    /// Number of landmarks of all maps.
    #[getter]
    fn landmark_count(&self) -> usize {
        self.inner.snapshot().landmark_count()
    }

    /// The routes saved with the map, by name.
    #[getter]
    fn routes(&self) -> BTreeMap<String, Route> {
        self.routes.iter().map(|(name, route)| (name.clone(), Route { inner: route.clone() })).collect()
    }

    /// Whether lengths in a map are metres; False in an empty map.
    #[pyo3(signature = (map=None))]
    fn is_metric(&self, map: Option<usize>) -> PyResult<bool> {
        Ok(self.named(map)?.is_some_and(|m| self.inner.is_metric(m)))
    }

    /// The key frames of a map.
    ///
    /// Raises:
    ///     KeyError: When there is no map of that name.
    #[pyo3(signature = (map=None))]
    fn key_frames(&self, map: Option<usize>) -> PyResult<KeyFrames> {
        let mut out = KeyFrames::default();
        let Some(map) = self.named(map)? else { return Ok(out) };
        for (k, pose) in self.inner.key_frames(map) {
            out.ids.push(k.id.index() as i64);
            out.stamps_ns.push(k.stamp.0);
            out.poses.push(pose.se3);
        }
        Ok(out)
    }

    /// The landmarks of a map.
    ///
    /// Raises:
    ///     KeyError: When there is no map of that name.
    #[pyo3(signature = (map=None))]
    fn landmarks(&self, map: Option<usize>) -> PyResult<Landmarks> {
        let mut out = Landmarks::default();
        let Some(map) = self.named(map)? else { return Ok(out) };
        for l in self.inner.landmarks(map) {
            out.ids.push(l.id.index() as i64);
            out.positions.push(l.position);
            out.normals.push(l.normal);
            out.observations.push(l.observations.len() as i64);
            out.descriptors.push(l.descriptor);
        }
        Ok(out)
    }

    /// Positions of the landmarks of a map, (N, 3), in the map's frame.
    ///
    /// Raises:
    ///     KeyError: When there is no map of that name.
    #[pyo3(signature = (map=None))]
    fn points<'py>(&self, py: Python<'py>, map: Option<usize>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        match self.named(map)? {
            Some(map) => points(py, self.inner.landmarks(map).map(|l| l.position)),
            None => points(py, std::iter::empty()),
        }
    }

    /// Poses of the body at the key frames of a map, in order of time.
    ///
    /// Raises:
    ///     KeyError: When there is no map of that name.
    #[pyo3(signature = (map=None))]
    fn trajectory(&self, map: Option<usize>) -> PyResult<Trajectory> {
        let inner = self.named(map)?.map(|m| self.inner.trajectory(m)).unwrap_or_default();
        Ok(Trajectory { inner })
    }
}

/// The key frames of a map as arrays, in order of creation.
#[pyclass(frozen, module = "cairn", sequence)]
#[derive(Default)]
pub struct KeyFrames {
    ids: Vec<i64>,
    stamps_ns: Vec<i64>,
    poses: Vec<Se3>,
}

#[pymethods]
impl KeyFrames {
    fn __len__(&self) -> usize {
        self.ids.len()
    }

    fn __repr__(&self) -> String {
        format!("KeyFrames({})", self.ids.len())
    }

    /// Numbers in order of creation, never reused, (N,).
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.ids)
    }

    /// Times in nanoseconds, (N,).
    #[getter]
    fn stamps_ns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.stamps_ns)
    }

    /// Matrices `world_from_body`, (N, 4, 4).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        matrices(py, self.poses.iter())
    }

    /// Positions of the body, (N, 3).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points(py, self.poses.iter().map(|p| p.translation))
    }
}

/// The landmarks of a map as arrays, in order of creation.
#[pyclass(frozen, module = "cairn", sequence)]
#[derive(Default)]
pub struct Landmarks {
    ids: Vec<i64>,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    observations: Vec<i64>,
    descriptors: Vec<[u8; 32]>,
}

#[pymethods]
impl Landmarks {
    fn __len__(&self) -> usize {
        self.ids.len()
    }

    fn __repr__(&self) -> String {
        format!("Landmarks({})", self.ids.len())
    }

    /// Numbers in order of creation, never reused, (N,).
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.ids)
    }

    /// Positions in the map's frame, (N, 3).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points(py, self.positions.iter().copied())
    }

    /// Mean directions from the cameras that saw them, of length one, (N, 3).
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points(py, self.normals.iter().copied())
    }

    /// Number of key frames that observe each, (N,).
    #[getter]
    fn observations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.observations)
    }

    /// Descriptors of 256 bits, (N, 32) of uint8.
    #[getter]
    fn descriptors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        rows(py, self.descriptors.clone())
    }
}
