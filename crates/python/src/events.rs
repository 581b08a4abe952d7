//! Events of the map: begun, loop closed, merged, rescaled, gravity-aligned; each with its similarity.

use crate::arrays::{point, similarity_matrix, xyzw};
use cairn::MapEvent;
use cairn::geometry::Sim3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use std::sync::Mutex;

/// Adds the classes to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Similarity>()?;
    module.add_class::<MapCreated>()?;
    module.add_class::<LoopClosed>()?;
    module.add_class::<MapsMerged>()?;
    module.add_class::<ScaleChanged>()?;
    module.add_class::<GravityAligned>()?;
    module.add_class::<Events>()
}

/// A similarity: `p_after = scale * R @ p_before + t`.
///
/// `numpy.asarray` gives its 4x4 matrix.
#[pyclass(frozen, module = "cairn")]
#[derive(Clone, Copy)]
pub struct Similarity {
    inner: Sim3,
}

#[pymethods]
impl Similarity {
    fn __repr__(&self) -> String {
        let (s, t) = (self.inner.scale, self.inner.translation);
        let degrees = self.inner.rotation.angle().to_degrees();
        format!(
            "Similarity(scale={s:.6}, {degrees:.3} degrees, translation=[{:.4}, {:.4}, {:.4}])",
            t.x, t.y, t.z
        )
    }

    /// Ratio of lengths, after to before.
    #[getter]
    fn scale(&self) -> f64 {
        self.inner.scale
    }

    /// Translation, (3,), in the unit after.
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        point(py, &self.inner.translation)
    }

    /// Rotation as x, y, z, w, (4,).
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &xyzw(&self.inner.rotation))
    }

    /// 4x4 matrix: `scale * R` and `t`.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        similarity_matrix(py, &self.inner)
    }

    #[pyo3(signature = (dtype=None, copy=None))]
    fn __array__<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<&Bound<'py, PyAny>>,
        copy: Option<bool>,
    ) -> PyResult<Bound<'py, PyAny>> {
        // It is a new array at each call, so there is nothing to copy.
        let _ = copy;
        let matrix = self.matrix(py)?.into_any();
        dtype.map_or(Ok(matrix.clone()), |dtype| matrix.call_method1("astype", (dtype,)))
    }
}

/// A map was created.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct MapCreated {
    /// Its name: the number of its first key frame.
    map: usize,
}

/// A loop was closed.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct LoopClosed {
    /// The map.
    map: usize,
    /// The key frame that shows a place again.
    key_frame: usize,
    /// The earlier key frame of that place.
    earlier: usize,
    /// How the surroundings of `key_frame` were corrected, in the map's frame.
    corrected_from_former: Similarity,
}

/// Two maps were merged; the younger's name is retired.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct MapsMerged {
    /// The younger.
    from_map: usize,
    /// The older.
    into_map: usize,
    /// From the younger map's frame to the older one's.
    into_from: Similarity,
}

/// The unit of length of a map is better known; it does not become metric by this.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct ScaleChanged {
    /// The map.
    map: usize,
    /// From the frame before to the frame after.
    corrected_from_former: Similarity,
}

/// Gravity and scale of a map are known, or known better: z points up, lengths are metres.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct GravityAligned {
    /// The map.
    map: usize,
    /// From the frame before to the frame after.
    aligned_from_former: Similarity,
}

#[pymethods]
impl MapCreated {
    #[classattr]
    fn __match_args__() -> (&'static str,) {
        ("map",)
    }

    fn __repr__(&self) -> String {
        format!("MapCreated(map={})", self.map)
    }
}

#[pymethods]
impl LoopClosed {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str, &'static str, &'static str) {
        ("map", "key_frame", "earlier", "corrected_from_former")
    }

    fn __repr__(&self) -> String {
        let Self { map, key_frame, earlier, corrected_from_former } = self;
        let by = corrected_from_former.__repr__();
        format!("LoopClosed(map={map}, key_frame={key_frame}, earlier={earlier}, corrected_from_former={by})")
    }
}

#[pymethods]
impl MapsMerged {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str, &'static str) {
        ("from_map", "into_map", "into_from")
    }

    fn __repr__(&self) -> String {
        let Self { from_map, into_map, into_from } = self;
        format!("MapsMerged(from_map={from_map}, into_map={into_map}, into_from={})", into_from.__repr__())
    }
}

#[pymethods]
impl ScaleChanged {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str) {
        ("map", "corrected_from_former")
    }

    fn __repr__(&self) -> String {
        let by = self.corrected_from_former.__repr__();
        format!("ScaleChanged(map={}, corrected_from_former={by})", self.map)
    }
}

#[pymethods]
impl GravityAligned {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str) {
        ("map", "aligned_from_former")
    }

    fn __repr__(&self) -> String {
        format!(
            "GravityAligned(map={}, aligned_from_former={})",
            self.map,
            self.aligned_from_former.__repr__()
        )
    }
}

/// An event as an object; None for kinds that are newer than this module.
pub fn object(py: Python<'_>, event: MapEvent) -> PyResult<Option<Py<PyAny>>> {
    let similarity = |inner: Sim3| Similarity { inner };
    Ok(Some(match event {
        MapEvent::Created { map } => Py::new(py, MapCreated { map: map.root().index() })?.into_any(),
        MapEvent::Loop { map, key_frame, earlier, corrected_from_former } => {
            let closed = LoopClosed {
                map: map.root().index(),
                key_frame: key_frame.index(),
                earlier: earlier.index(),
                corrected_from_former: similarity(corrected_from_former),
            };
            Py::new(py, closed)?.into_any()
        }
        MapEvent::Merge { from, into, into_from } => {
            let merged = MapsMerged {
                from_map: from.root().index(),
                into_map: into.root().index(),
                into_from: similarity(into_from),
            };
            Py::new(py, merged)?.into_any()
        }
        MapEvent::Rescale { map, corrected_from_former } => {
            let corrected_from_former = similarity(corrected_from_former);
            Py::new(py, ScaleChanged { map: map.root().index(), corrected_from_former })?.into_any()
        }
        MapEvent::GravityAligned { map, aligned_from_former } => {
            let aligned_from_former = similarity(aligned_from_former);
            Py::new(py, GravityAligned { map: map.root().index(), aligned_from_former })?.into_any()
        }
        _ => return Ok(None),
    }))
}

/// Events that have happened, as an iterator.
#[pyclass(frozen, module = "cairn")]
pub struct Events(Mutex<std::vec::IntoIter<Py<PyAny>>>);

impl Events {
    /// These, in order.
    pub fn new(objects: Vec<Py<PyAny>>) -> Self {
        Self(Mutex::new(objects.into_iter()))
    }
}

#[pymethods]
impl Events {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&self) -> Option<Py<PyAny>> {
        self.0.lock().ok()?.next()
    }
}
