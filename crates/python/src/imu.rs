//! Batches of IMU readings.

use crate::arrays::{from_seconds, integers, rows, table};
use cairn::geometry::Vec3;
use cairn::{ImuSample, Stamp};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Readings of one call; more are a mistake of units or shapes.
const LIMIT: usize = 1_000_000;

/// IMU readings in order of time, in the frame of the IMU.
///
/// Args:
///     accel: Specific force in m/s^2, (N, 3); about +9.8 along the upward axis at rest.
///     gyro: Angular rate in rad/s, (N, 3).
///     stamps: Times in seconds, (N,), increasing.
///     stamps_ns: The same in nanoseconds, instead of `stamps`: exact also for times since 1970.
///
/// Raises:
///     ValueError: For shapes that do not agree, numbers that are not finite, times that do not increase.
///
/// >>> import numpy as np
/// >>> batch = cairn.ImuBatch(accel=np.zeros((2, 3)), gyro=np.zeros((2, 3)), stamps=[0.0, 0.005])
/// >>> len(batch), batch.stamps_ns.tolist()
/// (2, [0, 5000000])
#[pyclass(frozen, module = "cairn", sequence)]
pub struct ImuBatch {
    pub samples: Vec<ImuSample>,
}

#[pymethods]
impl ImuBatch {
    #[new]
    #[pyo3(signature = (*, accel, gyro, stamps=None, stamps_ns=None))]
    fn new(
        accel: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        stamps: Option<&Bound<'_, PyAny>>,
        stamps_ns: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let accel = table(accel, "accel", 3, LIMIT)?;
        let gyro = table(gyro, "gyro", 3, LIMIT)?;
        let stamps: Vec<Stamp> = match (stamps, stamps_ns) {
            (Some(seconds), None) => {
                let seconds = table(seconds, "stamps", 1, LIMIT)?;
                seconds.into_iter().map(|s| from_seconds(s, "stamps")).collect::<PyResult<_>>()?
            }
            (None, Some(ns)) => integers(ns, "stamps_ns", LIMIT)?.into_iter().map(Stamp).collect(),
            _ => {
                return Err(PyTypeError::new_err(
                    "stamps (seconds) or stamps_ns (nanoseconds) is needed, not both",
                ));
            }
        };
        if accel.len() != gyro.len() || accel.len() != 3 * stamps.len() {
            return Err(PyValueError::new_err(format!(
                "accel has {} rows, gyro {}, and there are {} times",
                accel.len() / 3,
                gyro.len() / 3,
                stamps.len()
            )));
        }
        let three = |v: &[f64]| Vec3::new(v[0], v[1], v[2]);
        let readings = stamps.iter().zip(accel.chunks_exact(3).zip(gyro.chunks_exact(3)));
        Self::checked(readings.map(|(t, (a, g))| ImuSample::new(*t, three(g), three(a))).collect())
    }

    /// Number of readings.
    fn __len__(&self) -> usize {
        self.samples.len()
    }

    fn __repr__(&self) -> String {
        match (self.samples.first(), self.samples.last()) {
            (Some(first), Some(last)) => {
                format!("ImuBatch({} readings from {} to {} s)", self.samples.len(), first.stamp, last.stamp)
            }
            _ => "ImuBatch(no readings)".into(),
        }
    }

    /// Specific force in m/s^2, (N, 3).
    #[getter]
    fn accel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, self.samples.iter().map(|s| s.accel.into()).collect::<Vec<[f64; 3]>>())
    }

    /// Angular rate in rad/s, (N, 3).
    #[getter]
    fn gyro<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, self.samples.iter().map(|s| s.gyro.into()).collect::<Vec<[f64; 3]>>())
    }

    /// Times in seconds, (N,).
    #[getter]
    fn stamps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.samples.iter().map(|s| s.stamp.seconds()).collect())
    }

    /// Times in nanoseconds, (N,).
    #[getter]
    fn stamps_ns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, self.samples.iter().map(|s| s.stamp.0).collect())
    }

    /// All of it as (N, 7): ax ay az gx gy gz t, with t in seconds.
    #[getter]
    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let row = |s: &ImuSample| {
            let (a, g) = (s.accel, s.gyro);
            [a.x, a.y, a.z, g.x, g.y, g.z, s.stamp.seconds()]
        };
        rows(py, self.samples.iter().map(row).collect())
    }
}

impl ImuBatch {
    /// Readings whose numbers are finite and whose times increase.
    fn checked(samples: Vec<ImuSample>) -> PyResult<Self> {
        let finite = |s: &ImuSample| s.gyro.iter().chain(s.accel.iter()).all(|v| v.is_finite());
        if let Some(row) = samples.iter().position(|s| !finite(s)) {
            return Err(PyValueError::new_err(format!("imu: a number of reading {row} is not finite")));
        }
        if let Some(row) = samples.windows(2).position(|w| w[1].stamp <= w[0].stamp) {
            let (a, b) = (samples[row].stamp, samples[row + 1].stamp);
            return Err(PyValueError::new_err(format!(
                "imu: reading {} at {b} s is not later than the one before, at {a} s",
                row + 1
            )));
        }
        Ok(Self { samples })
    }

    /// What [`crate::slam::Slam::track`] takes as `imu`: a batch, or an array (N, 7) of ax ay az gx gy gz t.
    pub fn read(any: &Bound<'_, PyAny>) -> PyResult<Vec<ImuSample>> {
        if let Ok(batch) = any.cast::<Self>() {
            return Ok(batch.get().samples.clone());
        }
        let numbers = table(any, "imu", 7, LIMIT)?;
        let sample = |row: &[f64]| {
            let stamp = from_seconds(row[6], "imu, column t")?;
            let three = |v: &[f64]| Vec3::new(v[0], v[1], v[2]);
            Ok(ImuSample::new(stamp, three(&row[3..6]), three(&row[..3])))
        };
        let samples: PyResult<Vec<ImuSample>> = numbers.chunks_exact(7).map(sample).collect();
        Ok(Self::checked(samples?)?.samples)
    }
}
