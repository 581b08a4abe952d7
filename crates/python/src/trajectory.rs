//! Poses over time, and how far they are from the truth.

use crate::arrays::{integers, matrices, pose, rows, table, xyzw};
use crate::errors::{Error, raise};
use cairn::Stamp;
use cairn::eval::{load_trajectory, to_euroc, to_kitti, to_tum, write_whole};
use cairn::geometry::Se3;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::{PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Poses `world_from_body`, sorted by time.
///
/// Args:
///     poses: (N, 4, 4) matrices, or a sequence of 4x4 matrices.
///     stamps: Times in seconds, (N,).
///     stamps_ns: The same in nanoseconds, instead of `stamps`.
///
/// Raises:
///     ValueError: For shapes that do not agree and matrices that are no rigid transforms.
///
/// >>> import numpy as np
/// >>> path = cairn.Trajectory([np.eye(4), np.eye(4)], stamps=[0.0, 0.5])
/// >>> len(path), path.positions.shape, path.length_m
/// (2, (2, 3), 0.0)
#[pyclass(frozen, module = "cairn", sequence)]
pub struct Trajectory {
    pub inner: cairn::geometry::Trajectory,
}

/// Poses of a trajectory of years; more are a mistake.
const LIMIT: usize = 100_000_000;

impl Trajectory {
    /// Of poses by time.
    pub fn of(poses: impl Iterator<Item = (Stamp, Se3)>) -> PyResult<Self> {
        let inner = cairn::geometry::Trajectory::from_unsorted(poses.map(|(t, pose)| (t.0, pose)).collect());
        Ok(Self { inner: inner.map_err(raise)? })
    }
}

#[pymethods]
impl Trajectory {
    #[new]
    #[pyo3(signature = (poses, *, stamps=None, stamps_ns=None))]
    fn new(
        poses: Vec<Bound<'_, PyAny>>,
        stamps: Option<&Bound<'_, PyAny>>,
        stamps_ns: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let stamps: Vec<Stamp> = match (stamps, stamps_ns) {
            (Some(seconds), None) => {
                let seconds = table(seconds, "stamps", 1, LIMIT)?;
                let stamp = |s| crate::arrays::from_seconds(s, "stamps");
                seconds.into_iter().map(stamp).collect::<PyResult<_>>()?
            }
            (None, Some(ns)) => integers(ns, "stamps_ns", LIMIT)?.into_iter().map(Stamp).collect(),
            _ => {
                return Err(PyTypeError::new_err(
                    "stamps (seconds) or stamps_ns (nanoseconds) is needed, not both",
                ));
            }
        };
        if stamps.len() != poses.len() {
            let why = format!("there are {} poses and {} times", poses.len(), stamps.len());
            return Err(PyValueError::new_err(why));
        }
        let poses: PyResult<Vec<Se3>> =
            poses.iter().enumerate().map(|(i, m)| pose(m, &format!("poses[{i}]"))).collect();
        Self::of(stamps.into_iter().zip(poses?))
    }

    /// Reads a file in TUM, KITTI or EuRoC form.
    ///
    /// Raises:
    ///     cairn.Error: When it cannot be read; the message names the line.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let file = load_trajectory(&path).map_err(|e| Error::new_err(e.to_string()))?;
        Ok(Self { inner: file.trajectory })
    }

    /// Writes a file; one of that name is replaced.
    ///
    /// Args:
    ///     path: Where to.
    ///     format: "tum", "kitti" or "euroc".
    ///
    /// Raises:
    ///     OSError: When it cannot be written.
    #[pyo3(signature = (path, *, format="tum"))]
    fn save(&self, path: PathBuf, format: &str) -> PyResult<()> {
        let text = match format {
            "tum" => to_tum(&self.inner),
            "kitti" => to_kitti(&self.inner),
            "euroc" => to_euroc(&self.inner),
            _ => {
                let why = format!("format must be \"tum\", \"kitti\" or \"euroc\", not {format:?}");
                return Err(PyValueError::new_err(why));
            }
        };
        write_whole(&path, &text).map_err(|e| PyOSError::new_err(e.to_string()))
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    fn __repr__(&self) -> String {
        format!("Trajectory({} poses, {:.3} s)", self.inner.len(), self.inner.duration_s())
    }

    /// Times in seconds, (N,).
    #[getter]
    fn stamps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.stamps_ns().iter().map(|ns| Stamp(*ns).seconds()).collect())
    }

    /// Times in nanoseconds, (N,).
    #[getter]
    fn stamps_ns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, self.inner.stamps_ns())
    }

    /// Matrices `world_from_body`, (N, 4, 4).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        matrices(py, self.inner.poses().iter())
    }

    /// Positions of the body, (N, 3).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        crate::arrays::points(py, self.inner.poses().iter().map(|p| p.translation))
    }

    /// Orientations of the body as x, y, z, w, (N, 4).
    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, self.inner.poses().iter().map(|p| xyzw(&p.rotation)).collect())
    }

    /// Length of the path, in the unit of the poses.
    #[getter]
    fn length_m(&self) -> f64 {
        self.inner.length_m()
    }

    /// Seconds from the first pose to the last.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }
}

/// How far a trajectory is from the truth, after alignment.
#[pyclass(frozen, module = "cairn")]
pub struct Evaluation {
    pub inner: cairn::eval::Evaluation,
}

#[pymethods]
impl Evaluation {
    fn __repr__(&self) -> String {
        let e = &self.inner;
        format!(
            "Evaluation(ATE {:.4} m RMSE over {:.2} m, {:.3} of the reference covered)",
            e.ate_m.rmse, e.path_m, e.reference_covered
        )
    }

    /// Absolute trajectory error, root mean square, metres.
    #[getter]
    fn ate_rmse_m(&self) -> f64 {
        self.inner.ate_m.rmse
    }

    /// Absolute trajectory error, largest, metres.
    #[getter]
    fn ate_max_m(&self) -> f64 {
        self.inner.ate_m.max
    }

    /// Relative pose error from frame to frame, root mean square, metres; None without neighbouring pairs.
    #[getter]
    fn rpe_rmse_m(&self) -> Option<f64> {
        self.inner.rpe_m.as_ref().map(|s| s.rmse)
    }

    /// Share of the frames that have a pose, 0 to 1; None where the number of frames is not known.
    #[getter]
    fn coverage(&self) -> Option<f64> {
        self.inner.coverage
    }

    /// Share of the ground truth's poses that have a pose near them, 0 to 1.
    #[getter]
    fn reference_covered(&self) -> f64 {
        self.inner.reference_covered
    }

    /// Scale found by the alignment; 1 where lengths are metres.
    #[getter]
    fn scale(&self) -> f64 {
        self.inner.scale
    }

    /// Pairs of poses that were compared.
    #[getter]
    fn pairs(&self) -> usize {
        self.inner.pairs
    }

    /// Length of the true path over the pairs, metres.
    #[getter]
    fn path_m(&self) -> f64 {
        self.inner.path_m
    }

    /// Remarks, in sentences.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.inner.notes.clone()
    }

    /// 4x4 matrix of the alignment: `scale * R` and `t`, from the estimate's frame to the truth's.
    #[getter]
    fn reference_from_estimate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        crate::arrays::similarity_matrix(py, &self.inner.reference_from_estimate)
    }
}

/// The truth to compare with: a trajectory as pairs.
pub fn pairs(truth: &Trajectory) -> Vec<(Stamp, Se3)> {
    truth.inner.iter().map(|(ns, pose)| (Stamp(ns), *pose)).collect()
}
