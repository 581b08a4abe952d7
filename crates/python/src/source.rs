//! Recordings, video, live streams and simulated worlds, frame by frame.
//!
//! A source is read by a thread of its own, one frame for each that is asked for, so that Ctrl-C ends the waiting for a
//! camera that sends nothing, and so that dropping a source waits for nobody.

use crate::arrays::pixels;
use crate::errors::{Error, SourceError, raise};
use crate::imu::ImuBatch;
use crate::interrupt::{on_thread, wait};
use crate::rig::Rig;
use crate::trajectory::Trajectory;
use cairn::sensor::SourceInfo;
use cairn::sources::OpenOptions;
use cairn::{FramePacket, sensor};
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, channel};

/// A recording, a video, a live stream or a simulated world: an iterator of frames.
///
/// Made by `cairn.open`. Several threads may take frames from one source; each frame goes to one of them.
///
/// >>> source = cairn.open("sim:demo?sensor=rgbd&resolution=160x120&rate=10&duration=0.5&detail=0.2")
/// >>> source.rig
/// Rig(1 camera, depth)
/// >>> [frame.stamp_ns // 1_000_000 for frame in source][:3]
/// [1000, 1100, 1200]
#[pyclass(frozen, module = "cairn")]
pub struct Source {
    pub info: SourceInfo,
    pub rig: cairn::Rig,
    reader: Mutex<Reader>,
    process: u32,
}

/// The reading thread, seen from here.
struct Reader {
    ask: Sender<()>,
    answers: Receiver<Answer>,
    /// Asked for a frame that nobody has waited for to the end, after Ctrl-C.
    asked: bool,
    skipped: Vec<String>,
}

/// A frame, with the frames that were skipped until then.
struct Answer {
    frame: Result<Option<FramePacket>, sensor::SourceError>,
    skipped: Vec<String>,
}

/// Opens a recording, a video, a live stream or a simulated world; the kind is detected.
///
/// Args:
///     source: The folder of a recording (EuRoC, TUM-VI, TUM RGB-D, KITTI, 7-Scenes), a video file, "camera:0", "rtsp://...",
///         "rtmp://...", "rtmp-listen://...", or "sim:WORLD?key=value".
///     rig: A calibration to use instead of the source's own.
///     start_s: Seconds after the first image to start at.
///     frames: The largest number of frames to read.
///
/// Raises:
///     SourceError: When it does not exist, is of no known kind or cannot be read; the message has the remedy.
#[pyfunction]
#[pyo3(signature = (source, *, rig=None, start_s=0.0, frames=None))]
pub fn open(
    py: Python<'_>,
    source: PathBuf,
    rig: Option<&Bound<'_, Rig>>,
    start_s: f64,
    frames: Option<usize>,
) -> PyResult<Source> {
    let name = source.into_os_string().into_string();
    let name = name.map_err(|name| PyValueError::new_err(format!("{} is not UTF-8", name.display())))?;
    let options =
        OpenOptions { rig: rig.map(|r| r.get().inner.clone()), start_s, frames, ..OpenOptions::default() };
    on_thread(py, move || {
        let opened = cairn::sources::open(&name, options).map_err(raise)?;
        Source::reading(opened)
    })
}

impl Source {
    fn reading(mut source: Box<dyn cairn::Source>) -> PyResult<Self> {
        let (info, rig) = (source.info().clone(), source.rig().clone());
        let skipped = source.skipped().to_vec();
        let ((ask, asked), (to, answers)) = (channel(), channel());
        let work = move || {
            // Until the `Source` is dropped, or nobody wants the answer.
            while asked.recv().is_ok() {
                let frame = source.next_packet();
                let skipped = source.skipped().to_vec();
                if to.send(Answer { frame, skipped }).is_err() {
                    return;
                }
            }
        };
        let started = std::thread::Builder::new().name("cairn-source".into()).spawn(work);
        started.map_err(|e| Error::new_err(format!("no thread can be started: {e}")))?;
        let reader = Mutex::new(Reader { ask, answers, asked: false, skipped });
        Ok(Self { info, rig, reader, process: std::process::id() })
    }

    fn next(&self, py: Python<'_>) -> PyResult<Option<FramePacket>> {
        if std::process::id() != self.process {
            return Err(SourceError::new_err(
                "this source was opened by another process: open it in this one",
            ));
        }
        let stopped = || SourceError::new_err("reading was stopped by an error of the program");
        let mut reader = self.reader.lock_py_attached(py).map_err(|_| stopped())?;
        if !reader.asked {
            reader.ask.send(()).map_err(|_| stopped())?;
            reader.asked = true;
        }
        let answer = wait(py, &mut reader.answers)?;
        (reader.asked, reader.skipped) = (false, answer.skipped);
        answer.frame.map_err(raise)
    }
}

#[pymethods]
impl Source {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        Ok(self.next(py)?.map(|packet| Frame { packet }))
    }

    fn __repr__(&self) -> String {
        format!("Source({:?})", self.info.name)
    }

    /// Kind and location, for display.
    #[getter]
    fn name(&self) -> &str {
        &self.info.name
    }

    /// Number of frames, or None where it is not known.
    #[getter]
    fn frames(&self) -> Option<usize> {
        self.info.frames
    }

    /// Nominal frames a second.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.info.rate_hz
    }

    /// The calibration.
    #[getter]
    fn rig(&self) -> Rig {
        Rig { inner: self.rig.clone() }
    }

    /// Ground truth `world_from_body`, or None where the source has none.
    #[getter]
    fn truth(&self) -> PyResult<Option<Trajectory>> {
        if self.info.truth.is_empty() {
            return Ok(None);
        }
        Trajectory::of(self.info.truth.iter().copied()).map(Some)
    }

    /// Which part of the rig was assumed rather than read, or None.
    #[getter]
    fn assumed(&self) -> Option<&str> {
        self.info.assumed.as_deref()
    }

    /// The frames skipped so far and why, one line each.
    #[getter]
    fn skipped(&self, py: Python<'_>) -> Vec<String> {
        self.reader.lock_py_attached(py).map(|r| r.skipped.clone()).unwrap_or_default()
    }
}

/// The images of one instant and the IMU readings since the frame before.
///
/// `Slam.track` takes it as it is. Its arrays are copies: they may be written to and kept.
#[pyclass(frozen, module = "cairn")]
pub struct Frame {
    pub packet: FramePacket,
}

#[pymethods]
impl Frame {
    fn __repr__(&self) -> String {
        let p = &self.packet;
        let depth = if p.depth.is_some() { ", depth" } else { "" };
        format!("Frame({} s, {} images{depth}, {} IMU readings)", p.stamp, p.images.len(), p.imu.len())
    }

    /// Time of exposure in seconds of the source's clock; for times since 1970 use `stamp_ns`.
    #[getter]
    fn stamp(&self) -> f64 {
        self.packet.stamp.seconds()
    }

    /// Time of exposure in nanoseconds of the source's clock.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.packet.stamp.0
    }

    /// The images, one per camera of the rig, each (height, width) of uint8.
    #[getter]
    fn images<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<u8>>>> {
        self.packet.images.iter().map(|image| pixels(py, image)).collect()
    }

    /// The first camera's image, (height, width) of uint8.
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let first = self.packet.images.first();
        pixels(py, first.ok_or_else(|| SourceError::new_err("the frame has no image"))?)
    }

    /// The second camera's image, or None.
    #[getter]
    fn right<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<u8>>>> {
        self.packet.images.get(1).map(|image| pixels(py, image)).transpose()
    }

    /// The depth image, (height, width) of uint16 in units of `Rig.depth_scale` metres, or None.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<u16>>>> {
        self.packet.depth.as_ref().map(|image| pixels(py, image)).transpose()
    }

    /// The IMU readings since the frame before, up to the first at or after the image.
    #[getter]
    fn imu(&self) -> ImuBatch {
        ImuBatch { samples: self.packet.imu.clone() }
    }
}
