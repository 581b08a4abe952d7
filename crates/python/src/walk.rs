//! Recorded routes, and what the guide says.

use crate::arrays::{matrices, points};
use crate::errors::raise;
use cairn::guide::{Facing, GuideState, Route as GuideRoute, StopReason};
use cairn::session::{Event, earcon_name};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Adds the classes to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Said>()?;
    module.add_class::<Sound>()?;
    module.add_class::<Route>()
}

/// An utterance that starts now.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct Said {
    /// Time in seconds of the source's clock.
    stamp: f64,
    /// Time in nanoseconds of the source's clock.
    stamp_ns: i64,
    /// The text.
    text: String,
    /// 0 urgent, 1 high, 2 normal, 3 low.
    priority: u8,
    /// Whether the present utterance must be broken off.
    interrupts: bool,
    /// Estimated duration in seconds.
    duration_s: f64,
    /// The turn that is asked for, radians, positive to the left; or None.
    turn_rad: Option<f64>,
}

#[pymethods]
impl Said {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str) {
        ("stamp", "text")
    }

    fn __repr__(&self) -> String {
        format!("Said({:.3} s, {:?})", self.stamp, self.text)
    }
}

/// A short sound that starts now.
#[pyclass(frozen, get_all, module = "cairn")]
pub struct Sound {
    /// Seconds since the first frame.
    t_s: f64,
    /// "on-course", "off-course", "turn", "turning", "waypoint", "arrival" or "stop".
    name: &'static str,
    /// The direction it should be heard from, radians, positive to the left.
    bearing_rad: f64,
}

#[pymethods]
impl Sound {
    #[classattr]
    fn __match_args__() -> (&'static str, &'static str) {
        ("t_s", "name")
    }

    fn __repr__(&self) -> String {
        format!("Sound({:.3} s, {:?})", self.t_s, self.name)
    }
}

/// What is due to be heard, as an object.
pub fn object(py: Python<'_>, event: Event) -> PyResult<Py<PyAny>> {
    Ok(match event {
        Event::Said(s) => {
            let said = Said {
                stamp: s.stamp.seconds(),
                stamp_ns: s.stamp.0,
                text: s.text,
                priority: s.priority,
                interrupts: s.interrupts,
                duration_s: s.duration_s,
                turn_rad: s.turn_rad,
            };
            Py::new(py, said)?.into_any()
        }
        Event::Sound(s) => {
            let sound = Sound { t_s: s.t_s, name: earcon_name(s.earcon), bearing_rad: s.bearing_rad };
            Py::new(py, sound)?.into_any()
        }
    })
}

/// How the camera is mounted relative to the walker, by name.
pub fn facing(name: &str) -> PyResult<Facing> {
    match name {
        "home" => Ok(Facing::Home),
        "back" => Ok(Facing::Back),
        "backwards" => Ok(Facing::Backwards),
        _ => Err(PyValueError::new_err(format!(
            "facing must be \"home\", \"back\" or \"backwards\", not {name:?}"
        ))),
    }
}

/// The guide's state as a word.
pub fn state_name(state: GuideState) -> &'static str {
    match state {
        GuideState::Waiting => "waiting",
        GuideState::Turning => "turning",
        GuideState::Moving => "moving",
        GuideState::Checking => "checking",
        GuideState::SteppingAside => "stepping-aside",
        GuideState::Arrived => "arrived",
        GuideState::Stopped(why) => match why {
            StopReason::TrackingLost => "stopped: tracking lost",
            StopReason::PoseStale => "stopped: pose too old",
            StopReason::PicturesLate => "stopped: pictures too late",
            StopReason::AgeUnknown => "stopped: age of pictures unknown",
            StopReason::Obstacle(_) => "stopped: obstacle",
            StopReason::Drop => "stopped: the ground drops",
            StopReason::UnknownGround => "stopped: unknown ground",
            StopReason::NoWayPast => "stopped: no way past",
            StopReason::ScaleUncertain => "stopped: scale uncertain",
            StopReason::CannotRelocalise => "stopped: cannot relocalise",
            StopReason::ToAndFro => "stopped: to and fro",
            StopReason::StageDied => "stopped: failure",
        },
    }
}

/// A recorded route, as it was recorded.
#[pyclass(frozen, module = "cairn", sequence)]
pub struct Route {
    pub inner: GuideRoute,
}

#[pymethods]
impl Route {
    /// Reads a recorded route.
    ///
    /// Raises:
    ///     RouteError: When it cannot be read.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self { inner: GuideRoute::load(&path).map_err(raise)? })
    }

    /// Number of points.
    fn __len__(&self) -> usize {
        self.inner.points.len()
    }

    fn __repr__(&self) -> String {
        let unit = if self.inner.header.metric { "metric" } else { "unknown scale" };
        format!("Route({} points, {unit})", self.inner.points.len())
    }

    /// Whether lengths are metres.
    #[getter]
    fn metric(&self) -> bool {
        self.inner.header.metric
    }

    /// Times of the points in nanoseconds, (N,).
    #[getter]
    fn stamps_ns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, self.inner.points.iter().map(|p| p.stamp.0).collect())
    }

    /// Poses of the camera as they were recorded, (N, 4, 4).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        matrices(py, self.inner.points.iter().map(|p| &p.odom_from_camera))
    }

    /// Positions of the camera as they were recorded, (N, 3).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points(py, self.inner.points.iter().map(|p| p.odom_from_camera.translation))
    }
}
