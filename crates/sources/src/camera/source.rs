//! A camera of the kernel as a [`Source`]: its streams synchronised, depth aligned, the newest set first.

use super::address::{CameraAddress, Place};
use super::align::DepthAligner;
use super::clock::DeviceClock;
use super::device::{DeviceError, Kernel, Mode, MotionKind, Usb};
use super::format;
use super::reader::{self, DEPTH, Feed, Frame, IMAGE, Measured, MotionFeed, Shared, VideoFeed};
use super::select::{Role, Started, Streams, start, start_motion};
use crate::Cancel;
use crate::live::rig_for;
use crate::motion_pair::MotionPair;
use crate::options::OpenOptions;
use cairn_geometry::Vec3;
use cairn_sensor::{
    ClockReading, FramePacket, ImuSample, Live, Merge, MergeConfig, Merged, Rig, Source, SourceError,
    SourceInfo, Stamp,
};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How long every stream may take to deliver first.
const OPEN_TIMEOUT: Duration = Duration::from_secs(5);
/// How often waiting looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(50);
/// How long an image waits for its depth and for a motion reading after it, seconds.
const WAIT_S: f64 = 0.1;
/// Lines for people that are kept; a camera with a loose plug would add to them without end.
const MAX_LINES: usize = 1000;
/// What the line of counts begins with.
const COUNTS: &str = "frames lost: ";

/// A camera.
pub struct CameraSource {
    info: SourceInfo,
    rig: Rig,
    shared: Arc<Shared>,
    kernel: Arc<dyn Kernel>,
    threads: Vec<JoinHandle<()>>,
    merge: Merge<Frame, Frame>,
    aligner: Option<DepthAligner>,
    /// Clocks of gyroscope and accelerometer, each with the session that it is of.
    clocks: [(usize, DeviceClock); 2],
    motion: MotionPair,
    /// RealSense: see [`turned`].
    turned: bool,
    /// Samples of sets that were overtaken or could not be decoded.
    kept_imu: Vec<ImuSample>,
    /// Sets that newer ones overtook after they were complete.
    overtaken: usize,
    /// From the monotonic clock to the stamps, nanoseconds: those count from 1970.
    epoch_ns: i64,
    skipped: Vec<String>,
    left: Option<usize>,
    cancel: Cancel,
}

/// Readings of a RealSense in the axes of its extrinsics, x right, y down, z forward as its cameras': the chip (Bosch BMI055
/// in a D435i and a D455) is turned by half a turn about y, which the SDK undoes too (`_imu_2_depth_rot` of librealsense).
fn turned(v: &Vec3) -> Vec3 {
    Vec3::new(-v.x, v.y, -v.z)
}

impl CameraSource {
    /// Opens a camera of this kernel and waits until every stream has delivered.
    ///
    /// # Errors
    /// [`SourceError`] where there is no such camera, it is used by another program or not for this user, it has no fitting
    /// mode, a RealSense comes without a rig, or a stream delivers nothing within 5 s.
    pub fn open(
        kernel: Arc<dyn Kernel>,
        address: &CameraAddress,
        options: &OpenOptions,
    ) -> Result<Self, SourceError> {
        let shown = &address.shown;
        if options.start_s > 0.0 {
            let cure = "leave --start out: a live camera starts now";
            return Err(SourceError::new(shown, "a live camera has no start position", cure));
        }
        let mut rig = options.rig.clone();
        match (&address.place, &mut rig) {
            (Place::RealSense { .. }, None) => {
                let cure = "write its factory calibration to a file, rs-enumerate-devices -c > camera.txt, and give that: \
                            --rig camera.txt (docs/guides/realsense.md)";
                return Err(SourceError::new(shown, "the calibration of a RealSense is not known", cure));
            }
            // One node has neither depth nor motion.
            (Place::Node(_), Some(rig)) => (rig.depth, rig.imu) = (None, None),
            _ => {}
        }
        let streams = Streams::of(&address.place, rig.as_ref());
        let size =
            address.size.or_else(|| rig.as_ref()?.cameras.first().map(|c| [c.camera.width, c.camera.height]));
        let image =
            start(kernel.as_ref(), &address.place, streams.image, size, address.rate_hz, streams.dark)?;
        let (mode, usb) = (image.mode, image.usb.clone());
        let (mut rig, assumed) = match rig {
            Some(rig) if rig.cameras.len() > 1 => (fitting_pair(shown, &mode, rig)?, None),
            rig => rig_for(shown, [mode.width, mode.height], rig)?,
        };
        rig.validate().map_err(|e| {
            SourceError::new(shown, format!("its rig is wrong: {e}"), "correct the calibration")
        })?;
        let mut source = Self::new(kernel, address, options, &rig, mode, assumed);
        source.read_video(
            address,
            (streams.image, streams.dark),
            IMAGE,
            Some(size.unwrap_or([mode.width, mode.height])),
            image,
        )?;
        if streams.depth
            && let Some(sensor) = &rig.depth
        {
            let size = Some([sensor.camera.width, sensor.camera.height]);
            let depth =
                start(source.kernel.as_ref(), &address.place, Role::Depth, size, address.rate_hz, false)?;
            source.read_video(address, (Role::Depth, false), DEPTH, size, depth)?;
        }
        if let Some(rate_hz) = streams.motion
            && let Err(e) = source.read_motion(usb.as_ref(), rate_hz)
        {
            rig.imu = None;
            source.skipped.push(format!("the motion sensors are not used: {e}; {}", e.cure()));
        }
        source.settle(rig);
        source.await_first(shown)?;
        Ok(source)
    }

    fn new(
        kernel: Arc<dyn Kernel>,
        address: &CameraAddress,
        options: &OpenOptions,
        rig: &Rig,
        mode: Mode,
        assumed: Option<String>,
    ) -> Self {
        let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64);
        let info = SourceInfo {
            name: format!("{} ({mode})", address.shown),
            frames: options.frames,
            rate_hz: mode.rate_hz,
            truth: Vec::new(),
            assumed,
        };
        Self {
            info,
            rig: rig.clone(),
            shared: Arc::new(Shared::default()),
            epoch_ns: unix_ns.saturating_sub(kernel.now().0),
            kernel,
            threads: Vec::new(),
            merge: Merge::new(MergeConfig::default()),
            aligner: None,
            clocks: Default::default(),
            motion: MotionPair::default(),
            turned: matches!(address.place, Place::RealSense { .. }),
            kept_imu: Vec::new(),
            overtaken: 0,
            skipped: Vec::new(),
            left: options.frames,
            cancel: options.cancel.clone(),
        }
    }

    /// Takes the rig as it came out, and sets up the merge for it.
    fn settle(&mut self, mut rig: Rig) {
        if let (Some(sensor), Some(camera)) = (&rig.depth, rig.cameras.first())
            && !sensor.registered
        {
            let aligner = DepthAligner::new(sensor, camera);
            rig.depth = Some(aligner.sensor(camera));
            self.aligner = Some(aligner);
        }
        // Stamps are delivered in the images' clock, so no offset is left.
        let imu_offset_s = rig.imu.as_mut().map_or(0.0, |imu| std::mem::take(&mut imu.offset_s));
        self.merge = Merge::new(MergeConfig {
            cameras: 1,
            depth: rig.depth.is_some(),
            imu_period_s: rig.imu.as_ref().map(|imu| 1.0 / imu.rate_hz),
            imu_offset_s,
            // The sensors of a RealSense are not triggered together: the nearest depth image is half a period away at most.
            same_instant_s: 0.55 / self.info.rate_hz,
            wait_s: WAIT_S,
            ..Default::default()
        });
        self.rig = rig;
    }

    fn spawn(
        &mut self,
        name: &'static str,
        stream: usize,
        first: Box<dyn Feed>,
        open: impl Fn(usize) -> Result<Box<dyn Feed>, DeviceError> + Send + 'static,
    ) -> Result<(), SourceError> {
        let (kernel, shared) = (self.kernel.clone(), self.shared.clone());
        let work = move || reader::run(name, stream, first, open, &kernel, &shared);
        let thread = std::thread::Builder::new().name("cairn-camera".into()).spawn(work);
        self.threads.push(thread.map_err(|e| {
            SourceError::new(&self.info.name, format!("no thread to read it ({e})"), "close other programs")
        })?);
        Ok(())
    }

    fn read_video(
        &mut self,
        address: &CameraAddress,
        (role, dark): (Role, bool),
        stream: usize,
        size: Option<[usize; 2]>,
        first: Started,
    ) -> Result<(), SourceError> {
        let name = if stream == DEPTH { "The depth camera" } else { "The camera" };
        let (kernel, place, rate_hz) = (self.kernel.clone(), address.place.clone(), address.rate_hz);
        let shared = self.shared.clone();
        let tell = move |why: Option<DeviceError>| {
            let line = why.map(|e| {
                format!(
                    "the projector could not be switched off: {e}; if it is on, its dots are in the pictures"
                )
            });
            shared.change(|s| s.lines.extend(line));
        };
        tell(first.projector);
        let again = move |_| {
            let Started { node, mode, projector, .. } =
                start(kernel.as_ref(), &place, role, size, rate_hz, dark)?;
            tell(projector);
            Ok(Box::new(VideoFeed::new(node, mode)) as Box<dyn Feed>)
        };
        self.spawn(name, stream, Box::new(VideoFeed::new(first.node, first.mode)), again)
    }

    fn read_motion(&mut self, usb: Option<&Usb>, rate_hz: f64) -> Result<(), DeviceError> {
        let port = usb.map_or(String::new(), |u| u.port.clone());
        let mut opened = Vec::new();
        for kind in [MotionKind::Gyro, MotionKind::Accel] {
            opened.push((kind, start_motion(self.kernel.as_ref(), &port, kind, rate_hz)?.0));
        }
        for (kind, node) in opened {
            let (name, stream) = match kind {
                MotionKind::Gyro => ("The gyroscope", 2),
                MotionKind::Accel => ("The accelerometer", 3),
            };
            let (kernel, port) = (self.kernel.clone(), port.clone());
            let again = move |session| {
                let (node, _) = start_motion(kernel.as_ref(), &port, kind, rate_hz)?;
                Ok(Box::new(MotionFeed { kind, node, session }) as Box<dyn Feed>)
            };
            let first = Box::new(MotionFeed { kind, node, session: 0 });
            self.spawn(name, stream, first, again)
                .map_err(|e| DeviceError::new(super::Trouble::Other, e.what, e.why))?;
        }
        Ok(())
    }

    /// Waits until every stream has delivered.
    fn await_first(&mut self, shown: &str) -> Result<(), SourceError> {
        let needed = self.threads.len();
        let until = Instant::now() + OPEN_TIMEOUT;
        loop {
            let (heard, trouble) = {
                let s = self.shared.lock();
                (s.heard.iter().filter(|h| **h).count(), s.trouble.iter().flatten().next().cloned())
            };
            if heard >= needed {
                return Ok(());
            }
            if self.cancel.is_cancelled() {
                return Err(SourceError::new(shown, "waiting for it was interrupted", "start again"));
            }
            if Instant::now() >= until {
                let why = trouble.unwrap_or_else(|| "a stream sends nothing".into());
                let cure = "unplug it and plug it in again, at a USB 3 port; sudo dmesg tells what the kernel says of it";
                return Err(SourceError::new(shown, format!("sent nothing within 5 s: {why}"), cure));
            }
            self.shared.wait(LOOK, |_| false);
        }
    }

    /// Hands what the threads took to the merge.
    fn collect(&mut self) {
        let (frames, motion) =
            self.shared.change(|s| (std::mem::take(&mut s.frames), std::mem::take(&mut s.motion)));
        motion.into_iter().for_each(|m| self.measured(&m));
        while let Some(sample) = self.motion.pop() {
            // What is dropped is counted by the merge.
            let _ = self.merge.push_imu(sample);
        }
        let [images, depths] = frames;
        for image in images {
            let _ = self.merge.push_image(0, self.stamp(image.stamp.0), image);
        }
        for depth in depths {
            let _ = self.merge.push_depth(self.stamp(depth.stamp.0), depth);
        }
        self.merge.advance(self.stamp(self.kernel.now().0));
    }

    /// A time of the monotonic clock as the stamp of packets.
    fn stamp(&self, monotonic_ns: i64) -> Stamp {
        Stamp(monotonic_ns.saturating_add(self.epoch_ns))
    }

    fn measured(&mut self, m: &Measured) {
        let (session, clock) = &mut self.clocks[usize::from(m.kind == MotionKind::Accel)];
        if std::mem::replace(session, m.session) != m.session {
            clock.restart();
            self.motion.restart();
        }
        let host_ns = clock.host_ns(m.reading.device_ns, m.arrived.0);
        let at = self.stamp(host_ns);
        let value = if self.turned { turned(&m.reading.value) } else { m.reading.value };
        match m.kind {
            MotionKind::Gyro => self.motion.gyro(at, value),
            MotionKind::Accel => self.motion.accel(at, value),
        }
    }

    /// The newest complete set; the samples of those that it overtook are kept.
    fn newest(&mut self) -> Option<Merged<Frame, Frame>> {
        let mut newest: Option<Merged<Frame, Frame>> = None;
        while let Some(mut set) = self.merge.pop() {
            // Samples made up for the sets before: the real ones follow.
            self.kept_imu.retain(|s| !s.is_synthesised());
            self.kept_imu.append(&mut set.imu);
            self.overtaken += usize::from(newest.replace(set).is_some());
        }
        newest
    }

    fn packet(&mut self, set: Merged<Frame, Frame>) -> Option<FramePacket> {
        let began = Instant::now();
        let [image] = <[Frame; 1]>::try_from(set.images).ok()?;
        let images = match format::images(&image.mode, &image.bytes) {
            Ok(images) => images,
            Err(why) => {
                self.tell(format!("a picture cannot be read: {why}"));
                return None;
            }
        };
        let depth = set.depth.and_then(|frame| match format::depth(&frame.mode, &frame.bytes) {
            Ok(depth) => match &self.aligner {
                Some(aligner) => aligner.align(&depth),
                None => Some(depth),
            },
            Err(why) => {
                self.tell(format!("a depth image cannot be read: {why}"));
                None
            }
        });
        let images = images.into_iter().take(self.rig.cameras.len()).map(Arc::new).collect();
        let imu = std::mem::take(&mut self.kept_imu);
        let decode_ms = began.elapsed().as_secs_f64() * 1e3;
        Some(FramePacket { stamp: set.stamp, images, depth: depth.map(Arc::new), imu, decode_ms })
    }

    /// A line for people, once while it stays the same.
    fn tell(&mut self, line: String) {
        if !self.skipped.contains(&line) && self.skipped.len() < MAX_LINES {
            self.skipped.push(line);
        }
    }

    /// Takes over the lines of the threads, and adds one with the counts, which stays last.
    fn note(&mut self) {
        let (lines, counts) = self.shared.change(|s| (std::mem::take(&mut s.lines), s.counts));
        if self.skipped.last().is_some_and(|l| l.starts_with(COUNTS)) {
            self.skipped.pop();
        }
        let room = MAX_LINES.saturating_sub(self.skipped.len());
        self.skipped.extend(lines.into_iter().take(room));
        let merged = *self.merge.counts();
        let overtaken = counts.overtaken + self.overtaken;
        let parts = [
            (overtaken, "overtaken by newer ones"),
            (counts.missed, "left out by the driver"),
            (counts.damaged, "incomplete"),
            (merged.depth_dropped, "depth images without an image at their time"),
            (counts.motion + merged.imu_dropped + self.motion.left_out(), "motion readings"),
        ];
        let told: Vec<String> =
            parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        if !told.is_empty() {
            self.skipped.push(format!("{COUNTS}{}", told.join(", ")));
        }
    }

    /// The offsets of gyroscope and accelerometer to this machine's clock, seconds: `t_host = t_device + offset`; `None` before
    /// they have delivered.
    pub fn motion_offsets_s(&self) -> [Option<f64>; 2] {
        [self.clocks[0].1.offset_s(), self.clocks[1].1.offset_s()]
    }
}

/// A pair of infrared cameras of the size of the rig.
fn fitting_pair(shown: &str, mode: &Mode, mut rig: Rig) -> Result<Rig, SourceError> {
    rig.cameras.truncate(2);
    match rig.cameras.iter().find(|c| [c.camera.width, c.camera.height] != [mode.width, mode.height]) {
        None => Ok(rig),
        Some(c) => {
            let why = format!(
                "has images of {}x{}, {} is for {}x{}",
                mode.width, mode.height, c.name, c.camera.width, c.camera.height
            );
            Err(SourceError::new(shown, why, "give a rig for that size"))
        }
    }
}

impl Source for CameraSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Waits for a set; while the camera is unplugged, until it is back. Once cancelled, the source is at its end.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let packet = loop {
            if self.left == Some(0) || self.cancel.is_cancelled() {
                break None;
            }
            self.collect();
            if let Some(set) = self.newest() {
                match self.packet(set) {
                    Some(packet) => break Some(packet),
                    None => continue,
                }
            }
            let shared = self.shared.clone();
            shared.wait(LOOK, |s| s.frames.iter().any(|f| !f.is_empty()) || !s.motion.is_empty());
        };
        self.note();
        self.left = self.left.map(|n| n - usize::from(packet.is_some()));
        Ok(packet)
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn live(&self) -> Option<Arc<dyn Live>> {
        let (kernel, shared) = (self.kernel.clone(), self.shared.clone());
        let bound_s = 1.0 / self.info.rate_hz;
        Some(Arc::new(CameraLive { kernel, shared, epoch_ns: self.epoch_ns, bound_s }))
    }
}

impl Drop for CameraSource {
    fn drop(&mut self) {
        self.shared.change(|s| s.closing = true);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// The camera as other threads see it.
struct CameraLive {
    kernel: Arc<dyn Kernel>,
    shared: Arc<Shared>,
    epoch_ns: i64,
    /// The kernel stamps a frame when it begins or ends to arrive; it was exposed at most a period before.
    bound_s: f64,
}

impl Live for CameraLive {
    fn clock(&self) -> Option<ClockReading> {
        let now = Stamp(self.kernel.now().0.saturating_add(self.epoch_ns));
        Some(ClockReading { now, bound_s: self.bound_s, delivery_s: 0.0 })
    }

    fn trouble(&self) -> Option<String> {
        self.shared.lock().trouble.iter().flatten().next().cloned()
    }
}
