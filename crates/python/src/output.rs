//! The result of a frame: its pose, its state with the numbers, what is known of the scale.

use crate::arrays::{matrix, point, rows, xyzw};
use cairn::geometry::Se3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// Adds the classes to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Output>()?;
    module.add_class::<Starting>()?;
    module.add_class::<Tracking>()?;
    module.add_class::<Coasting>()?;
    module.add_class::<RotationOnly>()?;
    module.add_class::<Lost>()?;
    module.add_class::<Scale>()?;
    module.add_class::<Evidence>()
}

/// No map yet: `have` of the `need` points that the first map takes.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Starting {
    /// Points found so far.
    have: usize,
    /// Points needed.
    need: usize,
}

/// The pose is known.
#[pyclass(frozen, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Tracking;

/// Too few matches; the IMU carries the pose.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Coasting {
    /// Seconds since the last pose from images.
    since_s: f64,
    /// Standard deviation of the position, metres.
    sigma: f64,
}

/// Only the orientation is tracked; the position is that of the last known pose.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct RotationOnly {
    /// Seconds since the last full pose.
    since_s: f64,
    /// Standard deviation of the position, in the map's unit.
    sigma: f64,
}

/// The pose is not known: `inliers` matches agreed where `need` are needed.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Lost {
    /// Matches that agreed.
    inliers: usize,
    /// Matches needed.
    need: usize,
}

/// A plain class of values: its names for `match`, and how it prints.
macro_rules! values {
    ($class:ident $(, $field:ident)*) => {
        #[pymethods]
        impl $class {
            #[classattr]
            fn __match_args__(py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
                PyTuple::new(py, [$(stringify!($field)),*] as [&str; [$(stringify!($field)),*].len()])
            }

            fn __repr__(&self) -> String {
                #[allow(unused_mut)]
                let mut fields: Vec<String> = Vec::new();
                $(fields.push(format!(concat!(stringify!($field), "={:?}"), self.$field));)*
                format!("{}({})", stringify!($class), fields.join(", "))
            }
        }
    };
}

values!(Starting, have, need);
values!(Coasting, since_s, sigma);
values!(RotationOnly, since_s, sigma);
values!(Lost, inliers, need);
values!(Scale, map, metric, sigma_log, supported);
values!(Evidence, features, expected, matched, inliers);

#[pymethods]
impl Tracking {
    #[classattr]
    fn __match_args__(py: Python<'_>) -> Bound<'_, PyTuple> {
        PyTuple::empty(py)
    }

    fn __repr__(&self) -> &'static str {
        "Tracking()"
    }
}

/// What is known of the unit of length of a pose.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Scale {
    /// The map whose unit it is.
    map: usize,
    /// Whether lengths are metres.
    metric: bool,
    /// Standard deviation of the logarithm of the map's scale against the first map: 0 for that one and for metric maps.
    sigma_log: f64,
    /// False while the unit of length rests on nothing.
    supported: bool,
}

/// The evidence for a pose.
#[pyclass(frozen, get_all, eq, module = "cairn")]
#[derive(PartialEq)]
pub struct Evidence {
    /// Features extracted.
    features: usize,
    /// Landmarks of the local map that should be in view.
    expected: usize,
    /// Matches before outliers were rejected.
    matched: usize,
    /// Matches that agree with the pose.
    inliers: usize,
}

/// The result of a frame.
///
/// A lost pose is no exception: `world_from_body` is None, and `state` has the numbers. An output that is kept keeps the
/// features of its frame, about 0.1 MB.
#[pyclass(frozen, module = "cairn")]
pub struct Output {
    inner: cairn::Output,
    pose: Option<Se3>,
    step_ms: f64,
}

impl Output {
    /// Around an output of the engine, which took `step_ms` milliseconds.
    pub fn new(inner: cairn::Output, step_ms: f64) -> Self {
        let pose = inner.world_from_body().map(|p| p.se3);
        Self { inner, pose, step_ms }
    }
}

#[pymethods]
impl Output {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let at = self
            .pose
            .map(|p| format!(", at {:.3} {:.3} {:.3}", p.translation.x, p.translation.y, p.translation.z));
        let state = self.state(py)?.bind(py).repr()?.to_string();
        Ok(format!("Output({} s, {state}{})", self.inner.stamp, at.unwrap_or_default()))
    }

    /// Time of the frame in seconds.
    #[getter]
    fn stamp(&self) -> f64 {
        self.inner.stamp.seconds()
    }

    /// Time of the frame in nanoseconds.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.inner.stamp.0
    }

    /// `Starting`, `Tracking`, `Coasting`, `RotationOnly` or `Lost`, with the numbers.
    #[getter]
    fn state(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        use cairn::State as S;
        Ok(match self.inner.state {
            S::Starting { have, need } => Py::new(py, Starting { have, need })?.into_any(),
            S::Tracking => Py::new(py, Tracking)?.into_any(),
            S::Coasting { since_s, sigma } => Py::new(py, Coasting { since_s, sigma })?.into_any(),
            S::RotationOnly { since_s, sigma } => Py::new(py, RotationOnly { since_s, sigma })?.into_any(),
            S::Lost { inliers, need } => Py::new(py, Lost { inliers, need })?.into_any(),
        })
    }

    /// The pose of the body as a 4x4 matrix of float64, or None.
    #[getter]
    fn world_from_body<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.pose.map(|p| matrix(py, &p)).transpose()
    }

    /// The position of the body, (3,), or None.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.pose.map(|p| point(py, &p.translation))
    }

    /// The orientation of the body as x, y, z, w, (4,), or None.
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.pose.map(|p| PyArray1::from_slice(py, &xyzw(&p.rotation)))
    }

    /// Covariance of the pose of the camera in its map, (6, 6), or None without a pose: of a small motion of the camera, along
    /// its axes x, y, z and about them (metres where lengths are metres, radians). The landmarks count as exact: what the map
    /// itself is off is not in it. Zero where the frame began the map.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        // Symmetric: by columns is by rows.
        self.inner.pose.and_then(|p| p.covariance).map(|c| rows(py, c.data.0.to_vec())).transpose()
    }

    /// Whether lengths are metres in the map of the pose.
    #[getter]
    fn metric(&self) -> bool {
        self.inner.is_metric()
    }

    /// What is known of the unit of length of the pose, or None without a pose.
    #[getter]
    fn scale(&self) -> Option<Scale> {
        let s = self.inner.pose?.scale;
        let map = s.map.root().index();
        Some(Scale { map, metric: s.metric, sigma_log: s.sigma_log, supported: s.supported })
    }

    /// The evidence for the pose.
    #[getter]
    fn evidence(&self) -> Evidence {
        let e = self.inner.evidence;
        Evidence { features: e.features, expected: e.expected, matched: e.matched, inliers: e.inliers }
    }

    /// Pixels of the features in the image as it came, (N, 2) of float32.
    #[getter]
    fn keypoints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.inner.frame.raw.clone())
    }

    /// Milliseconds of the whole step, from the copied image on; without threads it has the mapping in it.
    #[getter]
    fn step_ms(&self) -> f64 {
        self.step_ms
    }

    /// Milliseconds from the image to its features.
    #[getter]
    fn extract_ms(&self) -> f64 {
        self.inner.timings.extract_ms
    }

    /// Milliseconds from the features to the pose.
    #[getter]
    fn track_ms(&self) -> f64 {
        self.inner.timings.track_ms
    }

    /// Milliseconds of each key frame that mapping has finished since the frame before.
    #[getter]
    fn map_ms(&self) -> Vec<f64> {
        self.inner.timings.map_ms.clone()
    }

    /// Name of the phase, such as "TRACKING" or "WAIT_MOTION".
    #[getter]
    fn phase(&self) -> &'static str {
        self.inner.status.phase.name()
    }

    /// What the engine is doing and waiting for, in words.
    #[getter]
    fn words(&self) -> String {
        self.inner.status.words()
    }

    /// Why mapping failed, reported once, or None; tracking goes on with the map as it is.
    #[getter]
    fn stage_failed(&self) -> Option<&str> {
        self.inner.stage_failed()
    }
}
