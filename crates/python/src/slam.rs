//! SLAM: frames in; poses, the map and its events out; routes recorded and followed; saved and loaded.

use crate::arrays::{Channels, depth, from_seconds, gray, stamp};
use crate::config::{Config, sensors};
use crate::errors::{FrameError, MapError, raise, warn};
use crate::events;
use crate::imu::ImuBatch;
use crate::interrupt::on_thread;
use crate::map::Map;
use crate::output::Output;
use crate::rig::Rig;
use crate::source::{Frame, Source};
use crate::trajectory::{Evaluation, Trajectory, pairs};
use crate::walk::{self, Route};
use cairn::sources::PacketValidator;
use cairn::{Builder, MapEvents, SensorMode};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Visual-inertial SLAM with one camera, two, or one with depth, with or without an IMU; and a recorder of routes and a
/// guide on it.
///
/// Args:
///     rig: The calibration.
///     sensor: "mono", "stereo" or "rgbd" without the IMU, "mono-imu", "stereo-imu" or "rgbd-imu" with it; where none is
///         given, all sensors of the rig.
///     config: A `Config`, or what makes one: nested dictionaries, or TOML.
///     rate_hz: Nominal frames a second.
///     threaded: Mapping and loop closing run on threads of their own, so that tracking never waits for them: for live
///         cameras. Without it all stages run one after the other, and two runs give the same bits.
///     map: A saved map to go on in: the pose is lost until a place is recognised.
///     localize_only: The map given is not changed.
///
/// Raises:
///     RigError: When the rig lacks a sensor.
///     ConfigError: For a number out of range.
///     MapError: When the map is empty, damaged, or of another camera and of no use to this one.
///
/// Its methods may be called from any thread; calls on one object wait for each other.
///
/// >>> source = cairn.open("sim:demo?sensor=rgbd&resolution=320x240&rate=10&duration=1&detail=0.3")
/// >>> slam = cairn.Slam(source.rig, "rgbd", rate_hz=source.rate_hz)
/// >>> for frame in source:
/// ...     output = slam.track(frame.image, depth=frame.depth, stamp_ns=frame.stamp_ns)
/// >>> output.state, output.world_from_body.shape
/// (Tracking(), (4, 4))
/// >>> slam.map.points().shape[0] > 100
/// True
#[pyclass(frozen, module = "cairn")]
pub struct Slam {
    rig: cairn::Rig,
    inner: Option<Arc<Mutex<Inner>>>,
    process: u32,
}

struct Inner {
    slam: cairn::Slam,
    events: MapEvents,
    packets: PacketValidator,
}

/// What a frame gave, the milliseconds that it took, and what is doubtful about the frames so far.
struct Tracked {
    output: cairn::Output,
    step_ms: f64,
    doubts: Vec<String>,
}

impl Inner {
    /// Processes a frame.
    fn step(&mut self, packet: &cairn::FramePacket) -> Result<Tracked, cairn::Error> {
        let start = Instant::now();
        let output = self.slam.track(packet)?;
        let step_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(Tracked { output, step_ms, doubts: self.packets.packet(packet) })
    }
}

/// Choices that both ways of building share.
struct Choices<'a, 'py> {
    sensor: Option<&'a str>,
    config: Option<&'a Bound<'py, PyAny>>,
    threaded: bool,
    map: Option<PathBuf>,
    localize_only: bool,
}

impl Slam {
    fn build(py: Python<'_>, rig: &cairn::Rig, builder: Builder, choices: Choices<'_, '_>) -> PyResult<Self> {
        let mut builder = builder;
        let mut used = rig.clone();
        if let Some(name) = choices.sensor {
            let (mode, imu) = sensors(name, rig)?;
            used.depth = used.depth.filter(|_| mode == SensorMode::Rgbd);
            used.imu = used.imu.filter(|_| imu);
            builder = builder.sensor(mode);
            builder = if imu { builder } else { builder.without_imu() };
        }
        if let Some(config) = choices.config {
            builder = match config.cast::<Config>() {
                Ok(config) => builder.config(&config.get().inner),
                Err(_) => {
                    let made = py.get_type::<Config>().call1((config,))?;
                    builder.config(&made.cast::<Config>()?.get().inner)
                }
            };
        }
        if choices.threaded {
            builder = builder.threaded();
        }
        if choices.localize_only && choices.map.is_none() {
            return Err(PyValueError::new_err("localize_only needs a map"));
        }
        let (map, localize_only) = (choices.map, choices.localize_only);
        // Reading the map and opening the vocabulary take a while.
        let inner = on_thread(py, move || {
            let file = map.map(cairn::Slam::load_map).transpose().map_err(raise)?;
            let builder = match file {
                Some(file) if localize_only => builder.localize_in(file),
                Some(file) => builder.map(file),
                None => builder,
            };
            let mut slam = builder.build().map_err(raise)?;
            let events = slam.events().map_err(raise)?;
            Ok(Inner { slam, events, packets: PacketValidator::new(&used) })
        })?;
        Ok(Self { rig: rig.clone(), inner: Some(Arc::new(Mutex::new(inner))), process: std::process::id() })
    }

    /// What is shared with a thread of its own.
    fn shared(&self) -> PyResult<&Arc<Mutex<Inner>>> {
        if std::process::id() != self.process {
            return Err(MapError::new_err("this Slam was made by another process: make one in this process"));
        }
        self.inner.as_ref().ok_or_else(stopped)
    }

    /// Runs a closure while the interpreter is released, so that other Python threads continue meanwhile.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Inner) -> T + Send) -> PyResult<T> {
        let inner = self.shared()?;
        // Locked while the interpreter is released: another thread that holds the lock may need it.
        py.detach(move || inner.lock().ok().map(|mut inner| work(&mut inner))).ok_or_else(stopped)
    }

    /// The same for work so long that Ctrl-C must end the waiting; the work itself continues to its end.
    fn with_patience<T: Send + 'static>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Inner) -> PyResult<T> + Send + 'static,
    ) -> PyResult<T> {
        let inner = self.shared()?.clone();
        on_thread(py, move || work(&mut *inner.lock().map_err(|_| stopped())?))
    }

    fn packet(
        &self,
        image: &Bound<'_, PyAny>,
        given: Given<'_, '_>,
        color: &str,
    ) -> PyResult<cairn::FramePacket> {
        let order = Channels::parse(color)?;
        let Some(first) = self.rig.cameras.first() else { return Err(stopped()) };
        let stamp = stamp(given.stamp, given.stamp_ns)?;
        let mut images = vec![Arc::new(gray(image, "image", &first.camera, order)?)];
        if let Some(right) = given.right {
            let Some(second) = self.rig.cameras.get(1) else {
                return Err(FrameError::new_err("right: the rig has one camera"));
            };
            images.push(Arc::new(gray(right, "right", &second.camera, order)?));
        }
        let depth = match (given.depth, &self.rig.depth) {
            (None, _) => None,
            (Some(_), None) => {
                let why = "depth: the rig has no depth sensor (cairn.Rig(camera, depth_scale=0.001))";
                return Err(FrameError::new_err(why));
            }
            (Some(image), Some(sensor)) => {
                let image = depth(image, &sensor.camera, sensor.metres_per_unit, given.depth_scale)?;
                Some(Arc::new(image))
            }
        };
        let imu = given.imu.map(ImuBatch::read).transpose()?.unwrap_or_default();
        Ok(cairn::FramePacket { stamp, images, depth, imu, decode_ms: 0.0 })
    }
}

/// The arguments of [`Slam::track`] besides the image.
struct Given<'a, 'py> {
    depth: Option<&'a Bound<'py, PyAny>>,
    right: Option<&'a Bound<'py, PyAny>>,
    imu: Option<&'a Bound<'py, PyAny>>,
    stamp: Option<f64>,
    stamp_ns: Option<i64>,
    depth_scale: Option<f64>,
}

fn stopped() -> PyErr {
    MapError::new_err("an earlier call was stopped by an error of the program")
}

impl Drop for Slam {
    /// Mapping threads are awaited while the interpreter is released.
    fn drop(&mut self) {
        let inner = self.inner.take();
        if std::process::id() != self.process {
            // Its threads belong to another process.
            std::mem::forget(inner);
            return;
        }
        Python::try_attach(|py| py.detach(move || drop(inner)));
    }
}

#[pymethods]
impl Slam {
    #[new]
    #[pyo3(signature = (rig, sensor=None, config=None, *, rate_hz=30.0, threaded=false, map=None, localize_only=false))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        rig: &Bound<'_, Rig>,
        sensor: Option<&str>,
        config: Option<&Bound<'_, PyAny>>,
        rate_hz: f64,
        threaded: bool,
        map: Option<PathBuf>,
        localize_only: bool,
    ) -> PyResult<Self> {
        let rig = &rig.get().inner;
        let builder = cairn::Slam::builder(rig).rate_hz(rate_hz);
        Self::build(py, rig, builder, Choices { sensor, config, threaded, map, localize_only })
    }

    /// With the rig and the frame rate of a source.
    ///
    /// Args and exceptions are those of `Slam`.
    #[staticmethod]
    #[pyo3(signature = (source, sensor=None, config=None, *, threaded=false, map=None, localize_only=false))]
    fn for_source(
        py: Python<'_>,
        source: &Bound<'_, Source>,
        sensor: Option<&str>,
        config: Option<&Bound<'_, PyAny>>,
        threaded: bool,
        map: Option<PathBuf>,
        localize_only: bool,
    ) -> PyResult<Self> {
        let source = source.get();
        let builder = cairn::Slam::builder(&source.rig).rate_hz(source.info.rate_hz);
        let choices = Choices { sensor, config, threaded, map, localize_only };
        Self::build(py, &source.rig, builder, choices)
    }

    /// Processes a frame. A lost pose is no exception: see `Output.state`.
    ///
    /// Args:
    ///     image: The first camera's image, (height, width) or (height, width, 3 or 4) of uint8; or a `Frame` of a source,
    ///         which has everything.
    ///     depth: (height, width), uint16 in the rig's unit, or floats in metres. 0, NaN and infinity are no measurement.
    ///     right: The second camera's image.
    ///     imu: The IMU readings since the frame before, up to the first at or after the image: an `ImuBatch`, or an array
    ///         (N, 7) of ax ay az gx gy gz t (m/s^2, rad/s, s).
    ///     stamp: Time of exposure in seconds, later than the frame before.
    ///     stamp_ns: The same in nanoseconds, instead of `stamp`: exact also for times since 1970.
    ///     depth_scale: Metres per unit of this depth image, where it is not the rig's unit (uint16) or metres (floats).
    ///     color: Order of the channels of colour images, "rgb" or "bgr".
    ///
    /// Arrays may have any stride and may be read-only; each is copied once, and none is kept.
    ///
    /// Raises:
    ///     FrameError: When the frame does not fit the rig or is not later than the one before, its uint16 depth is in
    ///         metres, or an IMU reading is not finite or out of order. The next frame can be processed, or this one again.
    ///     TypeError: For an array of another dtype.
    ///
    /// Warns:
    ///     DataWarning: Once, when the depth of the first second or the IMU of the first ten (or up to `finish`) is implausible:
    ///         no depth, gyroscope and accelerometer exchanged, degrees, g, clocks apart.
    #[pyo3(signature = (image, depth=None, right=None, imu=None, *, stamp=None, stamp_ns=None, depth_scale=None, color="rgb"))]
    #[allow(clippy::too_many_arguments)]
    fn track(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        depth: Option<&Bound<'_, PyAny>>,
        right: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        stamp: Option<f64>,
        stamp_ns: Option<i64>,
        depth_scale: Option<f64>,
        color: &str,
    ) -> PyResult<Output> {
        let given = Given { depth, right, imu, stamp, stamp_ns, depth_scale };
        let tracked = match image.cast::<Frame>() {
            Ok(frame) => {
                let alone = depth.is_none() && right.is_none() && imu.is_none();
                if !(alone && stamp.is_none() && stamp_ns.is_none()) {
                    return Err(PyTypeError::new_err(
                        "a Frame is given alone: it has its depth, right, imu and stamp",
                    ));
                }
                let packet = &frame.get().packet;
                self.with(py, |inner| inner.step(packet))
            }
            Err(_) => {
                let packet = self.packet(image, given, color)?;
                self.with(py, move |inner| inner.step(&packet))
            }
        };
        let tracked = tracked?.map_err(raise)?;
        warn(py, &tracked.doubts)?;
        Ok(Output::new(tracked.output, tracked.step_ms))
    }

    /// Waits for mapping and adjusts the whole map a last time. Call it after the last frame, before `trajectory` and
    /// `save`. After Ctrl-C the adjustment goes on to its end, and the next call waits for it.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        let doubts = self.with_patience(py, |inner| {
            inner.slam.finish();
            Ok(inner.packets.end())
        })?;
        warn(py, &doubts)
    }

    /// The latest map.
    #[getter]
    fn map(&self, py: Python<'_>) -> PyResult<Map> {
        Ok(Map::new(self.with(py, |inner| inner.slam.map())?))
    }

    /// What became of the maps since the last call, in order: `MapCreated`, `LoopClosed`, `MapsMerged`, `ScaleChanged`,
    /// `GravityAligned`.
    fn events(&self, py: Python<'_>) -> PyResult<events::Events> {
        let events: Vec<_> = self.with(py, |inner| (&mut inner.events).collect())?;
        let mut objects = Vec::with_capacity(events.len());
        for event in events {
            objects.extend(events::object(py, event)?);
        }
        Ok(events::Events::new(objects))
    }

    /// Poses `world_from_body` of all frames that were tracked, with all corrections of the map so far.
    fn trajectory(&self, py: Python<'_>) -> PyResult<Trajectory> {
        let inner = self.with(py, |inner| inner.slam.trajectory())?.map_err(raise)?;
        Ok(Trajectory { inner })
    }

    /// Poses `world_from_body` of all frames that were tracked, as they were estimated at the time.
    fn live_trajectory(&self, py: Python<'_>) -> PyResult<Trajectory> {
        let inner = self.with(py, |inner| inner.slam.live_trajectory())?.map_err(raise)?;
        Ok(Trajectory { inner })
    }

    /// Compares the trajectory with the truth: aligned without scale where lengths are metres, else with it.
    ///
    /// Raises:
    ///     TrajectoryError: When no times agree, or the poses do not determine an alignment.
    fn accuracy(&self, py: Python<'_>, truth: &Bound<'_, Trajectory>) -> PyResult<Evaluation> {
        let truth = pairs(truth.get());
        let inner = self.with(py, move |inner| inner.slam.accuracy(&truth))?.map_err(raise)?;
        Ok(Evaluation { inner })
    }

    /// Whether lengths are metres in the whole map.
    #[getter]
    fn is_metric(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |inner| inner.slam.is_metric())
    }

    /// The calibration.
    #[getter]
    fn rig(&self) -> Rig {
        Rig { inner: self.rig.clone() }
    }

    /// What the engine is doing and waiting for, in words.
    #[getter]
    fn words(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |inner| inner.slam.status().words())
    }

    /// Small differences between this camera and that of the map it was made with, one line each.
    #[getter]
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |inner| inner.slam.notes().to_vec())
    }

    /// A digest of the map and of every frame's pose: equal when all bits are.
    #[getter]
    fn digest(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |inner| inner.slam.engine().digest())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (frames, key_frames) = self.with(py, |inner| {
            let slam = &inner.slam;
            (slam.engine().log().frames().len(), slam.map().snapshot().key_frame_count())
        })?;
        Ok(format!("Slam({frames} frames, {key_frames} key frames)"))
    }

    /// Saves the map with the routes recorded in it; returns the size in bytes. A file of that name is replaced once the
    /// new one is complete.
    ///
    /// Raises:
    ///     MapError: When there is nothing to save, or the file cannot be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<u64> {
        self.with_patience(py, move |inner| inner.slam.save(path).map_err(raise))
    }

    /// Starts to record the route into a new file, point by point; returns the words for the walker.
    ///
    /// Raises:
    ///     RefusedError: While a recording is in progress.
    fn record(&self, py: Python<'_>, path: PathBuf) -> PyResult<String> {
        self.with(py, move |inner| inner.slam.record(path))?.map_err(raise)
    }

    /// Ends the recording; returns the route, which can be walked from now on.
    ///
    /// Raises:
    ///     RefusedError: When nothing was recorded, or the file does not hold all of it.
    fn stop_recording(&self, py: Python<'_>) -> PyResult<Route> {
        let inner = self.with(py, |inner| inner.slam.stop_recording().cloned())?.map_err(raise)?;
        Ok(Route { inner })
    }

    /// Loads a recorded route; returns the words for the walker. Guidance along it needs the map it was recorded in.
    ///
    /// Raises:
    ///     RouteError: When it cannot be read.
    ///     RefusedError: When it is empty.
    fn load_route(&self, py: Python<'_>, path: PathBuf) -> PyResult<String> {
        self.with(py, move |inner| inner.slam.load_route(path))?.map_err(raise)
    }

    /// The route recorded or loaded last, or None.
    #[getter]
    fn route(&self, py: Python<'_>) -> PyResult<Option<Route>> {
        Ok(self.with(py, |inner| inner.slam.route().cloned())?.map(|inner| Route { inner }))
    }

    /// Starts guidance along the route, back to where it began; returns the words for the walker.
    ///
    /// Args:
    ///     facing: "home" (the camera looks where the walker goes), "back" (it looks behind), "backwards" (the walker walks
    ///         backwards).
    ///
    /// Raises:
    ///     RefusedError: Without a route in this map, or when it cannot be walked like this.
    #[pyo3(signature = (facing="home"))]
    fn guide_home(&self, py: Python<'_>, facing: &str) -> PyResult<String> {
        let facing = walk::facing(facing)?;
        self.with(py, move |inner| inner.slam.guide_home(facing))?.map_err(raise)
    }

    /// Starts guidance along the route as it was recorded, from its start to its end; as `guide_home`.
    #[pyo3(signature = (facing="home"))]
    fn guide_again(&self, py: Python<'_>, facing: &str) -> PyResult<String> {
        let facing = walk::facing(facing)?;
        self.with(py, move |inner| inner.slam.guide_again(facing))?.map_err(raise)
    }

    /// Ends guidance; returns the words for the walker.
    ///
    /// Raises:
    ///     RefusedError: When there is none.
    fn halt(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |inner| inner.slam.halt())?.map_err(raise)
    }

    /// Time passes without a frame: the guide says stop when no picture arrives. Call it about twenty times a second while
    /// frames are late.
    ///
    /// Args:
    ///     now: Seconds in the clock of the frames.
    fn tick(&self, py: Python<'_>, now: f64) -> PyResult<()> {
        let now = from_seconds(now, "now")?;
        self.with(py, move |inner| inner.slam.tick(now))
    }

    /// The words (`Said`) and sounds (`Sound`) that are due since the last call, in order.
    fn heard(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        let heard = self.with(py, |inner| inner.slam.heard())?;
        heard.into_iter().map(|event| walk::object(py, event)).collect()
    }

    /// The guide's state: "waiting", "turning", "moving", "checking", "stepping-aside", "arrived", "stopped: REASON"; None
    /// without guidance.
    #[getter]
    fn guide_state(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        Ok(self.with(py, |inner| inner.slam.guide_state())?.map(walk::state_name))
    }

    /// Whether the last guidance ended at the end of its route.
    #[getter]
    fn has_arrived(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |inner| inner.slam.has_arrived())
    }
}
